//! What all depths of a plan share.

use crate::evidence::{OfPlan, PlanSpans, Rule};
use crate::kalman::{Kalman, KalmanSpans};
use crate::layout::Layout;
use crate::plan::span::{Cursor, Span};
use crate::prices::Prices;
use crate::response::{Response, ResponseSizes};
use crate::tol;

/// Numbers in the header of a plan.
pub(crate) const HEADER: usize = 32;

/// What a distance to the bounds of a group of rows is at least worth in units of each row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margin {
    /// 1 / the largest unit of the group.
    pub per_largest: f64,
    /// 1 / the smallest.
    pub per_smallest: f64,
}

impl Margin {
    /// Of rows with these units.
    pub fn new(units: &[f64]) -> Self {
        let largest = units.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let smallest = units.iter().copied().fold(f64::MAX, f64::min);
        Margin { per_largest: 1.0 / largest, per_smallest: 1.0 / smallest }
    }

    /// A lower bound on the distance in units of each row, from one in the user's units.
    #[inline(always)]
    pub fn of(self, margin: f64) -> f64 {
        margin * if margin > 0.0 { self.per_largest } else { self.per_smallest }
    }
}

/// Sizes and choices of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// States n.
    pub n: usize,
    /// Outputs p.
    pub p: usize,
    /// Known inputs m; 0 for a system without.
    pub m: usize,
    /// Instants that the response to them depends on; 1 without.
    pub lag: usize,
    /// Horizon M.
    pub horizon: usize,
    /// The highest number of directions r of all depths.
    pub rank: usize,
    /// Outputs in the window of a new run.
    pub filled: usize,
    /// Whether the states are bounded at every step.
    pub x_bounded: bool,
    /// Whether the fitted noise is.
    pub v_bounded: bool,
    /// Whether the fitted disturbance is.
    pub w_bounded: bool,
    /// Whether a disturbance is fitted.
    pub driven: bool,
    /// Whether bounds on the states are about x_c(t) of the experiment IV-A1.
    pub centered: bool,
    /// Whether the weight of the outputs is diagonal.
    pub plain_noise: bool,
    /// Whether the weights are those of the recording.
    pub recorded: bool,
    /// Of leaving the bounds.
    pub prices: Prices,
    /// What the evidence on estimates follows.
    pub rule: Rule,
    /// Whether each sample adds to the covariance of unseen states.
    pub drifts: bool,
    /// From how many deviations on an output is rejected; 0: none is.
    pub gate: f64,
    /// Whether an output that is stuck counts as not measured.
    pub stuck_missing: bool,
    /// Where a new run starts.
    pub start: Begin,
}

/// Where a new run starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Begin {
    /// From the window that is kept: a state, or the recording's end.
    #[default]
    Known,
    /// From an unknown state.
    Unknown,
    /// From the recording's end if the first windows say so, else from an unknown state.
    Auto,
}

impl Sizes {
    /// Whether a machine whose largest number is `largest` can count what is in the common block,
    /// in the block of any depth, and in the room for a step, and what is multiplied on the way
    /// there.
    pub fn countable(&self, largest: u64) -> bool {
        self.at_most().is_some_and(|numbers| numbers <= largest)
    }

    /// An upper bound on these, None beyond 64 bits. With S rows that a window slides through and r
    /// directions, each array has at most (S + r)(r + 2n + p + m) numbers, or L (n + p + m)² in Θ,
    /// or (S (2n + p) + r)² where bounds may be left, or (n + m + 1) n² where evidence follows a
    /// filter.
    fn at_most(&self) -> Option<u64> {
        let [n, p, m, lag] = [self.n, self.p, self.m, self.lag].map(|size| size as u64);
        let [M, r] = [self.horizon, self.rank].map(|size| size as u64);
        let channels = n.checked_mul(2)?.checked_add(p)?.checked_add(m)?;
        let theta = lag.checked_mul(channels)?.checked_mul(channels.checked_add(16)?)?;
        let samples = M.max(32).checked_mul(2)?.checked_add(2)?;
        let rows = samples.checked_mul(channels)?.checked_add(r)?.checked_add(16)?;
        let left = if self.prices.any() { rows.checked_mul(rows)? } else { 0 };
        let judged = match self.rule {
            Rule::Filter => {
                channels.checked_add(1)?.checked_mul(channels.checked_mul(channels)?)?
            }
            _ => 0,
        };
        rows.checked_mul(r.checked_add(channels)?.checked_add(16)?)?
            .checked_add(theta)?
            .checked_add(left)?
            .checked_add(judged)?
            .checked_mul(16)
    }

    /// Of the windows of a depth.
    pub fn layout(self, depth: usize) -> Layout {
        Layout { n: self.n, p: self.p, depth, driven: self.driven }
    }

    /// n, p and m.
    pub(crate) fn channels(self) -> [usize; 3] {
        [self.n, self.p, self.m]
    }

    /// Whether a run may start from an unknown state, now or later.
    pub fn opens(&self) -> bool {
        self.start != Begin::Known || self.gate > 0.0
    }

    /// Whether estimates carry evidence.
    #[inline(always)]
    pub fn judged(&self) -> bool {
        self.rule != Rule::Off
    }

    /// Of the response to known inputs.
    pub fn response(self) -> ResponseSizes {
        ResponseSizes { n: self.n, p: self.p, m: self.m, lag: self.lag }
    }
}

/// What all depths of a plan share, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Common {
    /// Sizes and choices.
    pub sizes: Sizes,
    /// Of the state rows, of the noise and of the disturbance, in the user's units.
    pub margins: [Margin; 3],
    /// ρ of (17).
    pub rho: f64,
    /// What the cost in scaled units is to be multiplied with.
    pub unit: f64,
    /// What a disturbance of its own deviation costs.
    pub price: f64,
    /// Means of the states (n), in the user's units.
    pub mean_x: Span,
    /// Scales of the states (n): one unit of a scaled deviation.
    pub s_x: Span,
    /// Their inverses (n).
    pub per_s_x: Span,
    /// Means of the outputs (p).
    pub mean_y: Span,
    /// Scales of the outputs (p).
    pub s_y: Span,
    /// Means of the inputs (m), in the user's units.
    pub mean_u: Span,
    /// Scales of the inputs (m).
    pub s_u: Span,
    /// Θᵀ in panels: see [`Response`].
    pub theta: Span,
    /// R of (17) in scaled units (p × p, by rows).
    pub R: Span,
    /// Smallest and largest state (n each), where the states are bounded.
    pub x_limits: [Span; 2],
    /// Bounds on the noise of every sample of the deepest window (M·p each).
    pub v_limits: [Span; 2],
    /// Bounds on the disturbances of the deepest window (M·n each).
    pub w_limits: [Span; 2],
    /// W with ‖W w‖² the square of a disturbance in its own deviations (n × n, by rows).
    pub whitening: Span,
    /// ρ^{j-1} for j = 1, …, M.
    pub discount: Span,
    /// Weight of the square of each fitted noise of the deepest window (M·p), if R is diagonal.
    pub noise: Span,
    /// The means of the states, for each of the deepest window ((M+1)·n).
    pub means: Span,
    /// The scales of the outputs, for each of the deepest window (M·p), and their inverses.
    pub scales: [Span; 2],
    /// States of a new run's window ((filled+1)·n), as scaled deviations.
    pub states: Span,
    /// Its outputs (filled·p).
    pub outputs: Span,
    /// Its inputs (filled·m).
    pub inputs: Span,
    /// The filter that a window without bounds is, with the weights of the recording.
    pub kalman: KalmanSpans,
    /// What the evidence on estimates is made with.
    pub evidence: PlanSpans,
    /// Numbers in the block, header included.
    pub len: usize,
}

impl Common {
    /// Of these sizes; scalars are to be filled in.
    pub fn new(sizes: Sizes) -> Self {
        let Sizes { n, p, m, horizon: M, filled, .. } = sizes;
        let mut next = Cursor(HEADER);
        let bounded = |yes: bool, len: usize| if yes { len } else { 0 };
        let none = Margin { per_largest: 1.0, per_smallest: 1.0 };
        let (x, v) = (bounded(sizes.x_bounded, n), bounded(sizes.v_bounded, M * p));
        let w = bounded(sizes.w_bounded, M * n);
        let mut common = Common {
            sizes,
            margins: [none; 3],
            rho: 1.0,
            unit: 1.0,
            price: 0.0,
            mean_x: next.take(n),
            s_x: next.take(n),
            per_s_x: next.take(n),
            mean_y: next.take(p),
            s_y: next.take(p),
            mean_u: next.take(m),
            s_u: next.take(m),
            theta: next.take(sizes.response().panels_len()),
            R: next.take(p * p),
            x_limits: [next.take(x), next.take(x)],
            v_limits: [next.take(v), next.take(v)],
            w_limits: [next.take(w), next.take(w)],
            whitening: next.take(bounded(sizes.driven, n * n)),
            discount: next.take(M),
            noise: next.take(bounded(sizes.plain_noise, M * p)),
            means: next.take((M + 1) * n),
            scales: [next.take(M * p), next.take(M * p)],
            states: next.take((filled + 1) * n),
            outputs: next.take(filled * p),
            inputs: next.take(filled * m),
            kalman: KalmanSpans::new(sizes.channels(), sizes.recorded, &mut next),
            evidence: PlanSpans::new(
                [n, p, m, M],
                (sizes.judged(), sizes.plain_noise, sizes.rule == Rule::Filter),
                &mut next,
            ),
            len: 0,
        };
        common.len = next.0;
        common
    }
}

/// The common block, to be read: see [`Common`] for what each array is.
#[derive(Debug, Clone, Copy)]
pub struct Shared<'a> {
    /// Sizes and choices.
    pub sizes: Sizes,
    /// See [`Common::margins`].
    pub margins: [Margin; 3],
    /// ρ.
    pub rho: f64,
    /// See [`Common::unit`].
    pub unit: f64,
    pub(crate) price: f64,
    /// Whether bounds may be left.
    pub soft: bool,
    pub(crate) mean_x: &'a [f64],
    pub(crate) s_x: &'a [f64],
    pub(crate) per_s_x: &'a [f64],
    mean_y: &'a [f64],
    pub(crate) s_y: &'a [f64],
    mean_u: &'a [f64],
    s_u: &'a [f64],
    theta: &'a [f64],
    pub(crate) R: &'a [f64],
    pub(crate) x_limits: Option<Limits<'a>>,
    pub(crate) v_limits: Option<Limits<'a>>,
    pub(crate) w_limits: Option<Limits<'a>>,
    pub(crate) whitening: &'a [f64],
    pub(crate) discount: &'a [f64],
    noise: &'a [f64],
    means: &'a [f64],
    scales: [&'a [f64]; 2],
    pub(crate) states: &'a [f64],
    pub(crate) outputs: &'a [f64],
    pub(crate) inputs: &'a [f64],
    pub(crate) kalman: Option<Kalman<'a>>,
    /// What the evidence on estimates is made with, where there is any.
    pub evidence: Option<OfPlan<'a>>,
}

impl<'a> Shared<'a> {
    /// From where its arrays are and their numbers.
    pub fn new(common: &Common, numbers: &'a [f64]) -> Self {
        let of = |span: Span| span.of(numbers);
        let limits =
            |yes: bool, [lo, hi]: [Span; 2]| yes.then(|| Limits { lo: of(lo), hi: of(hi) });
        let Sizes { x_bounded, v_bounded, w_bounded, .. } = common.sizes;
        Shared {
            sizes: common.sizes,
            margins: common.margins,
            rho: common.rho,
            unit: common.unit,
            price: common.price,
            soft: common.sizes.prices.any(),
            mean_x: of(common.mean_x),
            s_x: of(common.s_x),
            per_s_x: of(common.per_s_x),
            mean_y: of(common.mean_y),
            s_y: of(common.s_y),
            mean_u: of(common.mean_u),
            s_u: of(common.s_u),
            theta: of(common.theta),
            R: of(common.R),
            x_limits: limits(x_bounded, common.x_limits),
            v_limits: limits(v_bounded, common.v_limits),
            w_limits: limits(w_bounded, common.w_limits),
            whitening: of(common.whitening),
            discount: of(common.discount),
            noise: of(common.noise),
            means: of(common.means),
            scales: common.scales.map(of),
            states: of(common.states),
            outputs: of(common.outputs),
            inputs: of(common.inputs),
            kalman: common
                .sizes
                .recorded
                .then(|| Kalman::new(common.sizes.channels(), common.kalman, numbers)),
            evidence: common.sizes.judged().then(|| {
                let Sizes { rule, horizon, drifts, .. } = common.sizes;
                OfPlan::new((rule, horizon, drifts), common.evidence, numbers)
            }),
        }
    }

    /// The response to known inputs; None for a system without.
    #[inline(always)]
    pub fn response(&self) -> Option<Response<'a>> {
        (self.sizes.m > 0).then(|| Response::new(self.sizes.response(), self.theta))
    }

    /// Inputs as scaled deviations from the recording's mean.
    #[inline(always)]
    pub fn input_deviations(&self, u: &[f64]) -> impl Iterator<Item = f64> {
        u.iter().zip(self.mean_u).zip(self.s_u).map(|((u, mean), s)| (u - mean) / s)
    }

    /// Whether these are inputs of the plan, within [`MEASURABLE`](tol::MEASURABLE).
    #[inline(always)]
    pub fn knows(&self, u: &[f64]) -> bool {
        let mut inputs = self.input_deviations(u);
        u.len() == self.sizes.m && inputs.all(|u| u.abs() <= tol::MEASURABLE)
    }

    /// The means of the states of a window.
    #[inline(always)]
    pub fn means(&self, layout: Layout) -> &'a [f64] {
        &self.means[..layout.states_len()]
    }

    /// The scales of the outputs of a window.
    #[inline(always)]
    pub fn scales(&self, layout: Layout) -> &'a [f64] {
        &self.scales[0][..layout.outputs_len()]
    }

    /// Their inverses.
    #[inline(always)]
    pub fn per_scales(&self, layout: Layout) -> &'a [f64] {
        &self.scales[1][..layout.outputs_len()]
    }

    /// The weights of the squares of a window's fitted noise, if R is diagonal.
    #[inline(always)]
    pub fn noise(&self, layout: Layout) -> Option<&'a [f64]> {
        let first = self.noise.len().checked_sub(layout.outputs_len())?;
        Some(&self.noise[first..])
    }

    /// A state as scaled deviations from the recording's mean.
    #[inline(always)]
    pub fn state_deviations(&self, x: &[f64]) -> impl Iterator<Item = f64> {
        x.iter().zip(self.mean_x).zip(self.s_x).map(|((x, mean), s)| (x - mean) / s)
    }

    /// A state of these scaled deviations in the user's units.
    #[inline(always)]
    pub fn state_of(&self, x: &[f64]) -> impl Iterator<Item = f64> {
        x.iter().zip(self.mean_x).zip(self.s_x).map(|((x, mean), s)| x * s + mean)
    }

    /// An output as scaled deviations.
    #[inline(always)]
    pub fn output_deviations(&self, y: &[f64]) -> impl Iterator<Item = f64> {
        y.iter().zip(self.mean_y).zip(self.s_y).map(|((y, mean), s)| (y - mean) / s)
    }
}

/// Smallest and largest values: of each channel, or of each entry of a window.
#[derive(Debug, Clone, Copy)]
pub struct Limits<'a> {
    /// Smallest.
    pub lo: &'a [f64],
    /// Largest.
    pub hi: &'a [f64],
}
