//! What a step tells the witness of its estimates.

use crate::evidence::{Evidence, OfDepth, OfPlan, Rule};
use crate::kalman::Kalman;
use crate::memory::{FilterStep, Judged, Memory, Told};
use crate::plan::common::Shared;
use crate::problem::{WindowProblem, WindowSolution};
use crate::sliding::SlidingBuffer;
use crate::status::Status;
use crate::tol;

/// The newest estimate and output, as they came and went.
#[derive(Debug, Clone, Copy)]
pub struct Newest<'a> {
    /// y(t-1) (p), NaN where not measured.
    pub y: &'a [f64],
    /// x̂(t) (n).
    pub x: &'a [f64],
    /// Fitted noise of the window, of which that of y(t-1) is the last.
    pub v: &'a [f64],
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// Σ of the states that are kept, as at the beginning of a run.
    pub(crate) fn start_evidence(&mut self, shared: &Shared<'_>, unknown: bool, elsewhere: bool) {
        if let Some(known) = &shared.evidence {
            let states = self.states.len;
            let at = (states, unknown);
            let samples = if elsewhere || unknown { known.growth[2] } else { 0.0 };
            self.witness.start(self.block.as_mut(), known, at, (shared.s_x, samples));
        }
    }

    /// Takes note of y(t-1) as it came.
    #[inline(always)]
    pub(crate) fn note_output(&mut self, y: &[f64]) {
        self.witness.note(self.block.as_mut(), y);
    }

    /// Σ of the states that are kept after a restart with so many outputs: of the recording's
    /// filter it is followed through all but the newest, which is judged with the others.
    pub(crate) fn restart_evidence(&mut self, shared: &Shared<'_>, kept: usize) {
        let Some(known) = &shared.evidence else { return };
        let block = self.block.as_mut();
        self.witness.restart(block, known, (kept, shared.s_x));
        let Some(kalman) = &shared.kalman else { return };
        for k in (2..=kept).rev() {
            let of = |at: SlidingBuffer| {
                let from = at.last(k.min(at.len)).start;
                from..from + at.width
            };
            let step = FilterStep {
                model: &kalman.model,
                scales: [shared.s_x, shared.s_y],
                at: [of(self.states), of(self.outputs), of(self.inputs)],
                losses: None,
                opening: true,
            };
            self.witness.follow(self.block.as_mut(), known, &step);
        }
    }

    /// Whether the newest window is one of a run that goes on from the recording's end.
    #[inline(never)]
    pub fn goes_on(&self, problem: &WindowProblem<'_>, found: &WindowSolution) -> bool {
        let (Some(plan), Some(own)) = (&problem.shared.evidence, &problem.evidence) else {
            return true;
        };
        if found.status == Status::Failed {
            return true; // what has no minimiser says nothing of where the run began
        }
        let evidence = self.witness.evidence(self.block.as_ref(), plan);
        let innovations = evidence.innovation.iter().map(|nu| nu * nu);
        let (novel, far) = if plan.rule == Rule::Filter {
            // a recording that shows no noise says nothing of that of later outputs
            let silent = own.going_on.iter().any(|most| *most > 0.0);
            let most = evidence.innovation_variance.iter().zip(own.going_on);
            let most = most.map(|(of, least)| least.max(tol::GOES_ON * of));
            let far = innovations.zip(most).any(|(nu, most)| nu > most);
            (!silent && evidence.value > evidence.limit, far)
        } else {
            let [.., V_on, J_on] = own.levels;
            let far = innovations.zip(own.going_on).any(|(nu, most)| nu > *most);
            (found.minimum.value > V_on || found.cost > J_on, far)
        };
        // no window that goes on is within the bounds on the noise
        let sizes = problem.shared.sizes;
        let hard = sizes.v_bounded && !(sizes.prices.v > 0.0);
        let excluded = hard && found.status == Status::Infeasible;
        // a gate takes what is far for a wrong output
        !excluded && !novel && (!far || self.gate.is_used())
    }

    /// Σ(t) and the rest of the evidence on x̂(t), before x̂(t) is among the states that are kept.
    #[inline(never)]
    pub(crate) fn judge(
        &mut self,
        problem: &WindowProblem<'_>,
        found: &WindowSolution,
        newest: Newest<'_>,
    ) {
        let (Some(plan), Some(own)) = (&problem.shared.evidence, &problem.evidence) else { return };
        let p = newest.y.len();
        let window = self.outputs.last(self.depth);
        let lost = match self.missing {
            0 => 0,
            _ => self.block.as_ref()[window.clone()].iter().filter(|y| y.is_nan()).count(),
        };
        let u = self.newest_input();
        let told = Told {
            known: (plan, own),
            sizes: [found.minimum.value, found.cost],
            measured: window.len() - lost,
            reweighted: found.minimum.reweighted,
            minimised: found.sound,
            newest: &newest.v[newest.v.len() - p..],
            x: newest.x,
            mean: problem.shared.mean_x,
            u,
        };
        match &problem.shared.kalman {
            Some(kalman) => {
                let opening = !problem.depth.kind.filtered;
                self.judge_filter(&problem.shared, kalman, &told, opening);
            }
            None => {
                let at = self.room.sensitivity();
                let maps = self.scratch + at.start..self.scratch + at.end;
                self.witness.judge(self.block.as_mut(), (self.depth, maps), &told);
            }
        }
    }

    /// y(t-1) and u(t-1) taken in, and x̂(t) into x, in the user's units, where the estimates in
    /// the window are one filter's and nothing else is asked for: its cost. None where this step is
    /// another; nothing has changed then.
    #[inline(always)]
    pub(crate) fn filter_alone(
        &mut self,
        (shared, evidence): (&Shared<'_>, &Option<OfDepth<'_>>),
        (y, u): (&[f64], &[f64]),
        (depth, x): (usize, &mut [f64]),
    ) -> Option<f64> {
        let kalman = shared.kalman.as_ref()?;
        if shared.sizes.stuck_missing
            && let Some(known) = &shared.evidence
            && self.witness.will_stick(self.block.as_ref(), known, y)
        {
            return None;
        }
        let usual = self.missing == 0 && self.filtering.goes_on(depth);
        if !usual {
            return None;
        }
        let missing = self.push_output(shared.output_deviations(y));
        self.push_input(shared.input_deviations(u));
        let at = self.stretches();
        self.filtering.step_ahead(self.block.as_mut(), at, kalman, [1, 1]);
        let far = self.gate.is_used() && self.is_doubted(shared, kalman);
        let next = self.filtering.ahead(self.block.as_ref(), self.states.width);
        // NaN where an output was not measured
        if !next.iter().fold(true, |near, x| near & (x.abs() <= tol::MEASURABLE))
            || missing > 0
            || far
        {
            self.outputs.retract();
            self.inputs.retract();
            self.filtering.retract();
            self.missing -= missing;
            return None;
        }
        for (i, (to, next)) in x.iter_mut().zip(next).enumerate() {
            *to = next * shared.s_x[i] + shared.mean_x[i];
        }
        if self.depth != depth {
            self.deepen(depth);
        }
        if self.gate.is_used() {
            self.believe_newest();
        }
        let cost = self.filtering.cost(self.block.as_ref(), depth);
        if shared.sizes.judged() {
            self.judge_alone(shared, evidence.as_ref(), cost, (y, x));
        }
        self.push_state(shared.state_deviations(x));
        Some(cost)
    }

    /// The same where a filter alone has made x̂(t), at this cost.
    pub(crate) fn judge_alone(
        &mut self,
        shared: &Shared<'_>,
        own: Option<&OfDepth<'_>>,
        cost: f64,
        (y, x): (&[f64], &[f64]),
    ) {
        let (Some(plan), Some(own), Some(kalman)) = (&shared.evidence, own, &shared.kalman) else {
            return;
        };
        self.witness.note(self.block.as_mut(), y);
        let told = Told {
            known: (plan, own),
            sizes: [cost, cost],
            measured: self.depth * y.len(),
            reweighted: false,
            minimised: true,
            newest: y,
            x,
            mean: shared.mean_x,
            u: self.newest_input(),
        };
        self.judge_filter(shared, kalman, &told, false);
    }

    /// Whether the newest output is far from what the filter says it is.
    fn is_doubted(&mut self, shared: &Shared<'_>, kalman: &Kalman<'_>) -> bool {
        self.innovate(shared, kalman);
        let room = self.innovation_at();
        self.gate.any_far(self.block.as_ref(), room)
    }

    /// The newest output is none of those.
    fn believe_newest(&mut self) {
        self.note_newest();
        let room = self.innovation_at();
        self.gate.weigh(self.block.as_mut(), room);
    }

    /// With the weights of the recording.
    fn judge_filter(
        &mut self,
        shared: &Shared<'_>,
        kalman: &Kalman<'_>,
        told: &Told<'_>,
        opening: bool,
    ) {
        let step = FilterStep {
            model: &kalman.model,
            scales: [shared.s_x, shared.s_y],
            at: [self.states.last(1), self.outputs.last(1), told.u.clone()],
            losses: self.filtering.covariance(self.depth, self.states.width),
            opening,
        };
        self.witness.judge_filter(self.block.as_mut(), told, &step);
    }

    /// The evidence on the newest estimate; None where none is asked for.
    #[inline(always)]
    pub fn evidence<'b>(&'b self, known: &Option<OfPlan<'b>>) -> Option<Evidence<'b>> {
        let known = known.as_ref()?;
        let block = self.block.as_ref();
        Some(Evidence {
            gated: self.gate.gated(block),
            restarted: self.gate.restarts(block),
            ..self.witness.evidence(block, known)
        })
    }

    /// What is saved of it: see [`resume_evidence`](Self::resume_evidence).
    pub fn saved_evidence(&self) -> Option<([&[f64]; 3], Judged)> {
        self.witness.is_used().then(|| self.witness.saved(self.block.as_ref()))
    }

    /// How many numbers are kept of it, and of how many steps there are scores at most.
    pub fn saved_evidence_len(&self) -> [usize; 2] {
        self.witness.saved_len()
    }

    /// Takes it up: of each output the newest value and how often it came, Σ of the states that are
    /// kept.
    pub fn resume_evidence(&mut self, parts: [&[f64]; 3], judged: Judged) {
        self.witness.resume(self.block.as_mut(), parts, judged);
    }
}
