//! A window that slides over a signal.

use core::ops::Range;

/// The last samples of a signal, contiguous in memory: the window slides through a longer stretch
/// and moves back to its beginning once at the end of it, so that a step costs no shift.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SlidingBuffer {
    at: usize,        // where the stretch begins
    limit: usize,     // where it ends
    pub width: usize, // numbers in a sample
    start: usize,     // where the samples begin
    end: usize,       // where they end
    pub len: usize,
}

impl SlidingBuffer {
    /// Empty, with room for so many samples from `at` on.
    pub fn new(at: usize, width: usize, samples: usize) -> Self {
        SlidingBuffer { at, limit: at + samples * width, width, start: at, end: at, len: 0 }
    }

    /// Where its samples are.
    #[inline]
    pub fn window(&self) -> Range<usize> {
        self.start..self.end
    }

    /// Where the last samples are.
    #[inline]
    pub fn last(&self, samples: usize) -> Range<usize> {
        self.end - samples * self.width..self.end
    }

    /// Where the next sample goes.
    #[inline]
    pub fn next(&mut self, block: &mut [f64]) -> Range<usize> {
        self.make_room(block);
        let from = self.end;
        self.end += self.width;
        self.len += 1;
        from..self.end
    }

    /// At least one sample comes to lie behind the newest one.
    #[inline]
    pub fn make_room(&mut self, block: &mut [f64]) {
        if self.end == self.limit {
            block.copy_within(self.window(), self.at);
            (self.start, self.end) = (self.at, self.at + (self.end - self.start));
        }
    }

    /// How many samples come to lie one behind the other from the next one on, of a signal that has
    /// channels.
    #[inline]
    pub fn room(&self) -> usize {
        (self.limit - self.end) / self.width.max(1)
    }

    /// So many samples have come to lie behind the newest, and as many are forgotten.
    #[inline]
    pub fn move_on(&mut self, samples: usize) {
        self.start += samples * self.width;
        self.end += samples * self.width;
    }

    /// Forgets the oldest sample.
    #[inline]
    pub fn forget(&mut self) {
        self.start += self.width;
        self.len -= 1;
    }

    /// Forgets the newest sample.
    pub fn retract(&mut self) {
        if self.len > 0 {
            self.len -= 1;
            self.end -= self.width;
        }
    }

    /// Forgets all but the newest samples.
    pub fn keep(&mut self, samples: usize) {
        self.len = self.len.min(samples);
        self.start = self.end - self.len * self.width;
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        (self.start, self.end, self.len) = (self.at, self.at, 0);
    }
}
