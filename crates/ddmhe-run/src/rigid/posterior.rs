//! What a fit found.

use crate::panels::Root;
use crate::rigid::earlier::Firsts;
use crate::rigid::layout::TILT;
use crate::rigid::motion::Family;
use crate::rigid::small::Vector;
use crate::rigid::start::Start;

/// Costs that differ by less are of one optimum.
pub const SAME: f64 = 0.1;
/// What Euler's forward rule is to gain before it is believed: a simulation, not a body.
pub const EULER: f64 = 6.0;

/// The most probable motion given all data of a fit, and how certain it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posterior<M, const N: usize> {
    /// The family that it is of.
    pub motion: M,
    /// (ω at the recording's beginning, θ).
    pub z: [f64; N],
    /// ω at the beginnings of earlier recordings.
    pub firsts: Firsts,
    /// ω at the end of the data.
    pub w: Vector,
    /// Covariance of (ω at the end of the data, θ).
    pub P: [[f64; N]; N],
    /// Σ|x - ω|²/σx² + Σ|y - ŷ|²/σy² + |θ/sd|².
    pub cost: f64,
    /// log of the probability of the data, but for a constant of them.
    pub evidence: f64,
    /// How the residuals compare with their noise.
    pub misfit: Misfit,
}

impl<M: Clone, const N: usize> Posterior<M, N> {
    /// Where a fit from there begins.
    pub fn start(&self) -> Start<M, N> {
        Start { motion: self.motion.clone(), z: self.z, firsts: self.firsts }
    }
}

impl<M, const N: usize> Posterior<M, N> {
    /// (ω at the end of the data, θ).
    fn at_end(&self) -> [f64; N] {
        let mut z = self.z;
        z[..3].copy_from_slice(&self.w);
        z
    }

    /// Whether another is the same optimum: as probable, and as near as it is known.
    pub fn is(&self, other: &Self) -> bool {
        (self.cost - other.cost).abs() < SAME && self.is_near(other)
    }

    /// Whether the rates and inertia of another are nearer than they are known.
    pub fn is_near(&self, other: &Self) -> bool {
        apart(&self.at_end(), &other.at_end(), &self.P) < APART
    }

    /// The evidence, less what is to be gained before a body is believed to move by Euler's rule.
    pub fn weight<const P: usize>(&self) -> f64
    where
        M: Family<P, N>,
    {
        self.evidence - if self.motion.is_simulated() { 0.5 * EULER } else { 0.0 }
    }
}

/// Motions are the same whose rates and inertias are apart by less.
const APART: f64 = 0.5;

/// How far two motions are apart in ω and j, which no coordinates change: squared, in units of P.
fn apart<const N: usize>(a: &[f64; N], b: &[f64; N], P: &[[f64; N]; N]) -> f64 {
    // L Lᵀ = P of (ω, j), u = L⁻¹ (a - b)
    let (mut L, mut u) = ([[0.0; TILT]; TILT], [0.0; TILT]);
    for i in 0..TILT {
        for k in 0..=i {
            let known: f64 = (0..k).map(|q| L[i][q] * L[k][q]).sum();
            let rest = P[i][k] - known;
            L[i][k] = if i == k { rest.max(f64::MIN_POSITIVE).root() } else { rest / L[k][k] };
        }
        let known: f64 = (0..i).map(|q| L[i][q] * u[q]).sum();
        u[i] = (a[i] - b[i] - known) / L[i][i];
    }
    u.iter().map(|v| v * v).sum()
}

/// Mean squares of the residuals in units of their noise: of states, of outputs, and of both in
/// means over ten samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Misfit {
    /// χ of each.
    pub chi: [f64; 4],
    /// How many terms each has.
    pub terms: [f64; 4],
}

impl Misfit {
    /// What each χ is to be below: 4.5 deviations of what noise does, and more for noise that was
    /// read off the recording.
    pub fn limits(&self, known: bool) -> [f64; 4] {
        let wider = if known { 1.0 } else { READ_OFF };
        self.terms.map(|n| (SLACK + DEVIATIONS * (2.0 / n).root()) * wider)
    }

    /// The largest χ over its limit: below 1 the motion explains the data.
    pub fn excess(&self, known: bool) -> f64 {
        let limits = self.limits(known);
        (0..4).map(|i| self.chi[i] / limits[i]).fold(0.0, |most, v| if v > most { v } else { most })
    }

    /// Whether the motion explains the data.
    pub fn explained(&self, known: bool) -> bool {
        self.excess(known) < 1.0
    }
}

/// What χ may exceed 1 by whatever the number of terms: noise is known to some percent.
const SLACK: f64 = 1.05;
/// Deviations of a χ that has 2/n for its variance.
const DEVIATIONS: f64 = 4.5;
/// Noise from fifth differences of a short recording is off by some ten percent.
const READ_OFF: f64 = 1.35;
