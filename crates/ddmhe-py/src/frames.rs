//! What tables, files and rows are made of estimates and recordings: in Python, where these
//! libraries are.

use pyo3::prelude::*;

/// When estimates were made: the steps before, and the sampling interval, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// Steps since the run began, before these estimates.
    pub before: usize,
    /// Sampling interval, s.
    pub dt: f64,
}

impl Clock {
    /// Of what an estimator does next.
    pub fn of(core: &ddmhe_core::DdMhe) -> Self {
        Clock { before: core.t(), dt: core.history().dt() }
    }

    /// Of what an estimator has just done.
    pub fn behind(core: &ddmhe_core::DdMhe) -> Self {
        Clock { before: core.t().saturating_sub(1), dt: core.history().dt() }
    }
}

/// `ddmhe.frames.NAME(of, argument)`.
pub fn made<'py>(
    name: &str,
    of: &Bound<'py, PyAny>,
    argument: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    of.py().import("ddmhe.frames")?.call_method1(name, (of, argument))
}
