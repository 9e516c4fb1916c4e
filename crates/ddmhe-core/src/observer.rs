//! Interval observer: a box that is guaranteed to hold the state of
//!
//! > x(k+1) = A x + B u + f(x) + D1 w,  y = C x + r + D2 v,  |w| ≤ w̄, |v| ≤ v̄, |x(0) - p₀| ≤ x̄₀  (13), (17)
//!
//! with Df(x) in \[J̲, J̄\] (14). Equation numbers are those of the interval paper (see [`zonotope`](crate::Zonotope)).
//!
//! # How
//! With x̂⁺ = A x̂ + B u + f(x̂) + L(y - r - C x̂) (19) the error obeys e⁺ = (Ã + J) e + D1 w - L D2 v, Ã = A - L C, J in the
//! interval Jacobian over the segment from x̂ to x. Three sets of e are carried **in parallel**; only outputs are intersected:
//!
//! * the zonotope ⟨0, M⟩: `Paper` has M⁺ = ↓q\[ÃM, T, D1 Mw, L D2 Mv\] with T = \[D^c, D^s\] the inclusion of \[J\]M (45)-(50);
//!   `Tight` treats Ã + \[J\] as one interval matrix, which keeps the columns of ÃM and J^c M together;
//! * the level V̄ of V = eᵀPe: V⁺ ≤ (1-λ)V + γ(‖w‖² + ‖v‖²) (41) gives the ball (44) and the ellipsoid's box
//!   |e_i| ≤ √(V̄ (P⁻¹)_ii), which is never looser than the ball of its V̄;
//! * `Tight` only: a box of x itself, contracted with the measurement, backward through the last transitions, and forward.
//!
//! # What "guaranteed" rests on
//! Everything above is computed with outward rounding: x̂ is a float, and what its own update rounds away joins the
//! zonotope as a box and V̄ as a distance. What f is not known exactly for ([`Dynamics::value`] returns intervals, [`Dynamics::output_error`]) enters
//! the same way, so uncertain parameters need nothing else.

use crate::config::check_vector;
use crate::error::Error;
use crate::history::check_finite;
use crate::interval::{Interval, dot, points, weighted};
use crate::zonotope::{Reduction, Zonotope, diagonal, inflation, reduce, row_sums, strip_range};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

/// The nonlinear part f of the system and its Jacobian. Implementations must enclose: the guarantee rests on them.
pub trait Dynamics {
    /// Encloses f(x) at a single point (n). Wider than rounding where f depends on parameters known within bounds.
    ///
    /// # Errors
    /// What the implementation cannot compute.
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error>;

    /// Encloses every entry of Df over a box (n), row-major (n·n).
    ///
    /// # Errors
    /// What the implementation cannot compute.
    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error>;

    /// Bound on |y - C x - r - D2 v| over a box (n), (p): zero unless C or r are known within bounds only.
    ///
    /// # Errors
    /// What the implementation cannot compute.
    fn output_error(&self, _x: &[Interval], out: &mut [f64]) -> Result<(), Error> {
        out.fill(0.0);
        Ok(())
    }
}

/// The linear parts of (13), the bounds (14) and (17). Matrices are row-major.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct System {
    /// (n·n)
    pub A: Vec<f64>,
    /// (n·inputs), empty without input.
    pub B: Vec<f64>,
    /// (p·n)
    pub C: Vec<f64>,
    /// Offset r of the output (p); empty is zero.
    pub r: Vec<f64>,
    /// (n·w_radius.len())
    pub D1: Vec<f64>,
    /// (p·v_radius.len())
    pub D2: Vec<f64>,
    /// J̲ and J̄ (n·n): global bounds on Df; infinite = none.
    pub j_lo: Vec<f64>,
    /// See `j_lo`.
    pub j_hi: Vec<f64>,
    /// w̄ ≥ 0
    pub w_radius: Vec<f64>,
    /// v̄ ≥ 0
    pub v_radius: Vec<f64>,
}

/// A verified design: L and what (41), (23) give.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gain {
    /// L (n·p)
    pub L: Vec<f64>,
    /// P (n·n), symmetric positive definite
    pub P: Vec<f64>,
    /// λ in (0, 1)
    pub lambda: f64,
    /// γ of (41); infinite if none is known: then there is neither ball nor ellipsoid, only zonotope and box.
    pub gamma: f64,
    /// μ_w of (23)
    pub mu_w: f64,
    /// μ_v of (23)
    pub mu_v: f64,
    /// Weights s of the states in the ball ‖diag(s) e‖₂ ≤ φ (n), positive; empty is ones, as in (23).
    pub weights: Vec<f64>,
}

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

/// Past transitions that a measurement is carried back through.
const BACK: usize = 4;

/// What one step leaves. Intervals (n).
#[derive(Debug, Clone, PartialEq, Default)]
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

/// One past transition: the box of x, B u, and what the output said about x.
#[derive(Debug, Clone)]
struct Past {
    x: Vec<Interval>,
    input: Vec<Interval>,
    output: Vec<Interval>, // y - r - D2 v - δ, what C x is; all numbers where not measured
}

/// A later state is in offset + slope (x - c) for every x of a box: the mean-value form, row by row.
#[derive(Debug, Clone)]
struct MeanValue {
    c: Vec<f64>,
    offset: Vec<Interval>, // A c + f(c) + B u + D1 w, for one step
    slope: Vec<Interval>,  // A + [Df] over the box
}

impl MeanValue {
    fn shifted(&self, x: &[Interval]) -> Vec<Interval> {
        x.iter().zip(&self.c).map(|(x, &c)| *x - Interval::point(c)).collect()
    }

    fn image(&self, x: &[Interval]) -> Vec<Interval> {
        let shifted = self.shifted(x);
        let rows = self.slope.chunks_exact(x.len()).zip(&self.offset);
        rows.map(|(row, &offset)| offset + dot(row, &shifted)).collect()
    }

    /// This map applied to what `first` leads to.
    fn after(&self, first: &MeanValue) -> MeanValue {
        let n = self.c.len();
        let mut slope = Vec::with_capacity(n * n);
        for row in self.slope.chunks_exact(n) {
            slope.extend((0..n).map(|j| (0..n).fold(Interval::ZERO, |s, l| s + row[l] * first.slope[l * n + j])));
        }
        MeanValue { c: first.c.clone(), offset: self.image(&first.offset), slope }
    }
}

/// A zonotope, an ellipsoid and a box around the state of a bounded-Jacobian system, one step at a time.
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
    start: (Vec<f64>, Vec<f64>),
    // the present
    step: usize,
    center: Vec<f64>,
    generators: Vec<f64>,
    level: f64, // V̄
    fade: f64,  // (1-λ)^k: what (44) as printed adds
    box_: Vec<Interval>,
    past: Vec<Past>,
    estimate: IntervalEstimate,
}

impl<D: Dynamics> IntervalObserver<D> {
    /// An observer that starts with |x(0) - x0_center| ≤ x0_radius.
    ///
    /// # Errors
    /// Shape, NaN, negative radii, J̲ above J̄, λ or γ out of range, P not positive definite, q below n.
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
        let mut system = system;
        if system.C.is_empty() || !system.C.len().is_multiple_of(n) {
            return Err(Error::shape("C", format!("rows of {n} numbers"), format!("{} numbers", system.C.len())));
        }
        let p = system.C.len() / n;
        if system.r.is_empty() {
            system.r = vec![0.0; p];
        }
        if !system.B.len().is_multiple_of(n) {
            return Err(Error::shape("B", format!("{n} rows"), format!("{} numbers", system.B.len())));
        }
        let (nw, nv) = (system.w_radius.len(), system.v_radius.len());
        check_vector("A", &system.A, n * n)?;
        check_finite("B", &system.B, 1)?;
        check_finite("C", &system.C, n)?;
        check_vector("r", &system.r, p)?;
        check_vector("D1", &system.D1, n * nw)?;
        check_vector("D2", &system.D2, p * nv)?;
        check_vector("gain", &gain.L, n * p)?;
        check_vector("P", &gain.P, n * n)?;
        check_vector("x0_center", x0_center, n)?;
        for (name, radius, length) in
            [("w_radius", &system.w_radius[..], nw), ("v_radius", &system.v_radius, nv), ("x0_radius", x0_radius, n)]
        {
            check_vector(name, radius, length)?;
            if let Some(r) = radius.iter().find(|r| **r < 0.0) {
                return Err(Error::value(name, "radii of at least 0", r));
            }
        }
        for (name, j) in [("j_lo", &system.j_lo), ("j_hi", &system.j_hi)] {
            if j.len() != n * n {
                return Err(Error::shape(name, format!("{} numbers", n * n), j.len()));
            }
        }
        if let Some(k) = (0..n * n).find(|&k| Interval::new(system.j_lo[k], system.j_hi[k]).is_none()) {
            let found = format!("{} and {} in row {}, column {}", system.j_lo[k], system.j_hi[k], k / n, k % n);
            return Err(Error::value("j_lo", "numbers not above those of j_hi", found));
        }
        if order < n {
            return Err(Error::value("order", format!("at least the number of states, {n}"), order));
        }
        if !(gain.lambda > 0.0 && gain.lambda < 1.0) {
            return Err(Error::value("lambda", "a number in (0, 1)", gain.lambda));
        }
        for (name, mu) in [("gamma", gain.gamma), ("mu_w", gain.mu_w), ("mu_v", gain.mu_v)] {
            if !(mu >= 0.0) {
                return Err(Error::value(name, "a number of at least 0", mu));
            }
        }
        let mut gain = gain;
        if gain.weights.is_empty() {
            gain.weights = vec![1.0; n];
        }
        check_vector("weights", &gain.weights, n)?;
        if let Some(s) = gain.weights.iter().find(|s| !(**s > 0.0)) {
            return Err(Error::value("weights", "positive numbers", s));
        }
        let P_inverse = inverse_diagonal(&gain.P, n)?;

        let C = points(&system.C);
        let mut error_map = points(&system.A);
        for i in 0..n {
            for j in 0..n {
                let column: Vec<Interval> = (0..p).map(|k| C[k * n + j]).collect();
                error_map[i * n + j] = error_map[i * n + j] - weighted(&gain.L[i * p..(i + 1) * p], &column);
            }
        }
        // MIN_POSITIVE: what products may lose where they fall below the normal numbers
        let (mut noise, mut noise_error) = (Vec::new(), vec![f64::MIN_POSITIVE; n]);
        for k in 0..nw + nv {
            for (i, error) in noise_error.iter_mut().enumerate() {
                let exact = if k < nw {
                    Interval::point(system.D1[i * nw + k]) * Interval::point(system.w_radius[k])
                } else {
                    let column: Vec<Interval> = (0..p).map(|j| Interval::point(system.D2[j * nv + k - nw])).collect();
                    weighted(&gain.L[i * p..(i + 1) * p], &column) * Interval::point(system.v_radius[k - nw])
                };
                noise.push(exact.mid());
                *error += exact.rad();
            }
        }
        let ball = |radius: &[f64]| -> Vec<Interval> { radius.iter().map(|&r| Interval { lo: -r, hi: r }).collect() };
        let product = |D: &[f64], radius: &[f64], rows: usize| -> Vec<Interval> {
            (0..rows).map(|i| weighted(&D[i * radius.len()..(i + 1) * radius.len()], &ball(radius))).collect()
        };
        let mut observer = IntervalObserver {
            error_map,
            noise,
            noise_w: nw,
            noise_error: noise_error.iter().map(|e| e * inflation(nw + nv)).collect(),
            disturbance: product(&system.D1, &system.w_radius, n),
            output_noise: product(&system.D2, &system.v_radius, p),
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
            level: 0.0,
            fade: 1.0,
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
        self.level = worst_level(&self.gain.P, &radius);
        self.fade = 1.0;
        self.box_ = center.iter().zip(&radius).map(|(&c, &r)| Interval::about(c, r)).collect();
        self.generators = diagonal(&radius);
        self.center = center;
        self.past.clear();
        self.estimate = IntervalEstimate { predicted: self.box_.clone(), ..IntervalEstimate::default() };
    }

    /// Consumes y(k) (p; NaN = not measured) and u(k): bounds of x(k) with it, and of x(k+1).
    ///
    /// # Errors
    /// Shape, infinite numbers, or [`Error::ModelViolation`] if y(k) contradicts the model and its bounds. After an error the
    /// observer is as before the call: the step can be made again, for instance with y(k) as not measured.
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
                    let known = Interval::point(y[j]) - Interval::point(self.system.r[j]) - self.output_noise[j];
                    known - Interval { lo: -output_error[j], hi: output_error[j] }
                }
            })
            .collect();
        let input =
            (0..self.n).map(|i| weighted(&self.system.B[i * self.inputs..(i + 1) * self.inputs], &points(u))).collect();
        // only `Tight` looks back
        let mut past = self.past.clone();
        past.push(Past { x: self.box_.clone(), input, output });
        self.contract(&mut past)?;
        let now = past.len() - 1;
        if self.method == Method::Tight {
            let axes = diagonal(&vec![1.0; self.n]);
            for (i, axis) in axes.chunks_exact(self.n).enumerate() {
                let known = Interval::point(self.center[i]) + self.along(axis, &past[now], i)?;
                let x = &mut past[now].x[i];
                *x = x.intersect(known).ok_or_else(|| self.violation(i, [*x, known].into_iter()))?;
            }
        }
        let filtered = past[now].x.clone();

        // Jacobian over the segment from x̂ to x (14): over the zonotope's hull, or over all that is known of x.
        let over = match self.method {
            Method::Paper => self.hull(&self.center, &self.generators),
            Method::Tight => filtered.clone(),
        };
        let segment: Vec<Interval> = over.iter().zip(&self.center).map(|(x, &c)| x.hull(Interval::point(c))).collect();
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
                    Interval::point(y[j]) - Interval::point(self.system.r[j]) - weighted(row, &estimate)
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
            let next = weighted(&self.system.A[i * self.n..(i + 1) * self.n], &estimate)
                + past[now].input[i]
                + value[i]
                + weighted(&self.gain.L[i * self.p..(i + 1) * self.p], &innovation);
            if self.method == Method::Tight {
                // x(k+1) about x̂ along row i of A + [J], with the zonotope's correlations
                let row = i * self.n..(i + 1) * self.n;
                let slope: Vec<Interval> = J[row.clone()]
                    .iter()
                    .zip(&self.system.A[row.clone()])
                    .map(|(j, &a)| *j + Interval::point(a))
                    .collect();
                let middle: Vec<f64> = slope.iter().map(|s| s.mid()).collect();
                let spread = slope
                    .iter()
                    .zip(&middle)
                    .zip(filtered.iter().zip(&self.center))
                    .fold(Interval::ZERO, |sum, ((s, &m), (x, &c))| {
                        sum + (*s - Interval::point(m)) * (*x - Interval::point(c))
                    });
                let free = weighted(&self.system.A[row], &estimate) + past[now].input[i] + value[i];
                let known = free + self.along(&middle, &past[now], i)? + spread + self.disturbance[i];
                ahead[i] = ahead[i].intersect(known).ok_or_else(|| self.violation(i, [ahead[i], known].into_iter()))?;
            }
            center[i] = next.mid();
            rest[i] = (rest[i] + next.rad()) * inflation(1);
            // what C and r are uncertain by enters through L
            for j in (0..self.p).filter(|&j| measured[j]) {
                rest[i] = (rest[i] + self.gain.L[i * self.p + j].abs() * output_error[j]) * inflation(1);
            }
        }
        let generators = self.propagate(&J, &rest, &measured);

        // (41), then a distance of `rest`; without all outputs (41) does not hold, but the zonotope does.
        let level = if self.gain.gamma.is_infinite() {
            f64::INFINITY
        } else if measured.iter().all(|m| *m) {
            let contracted = ((1.0 - self.gain.lambda) * self.level + self.gain.gamma * self.power()) * inflation(8);
            ((contracted.sqrt() + worst_level(&self.gain.P, &rest).sqrt()) * inflation(2)).powi(2) * inflation(2)
        } else {
            worst_level(&self.gain.P, &row_sums(self.n, &generators))
        };
        let fade = self.fade * (1.0 - self.gain.lambda) * inflation(1);
        let (ball, ellipsoid) = self.level_boxes(&center, level, fade);

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
        self.level = level;
        self.fade = fade;
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

    /// ‖w̄‖² + ‖v̄‖², upward.
    fn power(&self) -> f64 {
        let sum: f64 = self.system.w_radius.iter().chain(&self.system.v_radius).map(|r| r * r).sum();
        sum * inflation(self.system.w_radius.len() + self.system.v_radius.len())
    }

    /// Bounds of dᵀe over the zonotope cut by each output in turn.
    fn along(&self, d: &[f64], past: &Past, state: usize) -> Result<Interval, Error> {
        let estimate = points(&self.center);
        let mut known = Interval::ENTIRE;
        for (row, output) in self.system.C.chunks_exact(self.n).zip(&past.output) {
            let strip = *output - weighted(row, &estimate);
            let found = strip_range(&self.generators, d, row, strip);
            let sets = [known, found.unwrap_or(known)];
            known = found
                .and_then(|found| found.intersect(known))
                .ok_or_else(|| self.violation(state, sets.into_iter()))?;
        }
        Ok(known)
    }

    /// M⁺: (45)-(50), or with Ã + \[J\] as one interval matrix; reduced.
    fn propagate(&self, J: &[Interval], rest: &[f64], measured: &[bool]) -> Vec<f64> {
        let (n, M) = (self.n, &self.generators);
        let sums = row_sums(n, M);
        let all = measured.iter().all(|m| *m);
        let mut error_map = std::borrow::Cow::from(&self.error_map);
        if !all {
            let error_map = error_map.to_mut();
            // without output j, A - L C loses column j of L
            for i in 0..n {
                for l in 0..n {
                    let used = (0..self.p).filter(|&j| measured[j]).fold(Interval::ZERO, |sum, j| {
                        sum + Interval::point(self.gain.L[i * self.p + j]) * Interval::point(self.system.C[j * n + l])
                    });
                    error_map[i * n + l] = Interval::point(self.system.A[i * n + l]) - used;
                }
            }
        }
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
                let expected = format!("values within [j_lo, j_hi] = [{}, {}]", stated.lo, stated.hi);
                let found = format!("[{}, {}] in row {}, column {}", entry.lo, entry.hi, k / self.n, k % self.n);
                Error::value("jacobian", expected, found)
            })?;
            if !(entry.lo.is_finite() && entry.hi.is_finite()) {
                return Err(Error::value("jacobian", "finite bounds", format!("[{}, {}]", entry.lo, entry.hi)));
            }
        }
        Ok(J)
    }

    /// x̂ ± |M| 1.
    fn hull(&self, center: &[f64], generators: &[f64]) -> Vec<Interval> {
        center.iter().zip(row_sums(self.n, generators)).map(|(&c, r)| Interval::about(c, r)).collect()
    }

    /// The ball of (44) and the ellipsoid's box.
    fn level_boxes(&self, center: &[f64], level: f64, fade: f64) -> (Vec<Interval>, Vec<Interval>) {
        if level.is_infinite() {
            return (vec![Interval::ENTIRE; self.n], vec![Interval::ENTIRE; self.n]);
        }
        let g = &self.gain;
        let square = |r: &[f64]| r.iter().map(|r| r * r).sum::<f64>();
        let (w, v) = (square(&self.system.w_radius), square(&self.system.v_radius));
        let mu = g.mu_w + g.mu_v;
        // λV̄ + (μ_w - γ)w̄² + (μ_v - γ)v̄² from (23); the printed (44) lets the sum in V̄ run to infinity
        let tail = if self.method == Method::Paper { g.gamma * fade * (w + v) } else { 0.0 };
        let inner = g.lambda * level + (g.mu_w - g.gamma) * w + (g.mu_v - g.gamma) * v + tail;
        let slack = 8.0 * f64::EPSILON * (g.lambda * level + (g.mu_w + g.mu_v + g.gamma) * (w + v));
        let phi = (mu * (inner + slack).max(0.0)).sqrt() * inflation(8);
        let boxed =
            |radius: &dyn Fn(usize) -> f64| (0..self.n).map(|i| Interval::about(center[i], radius(i))).collect();
        (boxed(&|i| phi / g.weights[i] * inflation(1)), boxed(&|i| (level * self.P_inverse[i]).sqrt() * inflation(8)))
    }

    fn violation(&self, state: usize, sets: impl Iterator<Item = Interval>) -> Error {
        let all = sets.fold(Interval::ENTIRE, |all, s| Interval { lo: all.lo.max(s.lo), hi: all.hi.min(s.hi) });
        Error::ModelViolation { argument: "y", step: self.step, state, gap: all.lo - all.hi }
    }

    /// Contracts the boxes of the last transitions with their outputs, backward and forward; `Paper` only the last output.
    fn contract(&self, past: &mut [Past]) -> Result<(), Error> {
        let last = past.len() - 1;
        self.contract_output(&mut past[last])?;
        if self.method == Method::Paper {
            return Ok(());
        }
        // maps from x(k) to x(k+1) and, composed, to the newest state; what is composed keeps the correlations that
        // boxes in between would lose
        let mut maps: Vec<(MeanValue, MeanValue)> = Vec::with_capacity(last);
        for k in (0..last).rev() {
            let one = self.linearised(&past[k])?;
            let whole = maps.last().map_or_else(|| one.clone(), |(_, later)| later.after(&one));
            let (before, after) = past.split_at_mut(k + 1);
            self.backward(&one, &mut before[k].x, &after[0].x)?;
            if k + 1 < last {
                self.backward(&whole, &mut before[k].x, &after[after.len() - 1].x)?;
            }
            self.contract_output(&mut before[k])?;
            maps.push((one, whole));
        }
        for (k, (one, whole)) in maps.iter().rev().enumerate() {
            let (next, newest) = (one.image(&past[k].x), whole.image(&past[k].x));
            self.narrow(&mut past[k + 1].x, &next)?;
            self.narrow(&mut past[last].x, &newest)?;
            self.contract_output(&mut past[k + 1])?;
        }
        self.contract_output(&mut past[last])
    }

    /// x within what the outputs say about C x.
    fn contract_output(&self, past: &mut Past) -> Result<(), Error> {
        for j in 0..self.p {
            if past.output[j] == Interval::ENTIRE {
                continue;
            }
            let row = points(&self.system.C[j * self.n..(j + 1) * self.n]);
            let x = past.x.clone();
            self.contract_row(&row, past.output[j], &x, &mut past.x)?;
        }
        Ok(())
    }

    /// x within what its image under the map allows, row by row.
    fn backward(&self, map: &MeanValue, x: &mut [Interval], image: &[Interval]) -> Result<(), Error> {
        let shifted = map.shifted(x);
        let mut narrowed = shifted.clone();
        for (i, image) in image.iter().enumerate() {
            let sum = *image - map.offset[i];
            self.contract_row(&map.slope[i * self.n..(i + 1) * self.n], sum, &shifted, &mut narrowed)?;
        }
        let back: Vec<Interval> = narrowed.iter().zip(&map.c).map(|(x, &c)| *x + Interval::point(c)).collect();
        self.narrow(x, &back)
    }

    /// x within other, entry by entry.
    fn narrow(&self, x: &mut [Interval], other: &[Interval]) -> Result<(), Error> {
        for (i, (x, other)) in x.iter_mut().zip(other).enumerate() {
            *x = x.intersect(*other).ok_or_else(|| self.violation(i, [*x, *other].into_iter()))?;
        }
        Ok(())
    }

    /// x(k) to x(k+1).
    fn linearised(&self, past: &Past) -> Result<MeanValue, Error> {
        let c: Vec<f64> = past.x.iter().map(|x| x.mid()).collect();
        let mut slope = self.jacobian(&past.x)?;
        slope.iter_mut().zip(&self.system.A).for_each(|(j, &a)| *j = *j + Interval::point(a));
        let mut offset = vec![Interval::ZERO; self.n];
        self.dynamics.value(&c, &mut offset)?;
        for (i, value) in offset.iter_mut().enumerate() {
            *value = *value
                + weighted(&self.system.A[i * self.n..(i + 1) * self.n], &points(&c))
                + past.input[i]
                + self.disturbance[i];
        }
        Ok(MeanValue { c, offset, slope })
    }

    /// Narrows x to what row·x = sum leaves of it, entry by entry.
    fn contract_row(&self, row: &[Interval], sum: Interval, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        for (j, a) in row.iter().enumerate() {
            if a.contains(0.0) {
                continue;
            }
            let others = (0..row.len()).filter(|&l| l != j).fold(Interval::ZERO, |s, l| s + row[l] * x[l]);
            let back = (sum - others) / *a;
            out[j] = out[j].intersect(back).ok_or_else(|| self.violation(j, [out[j], back].into_iter()))?;
        }
        Ok(())
    }
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

/// max eᵀPe over |e| ≤ r, upward: over the vertices of the box up to n = 10, Σ|P_ij| r_i r_j beyond (a convex function has
/// its maximum at a vertex).
fn worst_level(P: &[f64], r: &[f64]) -> f64 {
    let n = r.len();
    let sum = |sign: &dyn Fn(usize) -> f64| -> f64 {
        (0..n).map(|i| (0..n).map(|j| P[i * n + j] * sign(i) * sign(j) * r[i] * r[j]).sum::<f64>()).sum()
    };
    let magnitude: f64 = (0..n).map(|i| (0..n).map(|j| P[i * n + j].abs() * r[i] * r[j]).sum::<f64>()).sum();
    let worst = match n {
        0..=10 => {
            (0..1_u32 << (n - 1)).map(|bits| sum(&|i| if bits >> i & 1 == 1 { -1.0 } else { 1.0 })).fold(0.0, f64::max)
        }
        _ => magnitude,
    };
    worst + magnitude * (n * n + 4) as f64 * f64::EPSILON
}

/// Upper bounds of the diagonal of P⁻¹.
fn inverse_diagonal(P: &[f64], n: usize) -> Result<Vec<f64>, Error> {
    let wrong = || Error::value("P", "a symmetric positive definite matrix", "one that is not");
    let largest = P.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let symmetric = (0..n).all(|i| (0..i).all(|j| (P[i * n + j] - P[j * n + i]).abs() <= 1e-9 * largest));
    let matrix = Mat::from_fn(n, n, |i, j| 0.5 * (P[i * n + j] + P[j * n + i]));
    let inverse = matrix.llt(Side::Lower).ok().filter(|_| symmetric).ok_or_else(wrong)?.inverse();
    // Z is an approximate inverse: P⁻¹ = Z + P⁻¹(I - P Z), so |P⁻¹_ii| ≤ Z_ii + δ‖P⁻¹‖ with δ = ‖I - P Z‖ < 1 and
    // ‖P⁻¹‖ ≤ ‖Z‖/(1 - δ), in the norm of row sums.
    let rows = |f: &dyn Fn(usize, usize) -> f64| {
        (0..n).map(|i| (0..n).map(|j| f(i, j).abs()).sum::<f64>()).fold(0.0, f64::max)
    };
    let product = |i: usize, j: usize| (0..n).map(|k| matrix[(i, k)] * inverse[(k, j)]).sum::<f64>();
    let scale = rows(&|i, j| (0..n).map(|k| (matrix[(i, k)] * inverse[(k, j)]).abs()).sum::<f64>());
    let delta = rows(&|i, j| product(i, j) - f64::from(u8::from(i == j))) + scale * (n as f64 + 2.0) * f64::EPSILON;
    if !(delta < 0.5) {
        return Err(Error::value("P", "a well conditioned matrix", "one that is singular to rounding"));
    }
    let norm = rows(&|i, j| inverse[(i, j)]) / (1.0 - delta);
    Ok((0..n).map(|i| (inverse[(i, i)] + delta * norm) * inflation(8)).collect())
}

/// f = (0, -dt·stiffness·sin x1): the pendulum (60) with A = \[\[1, dt\], \[0, 1\]\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pendulum {
    /// dt·stiffness, 0.065 in the paper
    pub gain: f64,
}

impl Dynamics for Pendulum {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        out[0] = Interval::ZERO;
        out[1] = -(self.gain * Interval::point(x[0]).sin());
        Ok(())
    }

    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        out.fill(Interval::ZERO);
        out[2] = -(self.gain * x[0].cos());
        Ok(())
    }
}

/// Euler's equations with a braking torque linear in the rate, forward Euler, parameters within bounds:
/// f(x) = dt((a1 x2 x3, a2 x3 x1, a3 x1 x2) + ΔN x), y = C x with |C - C_nominal| ≤ output_radius.
#[derive(Debug, Clone, PartialEq)]
pub struct Euler {
    /// dt·(J2-J3)/J1, dt·(J3-J1)/J2, dt·(J1-J2)/J3
    pub ratios: [Interval; 3],
    /// dt·ΔN (3·3), what the linear part may be off by from the nominal one, which is in A
    pub linear: [Interval; 9],
    /// Radius of C (p·3)
    pub output_radius: Vec<f64>,
}

impl Dynamics for Euler {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        let x = points(x);
        for (i, out) in out.iter_mut().enumerate() {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            *out = self.ratios[i] * (x[j] * x[k]) + dot(&self.linear[3 * i..3 * i + 3], &x);
        }
        Ok(())
    }

    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        out.copy_from_slice(&self.linear);
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            out[3 * i + j] = out[3 * i + j] + self.ratios[i] * x[k];
            out[3 * i + k] = out[3 * i + k] + self.ratios[i] * x[j];
        }
        Ok(())
    }

    fn output_error(&self, x: &[Interval], out: &mut [f64]) -> Result<(), Error> {
        for (j, row) in self.output_radius.chunks_exact(3).enumerate() {
            out[j] = row.iter().zip(x).map(|(r, x)| r * x.mag()).sum::<f64>() * inflation(3);
        }
        Ok(())
    }
}

/// f(x) = offset + Δ(x; 1) with one parameter set a row: row i of Δ is in the rotated box {Σ_j β_j s_ij q_ij : |β_j| ≤ 1}. The first
/// n rows belong to the state, the others to the output. Axis-parallel q are an interval matrix (Remark 2).
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertain {
    /// Number of states n.
    pub n: usize,
    /// Generators s_ij q_ij of each row, n+1 numbers each, one after another.
    pub rows: Vec<Vec<f64>>,
    /// Known constant (n).
    pub offset: Vec<f64>,
}

impl Uncertain {
    /// Bound on |Δ_i (x; 1)| over a box.
    fn radius(&self, row: &[f64], x: &[Interval]) -> f64 {
        let sum: f64 =
            row.chunks_exact(self.n + 1).map(|g| (weighted(&g[..self.n], x) + Interval::point(g[self.n])).mag()).sum();
        sum * inflation(row.len())
    }
}

impl Dynamics for Uncertain {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        let x = points(x);
        for ((out, row), &offset) in out.iter_mut().zip(&self.rows).zip(&self.offset) {
            *out = Interval::about(offset, self.radius(row, &x));
        }
        Ok(())
    }

    fn jacobian(&self, _x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        for (i, row) in self.rows.iter().take(self.n).enumerate() {
            for j in 0..self.n {
                let sum: f64 = row.chunks_exact(self.n + 1).map(|g| g[j].abs()).sum();
                let r = sum * inflation(row.len());
                out[i * self.n + j] = Interval { lo: -r, hi: r };
            }
        }
        Ok(())
    }

    fn output_error(&self, x: &[Interval], out: &mut [f64]) -> Result<(), Error> {
        for (out, row) in out.iter_mut().zip(&self.rows[self.n..]) {
            *out = self.radius(row, x);
        }
        Ok(())
    }
}

/// Any of them behind a pointer.
impl<D: Dynamics + ?Sized> Dynamics for Box<D> {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        (**self).value(x, out)
    }

    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        (**self).jacobian(x, out)
    }

    fn output_error(&self, x: &[Interval], out: &mut [f64]) -> Result<(), Error> {
        (**self).output_error(x, out)
    }
}

/// A system without a nonlinear part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Linear;

impl Dynamics for Linear {
    fn value(&self, _x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        out.fill(Interval::ZERO);
        Ok(())
    }

    fn jacobian(&self, _x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        out.fill(Interval::ZERO);
        Ok(())
    }
}
