//! Algorithm 1 of Liu 2026 on checked input.
//!
//! At time t the window is y(t-M_t) … y(t-1); the estimate is x̂(t), made from outputs up to
//! y(t-1). M_t is the largest depth of the plan that t outputs fill, and from then on the horizon
//! M. The prior x̄(t-M_t) is x̄(0) where the window holds all outputs of the run, and otherwise the
//! estimate that was made then (filtering update).
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
//!
//! *Soft bounds.* A bound with a [price](crate::prices) is left where that costs less: no output is
//! left out for the sake of it, and no state is moved into it, whatever the status.

use crate::evidence::Minimum;
use crate::fallback::Fallback;
use crate::judging::Newest;
use crate::kalman::Kalman;
use crate::memory::{Memory, Parts};
use crate::panels::Root;
use crate::plan::common::{Limits, Shared};
use crate::problem::{Data, Fit, WindowProblem, WindowSolution};
use crate::status::Status;
use crate::tol;

/// Where a step's answer goes, in the user's units.
#[derive(Debug)]
pub struct Answer<'a> {
    /// x̂(t) (n).
    pub x: &'a mut [f64],
    /// The states of the window ((m+1)·n), oldest first.
    pub window: &'a mut [f64],
    /// Its fitted noise (m·p), NaN where not measured.
    pub v: &'a mut [f64],
    /// Its fitted disturbance (m·n); empty where none is fitted.
    pub w: &'a mut [f64],
}

impl Answer<'_> {
    #[inline(always)]
    fn fit(&mut self) -> Fit<'_> {
        Fit { states: self.window, v: self.v, w: self.w }
    }
}

/// What was found of a window before it is handed out.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Status and evidence.
    pub solution: WindowSolution,
    /// Whether the estimates of the window's past are to be replaced by the window.
    pub anew: bool,
    /// Whether everything in memory was forgotten.
    pub forgot: bool,
}

/// One pass of Algorithm 1's loop over one window.
#[derive(Debug)]
pub struct Pass<'a, B, F> {
    /// The problem of the window's depth.
    pub problem: &'a WindowProblem<'a>,
    /// The window.
    pub memory: &'a mut Memory<B>,
    /// What to do where the methods here are not certain.
    pub fallback: &'a F,
    /// Bounds on the states for this step alone.
    pub x_bounds: Option<Limits<'a>>,
}

impl<B: AsRef<[f64]> + AsMut<[f64]>, F: Fallback> Pass<'_, B, F> {
    /// Takes y(t-1), NaN where not measured, and u(t-1) into the window. Returns how many entries
    /// of y cannot be used. What of them cannot be right is for
    /// [`doubt_newest`](Self::doubt_newest) to find.
    #[inline(always)]
    pub fn take_in(&mut self, y: &[f64], u: &[f64]) -> usize {
        let shared = &self.problem.shared;
        let missing = self.memory.push_output(shared.output_deviations(y));
        self.memory.count_output();
        if shared.sizes.m > 0 {
            self.memory.push_input(shared.input_deviations(u));
        }
        if shared.sizes.judged() {
            self.memory.note_output(y);
        }
        self.fit_window();
        missing
    }

    /// The window has the depth of its problem, with the forced motion in it.
    #[inline(always)]
    pub fn fit_window(&mut self) {
        let shared = &self.problem.shared;
        let depth = self.problem.depth.layout.depth;
        if self.memory.depth() != depth {
            self.memory.deepen(depth);
        }
        if shared.sizes.m > 0 {
            self.force();
        }
    }

    /// Leaves out what cannot be right of the newest output: see [`gating`](crate::gating). True:
    /// the state has jumped, the run has started again, and the window is another problem's.
    #[inline(always)]
    pub fn doubt_newest(&mut self) -> bool {
        let shared = &self.problem.shared;
        if shared.sizes.stuck_missing {
            self.memory.lose_stuck(shared);
        }
        if shared.sizes.gate > 0.0 && self.gate() {
            self.memory.restart(shared);
            return true;
        }
        false
    }

    /// Finds the minimiser of the window that y(t-1) was [taken](Self::take_in) into, `missing` of
    /// whose entries cannot be used; states and noise are in the answer then.
    #[inline(always)]
    pub fn find(&mut self, y: &[f64], missing: usize, out: &mut Answer<'_>) -> Found {
        let mut found = match self.at_once(out) {
            Ok(solution) => Found { solution, anew: false, forgot: false },
            Err(begun) => self.look_closer(begun, out),
        };
        if missing > 0 && missing > y.iter().filter(|y| y.is_nan()).count() {
            found.solution.status = Status::Failed; // an output that cannot be computed with
        }
        let (window, n) = (&*out.window, out.x.len());
        out.x.copy_from_slice(&window[window.len() - n..]);
        if self.problem.shared.sizes.judged() {
            let newest = Newest { y, x: out.x, v: out.v };
            self.memory.judge(self.problem, &found.solution, newest);
        }
        found
    }

    /// The minimiser of a window that was measured as a whole and touches no bound: see
    /// [`plain`](crate::plain). An error where it is another window; true: it was begun.
    #[inline(always)]
    fn at_once(&mut self, out: &mut Answer<'_>) -> Result<WindowSolution, bool> {
        let (problem, memory) = (self.problem, &mut *self.memory);
        let Some(known) = &problem.at_once else { return Err(false) };
        if self.x_bounds.is_some() || !memory.is_plain() {
            return Err(false);
        }
        let found = self.fallback.vectorised(
            #[inline(always)]
            || problem.minimise_at_once(known, memory.plain(), &mut out.fit()),
        );
        let [cost, value] = found.ok_or(true)?;
        let (minimum, rest) = (Minimum { value, reweighted: false }, WindowSolution::default());
        Ok(WindowSolution { status: Status::Optimal, sound: true, cost, minimum, ..rest })
    }

    /// The minimiser of any window, and what to make of one without.
    #[inline(never)]
    fn look_closer(&mut self, begun: bool, out: &mut Answer<'_>) -> Found {
        let shared = &self.problem.shared;
        if let Some(kalman) = &shared.kalman {
            self.filter(kalman);
        }
        let solution = self.minimise(begun, out);
        if shared.sizes.recorded && !solution.filtered {
            self.memory.unchain();
        }
        let mut found = Found { solution, anew: false, forgot: false };
        if solution.status != Status::Optimal {
            self.reconsider(&mut found, out);
        }
        found
    }

    /// The step whose x̂(t), into x, is all that is asked for: its cost, with the weights of the
    /// recording, without bounds and without a window that has to be looked at. None where this
    /// step is another; nothing has changed then.
    #[inline(always)]
    pub fn alone(&mut self, y: &[f64], u: &[f64], x: &mut [f64]) -> Option<f64> {
        let depth = self.problem.depth;
        if !depth.kind.filtered {
            return None;
        }
        let (memory, shared) = (&mut *self.memory, &self.problem.shared);
        let evidence = &self.problem.evidence;
        self.fallback.vectorised(
            #[inline(always)]
            || memory.filter_alone((shared, evidence), (y, u), (depth.layout.depth, x)),
        )
    }

    /// The forced motion of the window: apart, for the registers of the steps that have none.
    #[inline(never)]
    fn force(&mut self) {
        let (memory, shared) = (&mut *self.memory, &self.problem.shared);
        self.fallback.vectorised(
            #[inline(always)]
            || memory.force(shared),
        );
    }

    /// The window as a filter has it, with the weights of the recording.
    #[inline(never)]
    fn filter(&mut self, kalman: &Kalman<'_>) {
        let (memory, filtered) = (&mut *self.memory, self.problem.depth.kind.filtered);
        self.fallback.vectorised(
            #[inline(always)]
            || memory.filter(kalman, filtered),
        );
    }

    /// What was found becomes the past: x̂(t) into memory. Where it is not optimal it is moved into
    /// its box; `moved` is told from which state to which it went on. Returns how far, ‖·‖, it was
    /// moved for what is handed out.
    #[inline(always)]
    pub fn hand_out(
        &mut self,
        found: &Found,
        out: &mut Answer<'_>,
        moved: impl FnOnce(&[f64], &[f64]),
    ) -> f64 {
        self.memory.push_state(self.problem.shared.state_deviations(out.x));
        if found.solution.status != Status::Optimal {
            return self.confine(found.anew, out, moved);
        }
        0.0
    }

    /// The minimiser over the window in memory, which may be begun.
    #[inline(never)]
    fn minimise(&mut self, begun: bool, out: &mut Answer<'_>) -> WindowSolution {
        let Parts { prior, outputs, means, missing, filtered, lacking, mut scratch, mut working } =
            self.memory.parts();
        let means = self.problem.means(means);
        // the filtering update: x̄(t-M_t) is the estimate that was made then
        let x_bounds = self.x_bounds;
        let data = Data { prior, outputs, missing, filtered, lacking, means, x_bounds, begun };
        let mut fit = out.fit();
        let (problem, fallback) = (self.problem, self.fallback);
        let room = (&mut working, &mut scratch);
        if let Some(found) = problem.solve_vectorised(fallback, &data, room, &mut fit) {
            return found;
        }
        let room = (&mut working, &mut scratch);
        if let Some(found) = self.fallback.anew(&data, room, out.fit()) {
            return found;
        }
        self.problem.rest(&data, &mut scratch, out.fit())
    }

    /// The same of a window that was changed.
    #[cold]
    fn minimise_again(&mut self, out: &mut Answer<'_>) -> WindowSolution {
        self.memory.working_set().clear();
        self.minimise(false, out)
    }

    /// What to make of a window without a minimiser.
    #[cold]
    fn reconsider(&mut self, found: &mut Found, out: &mut Answer<'_>) {
        let status = found.solution.status;
        if status == Status::AlmostOptimal {
            return;
        }
        let sizes = self.problem.shared.sizes;
        let excluded = sizes.v_bounded && !(sizes.prices.v > 0.0);
        if status == Status::Failed || excluded {
            (found.solution, found.anew) = self.doubt(status == Status::Failed, out);
        }
        if !found.solution.sound {
            self.memory.forget_all();
            found.forgot = true;
            found.solution = self.minimise_again(out);
        }
        if !found.solution.sound {
            let Parts { prior, outputs, means, missing, mut scratch, .. } = self.memory.parts();
            let means = self.problem.means(means);
            let (filtered, lacking, x_bounds) = (None, None, self.x_bounds);
            let data =
                Data { prior, outputs, missing, filtered, lacking, means, x_bounds, begun: false };
            found.solution = self.problem.rest(&data, &mut scratch, out.fit());
        }
        found.solution.status = status;
    }

    /// The answer without the outputs that contradict the others: without the newest sample, or,
    /// where the [`DOUBTS`](tol::DOUBTS) before it say nothing, without all before it (true). Of a
    /// window that cannot be computed the sample furthest out is the first in doubt. What is
    /// doubted counts as not measured from then on; where nothing helps, nothing is.
    fn doubt(&mut self, failed: bool, out: &mut Answer<'_>) -> (WindowSolution, bool) {
        let newest = self.memory.depth() - 1;
        let stale = newest >= tol::DOUBTS && self.memory.silent(newest - tol::DOUBTS..newest);
        let older = if stale && !failed { 0..newest } else { 0..0 };
        let furthest = if failed { self.memory.furthest() } else { newest };
        for doubted in [older, furthest..furthest + 1, newest..newest + 1] {
            if self.memory.silent(doubted.clone()) {
                continue;
            }
            self.memory.set_aside(doubted.clone());
            let found = self.minimise_again(out);
            if found.status == Status::Optimal {
                return (found, doubted.len() > 1);
            }
            self.memory.take_back();
        }
        (self.minimise_again(out), false)
    }

    /// After a step that is not optimal: what is handed out is moved into the box in force, and
    /// what goes on as x̂(t) into the configured one, since a box for this step alone says nothing
    /// of later ones. With `anew` the estimates of the window's past are replaced by the window.
    #[cold]
    fn confine(
        &mut self,
        anew: bool,
        out: &mut Answer<'_>,
        moved: impl FnOnce(&[f64], &[f64]),
    ) -> f64 {
        let (n, shared) = (out.x.len(), &self.problem.shared);
        if anew {
            let past = out.window.chunks_exact(n).flat_map(|x| shared.state_deviations(x));
            self.memory.replace_states(past);
        }
        self.move_into(None, out);
        let inside = &out.window[out.window.len() - n..];
        self.memory.replace_newest(shared.state_deviations(inside));
        moved(out.x, inside);
        if self.x_bounds.is_some() {
            self.move_into(self.x_bounds, out);
        }
        let inside = &out.window[out.window.len() - n..];
        let far: f64 = out.x.iter().zip(inside).map(|(x, to)| (x - to) * (x - to)).sum();
        out.x.copy_from_slice(inside);
        far.root()
    }

    /// The window with its states moved into a box, unless they may leave it; None: the configured
    /// one.
    fn move_into(&mut self, x_bounds: Option<Limits<'_>>, out: &mut Answer<'_>) {
        if self.problem.shared.sizes.prices.x > 0.0 {
            return;
        }
        let Parts { prior, outputs, means, missing, mut scratch, .. } = self.memory.parts();
        let (filtered, lacking, means) = (None, None, self.problem.means(means));
        let data =
            Data { prior, outputs, missing, filtered, lacking, means, x_bounds, begun: false };
        self.problem.confine(&data, &mut scratch, out.window);
    }
}

/// From the first window of each depth in a run from an unknown state on, x̄ of the instants in it
/// are its own states: smoothed, not what was made from the few outputs of then. x̄(0) stays.
#[cold]
pub fn smooth<B: AsRef<[f64]> + AsMut<[f64]>>(
    shared: &Shared<'_>,
    memory: &mut Memory<B>,
    window: &[f64],
) {
    let states = window.chunks_exact(shared.sizes.n).take(memory.depth()).skip(1);
    memory.replace_past(states.flat_map(|x| shared.state_deviations(x)));
    memory.working_set().clear(); // the next window of this depth is another problem's
}
