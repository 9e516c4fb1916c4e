//! Checks of arguments, the same for intervals, recordings and estimators.

use crate::error::Error;

/// A vector of `len` finite numbers.
///
/// # Errors
/// [`Error::Shape`] or [`Error::NotFinite`].
pub fn check_vector(argument: &'static str, x: &[f64], len: usize) -> Result<(), Error> {
    if x.len() != len {
        return Err(Error::shape(argument, format!("{len} numbers"), x.len()));
    }
    check_finite(argument, x, len)
}

/// Rejects NaN and infinity, naming the place in a matrix of `width` columns.
///
/// # Errors
/// [`Error::NotFinite`].
pub fn check_finite(argument: &'static str, values: &[f64], width: usize) -> Result<(), Error> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(k) => {
            Err(Error::NotFinite { argument, row: k / width, column: k % width, value: values[k] })
        }
    }
}
