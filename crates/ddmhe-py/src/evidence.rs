//! `ddmhe.Evidence` and `ddmhe.EvidenceLog`: how far to trust one estimate, and those of a run.

use crate::convert::{DdmheError, array1, array2};
use ddmhe_core::EvidenceKind;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

/// How far to trust one estimate. Arrays are made when they are asked for.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
/// >>> evidence = ddmhe.DdMhe(record.history(200)).step(record.y[200]).evidence
/// >>> evidence.kind, evidence.value < evidence.limit, evidence.innovation.shape
/// ('V', True, (3,))
#[pyclass(module = "ddmhe", frozen, name = "Evidence")]
pub struct Evidence {
    core: ddmhe_core::Evidence,
}

impl Evidence {
    pub fn new(core: &ddmhe_core::Evidence) -> Self {
        Evidence { core: core.clone() }
    }
}

fn kind(kind: EvidenceKind) -> &'static str {
    match kind {
        EvidenceKind::V => "V",
        EvidenceKind::Nis => "nis",
    }
}

/// Roots of variances.
fn deviations(variances: &[f64]) -> Vec<f64> {
    variances.iter().map(|variance| variance.sqrt()).collect()
}

/// The deviations of the states, from covariances one behind the other.
pub fn diagonal(covariance: &[f64], n: usize) -> Vec<f64> {
    let of = |sigma: &[f64]| (0..n).map(|i| sigma[i * n + i].sqrt()).collect::<Vec<_>>();
    covariance.chunks_exact((n * n).max(1)).flat_map(of).collect()
}

/// A Reason of these bits.
pub fn reason<'py>(py: Python<'py>, bits: u8) -> PyResult<Bound<'py, PyAny>> {
    py.import("ddmhe.reasons")?.getattr("Reason")?.call1((bits,))
}

#[pymethods]
impl Evidence {
    /// What value is: "V", the minimum of the window's problem in units of what it is in windows
    /// held out of the recording, or "nis", the mean of the normalised innovations squared over the
    /// window, with the weights of the recording.
    #[getter]
    fn kind(&self) -> &'static str {
        kind(self.core.kind)
    }

    /// How unlike the recording the window is; see kind.
    #[getter]
    fn value(&self) -> f64 {
        self.core.value
    }

    /// What value is novel above.
    #[getter]
    fn limit(&self) -> f64 {
        self.core.limit
    }

    /// What the newest output differs by from what all others say it is (p,); NaN where not
    /// measured.
    #[getter]
    fn innovation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.core.innovation)
    }

    /// Standard deviation of that (p,).
    #[getter]
    fn innovation_std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &deviations(&self.core.innovation_variance))
    }

    /// Whether each output repeats one value longer than it ever did in the recording (p,).
    #[getter]
    fn stuck<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(py, &self.core.stuck)
    }

    /// Whether each entry of the newest output was rejected (p,): it counts as not measured.
    #[getter]
    fn gated<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(py, &self.core.gated)
    }

    /// Whether the run started again with the newest output, because the state has jumped.
    #[getter]
    fn restarted(&self) -> bool {
        self.core.restarted
    }

    fn __repr__(&self) -> String {
        let e = &self.core;
        format!("Evidence(kind='{}', value={:.4}, limit={:.4})", kind(e.kind), e.value, e.limit)
    }
}

/// How far to trust the estimates of a run; row k belongs to step k+1 of it.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
/// >>> evidence = ddmhe.DdMhe(record.history(200)).run(record.y[200:300]).evidence
/// >>> evidence.value.shape, evidence.innovation.shape
/// ((100,), (100, 3))
#[pyclass(module = "ddmhe", frozen, name = "EvidenceLog")]
pub struct EvidenceLog {
    /// What value is: see Evidence.kind.
    #[pyo3(get)]
    kind: String,
    /// How unlike the recording each window is (N,).
    #[pyo3(get)]
    value: Py<PyArray1<f64>>,
    /// What value is novel above (N,).
    #[pyo3(get)]
    limit: Py<PyArray1<f64>>,
    /// What each newest output differs by from what all others say it is (N, p); NaN where not
    /// measured.
    #[pyo3(get)]
    innovation: Py<PyArray2<f64>>,
    /// Standard deviation of that (N, p).
    #[pyo3(get)]
    innovation_std: Py<PyArray2<f64>>,
    /// Whether each output repeats one value longer than it ever did in the recording (N, p).
    #[pyo3(get)]
    stuck: Py<PyArray2<bool>>,
    /// Whether each entry of an output was rejected (N, p).
    #[pyo3(get)]
    gated: Py<PyArray2<bool>>,
    /// Whether the run started again with that output, because the state has jumped (N,).
    #[pyo3(get)]
    restarted: Py<PyArray1<bool>>,
    #[pyo3(get)]
    _covariance: Py<PyArray3<f64>>,
    #[pyo3(get)]
    _reasons: Py<PyArray1<u8>>,
}

/// What `EvidenceLog._of` takes.
type Columns<'py> = (
    String,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    (Bound<'py, PyArray2<bool>>, Bound<'py, PyArray2<bool>>, Bound<'py, PyArray1<bool>>),
    (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray1<u8>>),
);

impl EvidenceLog {
    pub fn new(py: Python<'_>, log: ddmhe_core::EvidenceLog, n: usize, p: usize) -> PyResult<Self> {
        let steps = log.value.len();
        let covariance = PyArray1::from_vec(py, log.covariance).reshape([steps, n, n])?;
        Ok(EvidenceLog {
            kind: kind(log.kind).into(),
            value: array1(py, &log.value).unbind(),
            limit: array1(py, &log.limit).unbind(),
            innovation: array2(py, log.innovation, p)?.unbind(),
            innovation_std: array2(py, deviations(&log.innovation_variance), p)?.unbind(),
            stuck: PyArray1::from_vec(py, log.stuck).reshape([steps, p])?.unbind(),
            gated: PyArray1::from_vec(py, log.gated).reshape([steps, p])?.unbind(),
            restarted: PyArray1::from_vec(py, log.restarted).unbind(),
            _covariance: covariance.unbind(),
            _reasons: PyArray1::from_vec(py, log.reasons).unbind(),
        })
    }

    /// Σ of each step (N, n, n).
    pub fn covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        self._covariance.bind(py).clone()
    }

    /// Bits of the reasons of each step (N,).
    pub fn reasons<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        self._reasons.bind(py).clone()
    }
}

#[pymethods]
impl EvidenceLog {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Columns<'py>)> {
        let columns = (
            self.kind.clone(),
            self.value.bind(py).clone(),
            self.limit.bind(py).clone(),
            self.innovation.bind(py).clone(),
            self.innovation_std.bind(py).clone(),
            (
                self.stuck.bind(py).clone(),
                self.gated.bind(py).clone(),
                self.restarted.bind(py).clone(),
            ),
            (self._covariance.bind(py).clone(), self._reasons.bind(py).clone()),
        );
        Ok((py.get_type::<Self>().getattr("_of")?, columns))
    }

    /// From its columns.
    #[classmethod]
    #[pyo3(signature = (*columns))]
    fn _of(_cls: &Bound<'_, PyType>, columns: &Bound<'_, PyTuple>) -> PyResult<Self> {
        let columns: Columns<'_> = columns.extract().map_err(|_| {
            DdmheError::new_err("columns: expected those of an EvidenceLog, found others")
        })?;
        let (kind, value, limit, innovation, innovation_std, doubted, reasons) = columns;
        let (stuck, gated, restarted) = doubted;
        let (covariance, reasons) = reasons;
        Ok(EvidenceLog {
            kind,
            value: value.unbind(),
            limit: limit.unbind(),
            innovation: innovation.unbind(),
            innovation_std: innovation_std.unbind(),
            stuck: stuck.unbind(),
            gated: gated.unbind(),
            restarted: restarted.unbind(),
            _covariance: covariance.unbind(),
            _reasons: reasons.unbind(),
        })
    }
}
