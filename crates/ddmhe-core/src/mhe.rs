//! Data-driven moving horizon estimation: Algorithm 1 of Liu 2026.
//!
//! At time t the window is y(t-M_t) … y(t-1) with M_t = min(t, M); the estimate is x̂(t), made from
//! outputs up to y(t-1). The prior x̄(t-M_t) is x̄(0) while the window grows and afterwards the
//! estimate made at that time (filtering update).
//!
//! *Where there is no minimiser.* An entry of y that is more than 1/ε deviations from the recording
//! is one that cannot be computed with: it counts as not measured, now and later, and the status of
//! its step is [`Status::Failed`]. If no window satisfies all bounds and the noise is bounded, the
//! newest output is one that no admissible window explains: it is left out in the same way, and the
//! estimate is that of the other outputs, within all bounds; its status stays
//! [`Status::Infeasible`]. Where the three samples before it say nothing (they were left out, or
//! lost) it is believed instead, the older ones are left out, and the past estimates are those of
//! this window. A window whose answer cannot be computed loses the output furthest out, or the
//! newest. Where none of that helps, the box is at fault: what is handed out is the minimiser
//! without bounds, its states moved into the box in force, and x̄ of later steps is that estimate
//! in the configured box alone: a box of one step is not remembered. An estimate that is itself
//! beyond 1/ε deviations is none: the window starts again from the recording's mean and from no
//! output.

use crate::active_set::{ActiveBound, WorkingSet};
use crate::certificate::ErrorBound;
use crate::check::check_vector;
use crate::config::{
    Bounds, Config, Settings, Start, check_beside, check_box, check_measured, check_output,
    check_start,
};
use crate::design::{Design, check_reach, filled};
use crate::error::Error;
use crate::estimate::{Estimate, Log};
use crate::history::{History, check_finite};
use crate::interrupt::Interrupt;
use crate::memory::Memory;
use crate::start::Opening;
use crate::status::Status;
use crate::tol;
use crate::watch::Seen;
use crate::weights::Weights;
use crate::window::{Data, Scratch, WindowProblem, WindowSolution};
use std::sync::Arc;

/// The estimator. A copy continues on its own from the same window and shares everything that was
/// computed at construction.
pub struct DdMhe {
    design: Arc<Design>,
    config: Config,
    start: Start, // of this run
    opening: Option<Arc<Opening>>,
    growing: usize, // the first steps, whose problems are those of the opening
    bound: Option<ErrorBound>,
    memory: Memory,   // y(t-M_t) … y(t-1) and x̂(t-M_t) … x̂(t)
    kept: WorkingSet, // active bounds of the last step
    seen: Seen,       // what the outputs did that they never did in the recording
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
            growing: self.growing,
            bound: self.bound.clone(),
            memory: self.memory.clone(),
            kept: self.kept.clone(),
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
    /// [`Error::Value`], [`Error::Shape`] or [`Error::NotFinite`] naming the setting at fault; [`Error::Rank`] when the
    /// recording is too short for the horizon or violates the rank condition (7).
    pub fn new(history: &History, config: Config) -> Result<Self, Error> {
        let design = Design::new(history, &config, config.start)?;
        let mut mhe = DdMhe {
            start: config.start,
            opening: None,
            growing: 0,
            bound: design.bound.clone(),
            memory: Memory::new(history.n(), history.p(), design.settings.horizon, design.rank),
            kept: WorkingSet::default(),
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

    /// [`step`](Self::step) with other state bounds for this step alone: lo and hi hold n numbers each, or one row per state of
    /// the window, (M_t+1)·n with M_t = [`next_depth`](Self::next_depth).
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

    /// [`run`](Self::run) until `stop`, asked every 50 ms or so, is true: the log then ends with the last step made, where the
    /// estimator stands.
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
    /// [`Error::Shape`] or [`Error::NotFinite`] for `x_prior`; [`Error::Value`] for a start that contradicts it, or an unknown one
    /// beside a disturbance. The estimator is then unchanged.
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
        (self.memory.depth() + 1).min(self.design.settings.horizon)
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
    pub(crate) fn active_bounds(&self) -> (&[ActiveBound], bool) {
        (&self.kept.sides, self.kept.moves)
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
            && (active.is_empty()
                || self.design.problem(samples).is_some_and(|problem| problem.allows(&active)));
        if !fits || samples < self.design.first - 1 {
            return Err(Error::value(
                "blob",
                "a window that fits the horizon",
                format!("{samples} samples"),
            ));
        }
        check_measured("blob", outputs, p)?;
        check_finite("blob", states, n)?;
        self.refill(outputs.iter().copied(), states.iter().copied());
        self.kept = WorkingSet::new(active, moves);
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
        if start != Start::Recording && self.design.first > 1 {
            let design = Design::new(&self.design.history, &self.config, start)?;
            self.memory = Memory::new(self.n(), self.p(), design.settings.horizon, design.rank);
            self.design = Arc::new(design);
        }
        if start == Start::Unknown && self.opening.is_none() {
            self.opening = Some(Arc::new(Opening::new(&self.design, &self.config)?));
        }
        self.growing = if start == Start::Unknown { self.design.settings.horizon } else { 0 };
        self.start = start;
        Ok(())
    }

    /// The state of a new estimator; nothing of what was before may reach a later number.
    fn restart(&mut self, x_prior: Option<&[f64]>) {
        let design = Arc::clone(&self.design);
        let (history, scaling) = (&design.history, &design.scaling);
        let (n, p) = (history.n(), history.p());
        self.t = 0;
        self.estimate = Estimate::default();
        self.seen = design.watch.start();
        self.kept = WorkingSet::default();
        self.reserve();
        let last = history.recordings() - 1;
        let filled = filled(history, self.start, design.settings.horizon);
        let (x, y) = (history.states(last), history.outputs(last));
        let mut states = x[x.len() - (filled + 1) * n..].to_vec();
        match (self.start, x_prior.or(self.config.x_prior.as_deref())) {
            (Start::State, Some(prior)) => states.copy_from_slice(prior),
            (Start::Unknown, _) => states.copy_from_slice(&scaling.mean_x),
            _ => {}
        }
        let outputs =
            y[y.len() - filled * p..].chunks_exact(p).flat_map(|y| scaling.deviations(&[], y));
        self.refill(outputs, states.chunks_exact(n).flat_map(|x| scaling.deviations(x, &[])));
        if let Some(bound) = &mut self.bound {
            bound.restart(filled + 1);
        }
    }

    /// Room for the longest window, so that no step allocates.
    fn reserve(&mut self) {
        let (n, p, depth) = (self.n(), self.p(), self.design.settings.horizon);
        let (rank, Estimate { x, window, v, .. }) = (self.design.rank, &mut self.estimate);
        x.reserve(n - x.len());
        window.reserve((depth + 1) * n - window.len());
        v.reserve(depth * p - v.len());
        self.kept.reserve(rank);
        if let Some(bound) = &mut self.bound {
            bound.reserve(depth + 2);
        }
    }

    /// A window of other outputs and states.
    fn refill(
        &mut self,
        mut outputs: impl Iterator<Item = f64>,
        mut states: impl Iterator<Item = f64>,
    ) {
        let (n, p) = (self.n(), self.p());
        self.memory.clear();
        while let Some(first) = states.next() {
            self.memory.push_state(std::iter::once(first).chain(states.by_ref().take(n - 1)));
        }
        while let Some(first) = outputs.next() {
            self.memory.push_output(std::iter::once(first).chain(outputs.by_ref().take(p - 1)));
        }
    }

    /// One pass of Algorithm 1's loop, on checked input: nothing can go wrong that is not a status.
    fn advance(&mut self, y: &[f64], x_bounds: Option<&Bounds>) -> &Estimate {
        if self.memory.depth() == self.next_depth() {
            self.memory.forget();
            if let Some(bound) = &mut self.bound {
                bound.forget();
            }
        } else {
            self.kept.clear(); // rows have other places in a window of another depth
        }
        let missing = self.memory.push_output(self.design.scaling.deviations(&[], y));
        let mut found = self.minimise(x_bounds);
        let anew = found.status != Status::Optimal && self.reconsider(&mut found, x_bounds);
        if missing > 0 && missing > y.iter().filter(|y| y.is_nan()).count() {
            found.status = Status::Failed; // an output that cannot be computed with
        }
        self.hand_out(found);
        if found.status != Status::Optimal {
            self.confine(x_bounds, anew);
        }
        self.t += 1;
        self.design.watch.note(&mut self.seen, y, self.t);
        if self.t == self.growing {
            self.smoothed();
        }
        &self.estimate
    }

    /// From the first full window of a run from an unknown state on, x̄ of the instants in it are
    /// its own states.
    #[cold]
    fn smoothed(&mut self) {
        let n = self.design.history.n();
        let past = self.estimate.window.chunks_exact(n).take(self.memory.depth());
        self.memory.replace_states(past.flat_map(|x| self.design.scaling.deviations(x, &[])));
    }

    /// The minimiser over the window in memory, its states and fitted noise into the estimate.
    #[inline(always)]
    fn minimise(&mut self, x_bounds: Option<&Bounds>) -> WindowSolution {
        let (design, Estimate { window: states, v, .. }) = (&*self.design, &mut self.estimate);
        let (problems, weights) = problems(design, self.opening.as_deref(), self.t < self.growing);
        let (problem, data, mut scratch) = window(design, problems, &mut self.memory, x_bounds);
        states.resize((problem.shape.depth + 1) * problem.shape.n, 0.0);
        v.resize(data.outputs.len(), 0.0);
        match problem.solve(
            weights,
            &design.limits,
            &data,
            (&mut self.kept, &mut scratch),
            (states, v),
        ) {
            Some(found) => found,
            None => {
                anew(design, (problem, weights), &data, (&mut self.kept, &mut scratch), (states, v))
            }
        }
    }

    /// The same of a window that was changed.
    #[cold]
    fn minimise_again(&mut self, x_bounds: Option<&Bounds>) -> WindowSolution {
        self.kept.clear();
        self.minimise(x_bounds)
    }

    /// The rest of the estimate, and x̂(t) into memory.
    #[inline]
    fn hand_out(&mut self, found: WindowSolution) {
        let (design, estimate) = (&*self.design, &mut self.estimate);
        let (n, window) = (design.history.n(), &estimate.window);
        estimate.x.clear();
        estimate.x.extend_from_slice(&window[window.len() - n..]);
        estimate.cost = found.cost;
        (estimate.status, estimate.active, estimate.iterations) =
            (found.status, found.active, found.iterations);
        estimate.bound = self.bound.as_mut().map(|bound| {
            let (states, outputs) = (self.memory.states(), self.memory.outputs());
            let past = |k: usize| design.scaling.state(k % n, states[k]);
            bound.advance(window, |k| design.scaling.output(k, outputs[k]), &estimate.v, past)
        });
        self.memory.push_state(design.scaling.deviations(&estimate.x, &[]));
    }

    /// What to make of a window without a minimiser, into the estimate; whether past estimates are
    /// to be forgotten.
    #[cold]
    fn reconsider(&mut self, found: &mut WindowSolution, x_bounds: Option<&Bounds>) -> bool {
        if found.status == Status::AlmostOptimal {
            return false;
        }
        let status = found.status;
        let mut anew = false;
        if status == Status::Failed || self.design.limits.v.is_some() {
            (*found, anew) = self.doubt(status == Status::Failed, x_bounds);
        }
        if !found.sound {
            self.memory.forget_all();
            if let Some(bound) = &mut self.bound {
                bound.forget_all();
            }
            *found = self.minimise_again(x_bounds);
        }
        if !found.sound {
            let (problems, weights) =
                problems(&self.design, self.opening.as_deref(), self.t < self.growing);
            let (problem, data, mut scratch) =
                window(&self.design, problems, &mut self.memory, x_bounds);
            let Estimate { window: states, v, .. } = &mut self.estimate;
            *found = problem.rest(weights, &data, &mut scratch, (states, v));
        }
        found.status = status;
        anew
    }

    /// The answer without the outputs that contradict the others: without the newest sample, or,
    /// where the
    /// [`DOUBTS`](tol::DOUBTS) before it say nothing, without all before it (true). Of a window that cannot be computed the sample
    /// furthest out is the first in doubt. What is doubted counts as not measured from then on;
    /// where nothing helps, nothing is.
    fn doubt(&mut self, failed: bool, x_bounds: Option<&Bounds>) -> (WindowSolution, bool) {
        let newest = self.memory.depth() - 1;
        let stale = newest >= tol::DOUBTS && self.memory.silent(newest - tol::DOUBTS..newest);
        let older = if stale && !failed { 0..newest } else { 0..0 };
        let furthest = if failed { self.memory.furthest() } else { newest };
        for doubted in [older, furthest..furthest + 1, newest..newest + 1] {
            if self.memory.silent(doubted.clone()) {
                continue;
            }
            self.memory.set_aside(doubted.clone());
            let found = self.minimise_again(x_bounds);
            if found.status == Status::Optimal {
                return (found, doubted.len() > 1);
            }
            self.memory.take_back();
        }
        (self.minimise_again(x_bounds), false)
    }

    /// After a step that is not optimal: what is handed out is moved into the box in force, and
    /// what goes on as x̂(t) into the configured one, since a box for this step alone says nothing
    /// of later ones. With `anew` the estimates of the window's past are replaced by the window.
    #[cold]
    fn confine(&mut self, x_bounds: Option<&Bounds>, anew: bool) {
        let n = self.design.history.n();
        if anew {
            let past = self.estimate.window.chunks_exact(n);
            self.memory.replace_states(past.flat_map(|x| self.design.scaling.deviations(x, &[])));
            if let Some(bound) = &mut self.bound {
                bound.forget_past();
            }
        }
        self.move_into(None);
        let Estimate { x, window, .. } = &self.estimate;
        let inside = &window[window.len() - n..];
        self.memory.replace_newest(self.design.scaling.deviations(inside, &[]));
        if let Some(bound) = &mut self.bound {
            bound.moved(|i| inside[i] - x[i]);
        }
        if x_bounds.is_some() {
            self.move_into(x_bounds);
        }
        let Estimate { x, window, bound, .. } = &mut self.estimate;
        let inside = &window[window.len() - n..];
        let moved =
            x.iter().zip(inside).map(|(x, inside)| (x - inside).powi(2)).sum::<f64>().sqrt();
        *bound = bound.map(|bound| bound + moved);
        x.copy_from_slice(inside);
    }

    /// The estimate's window with its states moved into a box; None: the configured one.
    fn move_into(&mut self, x_bounds: Option<&Bounds>) {
        let (problems, _) = problems(&self.design, self.opening.as_deref(), self.t < self.growing);
        let (problem, data, mut scratch) =
            window(&self.design, problems, &mut self.memory, x_bounds);
        problem.confine(&self.design.limits, &data, &mut scratch, &mut self.estimate.window);
    }
}

/// The problems of this step, from depth `design.first` on, and the weights they were made with.
#[inline(always)]
fn problems<'a>(
    design: &'a Design,
    opening: Option<&'a Opening>,
    growing: bool,
) -> (&'a [WindowProblem], &'a Weights) {
    match opening {
        Some(opening) if growing => (&opening.problems, &opening.weights),
        _ => (&design.problems, &design.weights),
    }
}

/// What [`WindowProblem::solve`] finds of a problem made for what was measured; the mean window
/// where there is none.
#[cold]
fn anew(
    design: &Design,
    (problem, weights): (&WindowProblem, &Weights),
    data: &Data<'_>,
    (kept, scratch): (&mut WorkingSet, &mut Scratch<'_>),
    (states, v): (&mut [f64], &mut [f64]),
) -> WindowSolution {
    let made = design.without_missing(problem, weights, data.outputs).ok();
    made.and_then(|made| made.solve(weights, &design.limits, data, (kept, scratch), (states, v)))
        .unwrap_or_else(|| problem.rest(weights, data, scratch, (states, v)))
}

/// The problem of the window in memory, its data and room to solve it.
#[inline(always)]
fn window<'a>(
    design: &'a Design,
    problems: &'a [WindowProblem],
    memory: &'a mut Memory,
    x_bounds: Option<&'a Bounds>,
) -> (&'a WindowProblem, Data<'a>, Scratch<'a>) {
    let (depth, missing) = (memory.depth(), memory.missing());
    let (states, outputs, scratch) = memory.parts();
    // the filtering update: x̄(t-M_t) is the estimate that was made then, the oldest in memory
    let data = Data { prior: &states[..design.history.n()], outputs, missing, x_bounds };
    (&problems[depth - design.first], data, scratch)
}
