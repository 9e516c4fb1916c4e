//! What a step tells the witness of its estimates.

use crate::evidence::{Evidence, OfDepth, OfPlan};
use crate::kalman::Kalman;
use crate::memory::Memory;
use crate::memory::witness::{Judged, Told};
use crate::panels::dot;
use crate::plan::common::Shared;
use crate::problem::{WindowProblem, WindowSolution};

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
    pub fn start_evidence(&mut self, shared: &Shared<'_>, unknown: bool) {
        if let Some(known) = &shared.evidence {
            let states = self.states.len;
            self.witness.start(self.block.as_mut(), known, (states, unknown));
        }
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
        self.witness.note(self.block.as_mut(), newest.y);
        let window = self.outputs.last(self.depth);
        let lost = match self.missing {
            0 => 0,
            _ => self.block.as_ref()[window.clone()].iter().filter(|y| y.is_nan()).count(),
        };
        let u = self.inputs.last(1.min(self.inputs.len));
        let told = Told {
            known: (plan, own),
            sizes: [found.minimum.value, found.cost],
            measured: window.len() - lost,
            reweighted: found.minimum.reweighted,
            minimised: found.sound,
            newest: &newest.v[newest.v.len() - p..],
            x: newest.x,
            u,
        };
        match &problem.shared.kalman {
            Some(kalman) => {
                let opening = !problem.depth.kind.filtered;
                self.judge_filter(&problem.shared, kalman, &told, opening);
            }
            None => {
                let at = self.scratch + self.room.sensitivity_at();
                let maps = at..at + self.room.sensitivity;
                self.witness.judge(self.block.as_mut(), (self.depth, maps), &told);
            }
        }
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
            u: self.inputs.last(1.min(self.inputs.len)),
        };
        self.judge_filter(shared, kalman, &told, false);
    }

    /// With the weights of the recording.
    fn judge_filter(
        &mut self,
        shared: &Shared<'_>,
        kalman: &Kalman<'_>,
        told: &Told<'_>,
        opening: bool,
    ) {
        let n = self.states.width;
        let (x, y) = (self.states.last(1), self.outputs.last(1));
        let losses = self.filtering.covariance(self.depth, n);
        let block = self.block.as_mut();
        let (s_x, s_y) = (shared.s_x, shared.s_y);
        let innovation = |block: &[f64], i: usize| {
            let (x, y) = (&block[x.clone()], &block[y.clone()]);
            let predicted =
                dot(kalman.model.c(i), x) + kalman.model.pushed_output(i, &block[told.u.clone()]);
            (y[i] - predicted) * s_y[i]
        };
        self.witness.judge_filter(block, self.depth, told, innovation, |known, now, work| {
            let scale = |k: usize| s_x[k / n] * s_x[k % n];
            match losses {
                _ if opening => {
                    (0..n * n).for_each(|k| now[k] /= scale(k));
                    kalman.model.follow(&known[y.clone()], now, work);
                }
                Some(at) => now.copy_from_slice(&known[at]),
                None => now.copy_from_slice(kalman.model.P),
            }
            (0..n * n).for_each(|k| now[k] *= scale(k));
        });
    }

    /// The evidence on the newest estimate; None where none is asked for.
    #[inline(always)]
    pub fn evidence<'b>(&'b self, known: &Option<OfPlan<'b>>) -> Option<Evidence<'b>> {
        known.as_ref().map(|known| self.witness.evidence(self.block.as_ref(), known))
    }

    /// What is saved of it: see [`resume_evidence`](Self::resume_evidence).
    pub fn saved_evidence(&self) -> Option<([&[f64]; 3], Judged)> {
        let p = self.outputs.width;
        self.witness.is_used().then(|| self.witness.saved(self.block.as_ref(), p))
    }

    /// Takes it up: of each output the newest value and how often it came, Σ of the states that are
    /// kept.
    pub fn resume_evidence(&mut self, parts: [&[f64]; 3], judged: Judged) {
        self.witness.resume(self.block.as_mut(), parts, judged);
    }
}
