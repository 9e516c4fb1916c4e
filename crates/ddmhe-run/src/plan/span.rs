//! Where arrays are in a block of numbers.

use crate::panels::padded;

/// Where an array is in its block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    start: usize,
    end: usize,
}

impl Span {
    /// The array.
    #[inline(always)]
    pub fn of(self, block: &[f64]) -> &[f64] {
        &block[self.start..self.end]
    }

    /// The array, to be written.
    pub fn of_mut(self, block: &mut [f64]) -> &mut [f64] {
        &mut block[self.start..self.end]
    }

    /// How many numbers.
    pub fn len(self) -> usize {
        self.end - self.start
    }

    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.end == self.start
    }
}

/// Hands out spans one behind the other, each on whole panels.
pub(crate) struct Cursor(pub usize);

impl Cursor {
    pub fn take(&mut self, len: usize) -> Span {
        let start = self.0;
        self.0 += padded(len);
        Span { start, end: start + len }
    }
}
