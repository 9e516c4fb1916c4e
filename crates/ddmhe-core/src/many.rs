//! Many estimators at once.

use crate::config::Config;
use crate::error::Error;
use crate::estimate::Log;
use crate::history::History;
use crate::interrupt::on_all_cores;
use crate::mhe::{DdMhe, Signals};
use std::sync::atomic::{AtomicBool, Ordering};

/// [`DdMhe::run`] of many estimators over as many logs, on all cores: the same numbers, in the same
/// order.
///
/// `stop` is asked every 50 ms, with the number of logs done; after true, logs hold what was
/// finished by then.
///
/// # Errors
/// The first log's error, in order; as for [`DdMhe::run`] its estimator is then unchanged, the
/// others have run.
///
/// # Example
/// ```
/// # use ddmhe_core::*;
/// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
/// # let x: Vec<f64> =
/// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
/// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
/// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
/// let mut estimators = vec![DdMhe::new(&history, Config::default())?; 2];
/// let mut each: Vec<&mut DdMhe> = estimators.iter_mut().collect();
/// let logs = run_many(&mut each, &[y[30..60].into(), y[30..40].into()], &mut |_| false)?;
/// assert_eq!(logs[0].x[..10], logs[1].x[..]);
/// # Ok::<(), Error>(())
/// ```
pub fn run_many(
    estimators: &mut [&mut DdMhe],
    logs: &[Signals<'_>],
    stop: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Log>, Error> {
    same_length(estimators.len(), logs.len())?;
    let items = estimators.iter_mut().zip(logs).collect();
    collected(on_all_cores(
        items,
        |(estimator, log), stopped| until(estimator, *log, stopped),
        stop,
    )?)
}

/// [`DdMhe::run`] of as many copies of one estimator as there are logs, on all cores: each log
/// continues from where the estimator is, which itself does not move. What was computed at
/// construction is shared. `stop` as for [`run_many`].
///
/// # Errors
/// The first log's error, in order; as for [`DdMhe::run`].
///
/// # Example
/// ```
/// # use ddmhe_core::*;
/// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
/// # let x: Vec<f64> =
/// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
/// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
/// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
/// let estimator = DdMhe::new(&history, Config::default())?;
/// let logs = run_copies(&estimator, &[y[30..60].into(), y[30..40].into()], &mut |_| false)?;
/// assert_eq!(logs[0].x[..10], logs[1].x[..]);
/// # Ok::<(), Error>(())
/// ```
pub fn run_copies(
    estimator: &DdMhe,
    logs: &[Signals<'_>],
    stop: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Log>, Error> {
    let run = |log: Signals<'_>, stopped: &AtomicBool| until(&mut estimator.clone(), log, stopped);
    collected(on_all_cores(logs.to_vec(), run, stop)?)
}

/// [`DdMhe::run`] of an estimator for each recording over its log, all with the same settings, on
/// all cores. `stop` as for [`run_many`].
///
/// # Errors
/// The first error, in order; as for [`DdMhe::new`] and [`DdMhe::run`].
pub fn run_recordings(
    histories: &[&History],
    config: &Config,
    logs: &[Signals<'_>],
    stop: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Log>, Error> {
    same_length(histories.len(), logs.len())?;
    let run = |(history, log): (&&History, &Signals<'_>), stopped: &AtomicBool| {
        until(&mut DdMhe::new(history, config.clone())?, *log, stopped)
    };
    collected(on_all_cores(histories.iter().zip(logs).collect(), run, stop)?)
}

fn until(estimator: &mut DdMhe, log: Signals<'_>, stopped: &AtomicBool) -> Result<Log, Error> {
    estimator.run_until(log, &mut || stopped.load(Ordering::Relaxed))
}

fn same_length(estimators: usize, logs: usize) -> Result<(), Error> {
    match estimators == logs {
        true => Ok(()),
        false => Err(Error::shape("logs", format!("{estimators} logs, one per estimator"), logs)),
    }
}

/// Logs that were not begun are empty.
fn collected(found: Vec<Option<Result<Log, Error>>>) -> Result<Vec<Log>, Error> {
    found.into_iter().map(|log| log.unwrap_or_else(|| Ok(Log::default()))).collect()
}
