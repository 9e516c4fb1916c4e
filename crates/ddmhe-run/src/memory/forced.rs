//! The forced motion of a window: what its known inputs make of it.

use crate::look_ahead::LookAhead;
use crate::memory::stretches::{Stretches, samples};
use crate::panels::{padded, scaled_sum};
use crate::plan::common::{Shared, Sizes};
use crate::response::Response;

/// The forced motion of the window, and what is left of its outputs: nothing without inputs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Forced {
    pub inputs: usize, // where the stretch of the inputs begins
    pub x: usize,      // means + x_f, in the user's units
    pub free: usize,   // y - y_f
    x_f: usize,        // x_f(0), …
    y_f: usize,        // y_f(0), …
    scales: usize,     // s_x, for each x_f
    own: usize,        // what is made of the response, or room for an instant of it
    pub end: usize,
    at: usize,
    look_ahead: Option<LookAhead>,
    /// Whether what is made of the plan is there.
    prepared: bool,
}

impl Forced {
    pub fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, m, horizon, .. } = sizes;
        let known = |len: usize| if m > 0 { padded(len) } else { 0 };
        let look_ahead = LookAhead::new(sizes.response());
        let [states, outputs] = match look_ahead {
            Some(look_ahead) => look_ahead.motion_len(horizon),
            None => [horizon * n, horizon * p],
        };
        let x = at + known(samples(horizon) * m);
        let free = x + known((horizon + 1) * n);
        let x_f = free + known(horizon * p);
        let y_f = x_f + known(n + states);
        let scales = y_f + known(outputs);
        let own = scales + known((horizon + 1) * n);
        let end = own + look_ahead.map_or(known(n + p), LookAhead::len);
        Forced { inputs: at, x, free, x_f, y_f, scales, own, end, at, look_ahead, prepared: false }
    }

    pub fn len(&self) -> usize {
        self.end - self.at
    }

    /// The block was cleared.
    pub fn clear(&mut self) {
        self.prepared = false;
    }

    /// What is made once of a plan: at the start of a run, so that no step takes its time.
    pub fn prepare(&mut self, block: &mut [f64], shared: &Shared<'_>) {
        if let Some(response) = shared.response().filter(|_| !self.prepared) {
            self.make(block, shared, &response);
        }
    }

    #[cold]
    fn make(&mut self, block: &mut [f64], shared: &Shared<'_>, response: &Response<'_>) {
        let (scales, own) = block[self.scales..self.end].split_at_mut(self.own - self.scales);
        let tiled = shared.s_x.iter().cycle();
        scales.iter_mut().zip(tiled).for_each(|(to, s)| *to = *s);
        if let Some(look_ahead) = self.look_ahead {
            look_ahead.make(response, own);
        }
        self.prepared = true;
    }

    /// The forced motion of the window of this step, from its inputs.
    #[inline(always)]
    pub fn force(&mut self, block: &mut [f64], at: Stretches, shared: &Shared<'_>) {
        let Some(response) = shared.response() else { return };
        if !self.prepared {
            self.make(block, shared, &response);
        }
        let (n, depth) = (at.states.width, at.depth);
        let Forced { x, x_f, y_f, scales, own, end, .. } = *self;
        let (known, rest) = block.split_at_mut(x);
        let (x, rest) = rest.split_at_mut(x_f - x);
        let (x_f, rest) = rest.split_at_mut(y_f - x_f);
        let (y_f, rest) = rest.split_at_mut(scales - y_f);
        let (scales, rest) = rest.split_at_mut(own - scales);
        let (own, u) = (&mut rest[..end - own], &known[at.inputs.last(depth)]);
        let after_first = &mut x_f[n..]; // x_f(0) = 0
        match self.look_ahead {
            Some(look_ahead) => look_ahead.forced(own, u, after_first, y_f),
            None => response.forced(u, after_first, y_f, own),
        }
        let means = shared.means(shared.sizes.layout(depth));
        let states = means.len();
        scaled_sum(means, &x_f[..states], &scales[..states], &mut x[..states]);
    }

    /// Where the window's outputs without it are, and the states that it makes of their means.
    #[inline(always)]
    pub fn moved(self, at: Stretches) -> [core::ops::Range<usize>; 2] {
        let [n, p, _] = at.channels();
        [self.free..self.free + at.depth * p, self.x..self.x + (at.depth + 1) * n]
    }

    /// Where the forced part of the newest output is (p).
    pub fn newest_output(self, at: Stretches) -> core::ops::Range<usize> {
        let end = self.y_f + at.depth * at.outputs.width;
        end - at.outputs.width..end
    }

    /// The outputs of the window without their forced motion.
    #[inline(always)]
    pub fn free(self, block: &mut [f64], at: Stretches) {
        let window = at.outputs.last(at.depth);
        let (outputs, rest) = block.split_at_mut(self.free);
        let (free, motion) = rest.split_at_mut(self.y_f - self.free);
        let (outputs, free) = (&outputs[window.clone()], &mut free[..window.len()]);
        for ((free, y), y_f) in free.iter_mut().zip(outputs).zip(&*motion) {
            *free = y - y_f;
        }
    }
}
