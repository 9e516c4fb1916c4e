//! Settings of the rigid body's estimator, and the checks of every argument.

use crate::check::check_finite;
use crate::config::{Bounds, Config};
use crate::config_checks::check_box;
use crate::error::Error;
use crate::history::History;
use ddmhe_run::rigid::anchoring::OPTIMA;
use ddmhe_run::rigid::earlier::EARLIER;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Most outputs.
pub(crate) const OUTPUTS: usize = 6;
/// Fewest outputs, of all recordings together: ten blocks of ten, whose means say whether a fit
/// explains them.
pub(crate) const SAMPLES: usize = 100;

/// When the motion is fitted anew to recording and all outputs since.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Refits {
    /// In the step that it is due in, whatever time that takes.
    #[default]
    Now,
    /// When it is due, a slice with each step.
    Sliced,
    /// When [`RigidBodyMhe::refit`](crate::RigidBodyMhe::refit) is called.
    Manual,
}

/// Settings; what is None is read off the recording.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(default, deny_unknown_fields))]
pub struct RigidConfig {
    /// Standard deviation of the noise on recorded rates (rad/s): one, or three.
    pub x_noise: Option<Vec<f64>>,
    /// On recorded outputs: one, or p.
    pub y_noise: Option<Vec<f64>>,
    /// On later outputs: one, or p; None: as on recorded ones.
    pub output_noise: Option<Vec<f64>>,
    /// On rates that are measured later (rad/s): one, or three; None: as on recorded ones.
    pub rate_noise: Option<Vec<f64>>,
    /// Box on ω (rad/s); None: what the recorded energy allows a body that is braked, where a body
    /// explains the recording.
    pub x_bounds: Option<Bounds>,
    /// When the motion is fitted anew.
    pub refit: Refits,
    /// How many motions that may have made the data are followed at once, 1 to 4.
    pub optima: usize,
}

impl Default for RigidConfig {
    fn default() -> Self {
        RigidConfig {
            x_noise: None,
            y_noise: None,
            output_noise: None,
            rate_noise: None,
            x_bounds: None,
            refit: Refits::default(),
            optima: OPTIMA,
        }
    }
}

impl RigidConfig {
    /// The settings of an affine estimator in this one's place, in a box.
    pub(crate) fn of_affine(&self, x_bounds: Option<Bounds>) -> Config {
        Config { x_bounds, output_noise: self.output_noise.clone(), ..Config::default() }
    }

    /// Checks the settings and the recording that they are for.
    pub(crate) fn check(&self, history: &History) -> Result<(), Error> {
        let (n, p) = (history.n(), history.p());
        let rates = is_of_rates(history);
        if history.m() > 0 {
            let found = format!("m = {}", history.m());
            return Err(Error::shape("history", "none of known inputs", found));
        }
        if rates && history.recordings() > EARLIER + 1 {
            let expected = format!("at most {} recordings", EARLIER + 1);
            return Err(Error::shape("history", expected, history.recordings()));
        }
        if rates && history.T() < SAMPLES {
            let expected = format!("at least {SAMPLES} outputs");
            return Err(Error::shape("history", expected, history.T()));
        }
        if !(1..=OPTIMA).contains(&self.optima) {
            return Err(Error::value("optima", format!("1 to {OPTIMA}"), self.optima));
        }
        let other = |unit: &&String| !matches!(&unit[..], "" | "rad/s");
        if let Some(unit) = history.x_units().iter().find(other).filter(|_| rates) {
            return Err(Error::value("history", "rates in rad/s", format!("x_units \"{unit}\"")));
        }
        check_noise("x_noise", self.x_noise.as_deref(), n)?;
        check_noise("y_noise", self.y_noise.as_deref(), p)?;
        check_noise("rate_noise", self.rate_noise.as_deref(), n)?;
        check_noise("output_noise", self.output_noise.as_deref(), p)?;
        self.x_bounds.as_ref().map_or(Ok(()), |bounds| check_box("x_bounds", bounds, &[n]))
    }
}

/// Whether a recording may be one of a body's three rates and what shows them.
pub(crate) fn is_of_rates(history: &History) -> bool {
    history.n() == 3 && history.p() <= OUTPUTS
}

/// Standard deviations of so many channels, or one for all.
fn check_noise(argument: &'static str, given: Option<&[f64]>, width: usize) -> Result<(), Error> {
    let Some(given) = given else { return Ok(()) };
    if given.len() != 1 && given.len() != width {
        return Err(Error::shape(argument, format!("1 or {width} numbers"), given.len()));
    }
    check_finite(argument, given, given.len())?;
    match given.iter().find(|v| **v < 0.0) {
        Some(v) => Err(Error::value(argument, "standard deviations of at least 0", v)),
        None => Ok(()),
    }
}
