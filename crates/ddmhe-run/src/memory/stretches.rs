//! Where the samples that a window slides through are in the block.

use crate::sliding::SlidingBuffer;

/// Samples in the stretch that a window slides through.
pub(super) fn samples(depth: usize) -> usize {
    2 * depth.max(32) + 1
}

/// The samples that are kept, and the window of this step among them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stretches {
    pub outputs: SlidingBuffer,
    pub states: SlidingBuffer,
    pub inputs: SlidingBuffer,
    /// Outputs in the window of this step.
    pub depth: usize,
    /// NaN among the outputs that are kept.
    pub missing: usize,
}

impl Stretches {
    /// n, p and m.
    #[inline(always)]
    pub fn channels(&self) -> [usize; 3] {
        [self.states.width, self.outputs.width, self.inputs.width]
    }

    /// Whether an output in the window was not measured.
    #[inline(always)]
    pub fn missing(&self, block: &[f64]) -> bool {
        self.missing > 0
            && (self.depth == self.outputs.len
                || block[self.outputs.last(self.depth)].iter().any(|y| y.is_nan()))
    }
}
