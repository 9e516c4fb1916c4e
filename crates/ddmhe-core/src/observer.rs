//! Interval observer: a box that is guaranteed to hold the state of
//!
//! > x(k+1) = A x + B u + f(x) + D1 w,  y = C x + r + D2 v,  |w| ≤ w̄, |v| ≤ v̄, |x(0) - p₀| ≤ x̄₀
//! > (13), (17)
//!
//! with Df(x) in \[J̲, J̄\] (14). Equation numbers are those of the interval paper (see
//! [`zonotope`](crate::Zonotope)).
//!
//! # How
//! With x̂⁺ = A x̂ + B u + f(x̂) + L(y - r - C x̂) (19) the error obeys e⁺ = (Ã + J) e + D1 w - L
//! D2 v, Ã = A - L C, J in the interval Jacobian over the segment from x̂ to x. Three sets of e are
//! carried **in parallel**; only outputs are intersected:
//!
//! * the zonotope ⟨0, M⟩: `Paper` has M⁺ = ↓q\[ÃM, T, D1 Mw, L D2 Mv\] with T = \[D^c, D^s\] the
//!   inclusion of \[J\]M (45)-(50); `Tight` treats Ã + \[J\] as one interval matrix, which keeps
//!   the columns of ÃM and J^c M together;
//! * the level V̄ of V = eᵀPe: V⁺ ≤ (1-λ)V + γ(‖w‖² + ‖v‖²) (41) gives the ball (44) and the
//!   ellipsoid's box
//!   |e_i| ≤ √(V̄ (P⁻¹)_ii), which is never looser than the ball of its V̄;
//! * `Tight` only: a box of x itself, contracted with the measurement, backward through the last
//!   transitions, and forward.
//!
//! # What "guaranteed" rests on
//! Everything above is computed with outward rounding: x̂ is a float, and what its own update
//! rounds away joins the zonotope as a box and V̄ as a distance. What f is not known exactly for
//! ([`Dynamics::value`] returns intervals, [`Dynamics::output_error`]) enters the same way, so
//! uncertain parameters need nothing else.

mod contractor;
mod dynamics;
mod level;
mod saved;
mod system;

pub use dynamics::{Dynamics, Euler, Linear, Pendulum, Uncertain};
pub use system::{Gain, System};

use crate::check::check_vector;
use crate::error::Error;
use crate::interval::{Interval, points, weighted};
use crate::rounding::{diagonal, inflation, row_sums};
use crate::zonotope::{Reduction, Zonotope, reduce};
use contractor::{BACK, Past};
use level::{Peak, inverse_diagonal};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use system::checked;

/// Which recursion. See the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// (45)-(50) and (59) as printed (with the sound V₀).
    Paper,
    /// One interval matrix, and a box contracted with the measurements.
    #[default]
    Tight,
}

/// What is carried along, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Number q ≥ n of generators kept.
    pub order: usize,
    /// Recursion.
    pub method: Method,
    /// Reduction of `Tight`; `Paper` has its own.
    pub reduction: Reduction,
}

impl Default for Options {
    fn default() -> Self {
        Options { order: 20, method: Method::default(), reduction: Reduction::default() }
    }
}

/// What one step leaves. Intervals (n).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct IntervalEstimate {
    /// Bounds of x(k+1), before y(k+1) is known.
    pub predicted: Vec<Interval>,
    /// Bounds of x(k) that use y(k).
    pub filtered: Vec<Interval>,
    /// The ball (44) around x̂(k+1), as a box.
    pub ball: Vec<Interval>,
    /// The box around the ellipsoid V ≤ V̄ around x̂(k+1).
    pub ellipsoid: Vec<Interval>,
    /// x̂(k+1) (n)
    pub center: Vec<f64>,
    /// The generators of e(k+1), one after another.
    pub generators: Vec<f64>,
}

impl IntervalEstimate {
    /// The zonotope of x(k+1).
    pub fn zonotope(&self) -> Zonotope {
        Zonotope::from_parts(self.center.clone(), self.generators.clone())
    }
}

/// A zonotope, an ellipsoid and a box around the state of a bounded-Jacobian system, one step at a
/// time.
pub struct IntervalObserver<D> {
    dynamics: D,
    system: System,
    gain: Gain,
    method: Method,
    reduction: Reduction,
    order: usize,
    n: usize,
    p: usize,
    inputs: usize,
    // constants of the system
    error_map: Vec<Interval>,    // Ã (n·n)
    noise: Vec<f64>,             // columns of [D1 Mw, L D2 Mv]
    noise_w: usize,              // of which the first are those of w
    noise_error: Vec<f64>,       // what their rounding lost (n)
    disturbance: Vec<Interval>,  // D1 w (n)
    output_noise: Vec<Interval>, // D2 v (p)
    P_inverse: Vec<f64>,         // upper bounds of the diagonal (n)
    peak: Peak,                  // P and the radii in the units of the level
    start: (Vec<f64>, Vec<f64>),
    // the present
    step: usize,
    center: Vec<f64>,
    generators: Vec<f64>,
    distance: f64, // √V̄
    decay: f64,    // (1-λ)^k: what (44) as printed adds
    box_: Vec<Interval>,
    past: Vec<Past>,
    estimate: IntervalEstimate,
}

impl<D: Dynamics> IntervalObserver<D> {
    /// An observer that starts with |x(0) - x0_center| ≤ x0_radius.
    ///
    /// # Errors
    /// Shape, NaN, negative radii, J̲ above J̄, λ or γ out of range, P not positive definite, q
    /// below n.
    pub fn new(
        dynamics: D,
        system: System,
        gain: Gain,
        x0_center: &[f64],
        x0_radius: &[f64],
        options: Options,
    ) -> Result<Self, Error> {
        let Options { order, method, reduction } = options;
        let n = x0_center.len();
        if n == 0 {
            return Err(Error::shape("x0_center", "at least one number", "none"));
        }
        let (system, gain) = checked(system, gain, x0_center, x0_radius)?;
        let (p, nw, nv) = (system.C.len() / n, system.w_radius.len(), system.v_radius.len());
        if order < n {
            return Err(Error::value(
                "order",
                format!("at least the number of states, {n}"),
                order,
            ));
        }
        let P_inverse = inverse_diagonal(&gain.P, n)?;

        let error_map = error_map(&system, &gain.L, &vec![true; p]);
        // MIN_POSITIVE: what products may lose where they fall below the normal numbers
        let (mut noise, mut noise_error) = (Vec::new(), vec![f64::MIN_POSITIVE; n]);
        for k in 0..nw + nv {
            for (i, error) in noise_error.iter_mut().enumerate() {
                let exact = if k < nw {
                    Interval::point(system.D1[i * nw + k]) * Interval::point(system.w_radius[k])
                } else {
                    let column: Vec<Interval> =
                        (0..p).map(|j| Interval::point(system.D2[j * nv + k - nw])).collect();
                    weighted(&gain.L[i * p..(i + 1) * p], &column)
                        * Interval::point(system.v_radius[k - nw])
                };
                noise.push(exact.mid());
                *error += exact.rad();
            }
        }
        let ball = |radius: &[f64]| -> Vec<Interval> {
            radius.iter().map(|&r| Interval { lo: -r, hi: r }).collect()
        };
        let product = |D: &[f64], radius: &[f64], rows: usize| -> Vec<Interval> {
            (0..rows)
                .map(|i| weighted(&D[i * radius.len()..(i + 1) * radius.len()], &ball(radius)))
                .collect()
        };
        let mut observer = IntervalObserver {
            error_map,
            noise,
            noise_w: nw,
            noise_error: noise_error.iter().map(|e| e * inflation(nw + nv)).collect(),
            disturbance: product(&system.D1, &system.w_radius, n),
            output_noise: product(&system.D2, &system.v_radius, p),
            peak: Peak::new(&gain.P, &system.w_radius, &system.v_radius, n),
            P_inverse,
            start: (x0_center.to_vec(), x0_radius.to_vec()),
            inputs: system.B.len() / n,
            dynamics,
            system,
            gain,
            method,
            reduction,
            order,
            n,
            p,
            step: 0,
            center: Vec::new(),
            generators: Vec::new(),
            distance: 0.0,
            decay: 1.0,
            box_: Vec::new(),
            past: Vec::new(),
            estimate: IntervalEstimate::default(),
        };
        observer.reset();
        Ok(observer)
    }

    /// Number of states.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Number of outputs.
    pub fn p(&self) -> usize {
        self.p
    }

    /// Number of inputs u.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Samples consumed.
    pub fn steps(&self) -> usize {
        self.step
    }

    /// Back to the first sample.
    pub fn reset(&mut self) {
        let (center, radius) = (self.start.0.clone(), self.start.1.clone());
        self.step = 0;
        self.distance = self.peak.worst_distance(&radius);
        self.decay = 1.0;
        self.box_ = center.iter().zip(&radius).map(|(&c, &r)| Interval::about(c, r)).collect();
        self.generators = diagonal(&radius);
        self.center = center;
        self.past.clear();
        self.estimate =
            IntervalEstimate { predicted: self.box_.clone(), ..IntervalEstimate::default() };
    }

    /// Consumes y(k) (p; NaN = not measured) and u(k): bounds of x(k) with it, and of x(k+1).
    ///
    /// # Errors
    /// Shape, infinite numbers, or [`Error::ModelViolation`] if y(k) contradicts the model and its
    /// bounds. After an error the observer is as before the call: the step can be made again, for
    /// instance with y(k) as not measured.
    pub fn step(&mut self, y: &[f64], u: &[f64]) -> Result<&IntervalEstimate, Error> {
        if y.len() != self.p {
            return Err(Error::shape("y", format!("{} numbers", self.p), y.len()));
        }
        if let Some(k) = y.iter().position(|v| v.is_infinite()) {
            return Err(Error::NotFinite { argument: "y", row: self.step, column: k, value: y[k] });
        }
        check_vector("u", u, self.inputs)?;

        let mut output_error = vec![0.0; self.p];
        self.dynamics.output_error(&self.box_, &mut output_error)?;
        let output = (0..self.p)
            .map(|j| match y[j].is_nan() {
                true => Interval::ENTIRE,
                false => {
                    let known = Interval::point(y[j])
                        - Interval::point(self.system.r[j])
                        - self.output_noise[j];
                    known - Interval { lo: -output_error[j], hi: output_error[j] }
                }
            })
            .collect();
        let input = (0..self.n)
            .map(|i| weighted(&self.system.B[i * self.inputs..(i + 1) * self.inputs], &points(u)))
            .collect();
        // only `Tight` looks back
        let mut past = self.past.clone();
        past.push(Past { x: self.box_.clone(), input, output });
        self.contract(&mut past)?;
        let now = past.len() - 1;
        let cut = (self.method == Method::Tight).then(|| self.cut(&past[now]));
        if let Some(cut) = &cut {
            self.cut_box(cut, &mut past[now])?;
        }
        let filtered = past[now].x.clone();

        // Jacobian over the segment from x̂ to x (14): over the zonotope's hull, or over all that
        // is known of x.
        let over = match self.method {
            Method::Paper => self.hull(&self.center, &self.generators),
            Method::Tight => filtered.clone(),
        };
        let segment: Vec<Interval> =
            over.iter().zip(&self.center).map(|(x, &c)| x.hull(Interval::point(c))).collect();
        let J = self.jacobian(&segment)?;

        // x̂(k+1), (19): a float, and what it rounded away.
        let mut value = vec![Interval::ZERO; self.n];
        self.dynamics.value(&self.center, &mut value)?;
        check_enclosure("f", &value)?;
        let estimate = points(&self.center);
        let measured: Vec<bool> = y.iter().map(|v| !v.is_nan()).collect();
        let innovation: Vec<Interval> = (0..self.p)
            .map(|j| match measured[j] {
                true => {
                    let row = &self.system.C[j * self.n..(j + 1) * self.n];
                    Interval::point(y[j])
                        - Interval::point(self.system.r[j])
                        - weighted(row, &estimate)
                }
                false => Interval::ZERO,
            })
            .collect();
        let mut ahead = match self.method {
            Method::Paper => Vec::new(),
            Method::Tight => self.linearised(&past[now])?.image(&past[now].x),
        };
        let (mut center, mut rest) = (vec![0.0; self.n], self.noise_error.clone());
        for i in 0..self.n {
            let free = weighted(&self.system.A[i * self.n..(i + 1) * self.n], &estimate)
                + past[now].input[i]
                + value[i];
            let next = free + weighted(&self.gain.L[i * self.p..(i + 1) * self.p], &innovation);
            if let Some(cut) = &cut {
                let known = free + self.along_row(i, &J, cut, &past[now])?;
                ahead[i] = ahead[i]
                    .intersect(known)
                    .ok_or_else(|| self.violation(i, [ahead[i], known].into_iter()))?;
            }
            center[i] = next.mid();
            rest[i] = (rest[i] + next.rad()) * inflation(1);
            // what C and r are uncertain by enters through L
            for j in (0..self.p).filter(|&j| measured[j]) {
                rest[i] =
                    (rest[i] + self.gain.L[i * self.p + j].abs() * output_error[j]) * inflation(1);
            }
        }
        let generators = self.propagate(&J, &rest, &measured);
        let all = measured.iter().all(|m| *m);

        let distance = self.next_distance(&rest, &generators, all);
        let decay = self.decay * (1.0 - self.gain.lambda) * inflation(1);
        let (ball, ellipsoid) = self.level_boxes(&center, distance, decay);

        let hull = self.hull(&center, &generators);
        let mut predicted = Vec::with_capacity(self.n);
        for i in 0..self.n {
            let inner = match ahead.get(i) {
                None => Some(ball[i]), // (59)
                Some(forward) => forward.intersect(ellipsoid[i]).and_then(|x| x.intersect(ball[i])),
            };
            let found = inner.and_then(|x| x.intersect(hull[i]));
            predicted.push(found.ok_or_else(|| {
                let all = [Some(hull[i]), Some(ball[i]), Some(ellipsoid[i]), ahead.get(i).copied()];
                self.violation(i, all.into_iter().flatten())
            })?);
        }

        match self.method {
            Method::Paper => past.clear(),
            Method::Tight if past.len() > BACK => drop(past.remove(0)),
            Method::Tight => {}
        }
        self.past = past;
        self.step += 1;
        self.distance = distance;
        self.decay = decay;
        self.box_.clone_from(&predicted);
        self.estimate.center.clone_from(&center);
        self.estimate.generators.clone_from(&generators);
        (self.center, self.generators) = (center, generators);
        (self.estimate.predicted, self.estimate.filtered) = (predicted, filtered);
        (self.estimate.ball, self.estimate.ellipsoid) = (ball, ellipsoid);
        Ok(&self.estimate)
    }

    /// The newest result; before the first step only `predicted` is filled: the bounds of x(0).
    pub fn estimate(&self) -> &IntervalEstimate {
        &self.estimate
    }

    /// M⁺: (45)-(50), or with Ã + \[J\] as one interval matrix; reduced.
    fn propagate(&self, J: &[Interval], rest: &[f64], measured: &[bool]) -> Vec<f64> {
        let (n, M) = (self.n, &self.generators);
        let sums = row_sums(n, M);
        let all = measured.iter().all(|m| *m);
        let error_map = match all {
            true => Cow::from(&self.error_map),
            false => Cow::from(error_map(&self.system, &self.gain.L, measured)),
        };
        let closed: Vec<Interval>;
        let parts: &[&[Interval]] = match self.method {
            Method::Paper => &[&error_map, J],
            Method::Tight => {
                closed = error_map.iter().zip(J).map(|(a, j)| *a + *j).collect();
                &[&closed]
            }
        };
        let mut columns = Vec::with_capacity(2 * M.len() + self.noise.len() + n * n);
        let mut D_s = rest.to_vec();
        for part in parts {
            let mid: Vec<f64> = part.iter().map(|a| a.mid()).collect();
            for g in M.chunks_exact(n) {
                for i in 0..n {
                    columns.push((0..n).map(|j| mid[i * n + j] * g[j]).sum());
                }
            }
            // the radius of the matrix times |M| 1, and the rounding of the products just made
            for (i, half) in D_s.iter_mut().enumerate() {
                let spread: f64 = (0..n)
                    .map(|j| {
                        let a = part[i * n + j];
                        (a.rad() + (n as f64 + 2.0) * f64::EPSILON * a.mid().abs()) * sums[j]
                    })
                    .sum();
                *half = (*half + spread) * inflation(n);
            }
        }
        columns.extend_from_slice(&self.noise[..self.noise_w * n]);
        if all {
            columns.extend_from_slice(&self.noise[self.noise_w * n..]);
        } else {
            // L D2 Mv with the rows of D2 that were measured, boxed
            for (i, half) in D_s.iter_mut().enumerate() {
                let sum: f64 = (0..self.p)
                    .filter(|&j| measured[j])
                    .map(|j| self.gain.L[i * self.p + j].abs() * self.output_noise[j].mag())
                    .sum();
                *half = (*half + sum * inflation(self.p)) * inflation(1);
            }
        }
        columns.extend(diagonal(&D_s));
        let method = if self.method == Method::Paper { Reduction::Paper } else { self.reduction };
        reduce(n, &mut columns, self.order, method);
        columns
    }

    /// \[Df\] over a box, within the global bounds.
    fn jacobian(&self, x: &[Interval]) -> Result<Vec<Interval>, Error> {
        let mut J = vec![Interval::ZERO; self.n * self.n];
        self.dynamics.jacobian(x, &mut J)?;
        check_enclosure("jacobian", &J)?;
        for (k, entry) in J.iter_mut().enumerate() {
            let stated = Interval { lo: self.system.j_lo[k], hi: self.system.j_hi[k] };
            *entry = entry.intersect(stated).ok_or_else(|| {
                let expected =
                    format!("values within [j_lo, j_hi] = [{}, {}]", stated.lo, stated.hi);
                let found = format!(
                    "[{}, {}] in row {}, column {}",
                    entry.lo,
                    entry.hi,
                    k / self.n,
                    k % self.n
                );
                Error::value("jacobian", expected, found)
            })?;
            if !(entry.lo.is_finite() && entry.hi.is_finite()) {
                return Err(Error::value(
                    "jacobian",
                    "finite bounds",
                    format!("[{}, {}]", entry.lo, entry.hi),
                ));
            }
        }
        Ok(J)
    }

    /// x̂ ± |M| 1.
    fn hull(&self, center: &[f64], generators: &[f64]) -> Vec<Interval> {
        center
            .iter()
            .zip(row_sums(self.n, generators))
            .map(|(&c, r)| Interval::about(c, r))
            .collect()
    }

    fn violation(&self, state: usize, sets: impl Iterator<Item = Interval>) -> Error {
        let all = sets.fold(Interval::ENTIRE, |all, s| Interval {
            lo: all.lo.max(s.lo),
            hi: all.hi.min(s.hi),
        });
        Error::ModelViolation { argument: "y", step: self.step, state, gap: all.lo - all.hi }
    }
}

/// Ã = A - L C (n·n), L without the columns of outputs that were not measured.
fn error_map(system: &System, L: &[f64], measured: &[bool]) -> Vec<Interval> {
    let p = measured.len();
    let n = system.C.len() / p;
    let entry = |(k, &a): (usize, &f64)| {
        let used = (0..p).filter(|&j| measured[j]).fold(Interval::ZERO, |sum, j| {
            sum + Interval::point(L[k / n * p + j]) * Interval::point(system.C[j * n + k % n])
        });
        Interval::point(a) - used
    };
    system.A.iter().enumerate().map(entry).collect()
}

fn check_enclosure(argument: &'static str, values: &[Interval]) -> Result<(), Error> {
    match values.iter().find(|v| !(v.lo <= v.hi)) {
        None => Ok(()),
        Some(v) => Err(Error::value(
            argument,
            "intervals with lower ends not above the upper",
            format!("[{}, {}]", v.lo, v.hi),
        )),
    }
}
