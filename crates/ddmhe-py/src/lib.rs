//! Python bindings of `ddmhe-core`: arrays in and out, errors to exceptions, no mathematics.

mod bounds;
mod certificate;
mod convert;
mod estimate;
mod evidence;
mod exceptions;
mod exclusive;
mod field;
mod frames;
mod history;
mod in_force;
mod interval;
mod log;
mod many;
mod measured;
mod mhe;
mod pickle;
mod rigid;
mod rigid_report;
mod settings;
mod signals;
mod spaces;
mod validation;
mod words;

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
    use crate::estimate::Estimate;
    #[pymodule_export]
    use crate::evidence::{Evidence, EvidenceLog};
    #[pymodule_export]
    use crate::history::{History, RankReport, noise_levels, wrapped_angle};
    #[pymodule_export]
    use crate::in_force::InForce;
    #[pymodule_export]
    use crate::interval::{
        Dynamics, IntervalEstimate, IntervalLog, ObserverCore, Zonotope, interval_operation,
    };
    #[pymodule_export]
    use crate::log::Log;
    #[pymodule_export]
    use crate::many::run_many;
    #[pymodule_export]
    use crate::mhe::DdMhe;
    #[pymodule_export]
    use crate::rigid::RigidBodyMhe;
    #[pymodule_export]
    use crate::rigid_report::RigidBodyReport;
    #[pymodule_export]
    use crate::settings::{check_settings, setting_names};
    #[pymodule_export]
    use crate::spaces::{Exact, Ridge, Truncated};
    #[pymodule_export]
    use crate::validation::validate;

    /// Discount ρ of the default rule.
    #[pymodule_export]
    const DEFAULT_RHO: f64 = ddmhe_core::defaults::RHO;
    /// Spectral radius of the map from prior to estimate above which an estimator is unstable.
    #[pymodule_export]
    const SPECTRAL_RADIUS: f64 = ddmhe_core::tol::SPECTRAL_RADIUS;
}
