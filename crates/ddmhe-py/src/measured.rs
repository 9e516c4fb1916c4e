//! What was measured along a log, as arguments: outputs and known inputs, a row a sample.

use crate::convert::{Numbers, ShapeError};
use pyo3::prelude::*;

/// The outputs of a log (N, p), and N; of one output (N,), too.
pub fn outputs(argument: &str, given: &Bound<'_, PyAny>, p: usize) -> PyResult<(Vec<f64>, usize)> {
    let numbers = Numbers::measured(argument, given)?;
    let made = if p == 1 {
        numbers.into_channels(argument, "(N, p)")
    } else {
        numbers.into_matrix(argument, "(N, p)")
    };
    let (data, rows, columns) = made?;
    if columns == p {
        return Ok((data, rows));
    }
    let hint = if rows == p { ", in an array that looks transposed" } else { "" };
    Err(ShapeError::new_err(format!("{argument}: expected {p} columns, found {columns}{hint}")))
}

/// The known inputs of a log of so many samples (N·m numbers), which are to be there where the
/// recording has inputs.
pub fn inputs(
    argument: &str,
    given: Option<&Bound<'_, PyAny>>,
    (samples, m): (usize, usize),
) -> PyResult<Vec<f64>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    let numbers = Numbers::from(argument, given)?;
    let (data, rows, columns) = match m {
        1 => numbers.into_channels(argument, "(N, m)")?,
        _ => numbers.into_matrix(argument, "(N, m)")?,
    };
    if (rows, columns) == (samples, m) {
        return Ok(data);
    }
    let expected = match m {
        0 => "none, for a recording without inputs".to_string(),
        m => format!("shape ({samples}, {m}), one row for each of Y"),
    };
    let found = format!("({rows}, {columns})");
    Err(ShapeError::new_err(format!("{argument}: expected {expected}, found {found}")))
}
