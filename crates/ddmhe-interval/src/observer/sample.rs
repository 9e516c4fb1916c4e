//! The sample at hand: what contradicts the model is reported with its number.

use crate::error::Error;
use crate::interval::Interval;

/// Number k of the sample y(k), counted from 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample(pub usize);

impl Sample {
    /// What both sets leave of a state, or that they leave nothing.
    pub(super) fn meet(self, state: usize, a: Interval, b: Interval) -> Result<Interval, Error> {
        a.intersect(b).ok_or_else(|| self.violation(state, [a, b]))
    }

    /// No value of this state is in all the sets.
    pub(super) fn violation(self, state: usize, sets: impl IntoIterator<Item = Interval>) -> Error {
        let (mut lo, mut hi) = (f64::NEG_INFINITY, f64::INFINITY);
        for set in sets {
            (lo, hi) = (lo.max(set.lo), hi.min(set.hi));
        }
        Error::ModelViolation { argument: "y", step: self.0, state, gap: lo - hi }
    }
}
