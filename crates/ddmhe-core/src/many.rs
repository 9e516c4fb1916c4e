//! Many estimators at once.

use crate::error::Error;
use crate::estimate::Log;
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
