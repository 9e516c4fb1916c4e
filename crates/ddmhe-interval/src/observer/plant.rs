//! The system as its observer sees it: linear parts and dynamics together, and what follows from
//! both.

use crate::error::Error;
use crate::interval::{Interval, points, weighted};
use crate::observer::dynamics::Dynamics;
use crate::observer::mean_value::MeanValue;
use crate::observer::system::System;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// x(k+1) = A x + B u + f(x) + D1 w, y = C x + r + D2 v (13).
pub(super) struct Plant<D> {
    dynamics: D,
    pub system: System,
    pub n: usize,
    pub p: usize,
    pub inputs: usize,
    pub disturbance: Vec<Interval>,  // D1 w (n)
    pub output_noise: Vec<Interval>, // D2 v (p)
}

/// One sample on its way: the box of x, B u, and what the output said about x.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(super) struct Transition {
    pub x: Vec<Interval>,
    pub input: Vec<Interval>,
    pub output: Vec<Interval>, // y - r - D2 v - δ, what C x is; all numbers where not measured
}

/// y (p; NaN = not measured) and what C x + r may be off from it by besides D2 v.
pub(super) struct Output<'a> {
    pub y: &'a [f64],
    pub error: Vec<f64>,
}

impl Output<'_> {
    /// Whether output j was measured.
    pub(super) fn has(&self, j: usize) -> bool {
        !self.y[j].is_nan()
    }

    /// Whether all were.
    pub(super) fn is_complete(&self) -> bool {
        self.y.iter().all(|y| !y.is_nan())
    }
}

impl<D: Dynamics> Plant<D> {
    /// Of a checked system in n states.
    pub(super) fn new(dynamics: D, system: System, n: usize) -> Self {
        let product = |D: &[f64], radius: &[f64], rows: usize| -> Vec<Interval> {
            let ball: Vec<Interval> = radius.iter().map(|&r| Interval { lo: -r, hi: r }).collect();
            let width = radius.len();
            (0..rows).map(|i| weighted(&D[i * width..(i + 1) * width], &ball)).collect()
        };
        let p = system.C.len() / n;
        Plant {
            n,
            p,
            inputs: system.B.len() / n,
            disturbance: product(&system.D1, &system.w_radius, n),
            output_noise: product(&system.D2, &system.v_radius, p),
            dynamics,
            system,
        }
    }

    /// y(k), and how well C and r are known over a box of x(k).
    pub(super) fn output<'a>(&self, y: &'a [f64], x: &[Interval]) -> Result<Output<'a>, Error> {
        let mut error = vec![0.0; self.p];
        self.dynamics.output_error(x, &mut error)?;
        Ok(Output { y, error })
    }

    /// The sample as the boxes see it, x the box so far.
    pub(super) fn transition(&self, x: &[Interval], output: &Output<'_>, u: &[f64]) -> Transition {
        let said = |j: usize| {
            if !output.has(j) {
                return Interval::ENTIRE;
            }
            let (r, noise) = (Interval::point(self.system.r[j]), self.output_noise[j]);
            let known = Interval::point(output.y[j]) - r - noise;
            known - Interval { lo: -output.error[j], hi: output.error[j] }
        };
        let (B, m, u) = (&self.system.B, self.inputs, points(u));
        Transition {
            x: x.to_vec(),
            input: (0..self.n).map(|i| weighted(&B[i * m..(i + 1) * m], &u)).collect(),
            output: (0..self.p).map(said).collect(),
        }
    }

    /// f at a point.
    pub(super) fn value(&self, x: &[f64]) -> Result<Vec<Interval>, Error> {
        let mut value = vec![Interval::ZERO; self.n];
        self.dynamics.value(x, &mut value)?;
        check_enclosure("f", &value)?;
        Ok(value)
    }

    /// \[Df\] over a box (n·n), within the global bounds (14).
    pub(super) fn jacobian(&self, x: &[Interval]) -> Result<Vec<Interval>, Error> {
        let mut J = vec![Interval::ZERO; self.n * self.n];
        self.dynamics.jacobian(x, &mut J)?;
        check_enclosure("jacobian", &J)?;
        for (k, entry) in J.iter_mut().enumerate() {
            let stated = Interval { lo: self.system.j_lo[k], hi: self.system.j_hi[k] };
            *entry = entry.intersect(stated).ok_or_else(|| {
                let expected = format!("values within [j_lo, j_hi] = {}", format_ends(stated));
                let place = format!("in row {}, column {}", k / self.n, k % self.n);
                Error::value("jacobian", expected, format!("{} {place}", format_ends(*entry)))
            })?;
            if !(entry.lo.is_finite() && entry.hi.is_finite()) {
                return Err(Error::value("jacobian", "finite bounds", format_ends(*entry)));
            }
        }
        Ok(J)
    }

    /// x(k) to x(k+1).
    pub(super) fn linearised(&self, at: &Transition) -> Result<MeanValue, Error> {
        let (n, A) = (self.n, &self.system.A);
        let c: Vec<f64> = at.x.iter().map(|x| x.mid()).collect();
        let mut slope = self.jacobian(&at.x)?;
        slope.iter_mut().zip(A).for_each(|(j, &a)| *j = *j + Interval::point(a));
        let mut offset = self.value(&c)?;
        let middle = points(&c);
        for (i, value) in offset.iter_mut().enumerate() {
            let linear = weighted(&A[i * n..(i + 1) * n], &middle);
            *value = *value + linear + at.input[i] + self.disturbance[i];
        }
        Ok(MeanValue { c, offset, slope })
    }
}

fn format_ends(x: Interval) -> String {
    format!("[{}, {}]", x.lo, x.hi)
}

fn check_enclosure(argument: &'static str, values: &[Interval]) -> Result<(), Error> {
    match values.iter().find(|v| !(v.lo <= v.hi)) {
        None => Ok(()),
        Some(v) => {
            let expected = "intervals with lower ends not above the upper";
            Err(Error::value(argument, expected, format_ends(*v)))
        }
    }
}
