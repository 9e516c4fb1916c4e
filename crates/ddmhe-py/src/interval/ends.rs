//! Intervals at the border: pairs of arrays, and generators as the columns of a matrix.

use crate::convert::{DdmheError, array1, array2};
use ddmhe_core::Interval;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// (lo, hi), one number a state each.
pub type Ends<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// The two ends of every interval.
pub fn ends<'py>(py: Python<'py>, x: &[Interval]) -> Ends<'py> {
    let side = |f: fn(&Interval) -> f64| array1(py, &x.iter().map(f).collect::<Vec<_>>());
    (side(|x| x.lo), side(|x| x.hi))
}

/// Generators stored by columns as an (n, m) array.
pub fn columns<'py>(
    py: Python<'py>,
    generators: &[f64],
    n: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let m = generators.len() / n;
    let rows: Vec<f64> = (0..n).flat_map(|i| (0..m).map(move |j| generators[j * n + i])).collect();
    if m == 0 {
        return Ok(PyArray2::zeros(py, [n, 0], false));
    }
    array2(py, rows, m)
}

/// Intervals from their ends.
pub fn intervals(argument: &'static str, lo: &[f64], hi: &[f64]) -> PyResult<Vec<Interval>> {
    let wrong = |k: usize| {
        let text = format!(
            "{argument}: expected lower ends not above the upper, found {} and {}",
            lo[k], hi[k]
        );
        DdmheError::new_err(text)
    };
    (0..lo.len()).map(|k| Interval::new(lo[k], hi[k]).ok_or_else(|| wrong(k))).collect()
}
