//! The peak-to-peak bound: the level V̄ of V = eᵀPe, the ball (44) and the ellipsoid's box.
//!
//! Carried is √V̄, the distance of e from 0 in the norm of P: squares of radii below 1e-154 or
//! above 1e154 are no floats.

use crate::error::Error;
use crate::interval::Interval;
use crate::observer::error_zonotope::Propagated;
use crate::observer::options::Method;
use crate::observer::system::{Gain, System};
use crate::rounding::{TINY, inflation};
use crate::tol;
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// V ≤ V̄ after k samples.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(super) struct LevelSet {
    pub distance: f64, // √V̄
    pub decay: f64,    // (1-λ)^k: what (44) as printed adds
}

/// What the recursion of the level has computed once.
pub(super) struct Level {
    peak: Peak,
    P_inverse: Vec<f64>, // upper bounds of the diagonal (n)
    gain: Gain,
    method: Method,
}

/// P and the radii in the units of the level.
struct Peak {
    root: Vec<f64>,  // √P_ii (n)
    ratio: Vec<f64>, // P_ij/√(P_ii P_jj) (n·n): ones on the diagonal
    w: f64,          // ‖w̄‖, upward
    v: f64,          // ‖v̄‖, upward
}

impl Peak {
    /// P (n·n) with a positive diagonal.
    fn new(P: &[f64], w_radius: &[f64], v_radius: &[f64], n: usize) -> Self {
        let root: Vec<f64> = (0..n).map(|i| P[i * n + i].sqrt()).collect();
        let ratio = (0..n * n).map(|k| P[k] / root[k / n] / root[k % n]).collect();
        Peak { root, ratio, w: norm(w_radius), v: norm(v_radius) }
    }

    /// max √(eᵀPe) over |e| ≤ r, upward: over the vertices of the box for few states, √(Σ|P_ij| r_i
    /// r_j) beyond (a convex function has its maximum at a vertex). In units of 1/√P_ii, and of the
    /// largest of them, no square leaves the floats.
    fn worst_distance(&self, r: &[f64]) -> f64 {
        let n = r.len();
        let mut reach: Vec<f64> = r.iter().zip(&self.root).map(|(r, root)| r * root).collect();
        let largest = unit(reach.iter().copied());
        if !reach.iter().all(|r| r.is_finite()) {
            return f64::INFINITY;
        }
        reach.iter_mut().for_each(|r| *r /= largest);
        let product = |i: usize, j: usize| self.ratio[i * n + j] * reach[i] * reach[j];
        let sum = |sign: &dyn Fn(usize) -> f64| -> f64 {
            (0..n).map(|i| (0..n).map(|j| product(i, j) * sign(i) * sign(j)).sum::<f64>()).sum()
        };
        let magnitude: f64 = (0..n).map(|i| (0..n).map(|j| product(i, j).abs()).sum::<f64>()).sum();
        let worst = match n {
            0..=tol::VERTICES => (0..1_u32 << (n - 1))
                .map(|bits| sum(&|i| if bits >> i & 1 == 1 { -1.0 } else { 1.0 }))
                .fold(0.0, f64::max),
            _ => magnitude,
        };
        let level = worst + magnitude * (n * n + 16) as f64 * f64::EPSILON;
        // TINY: what the reaches and the result may lose below the normal numbers
        largest * level.sqrt() * inflation(2) + 2.0 * n as f64 * TINY
    }
}

/// The largest of numbers of at least 0, or 1 if they are all 0: a unit in which they are at most
/// 1.
fn unit(numbers: impl Iterator<Item = f64>) -> f64 {
    let largest = numbers.fold(0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}

/// ‖x‖₂ of numbers of at least 0, upward; no number if one of them is not finite.
fn norm(x: &[f64]) -> f64 {
    let unit = unit(x.iter().copied());
    let sum: f64 = x.iter().map(|v| (v / unit) * (v / unit)).sum();
    if sum == 0.0 { 0.0 } else { unit * sum.sqrt() * inflation(x.len()) + TINY }
}

impl Level {
    /// Of a checked gain and system in n states.
    ///
    /// # Errors
    /// P is not symmetric positive definite, or singular to rounding.
    pub(super) fn new(
        gain: Gain,
        system: &System,
        n: usize,
        method: Method,
    ) -> Result<Self, Error> {
        let P_inverse = inverse_diagonal(&gain.P, n)?;
        let peak = Peak::new(&gain.P, &system.w_radius, &system.v_radius, n);
        Ok(Level { peak, P_inverse, gain, method })
    }

    /// The smallest level that holds |e| ≤ radius.
    pub(super) fn start(&self, radius: &[f64]) -> LevelSet {
        LevelSet { distance: self.peak.worst_distance(radius), decay: 1.0 }
    }

    /// One sample on: (41), then the distance of what else e⁺ has. Without all outputs
    /// (`complete`) (41) does not hold, but the zonotope does.
    pub(super) fn next(&self, at: LevelSet, to: &Propagated, complete: bool) -> LevelSet {
        let (g, peak) = (&self.gain, &self.peak);
        let decay = at.decay * (1.0 - g.lambda) * inflation(1);
        let distance = if !at.distance.is_finite() && complete || g.gamma.is_infinite() {
            f64::INFINITY
        } else if !complete {
            peak.worst_distance(&to.set.half_widths())
        } else {
            let parts = [
                (1.0 - g.lambda).sqrt() * at.distance,
                g.gamma.sqrt() * peak.w,
                g.gamma.sqrt() * peak.v,
            ];
            (norm(&parts) * inflation(8) + peak.worst_distance(&to.rest) + 4.0 * TINY)
                * inflation(2)
        };
        // what no float holds says nothing, and is a number that can be saved
        let distance = if distance.is_nan() { f64::INFINITY } else { distance };
        LevelSet { distance, decay }
    }

    /// The ball of (44) and the ellipsoid's box around x̂ (n).
    pub(super) fn boxes(&self, at: LevelSet, center: &[f64]) -> [Vec<Interval>; 2] {
        let LevelSet { distance, decay } = at;
        if !distance.is_finite() {
            return [vec![Interval::ENTIRE; center.len()], vec![Interval::ENTIRE; center.len()]];
        }
        let phi = self.radius_of_ball(distance, decay);
        let around = |radius: &dyn Fn(usize) -> f64| -> Vec<Interval> {
            let widened = |(i, &c)| Interval::about(c, radius(i) + 4.0 * TINY);
            center.iter().enumerate().map(widened).collect()
        };
        [
            around(&|i| phi / self.gain.weights[i] * inflation(1)),
            around(&|i| distance * self.P_inverse[i].sqrt() * inflation(8)),
        ]
    }

    /// φ of ‖S e‖ ≤ φ: λV̄ + (μ_w - γ)w̄² + (μ_v - γ)v̄² from (23). The printed (44) lets the sum
    /// in V̄ run to infinity.
    fn radius_of_ball(&self, distance: f64, decay: f64) -> f64 {
        let (g, peak) = (&self.gain, &self.peak);
        // all in the unit of the largest: what underflows there is below the slack
        let unit = unit([distance, peak.w, peak.v].into_iter());
        let square = |x: f64| (x / unit) * (x / unit);
        let (level, w, v) = (square(distance), square(peak.w), square(peak.v));
        let tail = if self.method == Method::Paper { g.gamma * decay * (w + v) } else { 0.0 };
        let inner = g.lambda * level + (g.mu_w - g.gamma) * w + (g.mu_v - g.gamma) * v + tail;
        let slack = 8.0 * f64::EPSILON * (g.lambda * level + (g.mu_w + g.mu_v + g.gamma) * (w + v))
            + f64::MIN_POSITIVE;
        unit * ((g.mu_w + g.mu_v).sqrt() * (inner + slack).max(0.0).sqrt() * inflation(8)) + TINY
    }
}

/// Upper bounds of the diagonal of P⁻¹.
fn inverse_diagonal(P: &[f64], n: usize) -> Result<Vec<f64>, Error> {
    let wrong = || Error::value("P", "a symmetric positive definite matrix", "one that is not");
    let largest = P.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let symmetric = (0..n)
        .all(|i| (0..i).all(|j| (P[i * n + j] - P[j * n + i]).abs() <= tol::SYMMETRIC * largest));
    let matrix = Mat::from_fn(n, n, |i, j| 0.5 * (P[i * n + j] + P[j * n + i]));
    let inverse = matrix.llt(Side::Lower).ok().filter(|_| symmetric).ok_or_else(wrong)?.inverse();
    // Z is an approximate inverse: P⁻¹ = Z + P⁻¹(I - P Z), so |P⁻¹_ii| ≤ Z_ii + δ‖P⁻¹‖ with δ = ‖I
    // - P Z‖ < 1 and ‖P⁻¹‖ ≤ ‖Z‖/(1 - δ), in the norm of row sums.
    let rows = |f: &dyn Fn(usize, usize) -> f64| {
        (0..n).map(|i| (0..n).map(|j| f(i, j).abs()).sum::<f64>()).fold(0.0, f64::max)
    };
    let product =
        |i: usize, j: usize| (0..n).map(|k| matrix[(i, k)] * inverse[(k, j)]).sum::<f64>();
    let scale = rows(&|i, j| (0..n).map(|k| (matrix[(i, k)] * inverse[(k, j)]).abs()).sum::<f64>());
    let delta = rows(&|i, j| product(i, j) - f64::from(u8::from(i == j)))
        + scale * (n as f64 + 2.0) * f64::EPSILON;
    if !(delta < tol::INVERTED) {
        return Err(Error::value(
            "P",
            "a well conditioned matrix",
            "one that is singular to rounding",
        ));
    }
    let norm = rows(&|i, j| inverse[(i, j)]) / (1.0 - delta);
    Ok((0..n).map(|i| (inverse[(i, i)] + delta * norm) * inflation(8)).collect())
}
