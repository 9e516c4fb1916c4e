//! Where a fit begins.

use crate::rigid::earlier::Firsts;
use crate::rigid::motion::Family;

/// A motion, and all unknowns of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start<M, const N: usize> {
    /// The family that it is of.
    pub motion: M,
    /// (ω at the recording's beginning, θ).
    pub z: [f64; N],
    /// ω at the beginnings of earlier recordings.
    pub firsts: Firsts,
}

impl<M, const N: usize> Start<M, N> {
    /// The same motion in coordinates of its own.
    pub fn rebased<const P: usize>(&self) -> Self
    where
        M: Family<P, N>,
    {
        let (motion, z) = self.motion.rebased(&self.z);
        Start { motion, z, firsts: self.firsts }
    }
}
