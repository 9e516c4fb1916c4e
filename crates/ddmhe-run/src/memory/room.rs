//! The room that a step works in.

use crate::active_set::priced::priced_len;
use crate::kalman;
use crate::panels::padded;
use crate::plan::common::Sizes;
use crate::sensitivity::sensitivity_len;

/// Sizes of the room that a step works in, in the order in which it lies in the block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    pub rank: usize,   // of z* and z, padded
    pub window: usize, // of the window and its bounds, padded
    pub outputs: usize,
    pub hessian_factor: usize,
    pub block: usize,
    pub moved: usize,
    pub smoothing: usize,
    pub sensitivity: usize,
    pub innovation: usize,
    pub sides: usize,
}

impl Room {
    pub fn new(sizes: Sizes) -> Self {
        let Sizes { n, p, horizon, rank: r, .. } = sizes;
        Room {
            rank: padded(r),
            window: sizes.layout(horizon).apart(),
            outputs: padded(horizon * p),
            hessian_factor: r * r.next_multiple_of(4),
            block: padded(p * p),
            moved: padded(n),
            smoothing: if sizes.recorded { kalman::room(n, p) } else { 0 },
            sensitivity: if sizes.judged() { padded(sensitivity_len(n, p, r)) } else { 0 },
            innovation: if sizes.gate > 0.0 { padded(2 * p) } else { 0 },
            sides: padded(r),
        }
    }

    pub fn len_before_sides(&self) -> usize {
        self.innovation_at() + self.innovation
    }

    pub fn innovation_at(&self) -> usize {
        self.sensitivity_at() + self.sensitivity
    }

    pub fn sensitivity_at(&self) -> usize {
        let Room { rank, window, outputs, hessian_factor, block, moved, smoothing, .. } = *self;
        2 * rank + 3 * window + outputs + hessian_factor + block + moved + smoothing
    }

    pub fn len(&self, sizes: Sizes) -> usize {
        let soft = sizes.prices.soft_rows(sizes.layout(sizes.horizon));
        self.len_before_sides() + 2 * self.sides + priced_len(sizes.rank, self.window, soft)
    }
}
