//! Outputs that cannot be right: those far from what all others say they are, jumps, and outputs
//! that are stuck. What is rejected counts as not measured as long as it is in the window.
//!
//! # Gate
//! ν_i is what output i of the newest sample differs by from what x̄ and all *other* outputs of the
//! window say it is, without the newest sample and without what was lost or rejected before; with
//! the weights of the recording it is the filter's innovation. σ_i² is its variance in windows that
//! were held out of the recording (in the first windows from an unknown state: of these), or
//! C Σ(t-1) Cᵀ + R of that filter. Output i is rejected where
//!
//! > |ν_i| > k c σ_i,  c² ← max(1, c² + (mean_i min(r_i², 9) - 1) c²/M),  r_i = |ν_i|/(c σ_i)
//!
//! so that errors which grow as the motion leaves the recording are not taken for wrong outputs.
//! The first output from an unknown state is believed. Bounds have no part in ν.
//!
//! # Jumps
//! A gate alone would lock out a state that has jumped. Where an output was rejected
//! [`RESTART`](tol::RESTART) = 4 times in a row to the same side, the run starts again four samples
//! ago from an unknown state: these outputs are taken back in, x̄ is the estimate of then with the
//! covariance of an unknown state about it, c = 1, and the window grows to M again.
//!
//! # Stuck outputs
//! An output that repeats one value longer than it ever did in the recording (see
//! [`evidence`](crate::evidence)) counts as not measured on request, all its repetitions with it.

use crate::evidence::OfDepth;
use crate::fallback::Fallback;
use crate::kalman::Kalman;
use crate::memory::{Memory, Parts};
use crate::plan::common::Shared;
use crate::problem::{Data, Scratch, WindowProblem};
use crate::stepper::Pass;
use crate::tol;

impl<B: AsRef<[f64]> + AsMut<[f64]>, F: Fallback> Pass<'_, B, F> {
    /// Rejects what cannot be right of the newest output, which is in the window. Whether it has
    /// jumped: then the [run starts again](Memory::restart).
    #[inline(never)]
    pub fn gate(&mut self) -> bool {
        self.memory.note_newest();
        let shared = &self.problem.shared;
        let known = match &shared.kalman {
            _ if self.memory.is_first() => false,
            Some(kalman) => {
                self.memory.innovate(shared, kalman);
                true
            }
            None => self.leave_out(),
        };
        known && self.memory.reject()
    }

    /// ν and σ² of the newest output in the window, by the window's problem; false where too little
    /// is left to tell.
    fn leave_out(&mut self) -> bool {
        let Some(own) = self.problem.evidence else { return false };
        let (problem, fallback, p) = (self.problem, self.fallback, self.problem.depth.layout.p);
        let with_gaps = self.memory.has_gaps();
        if with_gaps {
            self.memory.hide_newest();
        }
        let Parts { prior, outputs, means, missing, mut scratch, .. } = self.memory.parts();
        let means = problem.means(means);
        let (filtered, lacking, x_bounds) = (None, None, None);
        let data =
            Data { prior, outputs, missing, filtered, lacking, means, x_bounds, begun: false };
        let known = fallback.vectorised(
            #[inline(always)]
            || problem.newest_by_others(&data, &mut scratch, &own),
        );
        if with_gaps {
            self.memory.show_newest(p);
        }
        if known {
            self.memory.scale_innovation(&problem.shared, &own, with_gaps);
        }
        known
    }
}

impl WindowProblem<'_> {
    /// What all others say the newest output is (p, scaled) into the scratch; where no output is
    /// missing, ν itself.
    #[inline(always)]
    fn newest_by_others(&self, data: &Data<'_>, s: &mut Scratch<'_>, own: &OfDepth<'_>) -> bool {
        let (layout, p) = (self.depth.layout, self.depth.layout.p);
        if data.missing {
            if self.without_missing(data, s).is_none() {
                return false;
            }
        } else {
            self.minimiser(data.prior, data.outputs, s.unconstrained);
        }
        let first = layout.split() + layout.outputs_len() - p;
        let z = &s.unconstrained[..self.depth.rank];
        let innovation = s.spare.parts().innovation;
        for i in 0..p {
            let row = first + i;
            let along: f64 = z.iter().enumerate().map(|(j, z)| z * self.rows.entry(row, j)).sum();
            innovation[p + i] = self.rows.offset[row] + along;
        }
        let (nu, fitted) = innovation.split_at_mut(p);
        if data.missing {
            nu[..p].copy_from_slice(&fitted[..p]);
            return true;
        }
        let newest = &data.outputs[layout.outputs_len() - p..];
        let s_y = self.shared.s_y;
        fitted.iter_mut().zip(newest).for_each(|(fitted, y)| *fitted = y - *fitted);
        for (i, nu) in nu.iter_mut().enumerate() {
            let along = |j: usize| own.deleted[i * p + j] * fitted[j] * s_y[j];
            *nu = (0..p).map(along).sum::<f64>();
        }
        true
    }
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// Where the innovations and their variances are (p each).
    pub(crate) fn innovation_at(&self) -> usize {
        self.scratch + self.room.innovation_at()
    }

    /// Whether the newest output is the first from an unknown state.
    fn is_first(&self) -> bool {
        self.since == 1
    }

    /// Whether an output in the window is missing.
    fn has_gaps(&self) -> bool {
        self.stretches().missing(self.block.as_ref())
    }

    pub(crate) fn note_newest(&mut self) {
        let at = self.stretches();
        self.gate.note(self.block.as_mut(), at);
    }

    /// ν and σ² of the recording's filter, before x̂(t) is made.
    #[inline(always)]
    pub(crate) fn innovate(&mut self, shared: &Shared<'_>, kalman: &Kalman<'_>) {
        let [x, y, u] = [self.states.last(1), self.outputs.last(1), self.newest_input()];
        let (room, p, model) = (self.innovation_at(), self.outputs.width, &kalman.model);
        let (known, room) = self.block.as_mut().split_at_mut(room);
        let few = shared.evidence.map_or(1.0, |known| known.model.few());
        let sigma = self.witness.filter_covariance(known, x.len());
        for i in 0..p {
            let expected = model.expected_output(i, &known[x.clone()], &known[u.clone()]);
            room[i] = known[y.start + i] - expected;
            room[p + i] = model.output_covariance([i, i], sigma) + few * model.R[i];
        }
    }

    /// ν of what all others say, and σ², in the user's units.
    fn scale_innovation(&mut self, shared: &Shared<'_>, own: &OfDepth<'_>, with_gaps: bool) {
        let (room, p) = (self.innovation_at(), self.outputs.width);
        let restarted = self.gate.has_restarted(self.block.as_ref());
        let newest = self.outputs.last(1);
        let forced = self.forced_newest();
        let (known, room) = self.block.as_mut().split_at_mut(room);
        for i in 0..p {
            if with_gaps {
                let forced = forced.clone().map_or(0.0, |at| known[at.start + i]);
                room[i] = (known[newest.start + i] - forced - room[i]) * shared.s_y[i];
            }
            let first = if restarted { 0.0 } else { own.innovation[i] };
            room[p + i] = own.settled[i].max(first);
        }
    }

    /// Rejects what is too far of the newest output; whether it has jumped.
    fn reject(&mut self) -> bool {
        let (room, p) = (self.innovation_at(), self.outputs.width);
        let block = self.block.as_mut();
        if self.gate.weigh(block, room) {
            return true;
        }
        let newest = self.outputs.last(1);
        let mut rejected = 0;
        for i in 0..p {
            if self.gate.gated(block)[i] > 0.0 && !block[newest.start + i].is_nan() {
                block[newest.start + i] = f64::NAN;
                rejected += 1;
            }
        }
        self.missing += rejected;
        false
    }

    /// The newest output counts as not measured, until it is shown.
    fn hide_newest(&mut self) {
        let (newest, block) = (self.outputs.last(1), self.block.as_mut());
        let lost = block[newest.clone()].iter().filter(|y| y.is_nan()).count();
        self.missing += newest.len() - lost;
        block[newest].fill(f64::NAN);
    }

    fn show_newest(&mut self, p: usize) {
        let (newest, came) = (self.outputs.last(1), self.gate.recent(1));
        let block = self.block.as_mut();
        block.copy_within(came, newest.start);
        let lost = block[newest].iter().filter(|y| y.is_nan()).count();
        self.missing -= p - lost;
    }

    /// What is kept of a run that starts again: the newest outputs as they came, and the estimates
    /// before each, of which the oldest is the new x̄. The window is that of this many outputs.
    pub fn restart(&mut self, shared: &Shared<'_>) {
        let kept = tol::RESTART.min(shared.sizes.horizon).min(self.outputs.len);
        self.outputs.keep(kept);
        self.states.keep(kept);
        self.inputs.keep(kept);
        self.filtering.keep(kept);
        let block = self.block.as_mut();
        block.copy_within(self.gate.recent(kept), self.outputs.window().start);
        self.gate.restart(block);
        self.count_missing();
        self.deepen(kept);
        self.since = kept;
        self.restart_evidence(shared, kept);
    }

    /// An output that repeats one value too long counts as not measured, with its repetitions.
    pub(crate) fn lose_stuck(&mut self, shared: &Shared<'_>) {
        let Some(known) = &shared.evidence else { return };
        let (window, p) =
            (self.outputs.last(self.depth.max(1).min(self.len())), self.outputs.width);
        let mut lost = false;
        for i in 0..p {
            let Some(repeats) = self.witness.stuck(self.block.as_ref(), known, i) else { continue };
            let samples = window.len() / p;
            let block = self.block.as_mut();
            for k in samples - repeats.min(samples)..samples {
                block[window.start + k * p + i] = f64::NAN;
            }
            lost = true;
        }
        if lost {
            self.count_missing();
        }
    }
}
