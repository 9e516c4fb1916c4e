//! The dynamics that ship with the observer.

use crate::error::Error;
use crate::interval::{Interval, dot, points, weighted};
use crate::observer::dynamics::Dynamics;
use crate::rounding::inflation;

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

/// Euler's equations with a braking torque linear in the rate, forward Euler, parameters within
/// bounds: f(x) = dt((a1 x2 x3, a2 x3 x1, a3 x1 x2) + ΔN x), y = C x with |C - C_nominal| ≤
/// output_radius.
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
            let reach =
                row.iter().zip(x).map(|(&r, x)| Interval::point(r) * Interval::point(x.mag()));
            out[j] = reach.fold(Interval::ZERO, |sum, r| sum + r).hi;
        }
        Ok(())
    }
}

/// f(x) = offset + Δ(x; 1) with one parameter set a row: row i of Δ is in the rotated box {Σ_j β_j
/// s_ij q_ij : |β_j| ≤ 1}. The first n rows belong to the state, the others to the output.
/// Axis-parallel q are an interval matrix (Remark 2).
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
        let sum: f64 = row
            .chunks_exact(self.n + 1)
            .map(|g| (weighted(&g[..self.n], x) + Interval::point(g[self.n])).mag())
            .sum();
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
