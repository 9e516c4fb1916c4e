//! `ddmhe.RigidBodyReport`.

use crate::convert::{array1, array2};
use ddmhe_core::rigid::Report;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// What is known of a rigid body. Arrays are made when they are asked for.
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
/// >>> report = ddmhe.RigidBodyMhe(record.history(200)).report()
/// >>> report.inertia.shape, round(float(report.inertia.trace()), 9)
/// ((3, 3), 3.0)
/// >>> report.unseen.shape  # the direction that no output shows
/// (3,)
#[pyclass(module = "ddmhe", frozen, name = "RigidBodyReport")]
pub struct RigidBodyReport {
    pub(crate) core: Report,
}

fn matrix<'py>(py: Python<'py>, A: &[[f64; 3]; 3]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array2(py, A.as_flattened().to_vec(), 3)
}

#[pymethods]
impl RigidBodyReport {
    /// Mean squares of the latest fit's residuals in units of their noise (4,): of rates, of
    /// outputs, and of both in means over ten samples.
    #[getter]
    fn chi<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.core.chi)
    }

    /// What each of them is below where the motion explains the data (4,).
    #[getter]
    fn limits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.core.limits)
    }

    /// Log of the probability of the latest fit's data, but for a constant of them.
    #[getter]
    fn evidence(&self) -> f64 {
        self.core.evidence
    }

    /// The optima that are kept, the best first: (cost, evidence, inertia (3, 3)) of each.
    #[getter]
    #[allow(clippy::type_complexity)]
    fn optima<'py>(&self, py: Python<'py>) -> PyResult<Vec<(f64, f64, Bound<'py, PyArray2<f64>>)>> {
        let own = self.core.optima.iter();
        own.map(|o| Ok((o.cost, o.evidence, matrix(py, &o.inertia)?))).collect()
    }

    /// How probable each of them is as of now.
    #[getter]
    fn probabilities(&self) -> Vec<f64> {
        self.core.optima.iter().map(|o| o.probability).collect()
    }

    /// Inertia (3, 3) of trace 3: its scale cannot be seen.
    #[getter]
    fn inertia<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.core.inertia)
    }

    /// Standard deviations of its entries (3, 3).
    #[getter]
    fn inertia_std<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.core.inertia_std)
    }

    /// The direction (3,) about which a turn shows in no output; NaN in a known field, which moves:
    /// none stays so.
    #[getter]
    fn unseen<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, &self.core.unseen)
    }

    /// By how long the outputs lag behind the motion (s), where a lag was fitted; None: without.
    #[getter]
    fn lag(&self) -> Option<f64> {
        self.core.lag.map(|[lag, _]| lag)
    }

    /// Its standard deviation (s).
    #[getter]
    fn lag_std(&self) -> Option<f64> {
        self.core.lag.map(|[_, sd]| sd)
    }

    /// All of it in sentences.
    #[getter]
    fn words(&self) -> Vec<String> {
        self.core.words.clone()
    }

    fn __repr__(&self) -> String {
        format!("RigidBodyReport({})", self.core.words.join("; "))
    }
}
