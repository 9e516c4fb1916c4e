//! What can be wrong with an input, of an interval observer or of any estimator of `ddmhe-core`,
//! which re-exports it: whoever implements [`Dynamics`](crate::observer::Dynamics) and whoever
//! catches the error of a step name one type. A solver's outcome is never an error.

use thiserror::Error as ThisError;

/// A rejected input: which argument, what was expected, what came.
#[derive(Debug, Clone, PartialEq, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// An array has the wrong size.
    #[error("{argument}: expected {expected}, found {found}")]
    Shape {
        /// Name of the argument.
        argument: &'static str,
        /// The size that fits.
        expected: String,
        /// The size that came.
        found: String,
    },
    /// A number that must be finite is NaN or infinite.
    #[error("{argument}: expected finite numbers, found {value} at row {row}, column {column}")]
    NotFinite {
        /// Name of the argument.
        argument: &'static str,
        /// Sample, counted from 0.
        row: usize,
        /// Channel, counted from 0.
        column: usize,
        /// The offending number.
        value: f64,
    },
    /// A parameter lies outside its range.
    #[error("{argument}: expected {expected}, found {found}")]
    Value {
        /// Name of the argument.
        argument: &'static str,
        /// The range that is allowed.
        expected: String,
        /// The value that came.
        found: String,
    },
    /// The recording does not hold enough information (Liu 2026, Eq. (7)).
    #[error("{argument}: expected {expected}, found {found}")]
    Rank {
        /// Name of the argument.
        argument: &'static str,
        /// What the rank condition asks for.
        expected: String,
        /// What the recording offers.
        found: String,
    },
    /// Measurements contradict the stated model or its bounds: no state is left (interval
    /// observers).
    #[error(
        "{argument}: expected a sample that the model and its bounds allow, found step {step} \
        leaves state {} a gap of \
         {gap:.3e} between its bounds", state + 1
    )]
    ModelViolation {
        /// Name of the argument.
        argument: &'static str,
        /// Number of samples consumed before this one.
        step: usize,
        /// State without a value, counted from 0.
        state: usize,
        /// By how much its lower bound lies above its upper one, in the state's unit.
        gap: f64,
    },
}

impl Error {
    /// [`Error::Shape`] of what prints as text.
    pub fn shape(argument: &'static str, expected: impl ToString, found: impl ToString) -> Self {
        Error::Shape { argument, expected: expected.to_string(), found: found.to_string() }
    }

    /// [`Error::Value`] of what prints as text.
    pub fn value(argument: &'static str, expected: impl ToString, found: impl ToString) -> Self {
        Error::Value { argument, expected: expected.to_string(), found: found.to_string() }
    }

    /// [`Error::Rank`] of what prints as text.
    pub fn rank(argument: &'static str, expected: impl ToString, found: impl ToString) -> Self {
        Error::Rank { argument, expected: expected.to_string(), found: found.to_string() }
    }
}
