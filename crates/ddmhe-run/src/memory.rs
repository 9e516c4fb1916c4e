//! The numbers of a running estimator, in one block: the moving window and the room that a step
//! works in.

use crate::active_set::priced::priced_len;
use crate::active_set::working_set::{ActiveBound, Kept, Sides, WorkingSet};
use crate::panels::padded;
use crate::plan::common::{Shared, Sizes};
use crate::problem::Scratch;
use crate::sliding::SlidingBuffer;
use crate::tol;
use core::ops::Range;

/// Sizes of the room that a step works in, in the order in which it lies in the block.
#[derive(Debug, Clone, Copy)]
struct Room {
    rank: usize,   // of z* and z, padded
    window: usize, // of the window and its bounds, padded
    outputs: usize,
    hessian_factor: usize,
    block: usize,
    moved: usize,
    sides: usize,
}

impl Room {
    fn new(n: usize, p: usize, depth: usize, r: usize) -> Self {
        Room {
            rank: padded(r),
            window: padded((depth + 1) * n) + padded(depth * p),
            outputs: padded(depth * p),
            hessian_factor: r * r.next_multiple_of(4),
            block: padded(p * p),
            moved: padded(n),
            sides: padded(r),
        }
    }

    fn len_before_sides(&self) -> usize {
        let Room { rank, window, outputs, hessian_factor, block, moved, .. } = *self;
        2 * rank + 3 * window + outputs + hessian_factor + block + moved
    }

    fn len(&self, sizes: Sizes) -> usize {
        let Sizes { n, p, horizon, rank: r, prices, .. } = sizes;
        let soft = prices.soft_rows([padded((horizon + 1) * n), padded(horizon * p)]);
        self.len_before_sides() + 2 * self.sides + priced_len(r, self.window, soft)
    }
}

/// The moving window, as scaled deviations, and room for a step, in numbers that are owned or lent.
///
/// The window of a step may be shorter than what is kept: a run that grows through a few depths
/// only keeps all outputs until the horizon is reached.
#[derive(Debug, Clone)]
pub struct Memory<B> {
    block: B,
    outputs: SlidingBuffer,
    states: SlidingBuffer,
    inputs: SlidingBuffer,
    depth: usize,   // outputs in the window of this step
    missing: usize, // NaN among the outputs that are kept
    aside: usize,   // where the outputs are kept that were set aside
    forced: Forced, // where the forced motion is
    room: Room,
    scratch: usize, // where the room begins
    sides: usize,   // active bounds of the last step
    before: usize,
    kept: Kept,
}

/// Samples in the stretch that a window slides through.
fn samples(depth: usize) -> usize {
    2 * depth.max(32) + 1
}

/// Numbers that a memory takes, for windows up to `horizon` and up to `rank` directions.
pub fn memory_len(sizes: Sizes) -> usize {
    let Sizes { n, p, horizon, rank, .. } = sizes;
    let stretch = padded(samples(horizon) * p) + padded(samples(horizon) * n);
    let known = padded(horizon * p) + Forced::new(sizes, 0).len();
    stretch + known + Room::new(n, p, horizon, rank).len(sizes)
}

/// The forced motion of the window, and what is left of its outputs: nothing without inputs.
#[derive(Debug, Clone, Copy)]
struct Forced {
    inputs: usize, // where the stretch of the inputs begins
    x: usize,      // means + x_f, in the user's units
    free: usize,   // y - y_f
    motion: usize, // [x_f(k+1); y_f(k)] of each instant
    stride: usize, // from one to the next
    end: usize,
    at: usize,
}

impl Forced {
    fn new(sizes: Sizes, at: usize) -> Self {
        let Sizes { n, p, m, horizon, .. } = sizes;
        let known = |len: usize| if m > 0 { padded(len) } else { 0 };
        let x = at + known(samples(horizon) * m);
        let free = x + known((horizon + 1) * n);
        let motion = free + known(horizon * p);
        let stride = sizes.response().stride();
        Forced { inputs: at, x, free, motion, stride, end: motion + known(horizon * stride), at }
    }

    fn len(&self) -> usize {
        self.end - self.at
    }
}

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// In a block of [`memory_len`] zeros.
    pub fn new(sizes: Sizes, block: B) -> Self {
        let Sizes { n, p, m, horizon, rank, .. } = sizes;
        let samples = samples(horizon);
        let aside = padded(samples * p) + padded(samples * n);
        let forced = Forced::new(sizes, aside + padded(horizon * p));
        let slide = |at, width| SlidingBuffer::new(at, width, samples);
        Memory {
            block,
            outputs: slide(0, p),
            states: slide(padded(samples * p), n),
            inputs: slide(forced.inputs, m),
            depth: 0,
            missing: 0,
            aside,
            room: Room::new(n, p, horizon, rank),
            scratch: forced.end,
            forced,
            sides: 0,
            before: 0,
            kept: Kept::default(),
        }
    }

    /// As new.
    pub fn clear(&mut self) {
        self.block.as_mut().fill(0.0);
        self.outputs.clear();
        self.states.clear();
        self.inputs.clear();
        (self.depth, self.missing, self.sides, self.before) = (0, 0, 0, 0);
        self.kept = Kept::default();
    }

    /// Outputs that are kept.
    #[inline]
    pub fn len(&self) -> usize {
        self.outputs.len
    }

    /// Whether no output is kept.
    pub fn is_empty(&self) -> bool {
        self.outputs.len == 0
    }

    /// Outputs in the window of this step.
    #[inline]
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// The window of this step has another depth: rows have other places in it.
    pub fn deepen(&mut self, depth: usize) {
        self.depth = depth;
        self.working_set().clear();
    }

    /// All outputs that are kept.
    #[inline]
    pub fn outputs(&self) -> &[f64] {
        &self.block.as_ref()[self.outputs.window()]
    }

    /// All states that are kept.
    #[inline]
    pub fn states(&self) -> &[f64] {
        &self.block.as_ref()[self.states.window()]
    }

    /// The states of the window of this step but the newest, which is not estimated yet: x̄ first.
    #[inline]
    pub fn past(&self) -> &[f64] {
        &self.block.as_ref()[self.states.last(self.depth)]
    }

    /// The outputs in the window of this step.
    #[inline]
    pub fn window(&self) -> &[f64] {
        &self.block.as_ref()[self.outputs.last(self.depth)]
    }

    /// Whether an output in the window was not measured.
    #[inline]
    fn missing(&self) -> bool {
        self.missing > 0
            && (self.depth == self.outputs.len || self.window().iter().any(|y| y.is_nan()))
    }

    /// All inputs that are kept.
    pub fn inputs(&self) -> &[f64] {
        &self.block.as_ref()[self.inputs.window()]
    }

    /// The inputs in the window of this step.
    pub fn window_inputs(&self) -> &[f64] {
        &self.block.as_ref()[self.inputs.last(self.depth)]
    }

    /// Appends the inputs at the instant of the newest output, as scaled deviations.
    #[inline(always)]
    pub fn push_input(&mut self, u: impl Iterator<Item = f64>) {
        if self.inputs.width == 0 {
            return;
        }
        let at = self.inputs.next(self.block.as_mut());
        self.block.as_mut()[at].iter_mut().zip(u).for_each(|(slot, u)| *slot = u);
    }

    /// The forced motion of the window of this step, from its inputs.
    #[inline(always)]
    pub fn force(&mut self, shared: &Shared<'_>) {
        let Some(response) = shared.response() else { return };
        let (n, stride) = (self.states.width, self.forced.stride);
        let (inputs, forced) = (self.inputs.last(self.depth), self.forced);
        let (known, rest) = self.block.as_mut().split_at_mut(forced.x);
        let (x, rest) = rest.split_at_mut(forced.free - forced.x);
        let motion = &mut rest[forced.motion - forced.free..forced.end - forced.free];
        response.forced(&known[inputs], motion);
        // channel by channel: loops over the few channels of each instant cost more than their work
        let motion = &motion[..self.depth * stride];
        for (i, (mean, s)) in shared.mean_x.iter().zip(shared.s_x).enumerate() {
            x[i] = *mean;
            for (k, instant) in motion.chunks_exact(stride).enumerate() {
                x[(k + 1) * n + i] = mean + instant[i] * s;
            }
        }
    }

    /// The outputs of the window without their forced motion.
    #[inline(always)]
    fn free(&mut self) {
        let (n, p, stride) = (self.states.width, self.outputs.width, self.forced.stride);
        let window = self.outputs.last(self.depth);
        let (outputs, rest) = self.block.as_mut().split_at_mut(self.forced.free);
        let (free, motion) = rest.split_at_mut(self.forced.motion - self.forced.free);
        let outputs = &outputs[window];
        for i in 0..p {
            for (k, instant) in motion.chunks_exact(stride).take(self.depth).enumerate() {
                free[k * p + i] = outputs[k * p + i] - instant[n + i];
            }
        }
    }

    /// An entry beyond [`MEASURABLE`](tol::MEASURABLE) counts as not measured. Returns how many do.
    #[inline]
    pub fn push_output(&mut self, y: impl Iterator<Item = f64>) -> usize {
        let at = self.outputs.next(self.block.as_mut());
        let mut missing = 0;
        for (slot, y) in self.block.as_mut()[at].iter_mut().zip(y) {
            let within = y.abs() <= tol::MEASURABLE;
            *slot = if within { y } else { f64::NAN };
            missing += usize::from(!within);
        }
        self.missing += missing;
        missing
    }

    /// Whether nothing was measured in these samples of the window.
    pub fn silent(&self, samples: Range<usize>) -> bool {
        let p = self.outputs.width;
        self.window()[samples.start * p..samples.end * p].iter().all(|y| y.is_nan())
    }

    /// The sample of the window with the output that is furthest from the recording's mean.
    pub fn furthest(&self) -> usize {
        let far = |(k, y): (usize, &f64)| (if y.is_nan() { 0.0 } else { y.abs() }, k);
        let most = self.window().iter().enumerate().map(far).max_by(|a, b| a.0.total_cmp(&b.0));
        most.map_or(0, |(_, k)| k / self.outputs.width)
    }

    /// From now on these samples of the window count as not measured;
    /// [`take_back`](Self::take_back) undoes it.
    pub fn set_aside(&mut self, samples: Range<usize>) {
        let (p, window) = (self.outputs.width, self.outputs.last(self.depth));
        let block = self.block.as_mut();
        block.copy_within(window.clone(), self.aside);
        block[window.start + samples.start * p..window.start + samples.end * p].fill(f64::NAN);
        self.count_missing();
    }

    /// The outputs as they were when some were [set aside](Self::set_aside).
    pub fn take_back(&mut self) {
        let window = self.outputs.last(self.depth);
        self.block.as_mut().copy_within(self.aside..self.aside + window.len(), window.start);
        self.count_missing();
    }

    /// A window that nothing is known of: the recording's mean state throughout, and no output.
    pub fn forget_all(&mut self) {
        let (outputs, states) = (self.outputs.window(), self.states.window());
        self.block.as_mut()[outputs].fill(f64::NAN);
        self.block.as_mut()[states].fill(0.0);
        self.count_missing();
    }

    fn count_missing(&mut self) {
        self.missing = self.outputs().iter().filter(|y| y.is_nan()).count();
    }

    /// Another newest state, as scaled deviations.
    pub fn replace_newest(&mut self, x: impl Iterator<Item = f64>) {
        let at = self.states.last(1);
        self.block.as_mut()[at].iter_mut().zip(x).for_each(|(slot, x)| *slot = x);
    }

    /// Other states for those of a window that is estimated: its past and the newest.
    pub fn replace_states(&mut self, states: impl Iterator<Item = f64>) {
        let at = self.states.last(self.depth + 1);
        self.block.as_mut()[at].iter_mut().zip(states).for_each(|(slot, x)| *slot = x);
    }

    /// Other states for those between the oldest and the newest of such a window.
    pub fn replace_past(&mut self, states: impl Iterator<Item = f64>) {
        let at = self.states.last(self.depth);
        self.block.as_mut()[at].iter_mut().zip(states).for_each(|(slot, x)| *slot = x);
    }

    /// Appends a state, as scaled deviations.
    #[inline(always)]
    pub fn push_state(&mut self, x: impl Iterator<Item = f64>) {
        let at = self.states.next(self.block.as_mut());
        self.block.as_mut()[at].iter_mut().zip(x).for_each(|(slot, x)| *slot = x);
    }

    /// Forgets the oldest output with its inputs, and the oldest state.
    #[inline]
    pub fn forget(&mut self) {
        if self.missing > 0 {
            let oldest = &self.outputs()[..self.outputs.width];
            self.missing -= oldest.iter().filter(|y| y.is_nan()).count();
        }
        self.outputs.forget();
        self.states.forget();
        if self.inputs.width > 0 {
            self.inputs.forget();
        }
    }

    /// The active bounds of the last step.
    pub fn working_set(&mut self) -> WorkingSet<'_> {
        self.parts().working
    }

    /// The same, to be saved.
    pub fn active(&self) -> impl Iterator<Item = ActiveBound> + '_ {
        let at = self.scratch + self.room.len_before_sides();
        self.block.as_ref()[at..at + self.sides].iter().map(|code| ActiveBound::decode(*code))
    }

    /// Whether they move with the window.
    pub fn moves(&self) -> bool {
        self.kept.moves
    }

    /// Takes up saved active bounds of a window of this depth.
    pub fn resume(&mut self, depth: usize, active: &[ActiveBound], moves: bool) {
        if depth > self.len() {
            return; // no step was made
        }
        self.deepen(depth);
        let mut working = self.working_set();
        active.iter().for_each(|side| working.sides.push(*side));
        working.kept.moves = moves;
    }

    /// The window's x̄ and outputs, and the room for a step.
    #[inline(always)]
    pub fn parts(&mut self) -> Parts<'_> {
        let missing = self.missing();
        let (states, outputs) = (self.states.last(self.depth), self.outputs.last(self.depth));
        let (outputs, means) = match self.inputs.width {
            0 => (outputs, None),
            _ => {
                self.free();
                let Forced { x, free, .. } = self.forced;
                let states = (self.depth + 1) * self.states.width;
                (free..free + outputs.len(), Some(x..x + states))
            }
        };
        let (window, room) = self.block.as_mut().split_at_mut(self.scratch);
        let (unconstrained, room) = room.split_at_mut(self.room.rank);
        let (z, room) = room.split_at_mut(self.room.rank);
        let (answer, room) = room.split_at_mut(self.room.window);
        let (lo, room) = room.split_at_mut(self.room.window);
        let (hi, room) = room.split_at_mut(self.room.window);
        let (filled, room) = room.split_at_mut(self.room.outputs);
        let (hessian_factor, room) = room.split_at_mut(self.room.hessian_factor);
        let (block, room) = room.split_at_mut(self.room.block);
        let (moved, room) = room.split_at_mut(self.room.moved);
        let (sides, room) = room.split_at_mut(self.room.sides);
        let (before, work) = room.split_at_mut(self.room.sides);
        let n = self.states.width;
        Parts {
            prior: &window[states.start..states.start + n],
            outputs: &window[outputs],
            means: means.map(|means| &window[means]),
            missing,
            scratch: Scratch {
                unconstrained,
                z,
                window: answer,
                lo,
                hi,
                outputs: filled,
                hessian_factor,
                block,
                moved,
                work,
            },
            working: WorkingSet {
                sides: Sides::new(sides, &mut self.sides),
                before: Sides::new(before, &mut self.before),
                kept: &mut self.kept,
            },
        }
    }
}

/// A memory, part by part.
#[derive(Debug)]
pub struct Parts<'a> {
    /// x̄(t-m) (n), as scaled deviations.
    pub prior: &'a [f64],
    /// y(t-m) … y(t-1) (m·p), NaN where not measured; without their forced motion.
    pub outputs: &'a [f64],
    /// Means of the states with the forced motion, where there are inputs.
    pub means: Option<&'a [f64]>,
    /// Whether there is a NaN among them.
    pub missing: bool,
    /// Room for a step.
    pub scratch: Scratch<'a>,
    /// The active bounds of the last step.
    pub working: WorkingSet<'a>,
}
