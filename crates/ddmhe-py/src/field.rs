//! A known magnetic field as two arrays.

use crate::convert::{DdmheError, Numbers, ShapeError};
use ddmhe_core::rigid::KnownField;
use pyo3::prelude::*;

/// B and K of one of these counts of samples, with p outputs; without a count of one, which has no
/// axis for it.
pub fn known_field(given: &Bound<'_, PyAny>, counts: &[usize], p: usize) -> PyResult<KnownField> {
    let pair = given.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>();
    let (B, K) = pair.map_err(|_| {
        let found = given.get_type();
        DdmheError::new_err(format!("field: expected a pair (B, K), found {found}"))
    })?;
    Ok(KnownField {
        B: part("field B", &B, counts, &[3])?,
        K: part("field K", &K, counts, &[p, 3])?,
    })
}

fn part(
    name: &str,
    given: &Bound<'_, PyAny>,
    counts: &[usize],
    last: &[usize],
) -> PyResult<Vec<f64>> {
    let numbers = Numbers::from(name, given)?;
    let mut expected = vec![last.to_vec()];
    if !counts.is_empty() {
        expected = counts.iter().map(|count| [&[*count], last].concat()).collect();
    }
    if expected.contains(&numbers.shape) {
        return Ok(numbers.data);
    }
    let expected: Vec<String> = expected.iter().map(|shape| tuple(shape)).collect();
    let found = tuple(&numbers.shape);
    Err(ShapeError::new_err(format!("{name}: expected {}, found {found}", expected.join(" or "))))
}

fn tuple(shape: &[usize]) -> String {
    let numbers: Vec<String> = shape.iter().map(usize::to_string).collect();
    format!("({}{})", numbers.join(", "), if shape.len() == 1 { "," } else { "" })
}
