//! What a step of the observer leaves.

use crate::interval::Interval;
use crate::zonotope::Zonotope;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// What one step leaves. Intervals (n).
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct IntervalEstimate {
    /// Bounds of x(k+1), before y(k+1) is known.
    pub predicted: Vec<Interval>,
    /// Bounds of x(k) that use y(k).
    pub filtered: Vec<Interval>,
    /// The ball (44) around x̂(k+1), as a box.
    pub ball: Vec<Interval>,
    /// The box around the ellipsoid V ≤ V̄ around x̂(k+1).
    pub ellipsoid: Vec<Interval>,
    /// x̂(k+1) (n)
    pub center: Vec<f64>,
    /// The generators of e(k+1), one after another.
    pub generators: Vec<f64>,
}

impl IntervalEstimate {
    /// The zonotope of x(k+1).
    pub fn zonotope(&self) -> Zonotope {
        Zonotope::from_parts(self.center.clone(), self.generators.clone())
    }

    /// Whether the sizes are those of n states: all, or before the first step `predicted` alone.
    pub fn fits(&self, n: usize) -> bool {
        let proper = |x: &[Interval], len: usize| x.len() == len && x.iter().all(|x| x.lo <= x.hi);
        let rest = if self.center.is_empty() { 0 } else { n };
        n > 0
            && proper(&self.predicted, n)
            && [&self.filtered, &self.ball, &self.ellipsoid].iter().all(|x| proper(x, rest))
            && self.center.len() == rest
            && self.generators.len().is_multiple_of(n)
    }
}
