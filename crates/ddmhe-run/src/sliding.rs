//! A window that slides over a signal.

use core::ops::Range;

/// The last samples of a signal, contiguous in memory: the window slides through a longer stretch
/// and moves back to its beginning once at the end of it, so that a step costs no shift.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlidingBuffer {
    at: usize,        // where the stretch begins
    pub width: usize, // numbers in a sample
    samples: usize,   // in the stretch
    start: usize,
    pub len: usize,
}

impl SlidingBuffer {
    /// Empty, with room for so many samples from `at` on.
    pub fn new(at: usize, width: usize, samples: usize) -> Self {
        SlidingBuffer { at, width, samples, start: 0, len: 0 }
    }

    /// Where its samples are.
    #[inline]
    pub fn window(&self) -> Range<usize> {
        let first = self.at + self.start * self.width;
        first..first + self.len * self.width
    }

    /// Where the last samples are.
    #[inline]
    pub fn last(&self, samples: usize) -> Range<usize> {
        let end = self.window().end;
        end - samples * self.width..end
    }

    /// Where the next sample goes.
    #[inline]
    pub fn next(&mut self, block: &mut [f64]) -> Range<usize> {
        self.make_room(block);
        self.len += 1;
        self.last(1)
    }

    /// How many samples come to lie one behind the other from the next one on: at least one.
    #[inline]
    pub fn make_room(&mut self, block: &mut [f64]) -> usize {
        if self.start + self.len == self.samples {
            block.copy_within(self.window(), self.at);
            self.start = 0;
        }
        self.samples - self.start - self.len
    }

    /// So many samples have come to lie behind the newest, and as many are forgotten.
    #[inline]
    pub fn move_on(&mut self, samples: usize) {
        self.start += samples;
    }

    /// Forgets the oldest sample.
    #[inline]
    pub fn forget(&mut self) {
        self.start += 1;
        self.len -= 1;
    }

    /// Forgets the newest sample.
    pub fn retract(&mut self) {
        self.len = self.len.saturating_sub(1);
    }

    /// Forgets all but the newest samples.
    pub fn keep(&mut self, samples: usize) {
        let forgotten = self.len.saturating_sub(samples);
        (self.start, self.len) = (self.start + forgotten, self.len - forgotten);
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        (self.start, self.len) = (0, 0);
    }
}
