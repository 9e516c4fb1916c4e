//! The forced motion of a window: what its known inputs make of it.

use crate::memory::stretches::{Stretches, samples};
use crate::panels::padded;
use crate::plan::common::{Shared, Sizes};

/// The forced motion of the window, and what is left of its outputs: nothing without inputs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Forced {
    pub inputs: usize, // where the stretch of the inputs begins
    pub x: usize,      // means + x_f, in the user's units
    pub free: usize,   // y - y_f
    motion: usize,     // [x_f(k+1); y_f(k)] of each instant
    stride: usize,     // from one to the next
    pub end: usize,
    at: usize,
}

impl Forced {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, m, horizon, .. } = sizes;
        let known = |len: usize| if m > 0 { padded(len) } else { 0 };
        let x = at + known(samples(horizon) * m);
        let free = x + known((horizon + 1) * n);
        let motion = free + known(horizon * p);
        let stride = sizes.response().stride();
        Forced { inputs: at, x, free, motion, stride, end: motion + known(horizon * stride), at }
    }

    pub fn len(&self) -> usize {
        self.end - self.at
    }

    /// The forced motion of the window of this step, from its inputs.
    #[inline(always)]
    pub fn force(self, block: &mut [f64], at: Stretches, shared: &Shared<'_>) {
        let Some(response) = shared.response() else { return };
        let (n, stride) = (at.states.width, self.stride);
        let inputs = at.inputs.last(at.depth);
        let (known, rest) = block.split_at_mut(self.x);
        let (x, rest) = rest.split_at_mut(self.free - self.x);
        let motion = &mut rest[self.motion - self.free..self.end - self.free];
        response.forced(&known[inputs], motion);
        // channel by channel: loops over the few channels of each instant cost more than their work
        let motion = &motion[..at.depth * stride];
        for (i, (mean, s)) in shared.mean_x.iter().zip(shared.s_x).enumerate() {
            x[i] = *mean;
            for (k, instant) in motion.chunks_exact(stride).enumerate() {
                x[(k + 1) * n + i] = mean + instant[i] * s;
            }
        }
    }

    /// Where the forced part of the newest output is (p).
    pub fn newest_output(self, at: Stretches) -> core::ops::Range<usize> {
        let first = self.motion + (at.depth - 1) * self.stride + at.states.width;
        first..first + at.outputs.width
    }

    /// The outputs of the window without their forced motion.
    #[inline(always)]
    pub fn free(self, block: &mut [f64], at: Stretches) {
        let ([n, p, _], stride) = (at.channels(), self.stride);
        let window = at.outputs.last(at.depth);
        let (outputs, rest) = block.split_at_mut(self.free);
        let (free, motion) = rest.split_at_mut(self.motion - self.free);
        let outputs = &outputs[window];
        for i in 0..p {
            for (k, instant) in motion.chunks_exact(stride).take(at.depth).enumerate() {
                free[k * p + i] = outputs[k * p + i] - instant[n + i];
            }
        }
    }
}
