//! The peak-to-peak bound: the level V̄ of V = eᵀPe, the ball (44) and the ellipsoid's box.

use super::{Dynamics, IntervalObserver, Method};
use crate::error::Error;
use crate::interval::Interval;
use crate::zonotope::{inflation, row_sums};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

impl<D: Dynamics> IntervalObserver<D> {
    /// V̄ of the next sample: (41), then a distance of `rest`. Without all outputs (41) does not hold, but the zonotope does.
    pub(super) fn next_level(&self, rest: &[f64], generators: &[f64], all: bool) -> f64 {
        if !self.level.is_finite() && all || self.gain.gamma.is_infinite() {
            return f64::INFINITY;
        }
        if !all {
            return worst_level(&self.gain.P, &row_sums(self.n, generators));
        }
        let contracted = ((1.0 - self.gain.lambda) * self.level + self.gain.gamma * self.power()) * inflation(8);
        ((contracted.sqrt() + worst_level(&self.gain.P, rest).sqrt()) * inflation(2)).powi(2) * inflation(2)
    }

    /// ‖w̄‖² + ‖v̄‖², upward.
    fn power(&self) -> f64 {
        let sum: f64 = self.system.w_radius.iter().chain(&self.system.v_radius).map(|r| r * r).sum();
        sum * inflation(self.system.w_radius.len() + self.system.v_radius.len())
    }

    /// The ball of (44) and the ellipsoid's box.
    pub(super) fn level_boxes(&self, center: &[f64], level: f64, fade: f64) -> (Vec<Interval>, Vec<Interval>) {
        if !level.is_finite() {
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
}

/// max eᵀPe over |e| ≤ r, upward: over the vertices of the box up to n = 10, Σ|P_ij| r_i r_j beyond (a convex function has
/// its maximum at a vertex).
pub(super) fn worst_level(P: &[f64], r: &[f64]) -> f64 {
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
pub(super) fn inverse_diagonal(P: &[f64], n: usize) -> Result<Vec<f64>, Error> {
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
