//! What a step returns, with its evidence.

use ddmhe_run::alone::Row;
use ddmhe_run::evidence::Rule;
use ddmhe_run::{Reasons, Status};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// The estimate of one step and the evidence behind it. All arrays are time-major, in the user's
/// units.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
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
    #[cfg_attr(feature = "serde", serde(with = "status"))]
    pub status: Status,
    /// Number of bounds that the window touches, or leaves where they are soft.
    pub active: usize,
    /// Changes of the active set since the last step (or iterations of the interior-point solver,
    /// where that decided).
    pub iterations: u32,
    /// How far to trust it; None where the configuration asks for none.
    pub evidence: Option<Evidence>,
}

/// How far to trust one estimate, in the user's units: see [`ddmhe_run::evidence`].
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Evidence {
    /// Σ(t), covariance of the error of x̂(t) (n·n, by rows).
    pub covariance: Vec<f64>,
    /// Why the estimate is not trusted; empty: it is.
    #[cfg_attr(feature = "serde", serde(with = "reasons"))]
    pub reasons: Reasons,
    /// What `value` is.
    pub kind: EvidenceKind,
    /// V(t)/V₀, or the mean of ‖ν‖²/p over the window.
    pub value: f64,
    /// What that is novel above.
    pub limit: f64,
    /// What the newest output differs by from what all others say it is (p); NaN where not
    /// measured.
    pub innovation: Vec<f64>,
    /// Variance of that (p).
    pub innovation_variance: Vec<f64>,
    /// Whether each output repeats one value longer than it ever did in the recording (p).
    pub stuck: Vec<bool>,
    /// Whether each entry of the newest output was rejected (p): see [`ddmhe_run::gating`].
    pub gated: Vec<bool>,
    /// Whether the run started again with the newest output, because the state has jumped.
    pub restarted: bool,
}

/// What speaks for a window being like the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub enum EvidenceKind {
    /// V, the minimum of its problem, in units of what it is in windows held out of the recording.
    #[default]
    V,
    /// The normalised innovations squared of the recording's Kalman filter, ‖ν‖²/p.
    Nis,
}

impl Evidence {
    /// Standard deviation of the error of each state.
    pub fn std(&self) -> impl Iterator<Item = f64> + '_ {
        let n = self.covariance.len().isqrt();
        (0..n).map(move |i| self.covariance[i * n + i].sqrt())
    }

    /// Whether the estimate is trusted: see [`Reasons::trusted`].
    pub fn trusted(&self) -> bool {
        self.reasons.trusted()
    }

    /// Room for n states and p outputs.
    pub(crate) fn with_room(n: usize, p: usize, rule: Rule) -> Self {
        Evidence {
            covariance: vec![0.0; n * n],
            kind: if rule == Rule::Filter { EvidenceKind::Nis } else { EvidenceKind::V },
            innovation: vec![f64::NAN; p],
            innovation_variance: vec![0.0; p],
            stuck: vec![false; p],
            gated: vec![false; p],
            ..Evidence::default()
        }
    }

    /// Takes up what a step found.
    #[inline(always)]
    pub(crate) fn update(&mut self, found: &ddmhe_run::Evidence<'_>) {
        self.covariance.copy_from_slice(found.covariance);
        (self.reasons, self.value, self.limit) = (found.reasons, found.value, found.limit);
        self.innovation.copy_from_slice(found.innovation);
        self.innovation_variance.copy_from_slice(found.innovation_variance);
        let repeats = found.repeats.iter().zip(found.patience);
        self.stuck.iter_mut().zip(repeats).for_each(|(to, (count, most))| *to = count >= most);
        self.gated.iter_mut().zip(found.gated).for_each(|(to, gated)| *to = *gated > 0.0);
        self.restarted = found.restarted;
    }
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
    /// How far to trust the estimates; None where the configuration asks for no evidence.
    pub evidence: Option<EvidenceLog>,
}

/// The evidence on the estimates of a whole run: see [`Evidence`] for each field.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EvidenceLog {
    /// Σ, N·n·n.
    pub covariance: Vec<f64>,
    /// Bits of [`Reasons`].
    pub reasons: Vec<u8>,
    /// What `value` is.
    pub kind: EvidenceKind,
    /// V(t)/V₀, or the mean of ‖ν‖²/p over the window.
    pub value: Vec<f64>,
    /// What that is novel above.
    pub limit: Vec<f64>,
    /// N·p
    pub innovation: Vec<f64>,
    /// N·p
    pub innovation_variance: Vec<f64>,
    /// N·p
    pub stuck: Vec<bool>,
    /// N·p
    pub gated: Vec<bool>,
    /// N
    pub restarted: Vec<bool>,
}

impl EvidenceLog {
    #[inline(always)]
    pub(crate) fn push(&mut self, of: &Evidence) {
        self.covariance.extend_from_slice(&of.covariance);
        self.reasons.push(of.reasons.bits());
        self.kind = of.kind;
        self.value.push(of.value);
        self.limit.push(of.limit);
        self.innovation.extend_from_slice(&of.innovation);
        self.innovation_variance.extend_from_slice(&of.innovation_variance);
        self.stuck.extend_from_slice(&of.stuck);
        self.gated.extend_from_slice(&of.gated);
        self.restarted.push(of.restarted);
    }

    fn reserve(&mut self, steps: usize, n: usize, p: usize) {
        self.covariance.reserve_exact(steps * n * n);
        self.reasons.reserve_exact(steps);
        self.value.reserve_exact(steps);
        self.limit.reserve_exact(steps);
        self.innovation.reserve_exact(steps * p);
        self.innovation_variance.reserve_exact(steps * p);
        self.stuck.reserve_exact(steps * p);
        self.gated.reserve_exact(steps * p);
        self.restarted.reserve_exact(steps);
    }
}

impl Log {
    /// Room for so many steps of n states.
    pub(crate) fn reserve(&mut self, steps: usize, (n, p): (usize, usize), judged: bool) {
        self.x.reserve_exact(steps * n);
        self.cost.reserve_exact(steps);
        self.status.reserve_exact(steps);
        self.active.reserve_exact(steps);
        self.iterations.reserve_exact(steps);
        self.evidence = judged.then(EvidenceLog::default);
        if let Some(evidence) = &mut self.evidence {
            evidence.reserve(steps, n, p);
        }
    }
}

impl Log {
    /// One more step.
    #[inline(always)]
    pub(crate) fn push(&mut self, estimate: &Estimate) {
        self.x.extend_from_slice(&estimate.x);
        self.cost.push(estimate.cost);
        self.status.push(estimate.status);
        self.active.push(estimate.active);
        self.iterations.push(estimate.iterations);
        self.bound.extend(estimate.bound);
        if let (Some(log), Some(of)) = (&mut self.evidence, &estimate.evidence) {
            log.push(of);
        }
    }

    /// Up to so many more of n states that `make` makes without bounds: how many it made.
    #[inline(always)]
    pub(crate) fn row(
        &mut self,
        steps: usize,
        n: usize,
        make: impl FnOnce(Row<'_>) -> usize,
    ) -> usize {
        let (x, before) = (self.x.len(), self.cost.len());
        self.x.resize(x + steps * n, 0.0);
        self.cost.resize(before + steps, 0.0);
        let made = make(Row { x: &mut self.x[x..], cost: &mut self.cost[before..] });
        let steps = before + made;
        self.x.truncate(x + made * n);
        self.cost.truncate(steps);
        self.status.resize(steps, Status::Optimal);
        self.active.resize(steps, 0);
        self.iterations.resize(steps, 0);
        made
    }
}

/// [`Reasons`] as their bits.
#[cfg(feature = "serde")]
mod reasons {
    use super::Reasons;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(reasons: &Reasons, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_u8(reasons.bits())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Reasons, D::Error> {
        Ok(Reasons::from_bits(u8::deserialize(from)?))
    }
}

/// [`Status`](ddmhe_run::Status) as its code.
#[cfg(feature = "serde")]
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
