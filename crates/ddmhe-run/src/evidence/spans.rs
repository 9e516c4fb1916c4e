//! Where the numbers behind the evidence are, in the blocks of a plan.

use crate::evidence::model::{ModelSpans, OfModel};
use crate::evidence::rule::Rule;
use crate::plan::span::{Cursor, Span};

/// Of all depths. All in the user's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlanSpans {
    /// Σ of a new run's states (n × n).
    pub start: Span,
    /// 1 / the square of each state's recorded spread (n).
    pub per_spread: Span,
    /// Σ_x⁻¹ / D_most (n × n).
    pub away: Span,
    /// Variance above which each state is uncertain (n).
    pub uncertain: Span,
    /// Recorded range of each state with a quarter of it on both sides (n each).
    pub x_range: [Span; 2],
    /// The same of each input (m each), in scaled units.
    pub u_range: [Span; 2],
    /// From how many equal values in a row on each output is stuck (p).
    pub patience: Span,
    /// Weight of y - c times v of every output of the deepest window in V (M·p), where R is
    /// diagonal.
    pub weights: Span,
    /// What the recording leaves open of its model, with the recording's weights.
    pub model: ModelSpans,
    /// How held-out errors grow: 2q, .1 T and T of [`growth`](crate::evidence::formulas::growth),
    /// and how many samples a new run is from the recording's end.
    pub growth: Span,
    /// W: what a sample adds to Q (n × n).
    pub drift: Span,
}

impl PlanSpans {
    pub(crate) fn new(
        [n, p, m, horizon]: [usize; 4],
        (judged, plain, filter): (bool, bool, bool),
        next: &mut Cursor,
    ) -> Self {
        let kept = |len: usize| if judged { len } else { 0 };
        PlanSpans {
            start: next.take(kept(n * n)),
            per_spread: next.take(kept(n)),
            away: next.take(kept(n * n)),
            uncertain: next.take(kept(n)),
            x_range: [next.take(kept(n)), next.take(kept(n))],
            u_range: [next.take(kept(m)), next.take(kept(m))],
            patience: next.take(kept(p)),
            weights: next.take(if plain { kept(horizon * p) } else { 0 }),
            model: ModelSpans::new([n, m], filter, next),
            growth: next.take(kept(4)),
            drift: next.take(kept(n * n)),
        }
    }
}

/// Of one depth. All in the user's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DepthSpans {
    /// V₀, above which V and J a window is novel, and above which a run does not go on from the
    /// recording's end.
    pub levels: Span,
    /// Φ (n × n).
    pub carry: Span,
    /// Q₀ (n × n).
    pub error: Span,
    /// (I - H_nn)⁻¹ (p × p): from the newest fitted noise to the innovation.
    pub deleted: Span,
    /// What an error of x̄ makes of the innovation (p × n).
    pub of_prior: Span,
    /// Variance of the innovation where x̄ is exact (p).
    pub innovation: Span,
    /// That of a window whose x̄ is an estimate, not that of a run from an unknown state (p).
    pub settled: Span,
    /// Squares of innovations above which a run does not go on from the recording's end (p).
    pub going_on: Span,
}

impl DepthSpans {
    pub(crate) fn new([n, p]: [usize; 2], judged: bool, next: &mut Cursor) -> Self {
        let kept = |len: usize| if judged { len } else { 0 };
        DepthSpans {
            levels: next.take(kept(5)),
            carry: next.take(kept(n * n)),
            error: next.take(kept(n * n)),
            deleted: next.take(kept(p * p)),
            of_prior: next.take(kept(p * n)),
            innovation: next.take(kept(p)),
            settled: next.take(kept(p)),
            going_on: next.take(kept(p)),
        }
    }
}

/// The numbers of all depths, to be read.
#[derive(Debug, Clone, Copy)]
pub struct OfPlan<'a> {
    pub(crate) rule: Rule,
    pub(crate) start: &'a [f64],
    pub(crate) per_spread: &'a [f64],
    pub(crate) away: &'a [f64],
    pub(crate) uncertain: &'a [f64],
    pub(crate) x_range: [&'a [f64]; 2],
    pub(crate) u_range: [&'a [f64]; 2],
    pub(crate) patience: &'a [f64],
    pub(crate) weights: &'a [f64],
    pub(crate) model: OfModel<'a>,
    pub(crate) growth: [f64; 4],
    pub(crate) drift: Option<&'a [f64]>,
    pub(crate) horizon: usize,
}

impl<'a> OfPlan<'a> {
    /// Whether a new run is not to begin at the recording's end.
    pub fn starts_elsewhere(&self) -> bool {
        self.growth[3] > 0.0
    }

    /// Whether state i with this variance is uncertain.
    pub fn is_uncertain(&self, i: usize, variance: f64) -> bool {
        variance > self.uncertain[i]
    }

    /// Whether state i is outside of its recorded range.
    pub fn is_state_outside(&self, i: usize, x: f64) -> bool {
        x < self.x_range[0][i] || x > self.x_range[1][i]
    }

    pub(crate) fn new(
        (rule, horizon, drifts): (Rule, usize, bool),
        spans: PlanSpans,
        numbers: &'a [f64],
    ) -> Self {
        let of = |span: Span| span.of(numbers);
        OfPlan {
            rule,
            horizon,
            start: of(spans.start),
            per_spread: of(spans.per_spread),
            away: of(spans.away),
            uncertain: of(spans.uncertain),
            x_range: spans.x_range.map(of),
            u_range: spans.u_range.map(of),
            patience: of(spans.patience),
            weights: of(spans.weights),
            model: OfModel::new(spans.model, numbers),
            growth: spans.growth.of(numbers).try_into().unwrap_or_default(),
            drift: drifts.then(|| of(spans.drift)),
        }
    }
}

/// The numbers of one depth, to be read.
#[derive(Debug, Clone, Copy)]
pub struct OfDepth<'a> {
    pub(crate) levels: [f64; 5],
    pub(crate) carry: &'a [f64],
    pub(crate) error: &'a [f64],
    pub(crate) deleted: &'a [f64],
    pub(crate) of_prior: &'a [f64],
    pub(crate) innovation: &'a [f64],
    pub(crate) settled: &'a [f64],
    pub(crate) going_on: &'a [f64],
}

impl<'a> OfDepth<'a> {
    pub(crate) fn new(spans: DepthSpans, own: &'a [f64]) -> Self {
        let levels = spans.levels.of(own);
        OfDepth {
            levels: levels.try_into().unwrap_or_default(),
            carry: spans.carry.of(own),
            error: spans.error.of(own),
            deleted: spans.deleted.of(own),
            of_prior: spans.of_prior.of(own),
            innovation: spans.innovation.of(own),
            settled: spans.settled.of(own),
            going_on: spans.going_on.of(own),
        }
    }
}
