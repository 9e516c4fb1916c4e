//! Plans in flight: Algorithm 1 in memory of the caller's.

use crate::estimate::Estimate;
use crate::fallback::Alone;
use crate::memory::{Memory, memory_len};
use crate::plan::bytes::{Plan, PlanError};
use crate::plan::common::Sizes;
use crate::problem::{WindowProblem, WindowSolution};
use crate::status::Status;
use crate::stepper::{Answer, Pass, smooth};

/// An estimator that runs a plan in memory of the caller's: no allocation, no standard library.
///
/// Where a minimiser is not certain (nearly dependent active bounds, a window that has lost nearly
/// all outputs) there is no solver to ask, and the status is
/// [`Status::Failed`].
///
/// A plan that [finds its start](Plan::finds_start) begins as one that goes on from the recording's
/// end. Where one of the first M windows says that it does not, that step takes all outputs since
/// then in again, from an unknown state: it makes up to M steps in one.
#[derive(Debug)]
pub struct Stepper<'p, 'm> {
    plan: &'p Plan<'p>,
    memory: Memory<&'m mut [f64]>,
    answer: &'m mut [f64], // x, window, v, w of the deepest window
    log: &'m mut [f64],    // the first M samples [y; u], where the start is to be found
    problem: WindowProblem<'p>,
    of: (usize, bool), // outputs of its windows, and whether they are all since an unknown state
    found: WindowSolution,
    undecided: bool, // whether the start is still to be found
    certain: bool,   // whether all windows so far had their minimiser
    t: usize,
}

impl<'p, 'm> Stepper<'p, 'm> {
    /// Numbers that a stepper needs for this plan.
    pub fn room(plan: &Plan<'_>) -> usize {
        let sizes = plan.shared().sizes;
        let layout = sizes.layout(sizes.horizon);
        let answer = sizes.n + layout.states_len() + layout.outputs_len();
        memory_len(sizes) + answer + layout.disturbances_len() + Self::log_len(plan)
    }

    /// Numbers of the samples that a plan which finds its start keeps.
    fn log_len(plan: &Plan<'_>) -> usize {
        let Sizes { p, m, horizon, .. } = plan.shared().sizes;
        if plan.finds_start() { horizon * (p + m) } else { 0 }
    }

    /// A new run of a plan, in at least [`room`](Self::room) numbers. Steps are quickest where
    /// these begin on a cache line, as in [`Aligned`](crate::Aligned).
    ///
    /// # Errors
    /// [`PlanError::Room`] for fewer.
    pub fn new(plan: &'p Plan<'p>, memory: &'m mut [f64]) -> Result<Self, PlanError> {
        let sizes = plan.shared().sizes;
        if memory.len() < Self::room(plan) {
            return Err(PlanError::Room);
        }
        let (block, rest) = memory.split_at_mut(memory_len(sizes));
        let (log, answer) = rest.split_at_mut(Self::log_len(plan));
        let of = ((sizes.filled + 1).min(sizes.horizon), plan.starts_unknown());
        let problem = Self::block(plan, of).ok_or(PlanError::Sizes)?;
        let (memory, found) = (Memory::new(sizes, block), WindowSolution::default());
        let (undecided, certain) = (false, true);
        let mut stepper =
            Stepper { plan, memory, answer, log, problem, of, found, undecided, certain, t: 0 };
        stepper.reset();
        Ok(stepper)
    }

    /// The block for this many outputs: that of an unknown start where the window has to be one.
    fn block(plan: &'p Plan<'p>, (outputs, grows): (usize, bool)) -> Option<WindowProblem<'p>> {
        let opening = if grows { plan.depth(outputs, true) } else { None };
        let (depth, own) = opening.or_else(|| plan.depth(outputs, false))?;
        Some(WindowProblem::new(plan.shared(), depth, own))
    }

    /// Back to the start of a run.
    pub fn reset(&mut self) {
        let shared = self.plan.shared();
        self.undecided = self.plan.finds_start();
        (self.t, self.certain) = (0, true);
        self.memory.clear();
        for x in shared.states.chunks_exact(self.plan.n()) {
            self.memory.push_state(x.iter().copied());
        }
        for y in shared.outputs.chunks_exact(self.plan.p()) {
            self.memory.push_output(y.iter().copied());
        }
        if shared.sizes.m > 0 {
            for u in shared.inputs.chunks_exact(shared.sizes.m) {
                self.memory.push_input(u.iter().copied());
            }
        }
        let elsewhere = shared.evidence.is_some_and(|known| known.starts_elsewhere());
        self.memory.begin(&shared, self.plan.starts_unknown(), elsewhere);
    }

    /// Steps taken since the start.
    pub fn t(&self) -> usize {
        self.t
    }

    /// Whether the plan still has to find out where the run started.
    pub fn is_undecided(&self) -> bool {
        self.undecided
    }

    /// Whether the minimiser of every window of this run was found, also of those that the step
    /// which finds the start makes again: estimates are then those of the ground, bit for bit.
    pub fn is_certain(&self) -> bool {
        self.certain
    }

    /// Consumes y(t-1) (p numbers, NaN = this entry was not measured) and returns the estimate
    /// x̂(t). Whatever its status, x and the window are finite and, unless the status is optimal,
    /// exactly inside the box on the states, if that is hard; see [`stepper`](crate::stepper) for
    /// what they then are. None for another number of entries; the estimator is then unchanged.
    pub fn step(&mut self, y: &[f64]) -> Option<Estimate<'_>> {
        self.step_with(y, &[])
    }

    /// [`step`](Self::step) of a system with known inputs u(t-1) (m numbers). None as well where
    /// one is not finite, or more than 1/ε deviations from the recording.
    pub fn step_with(&mut self, y: &[f64], u: &[f64]) -> Option<Estimate<'_>> {
        if y.len() != self.plan.p() || !self.problem.shared.knows(u) {
            return None;
        }
        self.advance(y, u)?;
        if self.undecided {
            self.find_start(y, u)?;
        }
        let WindowSolution { status, cost, active, iterations, .. } = self.found;
        let evidence = self.memory.evidence(&self.problem.shared.evidence);
        let Answer { x, window, v, w } = answer(&self.problem, self.plan, self.answer);
        Some(Estimate { x, window, v, w, cost, status, active, iterations, evidence })
    }

    /// The problem of this many outputs.
    fn prepare(&mut self, outputs: usize, grows: bool) -> Option<()> {
        let of = (outputs, grows);
        if self.of != of {
            (self.problem, self.of) = (Self::block(self.plan, of)?, of);
        }
        Some(())
    }

    /// One pass of Algorithm 1's loop.
    fn advance(&mut self, y: &[f64], u: &[f64]) -> Option<()> {
        let horizon = self.plan.horizon();
        if self.memory.len() == horizon {
            self.memory.forget(&self.problem.shared);
        }
        self.prepare(self.memory.len() + 1, self.memory.grows(horizon))?;
        let mut pass = over(&self.problem, &mut self.memory);
        let missing = pass.take_in(y, u);
        if pass.doubt_newest() {
            self.prepare(self.memory.len(), true)?;
            over(&self.problem, &mut self.memory).fit_window();
        }
        let mut out = answer(&self.problem, self.plan, self.answer);
        let mut pass = over(&self.problem, &mut self.memory);
        let found = pass.find(y, missing, &mut out);
        pass.hand_out(&found, &mut out, |_, _| {});
        self.found = found.solution;
        if !out.x.iter().all(|x| x.is_finite()) {
            self.found.status = Status::Failed; // of a plan that was forged
        }
        self.certain &= self.found.status == Status::Optimal;
        self.t += 1;
        if self.memory.since() == self.problem.depth.layout.depth {
            smooth(&self.problem.shared, &mut self.memory, out.window);
        }
        Some(())
    }

    /// Whether the run goes on from the recording's end; where not, it starts over.
    #[cold]
    fn find_start(&mut self, y: &[f64], u: &[f64]) -> Option<()> {
        let p = y.len();
        let sample = &mut self.log[(self.t - 1) * (p + u.len())..];
        sample[..p].copy_from_slice(y);
        sample[p..p + u.len()].copy_from_slice(u);
        if self.memory.goes_on(&self.problem, &self.found) {
            self.undecided = self.t < self.plan.horizon();
            return Some(());
        }
        self.undecided = false;
        let (log, steps) = (core::mem::take(&mut self.log), self.t);
        let shared = self.plan.shared();
        (self.t, self.certain) = (0, true);
        self.memory.clear();
        self.memory.push_state(shared.mean_x.iter().map(|_| 0.0));
        self.memory.begin(&shared, true, true);
        for sample in log.chunks_exact(p + u.len()).take(steps) {
            let (y, u) = sample.split_at(p);
            self.advance(y, u)?;
        }
        self.log = log;
        Some(())
    }
}

/// One pass over the window in memory.
fn over<'a, 'm>(
    problem: &'a WindowProblem<'a>,
    memory: &'a mut Memory<&'m mut [f64]>,
) -> Pass<'a, &'m mut [f64], Alone> {
    Pass { problem, memory, fallback: &Alone, x_bounds: None }
}

/// Where the answer of a problem goes.
fn answer<'a>(problem: &WindowProblem<'_>, plan: &Plan<'_>, room: &'a mut [f64]) -> Answer<'a> {
    let (n, horizon, layout) = (plan.n(), plan.horizon(), problem.depth.layout);
    let (x, rest) = room.split_at_mut(n);
    let (window, rest) = rest.split_at_mut((horizon + 1) * n);
    let (v, w) = rest.split_at_mut(horizon * plan.p());
    Answer {
        x,
        window: &mut window[..layout.states_len()],
        v: &mut v[..layout.outputs_len()],
        w: &mut w[..layout.disturbances_len()],
    }
}
