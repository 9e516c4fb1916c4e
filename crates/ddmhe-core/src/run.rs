//! One run of an estimator: what changes from step to step, and the step itself, on checked input.
//!
//! A step is a [`Pass`] of [`ddmhe_run::stepper`], which tells what becomes of windows without a
//! minimiser. What a step of that crate cannot do in flight, [`Fallbacks`] does here.

use crate::block::Block;
use crate::config::{Bounds, Start};
use crate::design::Design;
use crate::doubts::Doubts;
use crate::error_bound::ErrorBound;
use crate::estimate::{Estimate, Evidence};
use crate::fallback::Fallbacks;
use crate::first_window::{Samples, filled, first_window};
use crate::inputs::SeenInputs;
use crate::plan_builder::Prepared;
use crate::start::Opening;
use crate::watch::Seen;
use crate::weights::Weights;
use ddmhe_run::Status;
use ddmhe_run::layout::Layout;
use ddmhe_run::memory::{Memory, memory_len};
use ddmhe_run::plan::Limits;
use ddmhe_run::problem::WindowSolution;
use ddmhe_run::stepper::{Answer, Found, Pass, smooth};

/// The state of a run.
pub(crate) struct Run {
    pub start: Start,
    pub bound: Option<ErrorBound>,
    /// y(t-M_t) … y(t-1), x̂(t-M_t) … x̂(t) and room for a step.
    pub memory: Memory<Block>,
    /// What the outputs did that they never did in the recording.
    pub seen: Seen,
    /// The same of the inputs.
    pub seen_inputs: SeenInputs,
    /// Since when estimates are in doubt.
    pub doubts: Doubts,
    pub t: usize,
    pub estimate: Estimate,
    /// Where the start is still to be found: all samples [y; u] since.
    pub first: Option<Vec<f64>>,
    /// Whether the newest window is one of a run that goes on from the recording's end.
    pub goes_on: bool,
}

impl Run {
    /// With room for all windows of a design, and nothing in it before [`restart`](Self::restart).
    pub fn new(design: &Design, start: Start) -> Self {
        let sizes = design.ground.sizes();
        Run {
            start,
            bound: design.bound.clone(),
            memory: Memory::new(sizes, Block::new(memory_len(sizes))),
            seen: Seen::default(),
            seen_inputs: SeenInputs::default(),
            doubts: Doubts::new(&design.history),
            t: 0,
            estimate: Estimate::default(),
            first: None,
            goes_on: true,
        }
    }

    /// A copy that goes on by itself.
    pub fn copy(&self, design: &Design) -> Self {
        let mut copy = Run {
            start: self.start,
            bound: self.bound.clone(),
            memory: self.memory.clone(),
            seen: self.seen.clone(),
            seen_inputs: self.seen_inputs.clone(),
            doubts: self.doubts.clone(),
            t: self.t,
            estimate: self.estimate.clone(),
            first: self.first.clone(),
            goes_on: self.goes_on,
        };
        copy.reserve(design); // a copied vector has no room to grow
        copy
    }

    /// The state of a new estimator; nothing of what was before may reach a later number.
    pub fn restart(&mut self, design: &Design, x_prior: Option<&[f64]>) {
        let (history, scaling) = (&design.history, &design.scaling);
        self.t = 0;
        self.estimate = Estimate::default();
        self.seen = design.watch.start();
        self.seen_inputs = design.input_watch.start();
        self.doubts = Doubts::new(history);
        self.first = (self.start == Start::Auto).then(Vec::new);
        let sizes = design.ground.sizes();
        self.estimate.evidence =
            sizes.judged().then(|| Evidence::with_room(sizes.n, sizes.p, sizes.rule));
        self.reserve(design);
        let filled = filled(history, self.start, design.settings.horizon);
        let first = first_window((history, scaling), self.start, filled, x_prior);
        self.refill(design, &first, x_prior.is_some());
        if let Some(bound) = &mut self.bound {
            bound.restart(filled + 1);
        }
    }

    /// Room for the longest window, so that no step allocates.
    pub fn reserve(&mut self, design: &Design) {
        let (n, p) = (design.history.n(), design.history.p());
        let depth = design.settings.horizon;
        let driven = design.driving.is_some();
        let Estimate { x, window, v, w, .. } = &mut self.estimate;
        x.reserve(n - x.len());
        w.reserve(if driven { depth * n - w.len() } else { 0 });
        window.reserve((depth + 1) * n - window.len());
        v.reserve(depth * p - v.len());
        if let Some(bound) = &mut self.bound {
            bound.reserve(depth + 2);
        }
        if let Some(first) = &mut self.first {
            first.reserve(depth * (p + design.history.m()) - first.len());
        }
    }

    /// Another window.
    #[cold]
    pub fn refill(&mut self, design: &Design, window: &Samples, elsewhere: bool) {
        self.memory.clear();
        for x in window.states.chunks_exact(design.history.n()) {
            self.memory.push_state(x.iter().copied());
        }
        for y in window.outputs.chunks_exact(design.history.p()) {
            self.memory.push_output(y.iter().copied());
        }
        for u in window.inputs.chunks_exact(design.history.m().max(1)) {
            self.memory.push_input(u.iter().copied());
        }
        let unknown = self.start == Start::Unknown;
        self.memory.begin(&design.ground.shared(), unknown, elsewhere);
    }

    /// Whether a step may be a filter's, with nothing but x̂(t) made: see
    /// [`advance_alone`](Self::advance_alone).
    pub fn may_be_alone(&self, design: &Design) -> bool {
        let sizes = design.ground.sizes();
        let bounded = sizes.x_bounded || sizes.v_bounded || sizes.w_bounded;
        sizes.recorded && !bounded && self.bound.is_none()
    }

    /// As [`advance`](Self::advance) without window, noise and disturbance, which are those of an
    /// earlier step then; false where this step is no filter's: nothing has changed then.
    #[inline]
    pub fn advance_alone(&mut self, design: &Design, (y, u): (&[f64], &[f64])) -> bool {
        let horizon = design.settings.horizon;
        let opens = self.memory.grows(horizon) || self.first.is_some();
        if opens || self.estimate.x.is_empty() {
            return false;
        }
        let full = self.memory.len() == horizon;
        let prepared = design.problem(self.memory.len() + usize::from(!full));
        let fallback = &Fallbacks { design, weights: &design.weights, prepared };
        let (problem, memory) = (prepared.problem(), &mut self.memory);
        let mut pass = Pass { problem, memory, fallback, x_bounds: None };
        let Some(cost) = pass.alone(y, u, &mut self.estimate.x) else { return false };
        if full {
            self.memory.forget(&design.problems[0].problem().shared);
        }
        (self.estimate.cost, self.estimate.status) = (cost, Status::Optimal);
        (self.estimate.active, self.estimate.iterations) = (0, 0);
        self.t += 1;
        self.note(design, y);
        true
    }

    /// One pass of Algorithm 1's loop, on checked input: nothing can go wrong that is not a status.
    #[inline]
    pub fn advance(
        &mut self,
        design: &Design,
        (y, u): (&[f64], &[f64]),
        x_bounds: Option<&Bounds>,
    ) -> &Estimate {
        let horizon = design.settings.horizon;
        if self.memory.len() == horizon {
            self.memory.forget(&design.problems[0].problem().shared);
            if let Some(bound) = &mut self.bound {
                bound.forget();
            }
        }
        // the window of this step holds all outputs of a run from an unknown state
        let opening = design.opening.get().filter(|_| self.memory.grows(horizon));
        let (mut prepared, mut weights) = problem(design, opening, self.memory.len() + 1);
        let x_bounds = x_bounds.map(|bounds| Limits { lo: &bounds.lo, hi: &bounds.hi });
        let (own, another);
        own = Fallbacks { design, weights, prepared };
        let (memory, of_depth) = (&mut self.memory, prepared.problem());
        let mut pass = Pass { problem: of_depth, memory, fallback: &own, x_bounds };
        let missing = pass.take_in(y, u);
        if pass.doubt_newest() {
            (prepared, weights) = problem(design, design.opening.get(), pass.memory.len());
            another = Fallbacks { design, weights, prepared };
            (pass.problem, pass.fallback) = (prepared.problem(), &another);
            pass.fit_window();
        }
        let layout = prepared.layout();
        pass.x_bounds = x_bounds.map(|bounds| newest_rows(bounds, layout));
        let estimate = &mut self.estimate;
        if estimate.v.len() != layout.outputs_len() {
            fit(estimate, layout);
        }
        let Estimate { x, window, v, w, bound: error_bound, .. } = estimate;
        let mut out = Answer { x, window, v, w };
        let found = pass.find(y, missing, &mut out);
        match &mut self.bound {
            None => {
                pass.hand_out(&found, &mut out, |_, _| {});
            }
            Some(bound) => *error_bound = Some(bounded(design, bound, &mut pass, &found, &mut out)),
        }
        if self.first.is_some() {
            self.goes_on = self.memory.goes_on(prepared.problem(), &found.solution);
        }
        let WindowSolution { status, cost, active, iterations, .. } = found.solution;
        (estimate.cost, estimate.status) = (cost, status);
        (estimate.active, estimate.iterations) = (active, iterations);
        self.t += 1;
        self.note(design, y);
        if self.memory.since() == layout.depth {
            smooth(&design.ground.shared(), &mut self.memory, &self.estimate.window);
        }
        &self.estimate
    }
}

impl Run {
    /// What the newest step showed that the recording did not.
    #[inline(always)]
    fn note(&mut self, design: &Design, y: &[f64]) {
        design.watch.note(&mut self.seen, y, self.t);
        if design.history.m() > 0 {
            design.input_watch.note(&mut self.seen_inputs, self.memory.window_inputs(), self.t);
        }
        let Some(own) = &mut self.estimate.evidence else { return };
        let shared = &design.problems[0].problem().shared;
        if let Some(found) = self.memory.evidence(&shared.evidence)
            && let Some(known) = &shared.evidence
        {
            own.update(&found);
            self.doubts.note(own, known, &self.estimate.x, self.t);
        }
    }
}

/// Bounds row by row, of as many states as a window has that was cut short.
fn newest_rows(bounds: Limits<'_>, layout: Layout) -> Limits<'_> {
    let rows = bounds.lo.len();
    let first = if rows > layout.n { rows.saturating_sub(layout.states_len()) } else { 0 };
    Limits { lo: &bounds.lo[first..], hi: &bounds.hi[first..] }
}

/// Room for the windows of another depth.
#[cold]
fn fit(estimate: &mut Estimate, layout: Layout) {
    estimate.x.resize(layout.n, 0.0);
    estimate.window.resize(layout.states_len(), 0.0);
    estimate.v.resize(layout.outputs_len(), 0.0);
    estimate.w.resize(layout.disturbances_len(), 0.0);
}

/// The problem for so many outputs, and the weights that it was made with: that of an unknown start
/// where the window holds all outputs of the run.
#[inline(always)]
fn problem<'a>(
    design: &'a Design,
    opening: Option<&'a Opening>,
    outputs: usize,
) -> (&'a Prepared, &'a Weights) {
    let regular = design.problem(outputs);
    match opening {
        Some(opening) if regular.layout().depth == outputs => {
            (&opening.problems[design.place(outputs)], &opening.weights)
        }
        _ => (regular, &design.weights),
    }
}

/// Hands out what was found, with a bound on ‖x̂(t) - x(t)‖.
#[cold]
fn bounded(
    design: &Design,
    bound: &mut ErrorBound,
    pass: &mut Pass<'_, Block, Fallbacks<'_>>,
    found: &Found,
    out: &mut Answer<'_>,
) -> f64 {
    let n = design.history.n();
    if found.forgot {
        bound.forget_all();
    }
    let (states, outputs) = (pass.memory.past(), pass.memory.window());
    let (inputs, scaling) = (pass.memory.window_inputs(), &design.scaling);
    let past = |k: usize| scaling.state(k % n, states[k]);
    let output = |k: usize| scaling.output(k, outputs[k]);
    let input = |k: usize| scaling.input(k, inputs[k]);
    let error = bound.advance(out.window, (output, out.v), input, past);
    if found.anew {
        bound.forget_past();
    }
    error + pass.hand_out(found, out, |x, inside| bound.moved(|i| inside[i] - x[i]))
}
