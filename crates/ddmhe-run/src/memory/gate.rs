//! What is kept to doubt outputs with: see [`gating`](crate::gating).

use crate::memory::stretches::Stretches;
use crate::panels::padded;
use crate::plan::common::Sizes;
use crate::tol;
use core::ops::Range;

/// Where it is; nothing where no output is doubted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gate {
    scale: usize,  // c² of the rule, whether the run has started again, and whether just now
    gated: usize,  // whether the newest output was rejected (p)
    count: usize,  // of each output how often in a row (p)
    sign: usize,   // to which side (p)
    recent: usize, // the newest outputs as they came, deviations (RESTART p)
    p: usize,
    horizon: usize,
    from: f64, // k of the rule; 0: nothing is rejected
    pub end: usize,
}

impl Gate {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { p, horizon, gate: from, .. } = sizes;
        let mut next = at;
        let mut take = |len: usize| {
            let start = next;
            next += if from > 0.0 { padded(len) } else { 0 };
            start
        };
        let (scale, gated, count, sign) = (take(3), take(p), take(p), take(p));
        let recent = take(tol::RESTART * p);
        Gate { scale, gated, count, sign, recent, p, horizon, from, end: next }
    }

    #[inline(always)]
    pub fn is_used(&self) -> bool {
        self.from > 0.0
    }

    /// As at the beginning of a run, in a block of zeros.
    pub fn start(&self, block: &mut [f64]) {
        if self.is_used() {
            block[self.scale] = 1.0;
        }
    }

    /// Where what is saved of it is.
    pub fn kept(&self) -> Range<usize> {
        self.scale..self.end
    }

    /// Whether the run has started again.
    pub fn has_restarted(&self, block: &[f64]) -> bool {
        self.is_used() && block[self.scale + 1] > 0.0
    }

    /// Whether it did so with the newest output.
    pub fn restarts(&self, block: &[f64]) -> bool {
        self.is_used() && block[self.scale + 2] > 0.0
    }

    /// Whether each of the newest outputs was rejected (p): above 0.
    pub fn gated<'b>(&self, block: &'b [f64]) -> &'b [f64] {
        if self.is_used() { &block[self.gated..self.gated + self.p] } else { &[] }
    }

    /// Takes note of the newest output as it came; none of it is rejected yet.
    #[inline(always)]
    pub fn note(&self, block: &mut [f64], at: Stretches) {
        let (p, recent) = (self.p, self.recent);
        block.copy_within(recent + p..recent + tol::RESTART * p, recent);
        let newest = at.outputs.last(1);
        block.copy_within(newest, recent + (tol::RESTART - 1) * p);
        block[self.gated..self.gated + p].fill(0.0);
        block[self.scale + 2] = 0.0;
    }

    /// The newest outputs as they came, this many.
    pub fn recent(&self, outputs: usize) -> Range<usize> {
        let end = self.recent + tol::RESTART * self.p;
        end - outputs * self.p..end
    }

    /// Whether one of these innovations and variances, p each, is too large.
    #[inline(always)]
    pub fn any_far(&self, block: &[f64], room: usize) -> bool {
        let (nu, variance) = block[room..room + 2 * self.p].split_at(self.p);
        let most = self.from * self.from * block[self.scale];
        nu.iter().zip(variance).any(|(nu, variance)| nu * nu > most * variance)
    }

    /// Rejects what is too large of them; whether one output was rejected to the same side so often
    /// that it has jumped.
    #[inline(always)]
    pub fn weigh(&self, block: &mut [f64], room: usize) -> bool {
        let (own, room) = block.split_at_mut(room);
        let (nu, variance) = room[..2 * self.p].split_at(self.p);
        let (scale, most) = (own[self.scale], self.from * self.from);
        let (mut sum, mut measured, mut jumped) = (0.0, 0.0, false);
        for i in (0..self.p).filter(|&i| !nu[i].is_nan()) {
            let square = nu[i] * nu[i];
            let r = if square > 0.0 { square / (scale * variance[i]) } else { 0.0 };
            (sum, measured) = (sum + r.min(tol::GATE_MOST), measured + 1.0);
            let far = r > most;
            let side = if nu[i] > 0.0 { 1.0 } else { -1.0 };
            let again = far && own[self.sign + i] == side;
            let before = if again { own[self.count + i] } else { 0.0 };
            own[self.gated + i] = f64::from(u8::from(far));
            own[self.count + i] = if far { before + 1.0 } else { 0.0 };
            own[self.sign + i] = if far { side } else { 0.0 };
            jumped |= own[self.count + i] >= tol::RESTART as f64;
        }
        if measured > 0.0 {
            let next = scale + (sum / measured - 1.0) * scale / self.horizon as f64;
            own[self.scale] = next.max(1.0);
        }
        jumped
    }

    /// What is kept after a jump: nothing is rejected.
    pub fn restart(&self, block: &mut [f64]) {
        let recent = self.recent..self.end;
        block[self.gated..recent.start].fill(0.0);
        block[self.scale..self.scale + 3].fill(1.0);
    }
}
