//! `DdMhe.settings`: what is in force, and why.

use crate::settings::start_name;
use crate::spaces;
use ddmhe_core::{ProcessNoise, Settings, Space, Start, Weighting};
use numpy::PyArray2;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The settings in force after the defaults are filled in.
#[pyclass(module = "ddmhe", frozen, name = "Settings")]
pub struct InForce {
    settings: Settings,
    space: Space,
    start: Start,
    n: usize,
}

impl InForce {
    pub fn new(core: &ddmhe_core::DdMhe) -> Self {
        let (settings, space) = (core.settings().clone(), core.config().space);
        InForce { settings, space, start: core.start(), n: core.n() }
    }
}

/// "paper", "scaled" or "recorded".
pub fn weights(weights: Weighting) -> &'static str {
    match weights {
        Weighting::Scaled => "scaled",
        Weighting::Recorded => "recorded",
        Weighting::Auto | Weighting::Paper => "paper",
    }
}

#[pymethods]
impl InForce {
    /// Horizon M.
    #[getter]
    fn horizon(&self) -> usize {
        self.settings.horizon
    }

    /// Discount; 1 with the weights of the recording.
    #[getter]
    fn rho(&self) -> f64 {
        self.settings.rho
    }

    /// Noise weight; with the weights of the recording the mean inverse variance of the outputs'
    /// noise, in their units.
    #[getter]
    fn mu(&self) -> f64 {
        self.settings.mu
    }

    /// "paper", "scaled" or "recorded".
    #[getter]
    fn weights(&self) -> &'static str {
        weights(self.settings.weights)
    }

    /// The disturbance that is fitted: None, "recorded", "residual" or its covariance (n, n).
    #[getter]
    fn process_noise<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match &self.settings.process_noise {
            ProcessNoise::Auto | ProcessNoise::None => Ok(py.None().into_bound(py)),
            ProcessNoise::Recorded => "recorded".into_bound_py_any(py),
            ProcessNoise::Residual => "residual".into_bound_py_any(py),
            ProcessNoise::Given(Q) => {
                let rows: Vec<Vec<f64>> = Q.chunks_exact(self.n).map(<[f64]>::to_vec).collect();
                Ok(PyArray2::from_vec2(py, &rows)?.into_any())
            }
        }
    }

    /// "state", "recording" or "unknown": of this run.
    #[getter]
    fn start(&self) -> &'static str {
        start_name(self.start)
    }

    /// The trajectory space that was asked for.
    #[getter]
    fn space<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        spaces::to_python(py, self.space)
    }

    /// For what was left open how it was chosen, {name: sentence}.
    #[getter]
    fn why<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let why = PyDict::new(py);
        for (name, sentence) in &self.settings.why {
            why.set_item(name, sentence)?;
        }
        Ok(why)
    }

    fn __repr__(&self) -> String {
        let s = &self.settings;
        let why: Vec<String> = s.why.iter().map(|(name, why)| format!("{name}: {why}")).collect();
        format!(
            "Settings(horizon={}, rho={:.4}, mu={:.4e}, weights='{}', start='{}'; {})",
            s.horizon,
            s.rho,
            s.mu,
            weights(s.weights),
            start_name(self.start),
            why.join("; ")
        )
    }
}
