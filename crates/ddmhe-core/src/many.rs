//! Many estimators at once.

use crate::config::Config;
use crate::error::Error;
use crate::estimate::Log;
use crate::history::History;
use crate::mhe::DdMhe;
use rayon::prelude::*;

/// [`DdMhe::run`] of many estimators over as many logs, on all cores (rayon): the same numbers, in the same order.
///
/// # Errors
/// The first log's error, in order; as for [`DdMhe::run`] its estimator is then unchanged, the others have run.
pub fn run_many(estimators: &mut [&mut DdMhe], logs: &[&[f64]]) -> Result<Vec<Log>, Error> {
    if estimators.len() != logs.len() {
        return Err(Error::shape("logs", format!("{} logs, one per estimator", estimators.len()), logs.len()));
    }
    let found: Vec<Result<Log, Error>> =
        estimators.par_iter_mut().zip(logs).map(|(estimator, log)| estimator.run(log)).collect();
    found.into_iter().collect()
}

/// [`DdMhe::run`] of as many copies of one estimator as there are logs, on all cores: each log continues from where the
/// estimator is, which itself does not move. What was computed at construction is shared.
///
/// # Errors
/// The first log's error, in order; as for [`DdMhe::run`].
pub fn run_copies(estimator: &DdMhe, logs: &[&[f64]]) -> Result<Vec<Log>, Error> {
    let found: Vec<Result<Log, Error>> = logs.par_iter().map(|log| estimator.clone().run(log)).collect();
    found.into_iter().collect()
}

/// An estimator for each recording, all with the same settings, built on all cores.
///
/// # Errors
/// The first recording's error, in order; as for [`DdMhe::new`].
pub fn build_many(histories: &[&History], config: &Config) -> Result<Vec<DdMhe>, Error> {
    let found: Vec<Result<DdMhe, Error>> =
        histories.par_iter().map(|history| DdMhe::new(history, config.clone())).collect();
    found.into_iter().collect()
}
