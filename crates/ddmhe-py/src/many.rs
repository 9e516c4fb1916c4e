//! `ddmhe.run_many`.

use crate::convert::{DdmheError, ShapeError, raise};
use crate::frames::Clock;
use crate::history::History;
use crate::log::Log;
use crate::measured::{inputs, outputs};
use crate::mhe::DdMhe;
use crate::signals::Signals;
use crate::words::kind;
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
/// inputs : list of arrays (N_i, m_i), optional
///     The known inputs of each log, where the recordings have inputs.
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
///
/// Examples
/// --------
/// >>> import ddmhe
/// >>> record = ddmhe.models.detumbling().simulate(duration=60.0, dt=0.1, noise=0.01)
/// >>> estimator = ddmhe.DdMhe(record.history(200))
/// >>> logs = ddmhe.run_many(estimator, [record.y[200:300], record.y[200:400]])
/// >>> [len(log) for log in logs]
/// [100, 200]
/// >>> bool((logs[0].x == logs[1].x[:100]).all())
/// True
#[pyfunction]
#[pyo3(signature = (estimators, logs, inputs=None))]
pub fn run_many(
    py: Python<'_>,
    estimators: &Bound<'_, PyAny>,
    logs: &Bound<'_, PyAny>,
    inputs: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<Log>> {
    let logs: Vec<Bound<'_, PyAny>> = items("logs", "a list of arrays", logs)?;
    let inputs = inputs.map(|inputs| items("inputs", "a list of arrays", inputs)).transpose()?;
    if let Some(inputs) = inputs.as_ref().filter(|inputs| inputs.len() != logs.len()) {
        let (expected, found) = (logs.len(), inputs.len());
        return Err(ShapeError::new_err(format!(
            "inputs: expected {expected}, one per log, found {found}"
        )));
    }
    let logs = Given { logs, inputs };
    if let Ok(one) = estimators.cast::<DdMhe>() {
        return run_copies(py, one.get(), &logs);
    }
    let estimators = items("estimators", "a DdMhe or a list of DdMhe or of History", estimators)?;
    if estimators.len() != logs.logs.len() {
        let (expected, found) = (estimators.len(), logs.logs.len());
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
fn run_copies(py: Python<'_>, one: &DdMhe, logs: &Given<'_>) -> PyResult<Vec<Log>> {
    let core = &*one.core()?;
    let data = logs.numbers(|_| (core.p(), core.history().m()))?;
    let slices = borrowed_logs(&data);
    let mut signals = Signals::default();
    let found = py
        .detach(|| ddmhe_core::run_copies(core, &slices, &mut |_| signals.raised()))
        .map_err(raise)?;
    let sizes = vec![((core.n(), core.p()), core.is_bounded(), Clock::of(core)); found.len()];
    logged(py, found, sizes, signals)
}

/// Each log by an estimator of its recording, with default settings.
fn run_recordings(
    py: Python<'_>,
    recordings: &[Bound<'_, PyAny>],
    logs: &Given<'_>,
) -> PyResult<Vec<Log>> {
    let histories: Vec<&History> =
        recordings.iter().map(|item| History::cast("estimators", item)).collect::<PyResult<_>>()?;
    let data = logs.numbers(|k| (histories[k].core.p(), histories[k].core.m()))?;
    let slices = borrowed_logs(&data);
    let histories: Vec<&ddmhe_core::History> = histories.iter().map(|h| &h.core).collect();
    let (mut signals, config) = (Signals::default(), Config::default());
    let found = py
        .detach(|| {
            ddmhe_core::run_recordings(&histories, &config, &slices, &mut |_| signals.raised())
        })
        .map_err(raise)?;
    let clock = |history: &&ddmhe_core::History| Clock { before: 0, dt: history.dt() };
    let sizes = histories.iter().map(|h| ((h.n(), h.p()), false, clock(h))).collect();
    logged(py, found, sizes, signals)
}

/// Each log by its own estimator, which moves on.
fn run_each(
    py: Python<'_>,
    estimators: &[Bound<'_, PyAny>],
    logs: &Given<'_>,
) -> PyResult<Vec<Log>> {
    let mut borrowed = Vec::with_capacity(estimators.len());
    for (k, item) in estimators.iter().enumerate() {
        let estimator = item.cast::<DdMhe>().map_err(|_| {
            DdmheError::new_err(format!(
                "estimators: expected DdMhe or History, the same throughout, found {} at {k}",
                kind(item)
            ))
        })?;
        borrowed.push(estimator.get().core().map_err(|_| in_use(k))?);
    }
    let data = logs.numbers(|k| (borrowed[k].p(), borrowed[k].history().m()))?;
    let sizes: Vec<Sizes> =
        borrowed.iter().map(|e| ((e.n(), e.p()), e.is_bounded(), Clock::of(e))).collect();
    let mut cores: Vec<&mut ddmhe_core::DdMhe> = borrowed.iter_mut().map(|e| &mut **e).collect();
    let slices = borrowed_logs(&data);
    let mut signals = Signals::default();
    let found = py
        .detach(|| ddmhe_core::run_many(&mut cores, &slices, &mut |_| signals.raised()))
        .map_err(raise)?;
    logged(py, found, sizes, signals)
}

/// (n, p), whether there are error bounds, and when the run begins.
type Sizes = ((usize, usize), bool, Clock);

/// Logs of these sizes, or what ended the work, with those that there are.
fn logged(
    py: Python<'_>,
    found: Vec<ddmhe_core::Log>,
    sizes: Vec<Sizes>,
    signals: Signals,
) -> PyResult<Vec<Log>> {
    let logs: Vec<Log> = found
        .into_iter()
        .zip(sizes)
        .map(|(log, (channels, bounded, clock))| Log::new(py, log, channels, bounded, None, clock))
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
    let wrong =
        |_| DdmheError::new_err(format!("{argument}: expected {expected}, found {}", kind(value)));
    value.try_iter().map_err(wrong)?.collect()
}

/// Logs with their inputs, where there are any.
struct Given<'py> {
    logs: Vec<Bound<'py, PyAny>>,
    inputs: Option<Vec<Bound<'py, PyAny>>>,
}

impl Given<'_> {
    /// The numbers of each log and of its inputs, which must have (p, m)(k) columns.
    fn numbers(
        &self,
        sizes: impl Fn(usize) -> (usize, usize),
    ) -> PyResult<Vec<(Vec<f64>, Vec<f64>)>> {
        let log = |(k, log): (usize, &Bound<'_, PyAny>)| {
            let (p, m) = sizes(k);
            let (y, rows) = outputs(&format!("logs, number {k}"), log, p)?;
            let given = self.inputs.as_ref().map(|inputs| &inputs[k]);
            Ok((y, inputs("inputs", given, (rows, m))?))
        };
        self.logs.iter().enumerate().map(log).collect()
    }
}

fn borrowed_logs(data: &[(Vec<f64>, Vec<f64>)]) -> Vec<ddmhe_core::Signals<'_>> {
    data.iter().map(|(y, u)| ddmhe_core::Signals { y, u }).collect()
}
