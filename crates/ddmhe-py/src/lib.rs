//! Python bindings of `ddmhe-core`: arrays in and out, errors to exceptions, no mathematics.

mod certificate;
mod convert;
mod exclusive;
mod history;
mod interval;
mod mhe;
mod pickle;
mod signals;
mod spaces;
mod validation;

use pyo3::prelude::*;

/// The compiled core; import `ddmhe` instead.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::certificate::minimum_horizon;
    #[pymodule_export]
    use crate::convert::{
        DdmheError, InfeasibleError, ModelViolationError, NotFiniteError, RankError, ShapeError,
        numbers,
    };
    #[pymodule_export]
    use crate::history::{History, RankReport, wrapped_angle};
    #[pymodule_export]
    use crate::interval::{Bounds, IntervalLog, ObserverCore, Zonotope, interval_operation};
    #[pymodule_export]
    use crate::mhe::{DdMhe, Estimate, Log, run_many};
    #[pymodule_export]
    use crate::spaces::{Exact, Ridge, Truncated};
    #[pymodule_export]
    use crate::validation::validate;
}
