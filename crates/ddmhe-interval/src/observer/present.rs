//! Where an interval observer stands: what its arguments do not say.

use crate::interval::Interval;
use crate::observer::error_zonotope::ErrorSet;
use crate::observer::estimate::IntervalEstimate;
use crate::observer::level::LevelSet;
use crate::observer::plant::Transition;
#[cfg(feature = "serde")]
use crate::tol;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// The three sets after `step` samples. Saved as it is: a change of its fields is one of the format
/// of [`blob`](crate::blob).
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(super) struct Present {
    pub step: usize,
    pub set: ErrorSet,
    pub level: LevelSet,
    pub state: Vec<Interval>, // the box of x
    pub past: Vec<Transition>,
    pub estimate: IntervalEstimate,
}

#[cfg(feature = "serde")]
impl Present {
    /// Whether an observer of n states and p outputs could stand there.
    pub(super) fn fits(&self, n: usize, p: usize) -> bool {
        let proper = |x: &[Interval], len: usize| x.len() == len && x.iter().all(|x| x.lo <= x.hi);
        let past =
            |at: &Transition| proper(&at.x, n) && proper(&at.input, n) && proper(&at.output, p);
        self.step < usize::MAX / 2
            && self.set.center.len() == n
            && self.set.generators.len().is_multiple_of(n)
            && self.level.distance >= 0.0
            && self.level.decay >= 0.0
            && proper(&self.state, n)
            && self.past.len() <= tol::TRANSITIONS
            && self.past.iter().all(past)
            && self.estimate.fits(n)
    }
}
