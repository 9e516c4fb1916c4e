//! What a fit found.

use crate::panels::Root;
use crate::rigid::small::Vector;

/// The most probable motion given all data of a fit, and how certain it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posterior<M, const N: usize> {
    /// The family that it is of.
    pub motion: M,
    /// (ω at the recording's beginning, θ).
    pub z: [f64; N],
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

/// Mean squares of the residuals in units of their noise: of states, of outputs, and of both in means
/// over ten samples.
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
