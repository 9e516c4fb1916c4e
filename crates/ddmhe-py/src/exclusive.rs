//! Objects that change: one call at a time, whichever thread it comes from.

use crate::convert::DdmheError;
use pyo3::PyResult;
use std::sync::{Mutex, MutexGuard, TryLockError};

/// What one call at a time may use.
pub struct Exclusive<T>(Mutex<T>);

impl<T> Exclusive<T> {
    pub fn new(value: T) -> Self {
        Exclusive(Mutex::new(value))
    }

    /// The value, or an error that says what to do where another call is using it: waiting for that
    /// call could be for ever.
    pub fn get(&self, noun: &str) -> PyResult<MutexGuard<'_, T>> {
        match self.0.try_lock() {
            Ok(value) => Ok(value),
            Err(TryLockError::Poisoned(error)) => Ok(error.into_inner()),
            Err(TryLockError::WouldBlock) => Err(DdmheError::new_err(format!(
                "{noun}: expected one call at a time, found it at work in another call, of this \
                 thread or of another: give each thread {noun} of its own, a copy.copy(…) made \
                 before the threads start (many logs on all cores: ddmhe.run_many)"
            ))),
        }
    }
}
