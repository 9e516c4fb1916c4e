//! The room that a step works in.

use crate::active_set::priced::priced_len;
use crate::kalman;
use crate::panels::padded;
use crate::plan::common::Sizes;
use crate::sensitivity::sensitivity_len;
use core::ops::Range;

/// Sizes of the room that a step works in, in the order in which it lies in the block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    pub rank: usize,        // of z*, padded
    pub window: usize,      // padded
    pub sides: usize,       // twice
    pub spare: [usize; 10], // see `Spare`
}

impl Room {
    pub fn new(sizes: Sizes) -> Self {
        let Sizes { n, p, horizon, rank: r, .. } = sizes;
        let (rank, window) = (padded(r), sizes.layout(horizon).apart());
        let spare = [
            padded(p * p),
            padded(n),
            rank,
            window,
            window,
            padded(horizon * p),
            r * r.next_multiple_of(4),
            if sizes.recorded { kalman::room(n, p) } else { 0 },
            if sizes.judged() { padded(sensitivity_len(n, p, r)) } else { 0 },
            if sizes.gate > 0.0 { padded(2 * p) } else { 0 },
        ];
        Room { rank, window, sides: padded(r), spare }
    }

    pub fn len_before_sides(&self) -> usize {
        self.rank + self.window
    }

    pub fn spare_at(&self) -> usize {
        self.len_before_sides() + 2 * self.sides
    }

    pub fn sensitivity(&self) -> Range<usize> {
        let at = self.spare_at() + self.spare[..8].iter().sum::<usize>();
        at..at + self.spare[8]
    }

    pub fn innovation_at(&self) -> usize {
        self.sensitivity().end
    }

    pub fn len(&self, sizes: Sizes) -> usize {
        let soft = sizes.prices.soft_rows(sizes.layout(sizes.horizon));
        let spare = self.spare.iter().sum::<usize>();
        self.spare_at() + spare + priced_len(sizes.rank, self.window, soft)
    }
}
