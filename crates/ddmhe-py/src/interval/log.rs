//! All sets of a run of the interval observer.

use crate::convert::{DdmheError, ModelViolationError, array2, raise};
use crate::pickle::{Made, bytes, made};
use ddmhe_core::snapshot::{Kind, from_bytes, to_bytes};
use ddmhe_core::{Interval, IntervalEstimate};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyType;
use serde::{Deserialize, Serialize};

/// All sets of a run: N rows, up to the first sample that contradicts model and bounds.
#[pyclass(module = "ddmhe._core", name = "IntervalLog", frozen)]
#[derive(Serialize, Deserialize)]
pub struct IntervalLog {
    n: usize,
    lower: Vec<f64>,
    upper: Vec<f64>,
    center: Vec<f64>,
    filtered: [Vec<f64>; 2],
    ball: [Vec<f64>; 2],
    ellipsoid: [Vec<f64>; 2],
    pub violation: Option<String>,
}

type Sides<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

impl IntervalLog {
    /// Without rows, for `rows` of them of n states.
    pub fn empty(n: usize, rows: usize) -> Self {
        let side = || Vec::with_capacity(rows * n);
        let pair = || [side(), side()];
        let (lower, upper, center) = (side(), side(), side());
        let (filtered, ball, ellipsoid) = (pair(), pair(), pair());
        IntervalLog { n, lower, upper, center, filtered, ball, ellipsoid, violation: None }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.lower.len() / self.n
    }

    /// One row more.
    pub fn push(&mut self, e: &IntervalEstimate) {
        let lower = |x: &Interval| x.lo;
        let upper = |x: &Interval| x.hi;
        self.lower.extend(e.predicted.iter().map(lower));
        self.upper.extend(e.predicted.iter().map(upper));
        self.center.extend(&e.center);
        for (sides, x) in [
            (&mut self.filtered, &e.filtered),
            (&mut self.ball, &e.ball),
            (&mut self.ellipsoid, &e.ellipsoid),
        ] {
            sides[0].extend(x.iter().map(lower));
            sides[1].extend(x.iter().map(upper));
        }
    }

    fn pair<'py>(&self, py: Python<'py>, sides: &[Vec<f64>; 2]) -> PyResult<Sides<'py>> {
        Ok((array2(py, sides[0].clone(), self.n)?, array2(py, sides[1].clone(), self.n)?))
    }
}

#[pymethods]
impl IntervalLog {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Made<'py>> {
        made::<Self>(py, "_restore", &to_bytes(Kind::IntervalLog, self))
    }

    #[classmethod]
    fn _restore(_cls: &Bound<'_, PyType>, blob: &Bound<'_, PyAny>) -> PyResult<Self> {
        let log: IntervalLog = from_bytes(Kind::IntervalLog, bytes(blob)?).map_err(raise)?;
        let pairs = [&log.filtered, &log.ball, &log.ellipsoid];
        let sides = pairs.into_iter().flatten().chain([&log.upper, &log.center]);
        if log.n == 0
            || !log.lower.len().is_multiple_of(log.n)
            || sides.into_iter().any(|s| s.len() != log.lower.len())
        {
            return Err(DdmheError::new_err(
                "blob: expected a saved interval log, found one of other sizes",
            ));
        }
        Ok(log)
    }

    /// N
    fn __len__(&self) -> usize {
        self.rows()
    }

    /// Why the run ended before its last sample: the ModelViolationError that a step with sample N
    /// raises, or None.
    #[getter]
    fn violation<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyAny>> {
        self.violation.as_ref().map(|text| {
            ModelViolationError::new_err(text.clone()).into_value(py).into_bound(py).into_any()
        })
    }

    fn __repr__(&self) -> String {
        let end =
            self.violation.as_ref().map_or(String::new(), |text| format!(", violation={text:?}"));
        format!("IntervalLog(N={}, n={}{end})", self.__len__(), self.n)
    }

    /// Lower bounds (N, n); row k is of x(k+1).
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.lower.clone(), self.n)
    }

    /// Upper bounds (N, n); row k is of x(k+1).
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.upper.clone(), self.n)
    }

    /// Estimates (N, n) of x(k+1).
    #[getter]
    fn center<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, self.center.clone(), self.n)
    }

    /// The estimates, as other estimators name them.
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.center(py)
    }

    /// (lo, hi), each (N, n); row k is of x(k) and uses y(k).
    #[getter]
    fn filtered<'py>(&self, py: Python<'py>) -> PyResult<Sides<'py>> {
        self.pair(py, &self.filtered)
    }

    /// (lo, hi) of the ball (44), each (N, n).
    #[getter]
    fn ball<'py>(&self, py: Python<'py>) -> PyResult<Sides<'py>> {
        self.pair(py, &self.ball)
    }

    /// (lo, hi) of the ellipsoid's box, each (N, n).
    #[getter]
    fn ellipsoid<'py>(&self, py: Python<'py>) -> PyResult<Sides<'py>> {
        self.pair(py, &self.ellipsoid)
    }
}
