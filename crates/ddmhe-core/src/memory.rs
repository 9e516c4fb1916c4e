//! The numbers of a running estimator, in one block that is allocated once: the moving window and
//! the room that a step works in.

use crate::active_set::work_len;
use crate::panels::padded;
use crate::tol;
use crate::window::Scratch;
use std::ops::Range;

/// The last samples of a signal, contiguous in memory: the window slides through a longer stretch
/// and moves back to its beginning once at the end of it, so that a step costs no shift.
#[derive(Debug, Clone)]
struct SlidingBuffer {
    at: usize,    // where the stretch begins
    width: usize, // numbers in a sample
    room: usize,  // samples in the stretch
    start: usize,
    len: usize,
}

impl SlidingBuffer {
    #[inline]
    fn window(&self) -> Range<usize> {
        let first = self.at + self.start * self.width;
        first..first + self.len * self.width
    }

    /// Where the next sample goes.
    #[inline]
    fn next(&mut self, block: &mut [f64]) -> Range<usize> {
        if self.start + self.len == self.room {
            block.copy_within(self.window(), self.at);
            self.start = 0;
        }
        self.len += 1;
        let end = self.window().end;
        end - self.width..end
    }

    #[inline]
    fn forget(&mut self) {
        self.start += 1;
        self.len -= 1;
    }

    fn clear(&mut self) {
        (self.start, self.len) = (0, 0);
    }
}

/// Sizes of the room that a step works in, in the order in which it lies in the block.
#[derive(Debug, Clone, Copy)]
struct Sizes {
    rank: usize,   // of z* and z, padded
    window: usize, // of the window and its bounds, padded
    outputs: usize,
    hessian_factor: usize,
    block: usize,
    moved: usize,
}

/// The moving window, as scaled deviations, and room for a step.
#[derive(Debug, Clone)]
pub(crate) struct Memory {
    block: Vec<f64>,
    outputs: SlidingBuffer,
    states: SlidingBuffer,
    missing: usize, // NaN in the window
    aside: usize,   // where the outputs are kept that were set aside
    sizes: Sizes,
    scratch: usize, // where the room begins
}

impl Memory {
    /// For windows up to `depth` and spaces up to rank r.
    pub fn new(n: usize, p: usize, depth: usize, r: usize) -> Self {
        let room = 2 * depth.max(32) + 1;
        let sizes = Sizes {
            rank: padded(r),
            window: padded((depth + 1) * n) + padded(depth * p),
            outputs: padded(depth * p),
            hessian_factor: r * r.next_multiple_of(4),
            block: padded(p * p),
            moved: padded(n),
        };
        let aside = padded(room * p) + padded(room * n);
        let scratch = aside + padded(depth * p);
        let Sizes { rank, window, outputs, hessian_factor, block, moved } = sizes;
        let len = scratch
            + 2 * rank
            + 3 * window
            + outputs
            + hessian_factor
            + block
            + moved
            + work_len(r);
        let slide = |at, width| SlidingBuffer { at, width, room, start: 0, len: 0 };
        Memory {
            block: vec![0.0; len],
            outputs: slide(0, p),
            states: slide(padded(room * p), n),
            missing: 0,
            aside,
            sizes,
            scratch,
        }
    }

    /// As new.
    pub fn clear(&mut self) {
        self.block.fill(0.0);
        self.outputs.clear();
        self.states.clear();
        self.missing = 0;
    }

    /// Outputs in the window.
    #[inline]
    pub fn depth(&self) -> usize {
        self.outputs.len
    }

    #[inline]
    pub fn outputs(&self) -> &[f64] {
        &self.block[self.outputs.window()]
    }

    #[inline]
    pub fn states(&self) -> &[f64] {
        &self.block[self.states.window()]
    }

    /// Whether an output in the window was not measured.
    #[inline]
    pub fn missing(&self) -> bool {
        self.missing > 0
    }

    /// An entry beyond [`MEASURABLE`](tol::MEASURABLE) counts as not measured. Returns how many do.
    #[inline]
    pub fn push_output(&mut self, y: impl Iterator<Item = f64>) -> usize {
        let at = self.outputs.next(&mut self.block);
        let mut missing = 0;
        for (slot, y) in self.block[at].iter_mut().zip(y) {
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
        self.outputs()[samples.start * p..samples.end * p].iter().all(|y| y.is_nan())
    }

    /// The sample of the window with the output that is furthest from the recording's mean.
    pub fn furthest(&self) -> usize {
        let far = |(k, y): (usize, &f64)| (if y.is_nan() { 0.0 } else { y.abs() }, k);
        let most = self.outputs().iter().enumerate().map(far).max_by(|a, b| a.0.total_cmp(&b.0));
        most.map_or(0, |(_, k)| k / self.outputs.width)
    }

    /// From now on these samples of the window count as not measured;
    /// [`take_back`](Self::take_back) undoes it.
    pub fn set_aside(&mut self, samples: Range<usize>) {
        let (p, window) = (self.outputs.width, self.outputs.window());
        self.block.copy_within(window.clone(), self.aside);
        self.block[window.start + samples.start * p..window.start + samples.end * p].fill(f64::NAN);
        self.count_missing();
    }

    /// The outputs as they were when some were [set aside](Self::set_aside).
    pub fn take_back(&mut self) {
        let window = self.outputs.window();
        self.block.copy_within(self.aside..self.aside + window.len(), window.start);
        self.count_missing();
    }

    /// A window that nothing is known of: the recording's mean state throughout, and no output.
    pub fn forget_all(&mut self) {
        let (outputs, states) = (self.outputs.window(), self.states.window());
        self.block[outputs].fill(f64::NAN);
        self.block[states].fill(0.0);
        self.count_missing();
    }

    fn count_missing(&mut self) {
        self.missing = self.outputs().iter().filter(|y| y.is_nan()).count();
    }

    /// Another newest state, as scaled deviations.
    pub fn replace_newest(&mut self, x: impl Iterator<Item = f64>) {
        let window = self.states.window();
        self.block[window.end - self.states.width..window.end]
            .iter_mut()
            .zip(x)
            .for_each(|(slot, x)| *slot = x);
    }

    /// Other states for those of the window, as scaled deviations.
    pub fn replace_states(&mut self, states: impl Iterator<Item = f64>) {
        let at = self.states.window();
        self.block[at].iter_mut().zip(states).for_each(|(slot, x)| *slot = x);
    }

    #[inline]
    pub fn push_state(&mut self, x: impl Iterator<Item = f64>) {
        let at = self.states.next(&mut self.block);
        self.block[at].iter_mut().zip(x).for_each(|(slot, x)| *slot = x);
    }

    /// Forgets the oldest output and the oldest state.
    #[inline]
    pub fn forget(&mut self) {
        if self.missing > 0 {
            let oldest = &self.outputs()[..self.outputs.width];
            self.missing -= oldest.iter().filter(|y| y.is_nan()).count();
        }
        self.outputs.forget();
        self.states.forget();
    }

    /// The window's states and outputs, and the room for a step.
    #[inline(always)]
    pub fn parts(&mut self) -> (&[f64], &[f64], Scratch<'_>) {
        let (window, room) = self.block.split_at_mut(self.scratch);
        let (free, room) = room.split_at_mut(self.sizes.rank);
        let (z, room) = room.split_at_mut(self.sizes.rank);
        let (answer, room) = room.split_at_mut(self.sizes.window);
        let (lo, room) = room.split_at_mut(self.sizes.window);
        let (hi, room) = room.split_at_mut(self.sizes.window);
        let (outputs, room) = room.split_at_mut(self.sizes.outputs);
        let (hessian_factor, room) = room.split_at_mut(self.sizes.hessian_factor);
        let (block, room) = room.split_at_mut(self.sizes.block);
        let (moved, work) = room.split_at_mut(self.sizes.moved);
        let scratch = Scratch {
            free,
            z,
            window: answer,
            lo,
            hi,
            outputs,
            hessian_factor,
            block,
            moved,
            work,
        };
        (&window[self.states.window()], &window[self.outputs.window()], scratch)
    }
}
