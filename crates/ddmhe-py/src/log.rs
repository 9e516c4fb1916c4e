//! `ddmhe.Log`.

use crate::convert::{DdmheError, array2};
use crate::evidence::{EvidenceLog, diagonal};
use crate::frames::{self, Clock};
use ddmhe_core::{Reasons, Status};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyTuple, PyType};

/// The estimates of a whole run; row k belongs to step k+1 of it.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
/// >>> log = ddmhe.DdMhe(record.history(200)).run(record.y[200:300])
/// >>> len(log), log.x.shape, log.std.shape
/// (100, (100, 3), (100, 3))
/// >>> log[10:20].t.shape, log.to_pandas().shape[0]
/// ((10,), 100)
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
    found: Vec<Status>, // what `status` says in words, where it was not given
    /// Number of touched bounds of each step (N,).
    #[pyo3(get)]
    active: Py<PyArray1<i64>>,
    /// Estimate.iterations of each step (N,).
    #[pyo3(get)]
    iterations: Py<PyArray1<i64>>,
    /// How far to trust the estimates, an EvidenceLog; None where no evidence was asked for.
    #[pyo3(get)]
    evidence: Option<Py<EvidenceLog>>,
    clock: Clock,
}

/// What `Log._of` takes.
type Columns<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Option<Bound<'py, PyArray1<f64>>>,
    Bound<'py, PyAny>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Option<Bound<'py, EvidenceLog>>,
    (usize, f64),
);

#[pymethods]
impl Log {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Columns<'py>)> {
        let (x, cost) = (self.x.bind(py).clone(), self.cost.bind(py).clone());
        let (active, iterations) = (self.active.bind(py).clone(), self.iterations.bind(py).clone());
        let bound = self.bound.as_ref().map(|bound| bound.bind(py).clone());
        let status = self.status(py)?.into_bound(py);
        let evidence = self.evidence.as_ref().map(|evidence| evidence.bind(py).clone());
        let clock = (self.clock.before, self.clock.dt);
        let columns = (x, cost, bound, status, active, iterations, evidence, clock);
        Ok((py.get_type::<Self>().getattr("_of")?, columns))
    }

    /// From its columns.
    #[classmethod]
    #[pyo3(signature = (*columns))]
    fn _of(_cls: &Bound<'_, PyType>, columns: &Bound<'_, PyTuple>) -> PyResult<Self> {
        let (x, cost, bound, status, active, iterations, evidence, clock): Columns<'_> = columns
            .extract()
            .map_err(|_| DdmheError::new_err("columns: expected those of a Log, found others"))?;
        let words = PyOnceLock::new();
        let _ = words.set(status.py(), status.unbind()); // it was empty
        Ok(Log {
            x: x.unbind(),
            cost: cost.unbind(),
            bound: bound.map(Bound::unbind),
            status: words,
            found: Vec::new(),
            active: active.unbind(),
            iterations: iterations.unbind(),
            evidence: evidence.map(Bound::unbind),
            clock: Clock { before: clock.0, dt: clock.1 },
        })
    }

    /// Covariance of the error of each x (N, n, n); None where no evidence was asked for.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray3<f64>>> {
        Some(self.evidence.as_ref()?.get().covariance(py))
    }

    /// Standard deviation of the error of each state (N, n).
    #[getter]
    fn std<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let Some(sigma) = self.covariance(py) else { return Ok(None) };
        let sigma = sigma.readonly();
        let n = sigma.as_array().shape()[1];
        array2(py, diagonal(sigma.as_slice()?, n), n).map(Some)
    }

    /// Whether each estimate is trusted (N,): neither NOVEL nor UNCERTAIN nor STUCK.
    #[getter]
    fn trusted<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<bool>>>> {
        let Some(reasons) = self.reasons(py) else { return Ok(None) };
        let trusted = |bits: &u8| Reasons::from_bits(*bits).trusted();
        let trusted = reasons.readonly().as_slice()?.iter().map(trusted).collect();
        Ok(Some(PyArray1::from_vec(py, trusted)))
    }

    /// Why each estimate is not trusted (N,): numbers of ddmhe.Reason, 0 where it is.
    #[getter]
    fn reasons<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<u8>>> {
        Some(self.evidence.as_ref()?.get().reasons(py))
    }

    /// Status of each step (N,), strings.
    #[getter]
    fn status(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let made = || -> PyResult<Py<PyAny>> {
            let words: Vec<&str> = self.found.iter().map(|status| status.as_str()).collect();
            Ok(py.import("numpy")?.call_method1("array", (words, "U16"))?.unbind())
        };
        Ok(self.status.get_or_try_init(py, made)?.clone_ref(py))
    }

    /// Times (N,) of the estimates, s since the run began: x[k] is the state at t[k].
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let Clock { before, dt } = self.clock;
        let steps = 1..=self.x.bind(py).readonly().as_array().shape()[0];
        PyArray1::from_vec(py, steps.map(|k| (before + k) as f64 * dt).collect())
    }

    /// Number of steps N.
    fn __len__(&self, py: Python<'_>) -> usize {
        self.x.bind(py).readonly().as_array().shape()[0]
    }

    /// Step k as a Row (t, x, std, status, trusted, reasons, cost), or the Log of a slice of steps
    /// that follow one another.
    fn __getitem__<'py>(
        slf: &Bound<'py, Self>,
        key: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("item", slf.as_any(), Some(key))
    }

    /// The rows, step by step.
    fn __iter__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        frames::made("rows", slf.as_any(), None)
    }

    /// Whether all numbers are the same; NaN is like NaN.
    fn __eq__<'py>(
        slf: &Bound<'py, Self>,
        other: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("same", slf.as_any(), Some(other))
    }

    /// A frame of pandas, a row a step, with t as its index: states, called by `names` (else x0,
    /// x1, …), their standard deviations, trusted, reasons in words, status, cost, and the error's
    /// bound where there is one.
    #[pyo3(signature = (names=None))]
    fn to_pandas<'py>(
        slf: &Bound<'py, Self>,
        names: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("to_pandas", slf.as_any(), names)
    }

    /// The same as a frame of polars, with t as its first column.
    #[pyo3(signature = (names=None))]
    fn to_polars<'py>(
        slf: &Bound<'py, Self>,
        names: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("to_polars", slf.as_any(), names)
    }

    /// All of it as a Dataset of xarray over t and state.
    #[pyo3(signature = (names=None))]
    fn to_xarray<'py>(
        slf: &Bound<'py, Self>,
        names: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        frames::made("to_xarray", slf.as_any(), names)
    }

    fn __repr__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        frames::made("words", slf.as_any(), None)
    }
}

impl Log {
    /// With `x` where the states have been written already.
    pub fn new(
        py: Python<'_>,
        log: ddmhe_core::Log,
        (n, p): (usize, usize),
        bounded: bool,
        x: Option<Bound<'_, PyArray2<f64>>>,
        clock: Clock,
    ) -> PyResult<Self> {
        let evidence = log.evidence.map(|of| Py::new(py, EvidenceLog::new(py, of, n, p)?));
        let whole = |values: Vec<i64>| PyArray1::from_vec(py, values).unbind();
        Ok(Log {
            x: x.map_or_else(|| array2(py, log.x, n), Ok)?.unbind(),
            cost: PyArray1::from_vec(py, log.cost).unbind(),
            bound: bounded.then(|| PyArray1::from_vec(py, log.bound).unbind()),
            status: PyOnceLock::new(),
            found: log.status,
            active: whole(log.active.into_iter().map(|a| a as i64).collect()),
            iterations: whole(log.iterations.into_iter().map(i64::from).collect()),
            evidence: evidence.transpose()?,
            clock,
        })
    }
}
