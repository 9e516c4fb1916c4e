//! How long ago a run started from an unknown state, and what outputs are doubted by since.

use crate::memory::Memory;
use crate::plan::common::Shared;
use core::ops::Range;

impl<B: AsRef<[f64]> + AsMut<[f64]>> Memory<B> {
    /// Whether the window of the next step holds all outputs since an unknown state.
    #[inline(always)]
    pub fn grows(&self, horizon: usize) -> bool {
        self.since < horizon
    }

    /// Outputs since an unknown state; `usize::MAX` after a known one.
    pub fn since(&self) -> usize {
        self.since
    }

    /// One output more since then.
    #[inline(always)]
    pub(crate) fn count_output(&mut self) {
        self.since = self.since.saturating_add(1);
    }

    /// A run begins with the window that is in memory: what is made of the plan, and the evidence
    /// on its states. `elsewhere`: not at the recording's end.
    pub fn begin(&mut self, shared: &Shared<'_>, unknown: bool, elsewhere: bool) {
        self.prepare(shared);
        if unknown {
            self.since = 0;
        }
        self.start_evidence(shared, unknown, elsewhere);
    }

    /// Takes up a saved number of [outputs since](Self::since).
    pub fn resume_since(&mut self, since: usize) {
        self.since = since;
    }

    /// What is kept to doubt outputs with, to be saved.
    pub fn saved_gate(&self) -> &[f64] {
        &self.block.as_ref()[self.gate.kept()]
    }

    /// Takes it up.
    pub fn resume_gate(&mut self, saved: &[f64]) {
        let kept = self.gate.kept();
        self.block.as_mut()[kept].copy_from_slice(saved);
    }

    /// Where the newest inputs are (m).
    pub(crate) fn newest_input(&self) -> Range<usize> {
        self.inputs.last(1.min(self.inputs.len))
    }

    /// Where the forced part of the newest output is (p), where there are inputs.
    pub(crate) fn forced_newest(&self) -> Option<Range<usize>> {
        (self.inputs.width > 0).then(|| self.forced.newest_output(self.stretches()))
    }
}
