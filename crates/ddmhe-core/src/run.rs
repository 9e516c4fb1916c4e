//! One run of an estimator: what changes from step to step, and the step itself, on checked input.
//!
//! A step is a [`Pass`] of [`ddmhe_run::stepper`], which tells what becomes of windows without a
//! minimiser. What a step of that crate cannot do in flight, [`Fallbacks`] does here.

use crate::block::Block;
use crate::config::{Bounds, Start};
use crate::config_checks::check_measured;
use crate::design::Design;
use crate::doubts::Doubts;
use crate::error::Error;
use crate::error_bound::ErrorBound;
use crate::estimate::{Estimate, Evidence};
use crate::fallback::Fallbacks;
use crate::first_window::{Samples, filled, first_window};
use crate::history::check_finite;
use crate::inputs::SeenInputs;
use crate::plan_builder::Prepared;
use crate::start::Opening;
use crate::watch::Seen;
use crate::weights::Weights;
use ddmhe_run::active_set::ActiveBound;
use ddmhe_run::layout::Layout;
use ddmhe_run::memory::{Judged, Memory, memory_len};
use ddmhe_run::plan::Limits;
use ddmhe_run::problem::WindowSolution;
use ddmhe_run::stepper::{Answer, Found, Pass, smooth};
use ddmhe_run::{Reasons, Status};
use serde::{Deserialize, Serialize};

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
}

/// What a run is continued from in another process.
#[derive(Serialize, Deserialize)]
pub(crate) struct Saved {
    window: Samples,
    bounds: Vec<f64>,
    active: Vec<(usize, f64)>, // rows and sides of the active bounds
    moves: bool,
    chain: bool,    // whether the estimates are one filter's
    tail: Vec<f64>, // covariance of the oldest, unless it is the stationary one
    seen: Seen,
    seen_inputs: SeenInputs,
    doubts: Doubts,
    evidence: Option<SavedEvidence>,
    pub start: Start, // of the run, which reset may have changed
    t: usize,
    estimate: Estimate,
}

/// Of it, what evidence is made from.
#[derive(Serialize, Deserialize)]
struct SavedEvidence {
    kept: Vec<f64>,
    covariances: Vec<f64>,
    scores: Vec<f64>,
    since: usize,
    inflation: f64,
    steps: f64,
    samples: f64,
    value: f64,
    limit: f64,
    reasons: u8,
}

impl SavedEvidence {
    fn of(memory: &Memory<Block>) -> Option<Self> {
        let ([kept, covariances, scores], judged) = memory.saved_evidence()?;
        Some(SavedEvidence {
            kept: kept.to_vec(),
            covariances: covariances.to_vec(),
            scores: scores.to_vec(),
            since: judged.since,
            inflation: judged.inflation,
            steps: judged.steps,
            samples: judged.samples,
            value: judged.value,
            limit: judged.limit,
            reasons: judged.reasons.bits(),
        })
    }

    /// Whether it is of so many states.
    fn fits(&self, memory: &Memory<Block>, n: usize, states: usize) -> bool {
        let [kept, steps] = memory.saved_evidence_len();
        self.kept.len() == kept
            && self.covariances.len() == states * n * n
            && self.covariances.iter().all(|v| v.is_finite())
            && self.scores.len() <= 2 * steps
            && self.scores.len().is_multiple_of(2)
            && self.inflation >= 0.0
    }

    fn resume(&self, memory: &mut Memory<Block>) {
        let SavedEvidence { since, inflation, steps, samples, value, limit, .. } = *self;
        let reasons = Reasons::from_bits(self.reasons);
        let judged = Judged { since, inflation, steps, samples, value, limit, reasons };
        memory.resume_evidence([&self.kept, &self.covariances, &self.scores], judged);
    }
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

    /// What [`resume`](Self::resume) continues from.
    pub fn saved(&self) -> Saved {
        Saved {
            window: Samples {
                states: self.memory.states().to_vec(),
                outputs: self.memory.outputs().to_vec(),
                inputs: self.memory.inputs().to_vec(),
            },
            bounds: self.bound.as_ref().map_or(&[][..], ErrorBound::errors).to_vec(),
            active: self.memory.active().map(|side| (side.row, side.sign)).collect(),
            moves: self.memory.moves(),
            chain: self.memory.is_chain(),
            tail: self.memory.tail().map_or_else(Vec::new, <[f64]>::to_vec),
            seen: self.seen.clone(),
            seen_inputs: self.seen_inputs.clone(),
            doubts: self.doubts.clone(),
            evidence: SavedEvidence::of(&self.memory),
            start: self.start,
            t: self.t,
            estimate: self.estimate.clone(),
        }
    }

    /// Continues a saved run from the same start.
    pub fn resume(&mut self, design: &Design, saved: Saved) -> Result<(), Error> {
        let Saved { window, bounds, moves, chain, tail, .. } = saved;
        let Saved { seen, seen_inputs, doubts, evidence, t, estimate, .. } = saved;
        let Samples { states, outputs, inputs } = &window;
        let (n, p, m) = (design.history.n(), design.history.p(), design.history.m());
        let samples = outputs.len() / p;
        let active = saved.active.iter().map(|&(row, sign)| ActiveBound { row, sign });
        let active: Vec<ActiveBound> = active.collect();
        let fits = samples <= design.settings.horizon
            && outputs.len() == samples * p
            && states.len() == (samples + 1) * n
            && inputs.len() == samples * m
            && bounds.len() == if self.bound.is_some() { samples + 1 } else { 0 }
            && bounds.iter().all(|e| *e >= 0.0)
            && t < usize::MAX / 2
            && estimate.fits(n, p)
            && evidence.is_some() == design.ground.sizes().judged()
            && evidence.as_ref().is_none_or(|own| own.fits(&self.memory, n, samples + 1))
            && estimate.evidence.is_some() == evidence.is_some()
            && (estimate.w.is_empty() || design.driving.is_some())
            && (tail.is_empty() || design.ground.sizes().recorded && tail.len() == n * n)
            && design.input_watch.allows(&seen_inputs)
            && estimate.v.len() <= design.settings.horizon * p
            && (active.is_empty() || design.problem(samples).allows(&active));
        if !fits || !design.reaches(samples + 1) {
            return Err(Error::value(
                "blob",
                "a window that fits the horizon",
                format!("{samples} samples"),
            ));
        }
        check_measured("blob", outputs, p)?;
        check_finite("blob", states, n)?;
        check_finite("blob", inputs, m)?;
        check_finite("blob", &tail, n)?;
        design.watch.check(&seen)?;
        doubts.check(&design.history)?;
        self.refill(design, &window, false);
        self.memory.resume(design.problem(samples).layout().depth, &active, moves);
        self.memory.resume_filter(&design.ground.shared(), (chain, &tail));
        if let Some(evidence) = evidence {
            evidence.resume(&mut self.memory);
        }
        (self.seen, self.t, self.estimate) = (seen, t, estimate);
        (self.seen_inputs, self.doubts) = (seen_inputs, doubts);
        self.reserve(design);
        if let Some(bound) = &mut self.bound {
            bound.resume(&bounds);
        }
        Ok(())
    }

    /// Room for the longest window, so that no step allocates.
    fn reserve(&mut self, design: &Design) {
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
    }

    /// Another window.
    #[cold]
    fn refill(&mut self, design: &Design, window: &Samples, elsewhere: bool) {
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
        self.memory.prepare(&design.ground.shared());
        let unknown = self.start == Start::Unknown;
        self.memory.start_evidence(&design.ground.shared(), unknown, elsewhere);
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
        if self.start == Start::Unknown && self.t < horizon || self.estimate.x.is_empty() {
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
        let growing = self.start == Start::Unknown && self.t < horizon;
        let opening = design.opening.get().filter(|_| growing);
        let (prepared, weights) = problem(design, opening, self.memory.len() + 1);
        let layout = prepared.layout();
        let estimate = &mut self.estimate;
        if estimate.v.len() != layout.outputs_len() {
            fit(estimate, layout);
        }
        let Estimate { x, window, v, w, bound: error_bound, .. } = estimate;
        let mut out = Answer { x, window, v, w };
        let fallback = &Fallbacks { design, weights, prepared };
        let (problem, memory) = (prepared.problem(), &mut self.memory);
        let x_bounds = x_bounds.map(|bounds| Limits { lo: &bounds.lo, hi: &bounds.hi });
        let mut pass = Pass { problem, memory, fallback, x_bounds };
        let found = pass.consume(y, u, &mut out);
        match &mut self.bound {
            None => {
                pass.hand_out(&found, &mut out, |_, _| {});
            }
            Some(bound) => *error_bound = Some(bounded(design, bound, &mut pass, &found, &mut out)),
        }
        let WindowSolution { status, cost, active, iterations, .. } = found.solution;
        (estimate.cost, estimate.status) = (cost, status);
        (estimate.active, estimate.iterations) = (active, iterations);
        self.t += 1;
        self.note(design, y);
        if self.start == Start::Unknown && self.t == layout.depth {
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
