//! What a step returns, with its evidence.

use ddmhe_run::Status;
use serde::{Deserialize, Serialize};

/// The estimate of one step and the evidence behind it. All arrays are time-major, in the user's
/// units.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Estimate {
    /// x̂(t) (n), from outputs up to y(t-1).
    pub x: Vec<f64>,
    /// The whole estimated window x̂(t-M_t|t) … x̂(t|t), (M_t+1)·n, oldest first.
    pub window: Vec<f64>,
    /// Fitted noise v̂(t-M_t|t) … v̂(t-1|t), M_t·p; NaN where nothing was measured, or where the
    /// output was left out (see [`DdMhe::step`](crate::DdMhe::step)).
    pub v: Vec<f64>,
    /// Fitted disturbance ŵ(t-M_t|t) … ŵ(t-1|t), M_t·n; empty where none is fitted.
    pub w: Vec<f64>,
    /// Cost (17) at the estimate, with that of the disturbance, where one is fitted (a weight on
    /// ‖α‖² is not part of it), and what it pays for leaving soft bounds.
    pub cost: f64,
    /// Bound on ‖x̂(t) - x(t)‖, if a certificate and the disturbance's size were given.
    pub bound: Option<f64>,
    /// What the optimisation found.
    #[serde(with = "status")]
    pub status: Status,
    /// Number of bounds that the window touches, or leaves where they are soft.
    pub active: usize,
    /// Changes of the active set since the last step (or iterations of the interior-point solver,
    /// where that decided).
    pub iterations: u32,
}

/// The estimates of a whole run: row t-1 is step t's.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Log {
    /// x̂, N·n, time-major.
    pub x: Vec<f64>,
    /// Cost of each step.
    pub cost: Vec<f64>,
    /// Error bound of each step; empty without a certificate and the disturbance's size.
    pub bound: Vec<f64>,
    /// Status of each step.
    pub status: Vec<Status>,
    /// Number of touched or left bounds of each step.
    pub active: Vec<usize>,
    /// `Estimate::iterations` of each step.
    pub iterations: Vec<u32>,
}

impl Log {
    /// Room for so many steps of n states.
    pub(crate) fn reserve(&mut self, steps: usize, n: usize) {
        self.x.reserve_exact(steps * n);
        self.cost.reserve_exact(steps);
        self.status.reserve_exact(steps);
        self.active.reserve_exact(steps);
        self.iterations.reserve_exact(steps);
    }
}

/// [`Status`](ddmhe_run::Status) as its code.
mod status {
    use ddmhe_run::Status;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(status: &Status, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_u32(status.code())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Status, D::Error> {
        Status::from_code(u32::deserialize(from)?).ok_or_else(|| D::Error::custom("a status"))
    }
}
