//! `ddmhe.Log`.

use crate::convert::{DdmheError, array1, array2};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyTuple, PyType};

/// The estimates of a whole run; row k belongs to step k+1 of it.
#[pyclass(module = "ddmhe", frozen, name = "Log")]
pub struct Log {
    /// Estimated states (N, n).
    #[pyo3(get)]
    x: Py<PyArray2<f64>>,
    /// Cost of each step (N,), as Estimate.cost.
    #[pyo3(get)]
    cost: Py<PyArray1<f64>>,
    /// Error bound of each step (N,), with a certificate and the disturbance's size where it can be
    /// relied on; else None, and DdMhe.warnings says why.
    #[pyo3(get)]
    bound: Option<Py<PyArray1<f64>>>,
    status: PyOnceLock<Py<PyAny>>,
    words: Vec<&'static str>,
    /// Number of touched bounds of each step (N,).
    #[pyo3(get)]
    active: Py<PyArray1<i64>>,
    /// Estimate.iterations of each step (N,).
    #[pyo3(get)]
    iterations: Py<PyArray1<i64>>,
}

/// What `Log._of` takes.
type Columns<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Option<Bound<'py, PyArray1<f64>>>,
    Bound<'py, PyAny>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
);

#[pymethods]
impl Log {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Columns<'py>)> {
        let (x, cost) = (self.x.bind(py).clone(), self.cost.bind(py).clone());
        let (active, iterations) = (self.active.bind(py).clone(), self.iterations.bind(py).clone());
        let bound = self.bound.as_ref().map(|bound| bound.bind(py).clone());
        let status = self.status(py)?.into_bound(py);
        Ok((py.get_type::<Self>().getattr("_of")?, (x, cost, bound, status, active, iterations)))
    }

    /// From its columns.
    #[classmethod]
    #[pyo3(signature = (*columns))]
    fn _of(_cls: &Bound<'_, PyType>, columns: &Bound<'_, PyTuple>) -> PyResult<Self> {
        let (x, cost, bound, status, active, iterations): Columns<'_> = columns
            .extract()
            .map_err(|_| DdmheError::new_err("columns: expected those of a Log, found others"))?;
        let words = PyOnceLock::new();
        let _ = words.set(status.py(), status.unbind()); // it was empty
        Ok(Log {
            x: x.unbind(),
            cost: cost.unbind(),
            bound: bound.map(Bound::unbind),
            status: words,
            words: Vec::new(),
            active: active.unbind(),
            iterations: iterations.unbind(),
        })
    }

    /// Status of each step (N,), strings.
    #[getter]
    fn status(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let made = || -> PyResult<Py<PyAny>> {
            Ok(py.import("numpy")?.call_method1("array", (&self.words, "U16"))?.unbind())
        };
        Ok(self.status.get_or_try_init(py, made)?.clone_ref(py))
    }
}

impl Log {
    /// With `x` where the states have been written already.
    pub fn new(
        py: Python<'_>,
        log: ddmhe_core::Log,
        n: usize,
        bounded: bool,
        x: Option<Bound<'_, PyArray2<f64>>>,
    ) -> PyResult<Self> {
        let whole = |values: Vec<i64>| PyArray1::from_vec(py, values).unbind();
        Ok(Log {
            x: x.map_or_else(|| array2(py, log.x, n), Ok)?.unbind(),
            cost: array1(py, &log.cost).unbind(),
            bound: bounded.then(|| array1(py, &log.bound).unbind()),
            status: PyOnceLock::new(),
            words: log.status.iter().map(|s| s.as_str()).collect(),
            active: whole(log.active.iter().map(|&a| a as i64).collect()),
            iterations: whole(log.iterations.iter().map(|&i| i64::from(i)).collect()),
        })
    }
}
