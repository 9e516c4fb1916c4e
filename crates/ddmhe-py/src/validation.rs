//! `ddmhe._core.validate`: settings tried on parts of a recording, for `ddmhe.tune`.

use crate::convert::{Numbers, raise};
use crate::history::History;
use crate::measured::inputs;
use crate::settings;
use crate::signals::Signals;
use ddmhe_core::Config;
use ddmhe_core::validation::{self, Fold, Score};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// History, prior (n,), outputs (N, p), known inputs (N, m) or None, true states (N, n), the number
/// of estimates that each error covers, and what errors are relative to (n,).
type Held<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Option<Bound<'py, PyAny>>,
    Bound<'py, PyAny>,
    Vec<usize>,
    Bound<'py, PyAny>,
);

/// Mean squared relative error of each span, spectral radius.
type Pair = (Vec<f64>, f64);

/// Scores (mean squared relative error of each span, spectral radius) of jobs (fold, settings), on
/// all cores.
///
/// A fold is (history, x_prior, outputs, inputs, truth, spans, spread).
///
/// Settings are keywords of DdMhe; a state to start from is the fold's. Settings that cannot be
/// used score inf. `progress(done)` is called now and then. What it or a signal's
/// handler raises ends the work within about 50 ms; the scores found by then, None for the others,
/// are the exception's attribute `finished`.
#[pyfunction]
#[pyo3(signature = (folds, jobs, progress=None))]
pub fn validate(
    py: Python<'_>,
    folds: Vec<Held<'_>>,
    jobs: Vec<(usize, Bound<'_, PyDict>)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<Option<Pair>>> {
    let folds: Vec<Fold> = folds.into_iter().map(fold).collect::<PyResult<_>>()?;
    let sizes = folds.first().map(|f| History::channels(&f.history));
    let jobs: Vec<(usize, Config)> = jobs
        .iter()
        .map(|(fold, given)| {
            settings::check_names("jobs", given)?;
            Ok((*fold, settings::config(given, sizes)?))
        })
        .collect::<PyResult<_>>()?;
    let mut signals = Signals::default();
    let mut stop = |done: usize| {
        signals.raised_by(|py| {
            py.check_signals()?;
            progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (done,)).map(drop))
        })
    };
    let scores = py.detach(|| validation::validate(&folds, &jobs, &mut stop)).map_err(raise)?;
    let scores = scores
        .into_iter()
        .map(|score| score.map(|Score { errors, spectral_radius }| (errors, spectral_radius)));
    signals.outcome(py, scores.collect(), "the validation was stopped")
}

fn fold((h, x, y, u, truth, spans, spread): Held<'_>) -> PyResult<Fold> {
    let history = History::cast("folds", &h)?.core.clone();
    let x_prior = Numbers::vector("folds", &x, history.n())?;
    let (outputs, N, _) = Numbers::measured("folds", &y)?.into_matrix("folds", "(N, p)")?;
    let inputs = inputs("folds", u.as_ref(), (N, history.m()))?;
    let (truth, ..) = Numbers::measured("folds", &truth)?.into_matrix("folds", "(N, n)")?;
    let spread = Numbers::vector("folds", &spread, history.n())?;
    Ok(Fold { history, x_prior, outputs, inputs, truth, spans, spread })
}
