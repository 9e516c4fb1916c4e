//! What each estimate says about itself: how far off it may be, and whether the motion is still
//! like the recording.
//!
//! # The statistic
//! V(t), the minimum of the window's problem, (17) with the weight λ on ‖a‖², is the squared
//! Mahalanobis length of \[x̄; y\] under the recorded windows. Windows that were held out of the
//! recording say what V is where the motion is like the recording (mean V₀, largest V), and how far
//! estimates are off then: Q₀. Over windows that are unlike it, squares of errors follow V/V₀
//! between its first and second power.
//!
//! D(t) = (x̂ - x̄)ᵀ Σ_x⁻¹ (x̂ - x̄), x̄ and Σ_x the mean and covariance of the recorded states,
//! says how far the estimate has left them; D_most is the largest D of recorded states, and of
//! held-out ones under what their estimates were made from. What curvature makes of an error goes
//! like the square of that distance. G is what held-out errors of a curved recording grew by with
//! the time since what they were made from: see [`formulas::growth`].
//!
//! # The covariance
//! The error of x̂(t) is that of x̄(t-m), carried by the map Φ: x̄ → x̂(t), and what the window
//! adds:
//!
//! > A = Φ Σ(t-m) Φᵀ,  Q = s Q₀,  s = max(s(v), G v, u² where u > 1)
//! >
//! > v = V/V₀,  s(v) = v for v ≤ 1, v^1.5 above,  u = D/(.7 D_most)
//! >
//! > Σ(t) = A (1 + 1/κ) + Q (1 + κ),  κ² = tr A / tr Q, each state in units of its recorded spread
//!
//! which holds however the two errors are correlated: held-out errors a window apart are so by up
//! to .99. Other [rules](Rule) hold where the recording is exact or the weights are its own.
//!
//! *Bounds.* V is that of the constrained problem. The minimiser within bounds is the projection of
//! the one without in the norm of the problem; where the truth satisfies them that takes it nearer,
//! so Σ of the problem without bounds is handed out, with V of the one that has them.
//!
//! *Lost outputs.* Φ and Q are those of the outputs that are left: Q₀ grows by what they add to the
//! covariance of z, whose unit is V₀ over the number of outputs; V grows by the share of V₀ that
//! was not measured.
//!
//! # Doubt
//! *Novel*: V, or its part J of (17), was above what held-out windows explain in one of the last M
//! steps. *Uncertain*: a state's deviation is above half its recorded spread and three times what
//! held-out windows were off. *Stuck*: an output repeats a value longer than it ever did.
//! *Outside*: a state or an input has left its recorded range by more than a quarter of it. An
//! estimate is trusted where none of the first three holds; outside is told and does not take trust
//! away by itself: a linear system is as well estimated there, and where curvature spoils the
//! estimate V shows it.

pub mod formulas;
pub mod model;
mod rule;
pub mod spans;

pub use model::{ModelSpans, OfModel};
pub use rule::Rule;
pub use spans::{DepthSpans, OfDepth, OfPlan, PlanSpans};

/// Why an estimate is not trusted: any of these.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Reasons(u8);

impl Reasons {
    /// The motion is unlike the recording.
    pub const NOVEL: Reasons = Reasons(1);
    /// A state may be off by more than half its recorded spread.
    pub const UNCERTAIN: Reasons = Reasons(2);
    /// An output repeats one value longer than it ever did in the recording.
    pub const STUCK: Reasons = Reasons(4);
    /// A state or an input has left its recorded range by more than a quarter of it.
    pub const OUTSIDE: Reasons = Reasons(8);

    /// As bits, 1, 2, 4 and 8 in this order.
    pub fn bits(self) -> u8 {
        self.0
    }

    /// From bits; those that mean nothing are left out.
    pub fn from_bits(bits: u8) -> Self {
        Reasons(bits & 15)
    }

    /// Whether an estimate with these is trusted: what is outside is not for that alone in doubt.
    pub fn trusted(self) -> bool {
        self.0 & !Self::OUTSIDE.0 == 0
    }

    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether all of the others are among these.
    pub fn contains(self, others: Reasons) -> bool {
        self.0 & others.0 == others.0
    }

    /// These, and another if `there`.
    pub(crate) fn with(self, other: Reasons, there: bool) -> Self {
        Reasons(self.0 | if there { other.0 } else { 0 })
    }
}

/// The evidence on one estimate, in the user's units.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// Σ(t), covariance of the error of x̂(t) (n·n, by rows).
    pub covariance: &'a [f64],
    /// Why the estimate is not trusted; empty: it is.
    pub reasons: Reasons,
    /// V(t) in units of V₀; with the weights of the recording, the mean of νᵀS⁻¹ν/p over the
    /// window.
    pub value: f64,
    /// What `value` is novel above.
    pub limit: f64,
    /// What the newest output differs by from what all others say it is (p); NaN where not
    /// measured.
    pub innovation: &'a [f64],
    /// Variance of that (p).
    pub innovation_variance: &'a [f64],
    /// How often in a row each output has had the value that it has (p).
    pub repeats: &'a [f64],
    /// From how many on it counts as stuck (p).
    pub patience: &'a [f64],
    /// Above 0: this entry of the newest output was rejected (p); empty where none is doubted.
    pub gated: &'a [f64],
    /// Whether the run started again with the newest output.
    pub restarted: bool,
}

/// What the solution of one window tells.
#[derive(Debug, Clone, Copy, Default)]
pub struct Minimum {
    /// V, in the units of the cost.
    pub value: f64,
    /// Whether the maps are those of the outputs that were left, in the scratch.
    pub reweighted: bool,
}
