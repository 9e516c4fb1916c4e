//! Where a run starts.
//!
//! A run from an *unknown* state has the recording's mean x̄ for its first prior, and the spread of
//! the recorded states for what that is worth: with Σ_x their covariance, P₀ = 10 Σ_x and σ_v² the
//! variance that an affine function of x leaves of the recorded outputs, the cost of the growing
//! windows (t ≤ M) is
//!
//! > μ σ_v² ‖x̂(0) - x̄‖²_{P₀⁻¹} + Σ_{j=1..t} ρ^{j-1} μ ‖v̂(t-j)‖²
//!
//! so that μ ‖v̂‖² and the prior are in the same proportion as the squares of the noise and of the
//! spread; with unlike weights of the outputs, μ σ_v² is the mean of their products. The prior has
//! no discount: it is one of x(0), however long the window has become. For M < t ≤ 2M the prior is
//! x̂(t-M | M), the first full window's: x̂(t-M), which was made from t-M outputs only, would be
//! believed as much as one made from M, and the start be remembered for ever. From t = 2M on the
//! two are one, and x̄(t-M) = x̂(t-M) as in Algorithm 1.
//!
//! With the weights of the recording (R⁻¹ on the noise) it is ‖x̂(0) - x̄‖²_{P₀⁻¹}.
//!
//! *An exact recording* leaves σ_v² = 0, and the prior no weight at all: [`tol::START_NOISE`] is
//! what outputs are taken to deviate by at least.

use crate::covariance::{inverse_factor, spread};
use crate::error::Error;
use crate::history::History;
use crate::plan_builder::Prepared;
use crate::scaling::Scaling;
use crate::tol;
use crate::weights::Weights;

/// P₀ in units of the covariance of the recorded states.
const SPREAD: f64 = 10.0;

/// The problems of the growing windows of a run from an unknown state.
pub(crate) struct Opening {
    pub problems: Vec<Prepared>, // of the depths that the design keeps
    pub weights: Weights,
}

/// The weights of those windows: Σ_x's prior beside the noise weights of the others.
pub(crate) fn opening_weights(
    history: &History,
    scaling: &Scaling,
    regular: &Weights,
) -> Result<Weights, Error> {
    let U = inverse_factor(&spread(history, scaling)).ok_or_else(|| {
        Error::rank("history", "states with a covariance", "none that can be factored")
    })?;
    let noise = regular.price(&residual(history, scaling));
    Ok(regular.opening(U * faer::Scale((noise / SPREAD).sqrt())))
}

/// σ_v²: variance of what an affine function of x(k) leaves of each channel of y(k), in scaled
/// units; all of it where the recording has no degree of freedom left to tell.
fn residual(history: &History, scaling: &Scaling) -> Vec<f64> {
    let n = history.n();
    let told = history.T() > n + history.m() + 1;
    let left = |i: usize| if told { scaling.one_step[n + i][0].sqrt() } else { scaling.unit_y[i] };
    let scaled = |i: usize| left(i).max(tol::START_NOISE * scaling.unit_y[i]) / scaling.s_y[i];
    (0..history.p()).map(|i| scaled(i).powi(2)).collect()
}
