//! `ddmhe.run_many`.

use crate::convert::{DdmheError, Numbers, ShapeError, raise};
use crate::history::History;
use crate::log::Log;
use crate::mhe::DdMhe;
use crate::signals::Signals;
use ddmhe_core::Config;
use pyo3::prelude::*;

/// Run many logs on all cores, with the GIL released: the same numbers as estimator.run(Y) for
/// each.
///
/// Parameters
/// ----------
/// estimators : DdMhe, list of DdMhe or list of History
///     One estimator: each log continues from a copy of it, and it does not move itself. A list of
///     estimators, one a log, each only once: a run moves its window on. A list of recordings, one
///     a log: an estimator with default settings for each.
/// logs : list of arrays (N_i, p_i)
///
/// Returns
/// -------
/// list of Log
///
/// Raises
/// ------
/// ShapeError, NotFiniteError, RankError, DdmheError
///     As DdMhe and run, for the first log at fault; nothing has run if a shape is wrong.
/// KeyboardInterrupt
///     Within about 50 ms of Ctrl-C; its attribute `finished` is the list of Logs, each with the
///     steps made by then.
#[pyfunction]
pub fn run_many(
    py: Python<'_>,
    estimators: &Bound<'_, PyAny>,
    logs: &Bound<'_, PyAny>,
) -> PyResult<Vec<Log>> {
    let logs: Vec<Bound<'_, PyAny>> = items("logs", "a list of arrays", logs)?;
    if let Ok(one) = estimators.cast::<DdMhe>() {
        return run_copies(py, one.get(), &logs);
    }
    let estimators = items("estimators", "a DdMhe or a list of DdMhe or of History", estimators)?;
    if estimators.len() != logs.len() {
        let (expected, found) = (estimators.len(), logs.len());
        return Err(ShapeError::new_err(format!(
            "logs: expected {expected}, one per estimator, found {found}"
        )));
    }
    if !estimators.is_empty() && estimators.iter().all(|item| item.cast::<History>().is_ok()) {
        return run_recordings(py, &estimators, &logs);
    }
    run_each(py, &estimators, &logs)
}

/// Each log from a copy of one estimator.
fn run_copies(py: Python<'_>, one: &DdMhe, logs: &[Bound<'_, PyAny>]) -> PyResult<Vec<Log>> {
    let core = &*one.core()?;
    let data = columns(logs, |_| core.p())?;
    let slices: Vec<&[f64]> = data.iter().map(Vec::as_slice).collect();
    let mut signals = Signals::default();
    let found = py
        .detach(|| ddmhe_core::run_copies(core, &slices, &mut |_| signals.raised()))
        .map_err(raise)?;
    let sizes = vec![(core.n(), core.is_bounded()); found.len()];
    logged(py, found, sizes, signals)
}

/// Each log by an estimator of its recording, with default settings.
fn run_recordings(
    py: Python<'_>,
    recordings: &[Bound<'_, PyAny>],
    logs: &[Bound<'_, PyAny>],
) -> PyResult<Vec<Log>> {
    let histories: Vec<&History> =
        recordings.iter().map(|item| History::cast("estimators", item)).collect::<PyResult<_>>()?;
    let data = columns(logs, |k| histories[k].core.p())?;
    let (histories, slices): (Vec<_>, Vec<&[f64]>) =
        histories.iter().zip(&data).map(|(h, log)| (&h.core, log.as_slice())).unzip();
    let (mut signals, config) = (Signals::default(), Config::default());
    let found = py
        .detach(|| {
            ddmhe_core::run_recordings(&histories, &config, &slices, &mut |_| signals.raised())
        })
        .map_err(raise)?;
    let sizes = histories.iter().map(|history| (history.n(), false)).collect();
    logged(py, found, sizes, signals)
}

/// Each log by its own estimator, which moves on.
fn run_each(
    py: Python<'_>,
    estimators: &[Bound<'_, PyAny>],
    logs: &[Bound<'_, PyAny>],
) -> PyResult<Vec<Log>> {
    let mut borrowed = Vec::with_capacity(estimators.len());
    for (k, item) in estimators.iter().enumerate() {
        let estimator = item.cast::<DdMhe>().map_err(|_| {
            DdmheError::new_err(format!(
                "estimators: expected DdMhe or History, the same throughout, found {} at {k}",
                item.get_type()
            ))
        })?;
        borrowed.push(estimator.get().core().map_err(|_| in_use(k))?);
    }
    let data = columns(logs, |k| borrowed[k].p())?;
    let sizes: Vec<(usize, bool)> = borrowed.iter().map(|e| (e.n(), e.is_bounded())).collect();
    let mut cores: Vec<&mut ddmhe_core::DdMhe> = borrowed.iter_mut().map(|e| &mut **e).collect();
    let slices: Vec<&[f64]> = data.iter().map(Vec::as_slice).collect();
    let mut signals = Signals::default();
    let found = py
        .detach(|| ddmhe_core::run_many(&mut cores, &slices, &mut |_| signals.raised()))
        .map_err(raise)?;
    logged(py, found, sizes, signals)
}

/// Logs of (n, whether there are error bounds), or what ended the work, with those that there are.
fn logged(
    py: Python<'_>,
    found: Vec<ddmhe_core::Log>,
    sizes: Vec<(usize, bool)>,
    signals: Signals,
) -> PyResult<Vec<Log>> {
    let logs: Vec<Log> = found
        .into_iter()
        .zip(sizes)
        .map(|(log, (n, bounded))| Log::new(py, log, n, bounded, None))
        .collect::<PyResult<_>>()?;
    signals.outcome(py, logs, "the run was stopped")
}

fn in_use(k: usize) -> PyErr {
    DdmheError::new_err(format!(
        "estimators: expected each only once and none at work in another thread, \
         found number {k} in use already"
    ))
}

fn items<'py>(
    argument: &str,
    expected: &str,
    value: &Bound<'py, PyAny>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let wrong = |_| {
        DdmheError::new_err(format!("{argument}: expected {expected}, found {}", value.get_type()))
    };
    value.try_iter().map_err(wrong)?.collect()
}

/// The numbers of each log, which must have p(k) columns.
fn columns(logs: &[Bound<'_, PyAny>], p: impl Fn(usize) -> usize) -> PyResult<Vec<Vec<f64>>> {
    let log = |(k, log): (usize, &Bound<'_, PyAny>)| {
        let (values, _, columns) = Numbers::measured("logs", log)?.into_matrix("logs", "(N, p)")?;
        let expected = p(k);
        if columns == expected {
            return Ok(values);
        }
        Err(ShapeError::new_err(format!(
            "logs: expected {expected} columns in number {k}, found {columns}"
        )))
    };
    logs.iter().enumerate().map(log).collect()
}
