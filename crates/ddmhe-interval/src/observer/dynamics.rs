//! What the observer asks of a system's nonlinear part.

use crate::error::Error;
use crate::interval::Interval;

/// The nonlinear part f of the system and its Jacobian. Implementations must enclose: the guarantee
/// rests on them.
pub trait Dynamics {
    /// Encloses f(x) at a single point (n). Wider than rounding where f depends on parameters known
    /// within bounds.
    ///
    /// # Errors
    /// What the implementation cannot compute.
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error>;

    /// Encloses every entry of Df over a box (n), row-major (n·n).
    ///
    /// # Errors
    /// What the implementation cannot compute.
    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error>;

    /// Bound on |y - C x - r - D2 v| over a box (n), (p): zero unless C or r are known within
    /// bounds only.
    ///
    /// # Errors
    /// What the implementation cannot compute.
    fn output_error(&self, _x: &[Interval], out: &mut [f64]) -> Result<(), Error> {
        out.fill(0.0);
        Ok(())
    }
}

/// Whatever is behind a pointer.
impl<D: Dynamics + ?Sized> Dynamics for Box<D> {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        (**self).value(x, out)
    }

    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        (**self).jacobian(x, out)
    }

    fn output_error(&self, x: &[Interval], out: &mut [f64]) -> Result<(), Error> {
        (**self).output_error(x, out)
    }
}
