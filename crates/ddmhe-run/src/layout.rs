//! Where the rows of a window are: the only file that knows.
//!
//! A window of depth m has the blocks x | y | w: the states x(0) … x(m), which are estimated, the
//! outputs y(0) … y(m-1), which are measured, and, where the system is disturbed, the disturbances
//! w(0) … w(m-1), which are fitted. Two orders are in use:
//!
//! - *in time*, x(0), y(0), …, x(m-1), y(m-1), x(m): a shorter window is the head of a longer one.
//!   Windows of a recording are stacked and decomposed in this order; no recording shows w.
//! - *apart*, all states, then all outputs, then all disturbances, each block padded to whole
//!   panels: a step reads and writes whole blocks.
//!
//! What the cost (17) sees of a window is x(0) and all outputs, in the order of the gain's columns:
//! \[x̄; y\].

use crate::panels::padded;
use core::ops::Range;

/// Sizes of the windows of one depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// States n.
    pub n: usize,
    /// Outputs p.
    pub p: usize,
    /// Depth m: outputs in the window.
    pub depth: usize,
    /// Whether a disturbance w(k) (n) is fitted between x(k) and x(k+1).
    pub driven: bool,
}

impl Layout {
    /// Rows of x(k), in time.
    pub fn x(self, k: usize) -> Range<usize> {
        let start = k * (self.n + self.p);
        start..start + self.n
    }

    /// Rows of y(k), in time.
    pub fn y(self, k: usize) -> Range<usize> {
        let start = k * (self.n + self.p) + self.n;
        start..start + self.p
    }

    /// Rows of all states, oldest first, in time.
    pub fn states(self) -> impl Iterator<Item = usize> {
        (0..=self.depth).flat_map(move |k| self.x(k))
    }

    /// Rows of all outputs, oldest first, in time.
    pub fn outputs(self) -> impl Iterator<Item = usize> {
        (0..self.depth).flat_map(move |k| self.y(k))
    }

    /// Rows that the cost (17) sees, in the order of \[x̄; y\], in time.
    pub fn seen(self) -> impl Iterator<Item = usize> {
        self.x(0).chain(self.outputs())
    }

    /// How many the cost sees: n + m p.
    #[inline(always)]
    pub fn seen_len(self) -> usize {
        self.n + self.depth * self.p
    }

    /// Numbers in the states of a window: (m+1) n.
    #[inline(always)]
    pub fn states_len(self) -> usize {
        (self.depth + 1) * self.n
    }

    /// Numbers in its outputs: m p.
    #[inline(always)]
    pub fn outputs_len(self) -> usize {
        self.depth * self.p
    }

    /// Numbers in its disturbances: m n, or none.
    #[inline(always)]
    pub fn disturbances_len(self) -> usize {
        if self.driven { self.depth * self.n } else { 0 }
    }

    /// Rows of the states, padded: where the outputs begin, apart.
    #[inline(always)]
    pub fn split(self) -> usize {
        padded(self.states_len())
    }

    /// Rows of the states and outputs, padded: where the disturbances begin, apart.
    #[inline(always)]
    pub fn second_split(self) -> usize {
        self.split() + padded(self.outputs_len())
    }

    /// Rows of a window with all paddings, apart.
    #[inline(always)]
    pub fn apart(self) -> usize {
        self.second_split() + padded(self.disturbances_len())
    }

    /// Where a row is, apart, when the window has moved on by a sample; None if it has left it.
    #[inline(always)]
    pub fn older(self, row: usize) -> Option<usize> {
        let (split, second) = (self.split(), self.second_split());
        if row < split {
            row.checked_sub(self.n)
        } else if row < second {
            (row - split).checked_sub(self.p).map(|row| split + row)
        } else {
            (row - second).checked_sub(self.n).map(|row| second + row)
        }
    }
}
