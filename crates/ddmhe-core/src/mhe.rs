//! Data-driven moving horizon estimation: Algorithm 1 of Liu 2026.
//!
//! What is computed at construction is a [`Design`]; a step is a [`Pass`] of
//! [`ddmhe_run::stepper`], which tells what becomes of windows without a minimiser. What a step of
//! that crate cannot do in flight, [`Fallbacks`] does here.

use crate::certificate::ErrorBound;
use crate::check::check_vector;
use crate::config::{
    Bounds, Config, Settings, Start, check_beside, check_box, check_measured, check_output,
    check_start,
};
use crate::design::{Design, check_reach, filled, first_window};
use crate::error::Error;
use crate::estimate::{Estimate, Log};
use crate::history::{History, check_finite};
use crate::interrupt::Interrupt;
use crate::plan_builder::Prepared;
use crate::start::Opening;
use crate::watch::Seen;
use crate::way_out::Fallbacks;
use crate::weights::Weights;
use ddmhe_run::active_set::ActiveBound;
use ddmhe_run::layout::Layout;
use ddmhe_run::memory::{Memory, memory_len};
use ddmhe_run::plan::Limits;
use ddmhe_run::problem::WindowSolution;
use ddmhe_run::stepper::{Answer, Found, Pass, smooth};
use std::sync::Arc;

/// The estimator. A copy continues on its own from the same window and shares everything that was
/// computed at construction.
pub struct DdMhe {
    design: Arc<Design>,
    config: Config,
    start: Start, // of this run
    opening: Option<Arc<Opening>>,
    bound: Option<ErrorBound>,
    memory: Memory<Vec<f64>>, // y(t-M_t) … y(t-1), x̂(t-M_t) … x̂(t) and room for a step
    seen: Seen,               // what the outputs did that they never did in the recording
    t: usize,
    estimate: Estimate,
}

impl Clone for DdMhe {
    fn clone(&self) -> Self {
        let mut copy = DdMhe {
            design: Arc::clone(&self.design),
            config: self.config.clone(),
            start: self.start,
            opening: self.opening.clone(),
            bound: self.bound.clone(),
            memory: self.memory.clone(),
            seen: self.seen.clone(),
            t: self.t,
            estimate: self.estimate.clone(),
        };
        copy.reserve(); // a copied vector has no room to grow
        copy
    }
}

impl DdMhe {
    /// Prepares the estimator: checks every argument, fills in the defaults and factors the
    /// problems of all depths.
    ///
    /// # Errors
    /// [`Error::Value`], [`Error::Shape`] or [`Error::NotFinite`] naming the setting at fault;
    /// [`Error::Rank`] when the recording is too short for the horizon or violates the rank
    /// condition (7).
    pub fn new(history: &History, config: Config) -> Result<Self, Error> {
        let design = Design::new(history, &config, config.start)?;
        let mut mhe = DdMhe {
            start: config.start,
            opening: None,
            bound: design.bound.clone(),
            memory: memory(&design),
            seen: Seen::default(),
            t: 0,
            estimate: Estimate::default(),
            design: Arc::new(design),
            config,
        };
        mhe.prepare(mhe.start)?;
        mhe.restart(None);
        Ok(mhe)
    }

    /// Consumes y(t-1) (p numbers, NaN = this entry was not measured) and returns the estimate
    /// x̂(t). Whatever its status, x and the window are finite and, unless the status is optimal,
    /// exactly inside the box on the states; see the head of this module for what they then are,
    /// and for what later steps take for x̄.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] (infinite entry); the estimator is then unchanged.
    pub fn step(&mut self, y: &[f64]) -> Result<&Estimate, Error> {
        self.step_within(y, None)
    }

    /// [`step`](Self::step) with other state bounds for this step alone: lo and hi hold n numbers
    /// each, or one row per state of the window, (M_t+1)·n with M_t =
    /// [`next_depth`](Self::next_depth).
    ///
    /// # Errors
    /// As [`step`](Self::step), and for bounds of the wrong size, NaN or crossed.
    pub fn step_within(
        &mut self,
        y: &[f64],
        x_bounds: Option<&Bounds>,
    ) -> Result<&Estimate, Error> {
        check_output(y, self.design.history.p())?;
        if let Some(bounds) = x_bounds {
            let n = self.design.history.n();
            check_box("x_bounds", bounds, &[n, (self.next_depth() + 1) * n])?;
        }
        Ok(self.advance(y, x_bounds))
    }

    /// All steps of a log `ys` (N·p, time-major): the same numbers as N calls of
    /// [`step`](Self::step).
    ///
    /// # Errors
    /// As [`step`](Self::step); the whole log is checked first, so a bad row leaves the estimator
    /// unchanged. Nothing errs after that.
    pub fn run(&mut self, ys: &[f64]) -> Result<Log, Error> {
        self.run_until(ys, &mut || false)
    }

    /// [`run`](Self::run) until `stop`, asked every 50 ms or so, is true: the log then ends with
    /// the last step made, where the estimator stands.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_until(&mut self, ys: &[f64], stop: &mut dyn FnMut() -> bool) -> Result<Log, Error> {
        let p = self.design.history.p();
        if !ys.len().is_multiple_of(p) {
            return Err(Error::shape("Y", format!("a multiple of p = {p} numbers"), ys.len()));
        }
        check_measured("Y", ys, p)?;
        let mut log = Log::default();
        let mut interrupt = Interrupt::new(stop);
        for y in ys.chunks_exact(p) {
            if interrupt.stopped() {
                break;
            }
            let estimate = self.advance(y, None);
            log.x.extend_from_slice(&estimate.x);
            log.cost.push(estimate.cost);
            log.status.push(estimate.status);
            log.active.push(estimate.active);
            log.iterations.push(estimate.iterations);
            log.bound.extend(estimate.bound);
        }
        Ok(log)
    }

    /// Back to t = 0 as a new estimator: from x̄(0) (n) if given, otherwise from where the
    /// configuration says.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] for `x_prior`.
    pub fn reset(&mut self, x_prior: Option<&[f64]>) -> Result<(), Error> {
        let start = if x_prior.is_some() { Start::State } else { self.config.start };
        self.reset_from(start, x_prior)
    }

    /// Back to t = 0 as an estimator that was made with this start, and with x̄(0) (n) if given.
    /// The first run from another start than before may have to factor the problems that it needs.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] for `x_prior`; [`Error::Value`] for a start that
    /// contradicts it, or an unknown one beside a disturbance. The estimator is then unchanged.
    pub fn reset_from(&mut self, start: Start, x_prior: Option<&[f64]>) -> Result<(), Error> {
        if let Some(x) = x_prior {
            check_vector("x_prior", x, self.design.history.n())?;
            check_reach("x_prior", &self.design.scaling, x, &[])?;
            check_start(start)?;
        }
        check_beside(&self.config, start)?;
        self.prepare(start)?;
        self.restart(x_prior);
        Ok(())
    }

    /// Number of states n.
    pub fn n(&self) -> usize {
        self.design.history.n()
    }

    /// Number of outputs p.
    pub fn p(&self) -> usize {
        self.design.history.p()
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.design.settings
    }

    /// What a new run of this estimator needs in flight, as bytes for
    /// [`ddmhe_run::Plan::from_bytes`]: no recording, no solver, no standard library.
    ///
    /// # Errors
    /// [`Error::Value`] where estimates carry an error bound, which a plan has not.
    pub fn plan(&self) -> Result<Vec<u8>, Error> {
        if self.is_bounded() {
            let found = "an estimator with error bounds";
            return Err(Error::value("disturbance", "none, for a plan", found));
        }
        let start = self.config.start; // of a new run, whatever this one is
        let Design { history, settings, ground, .. } = &*self.design;
        if ground.sizes().filled != filled(history, start, settings.horizon) {
            return DdMhe::new(history, self.config.clone())?.plan();
        }
        let opening = self.opening.as_deref().filter(|_| start == Start::Unknown);
        let opening = opening.map_or(&[][..], |opening| &opening.problems);
        Ok(self.design.ground.bytes(&self.design.problems, opening))
    }

    /// The configuration that was asked for.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Whether estimates carry an error bound; [`warnings`](Self::warnings) says why not, if one
    /// was asked for.
    pub fn is_bounded(&self) -> bool {
        self.bound.is_some()
    }

    /// Where this run started.
    pub fn start(&self) -> Start {
        self.start
    }

    /// Steps taken since the start or the last reset.
    pub fn t(&self) -> usize {
        self.t
    }

    /// Depth M_t of the next step's window.
    pub fn next_depth(&self) -> usize {
        let outputs = (self.memory.len() + 1).min(self.design.settings.horizon);
        self.design.problem(outputs).layout().depth
    }

    /// Spectral radius of the map x̄(t-M) → x̂(t) without new information: above 1 errors grow.
    pub fn spectral_radius(&self) -> f64 {
        self.design.spectral_radius
    }

    /// What a user should know, in words: about the recording and the settings, and since when
    /// outputs do what they never did in the recording (the list then grows).
    pub fn warnings(&self) -> Vec<String> {
        let online = self.design.watch.words(&self.seen, self.design.history.dt());
        self.design.warnings.iter().cloned().chain(online).collect()
    }

    /// What the outputs did that they never did in the recording, for a snapshot.
    pub(crate) fn seen(&self) -> &Seen {
        &self.seen
    }

    /// Takes up saved notes on the outputs.
    pub(crate) fn recall(&mut self, seen: Seen) -> Result<(), Error> {
        self.design.watch.check(&seen)?;
        self.seen = seen;
        Ok(())
    }

    /// The latest estimate (empty before the first step).
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The recording behind the estimator.
    pub fn history(&self) -> &History {
        &self.design.history
    }

    /// Outputs and states of the current window, as scaled deviations.
    pub(crate) fn window(&self) -> (&[f64], &[f64]) {
        (self.memory.outputs(), self.memory.states())
    }

    /// Error bounds of the states in [`window`](Self::window), empty without.
    pub(crate) fn bounds(&self) -> &[f64] {
        self.bound.as_ref().map_or(&[], ErrorBound::errors)
    }

    /// Bounds that were active in the last step, in the order in which they were taken in, and
    /// whether they move with time.
    pub(crate) fn active_bounds(&self) -> (Vec<ActiveBound>, bool) {
        (self.memory.active().collect(), self.memory.moves())
    }

    /// Continues from a saved window.
    pub(crate) fn resume(
        &mut self,
        (outputs, states): (&[f64], &[f64]),
        bounds: Vec<f64>,
        (active, moves): (Vec<ActiveBound>, bool),
        (t, estimate): (usize, Estimate),
    ) -> Result<(), Error> {
        let (n, p) = (self.n(), self.p());
        let samples = outputs.len() / p;
        let fits = samples <= self.design.settings.horizon
            && outputs.len() == samples * p
            && states.len() == (samples + 1) * n
            && bounds.len() == if self.bound.is_some() { samples + 1 } else { 0 }
            && bounds.iter().all(|e| *e >= 0.0)
            && t < usize::MAX / 2
            && estimate.fits(n, p)
            && estimate.v.len() <= self.design.settings.horizon * p
            && (active.is_empty() || self.design.problem(samples).allows(&active));
        if !fits || !self.design.reaches(samples + 1) {
            return Err(Error::value(
                "blob",
                "a window that fits the horizon",
                format!("{samples} samples"),
            ));
        }
        check_measured("blob", outputs, p)?;
        check_finite("blob", states, n)?;
        self.refill(outputs, states);
        self.memory.resume(self.design.problem(samples).layout().depth, &active, moves);
        self.estimate = estimate;
        self.reserve();
        self.t = t;
        if let Some(bound) = &mut self.bound {
            bound.resume(&bounds);
        }
        Ok(())
    }

    /// Everything that a run from this start needs.
    pub(crate) fn prepare(&mut self, start: Start) -> Result<(), Error> {
        if start != Start::Recording && !self.design.reaches(1) {
            let design = Design::new(&self.design.history, &self.config, start)?;
            self.memory = memory(&design);
            self.design = Arc::new(design);
        }
        if start == Start::Unknown && self.opening.is_none() {
            self.opening = Some(Arc::new(Opening::new(&self.design, &self.config)?));
        }
        self.start = start;
        Ok(())
    }

    /// The state of a new estimator; nothing of what was before may reach a later number.
    fn restart(&mut self, x_prior: Option<&[f64]>) {
        let design = Arc::clone(&self.design);
        let (history, scaling) = (&design.history, &design.scaling);
        self.t = 0;
        self.estimate = Estimate::default();
        self.seen = design.watch.start();
        self.reserve();
        let filled = filled(history, self.start, design.settings.horizon);
        let x_prior = x_prior.or(self.config.x_prior.as_deref());
        let (states, outputs) = first_window(history, scaling, self.start, filled, x_prior);
        self.refill(&outputs, &states);
        if let Some(bound) = &mut self.bound {
            bound.restart(filled + 1);
        }
    }

    /// Room for the longest window, so that no step allocates.
    fn reserve(&mut self) {
        let (n, p, depth) = (self.n(), self.p(), self.design.settings.horizon);
        let Estimate { x, window, v, .. } = &mut self.estimate;
        x.reserve(n - x.len());
        window.reserve((depth + 1) * n - window.len());
        v.reserve(depth * p - v.len());
        if let Some(bound) = &mut self.bound {
            bound.reserve(depth + 2);
        }
    }

    /// A window of other outputs and states.
    fn refill(&mut self, outputs: &[f64], states: &[f64]) {
        let (n, p) = (self.n(), self.p());
        self.memory.clear();
        for x in states.chunks_exact(n) {
            self.memory.push_state(x.iter().copied());
        }
        for y in outputs.chunks_exact(p) {
            self.memory.push_output(y.iter().copied());
        }
    }

    /// One pass of Algorithm 1's loop, on checked input: nothing can go wrong that is not a status.
    fn advance(&mut self, y: &[f64], x_bounds: Option<&Bounds>) -> &Estimate {
        let horizon = self.design.settings.horizon;
        if self.memory.len() == horizon {
            self.memory.forget();
            if let Some(bound) = &mut self.bound {
                bound.forget();
            }
        }
        let outputs = self.memory.len() + 1;
        let design = &*self.design;
        let opening = self.opening.as_deref().filter(|_| self.growing());
        let (prepared, weights) = problem(design, opening, outputs);
        let layout = prepared.layout();
        let estimate = &mut self.estimate;
        if estimate.v.len() != layout.outputs_len() {
            fit(estimate, layout);
        }
        let Estimate { x, window, v, bound: error_bound, .. } = estimate;
        let mut out = Answer { x, window, v };
        let fallback = &Fallbacks { design, weights, prepared };
        let (problem, memory) = (prepared.problem(), &mut self.memory);
        let x_bounds = x_bounds.map(|bounds| Limits { lo: &bounds.lo, hi: &bounds.hi });
        let mut pass = Pass { problem, memory, fallback, x_bounds };
        let found = pass.consume(y, &mut out);
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
        self.design.watch.note(&mut self.seen, y, self.t);
        if self.start == Start::Unknown && self.t == layout.depth {
            smooth(&self.design.ground.shared(), &mut self.memory, &self.estimate.window);
        }
        &self.estimate
    }

    /// Whether the window of the next step holds all outputs of a run from an unknown state.
    #[inline(always)]
    fn growing(&self) -> bool {
        self.start == Start::Unknown && self.t < self.design.settings.horizon
    }
}

/// Room for the windows of another depth.
#[cold]
fn fit(estimate: &mut Estimate, layout: Layout) {
    estimate.x.resize(layout.n, 0.0);
    estimate.window.resize(layout.states_len(), 0.0);
    estimate.v.resize(layout.outputs_len(), 0.0);
}

/// A memory for all windows of a design.
fn memory(design: &Design) -> Memory<Vec<f64>> {
    let sizes = design.ground.sizes();
    Memory::new(sizes, vec![0.0; memory_len(sizes)])
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
    pass: &mut Pass<'_, Vec<f64>, Fallbacks<'_>>,
    found: &Found,
    out: &mut Answer<'_>,
) -> f64 {
    let n = design.history.n();
    if found.forgot {
        bound.forget_all();
    }
    let (states, outputs) = (pass.memory.past(), pass.memory.window());
    let past = |k: usize| design.scaling.state(k % n, states[k]);
    let error = bound.advance(out.window, |k| design.scaling.output(k, outputs[k]), out.v, past);
    if found.anew {
        bound.forget_past();
    }
    error + pass.hand_out(found, out, |x, inside| bound.moved(|i| inside[i] - x[i]))
}
