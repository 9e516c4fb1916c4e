//! Checks of arguments that more than one part of the crate takes.

use crate::error::Error;
use crate::history::check_finite;

/// A vector of `len` finite numbers.
pub(crate) fn check_vector(argument: &'static str, x: &[f64], len: usize) -> Result<(), Error> {
    if x.len() != len {
        return Err(Error::shape(argument, format!("{len} numbers"), x.len()));
    }
    check_finite(argument, x, len)
}
