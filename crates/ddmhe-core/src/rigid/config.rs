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

/// Most outputs in a known field, and of sensors that lag.
pub(crate) const FEW_OUTPUTS: usize = 3;
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

/// The field in which a body was recorded, time-major: at each output and, if it is known, at the
/// last rate; without the latter that rate is left out.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct KnownField {
    /// B (3 each) at the body, in any unit.
    pub B: Vec<f64>,
    /// K (p x 3 each, by rows): the outputs are -κ K M (B × ω) with one κ.
    pub K: Vec<f64>,
}

impl KnownField {
    /// Of how many samples.
    pub(crate) fn count(&self) -> usize {
        self.B.len() / 3
    }

    /// B and K of a sample with p outputs.
    pub(crate) fn at(&self, k: usize, p: usize) -> (&[f64], &[f64]) {
        (&self.B[3 * k..3 * (k + 1)], &self.K[3 * p * k..3 * p * (k + 1)])
    }

    /// Of the first samples.
    pub(crate) fn first(&self, count: usize, p: usize) -> Self {
        KnownField { B: self.B[..3 * count].to_vec(), K: self.K[..3 * p * count].to_vec() }
    }

    fn check(&self, history: &History) -> Result<(), Error> {
        let (p, T) = (history.p(), history.T());
        if !is_of_rates(history) || p > FEW_OUTPUTS {
            let expected = format!("none, or three rates and at most {FEW_OUTPUTS} outputs");
            let found = format!("n = {}, p = {p}", history.n());
            return Err(Error::shape("field", expected, found));
        }
        if history.recordings() > 1 {
            let found = format!("{} of them", history.recordings());
            return Err(Error::shape("field", "none, or one recording", found));
        }
        let sizes = |count: usize| (3 * count, 3 * p * count);
        let found = (self.B.len(), self.K.len());
        if found != sizes(T) && found != sizes(T + 1) {
            let (b, k) = sizes(T);
            let expected = format!("B of {b} and K of {k} numbers, or of one sample more");
            let found = format!("{} and {}", found.0, found.1);
            return Err(Error::shape("field", expected, found));
        }
        check_finite("field", &self.B, self.B.len())?;
        check_finite("field", &self.K, self.K.len())?;
        match [&self.B, &self.K].iter().any(|v| v.iter().all(|v| *v == 0.0)) {
            true => Err(Error::value("field", "B and K that are not 0 throughout", 0)),
            false => Ok(()),
        }
    }
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
    /// The field of the recording, where it is known and moves: then each step is told it, too.
    pub field: Option<KnownField>,
    /// Whether the outputs lag behind the motion, as those of first-order sensors do, by a time
    /// that is fitted, too: true, false, or None: only where no body explains all data without it.
    /// Up to three outputs.
    pub output_lag: Option<bool>,
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
            field: None,
            output_lag: None,
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
        if self.output_lag == Some(true) && !may_lag(history, self) {
            let expected =
                format!("no true but with three rates, at most {FEW_OUTPUTS} outputs and no field");
            return Err(Error::value("output_lag", expected, true));
        }
        self.field.as_ref().map_or(Ok(()), |field| field.check(history))?;
        self.x_bounds.as_ref().map_or(Ok(()), |bounds| check_box("x_bounds", bounds, &[n]))
    }
}

/// Whether a recording may be one of a body's three rates and what shows them.
pub(crate) fn is_of_rates(history: &History) -> bool {
    history.n() == 3 && history.p() <= OUTPUTS
}

/// Whether a lag can be fitted.
pub(crate) fn may_lag(history: &History, config: &RigidConfig) -> bool {
    is_of_rates(history) && history.p() <= FEW_OUTPUTS && config.field.is_none()
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
