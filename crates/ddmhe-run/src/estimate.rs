//! What a step in the caller's memory returns, with its evidence.

use crate::evidence::Evidence;
use crate::status::Status;

/// The estimate of one step and the evidence behind it. All arrays are time-major, in the user's
/// units.
#[derive(Debug, Clone, Copy)]
pub struct Estimate<'a> {
    /// x̂(t) (n), from outputs up to y(t-1).
    pub x: &'a [f64],
    /// The whole estimated window x̂(t-M_t|t) … x̂(t|t), (M_t+1)·n, oldest first.
    pub window: &'a [f64],
    /// Fitted noise v̂(t-M_t|t) … v̂(t-1|t), M_t·p; NaN where nothing was measured, or where the
    /// output was left out.
    pub v: &'a [f64],
    /// Fitted disturbance ŵ(t-M_t|t) … ŵ(t-1|t), M_t·n; empty where none is fitted.
    pub w: &'a [f64],
    /// Cost (17) at the estimate, with that of the disturbance, where one is fitted (a weight on
    /// ‖α‖² is not part of it), and what it pays for leaving soft bounds.
    pub cost: f64,
    /// What the optimisation found.
    pub status: Status,
    /// Number of bounds that the window touches, or leaves where they are soft.
    pub active: usize,
    /// Changes of the active set since the last step.
    pub iterations: u32,
    /// How far to trust it; None where the plan was made without.
    pub evidence: Option<Evidence<'a>>,
}
