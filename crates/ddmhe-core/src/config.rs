//! Settings of the estimator, and the checks of every argument.

use crate::certificate::{Certificate, Disturbance};
use crate::check::check_vector;
use crate::covariance::check_covariance;
use crate::error::Error;
use crate::history::History;
use crate::soft::Soft;
use crate::space::Space;
use crate::tol;
use crate::variation::Rest;
use serde::{Deserialize, Serialize};

/// A box lo ≤ · ≤ hi; infinite entries are no bounds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Lower bounds, one per channel.
    pub lo: Vec<f64>,
    /// Upper bounds, one per channel.
    pub hi: Vec<f64>,
}

/// What the box on the states is relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Center {
    /// Nothing: the bounds are absolute.
    #[default]
    Absolute,
    /// x_c(t) = H_x H_y† y, the window that the recording alone associates with the measured
    /// outputs (Liu 2026, IV-A1, in affine form).
    History,
}

/// What the cost (17) is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Weighting {
    /// [`Paper`](Weighting::Paper) beside an explicit ρ or μ or a certificate, else
    /// [`Scaled`](Weighting::Scaled).
    #[default]
    Auto,
    /// (17) in the units of x and y, as printed.
    Paper,
    /// (17) with every channel in units of its [scale](crate::Scaling): μ has no unit, and
    /// rescaling a channel changes nothing.
    Scaled,
    /// Those of the recording: the noise R of its outputs, the disturbance Q between its states and
    /// the error covariance P that a Kalman filter settles to with them; ρ = 1, no μ, and windows of
    /// the recording's linear model.
    Recorded,
}

/// The disturbance ŵ(k) that is fitted between x(k) and x(k+1) (Remark 1), by its covariance.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub enum ProcessNoise {
    /// [`Recorded`](ProcessNoise::Recorded) beside the weights of the recording, else
    /// [`None`](ProcessNoise::None).
    #[default]
    Auto,
    /// No disturbance: windows are trajectories.
    None,
    /// The share of the recording's one-step residuals that makes the recording most likely when
    /// its states carry reading noise.
    Recorded,
    /// All of these residuals: right where the recorded states are exact.
    Residual,
    /// Q (n·n, by rows), symmetric and positive semidefinite, in the user's units.
    Given(Vec<f64>),
}

/// Where a run starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Start {
    /// From a known state, `x_prior` or the last recorded one, with the weight that (17) gives
    /// every prior; the window grows from 1 to M (Algorithm 1).
    #[default]
    State,
    /// Where the recording ends: the run goes on from there, with a window filled from its end.
    Recording,
    /// Anywhere: the window grows from a prior that is as wide as the recorded states.
    Unknown,
}

impl std::fmt::Display for Weighting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Weighting::Auto => "\"auto\"",
            Weighting::Paper => "\"paper\"",
            Weighting::Scaled => "\"scaled\"",
            Weighting::Recorded => "\"recorded\"",
        })
    }
}

impl std::fmt::Display for Start {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Start::State => "\"state\"",
            Start::Recording => "\"recording\"",
            Start::Unknown => "\"unknown\"",
        })
    }
}

/// A known rest of the system, in the user's units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Equilibrium {
    /// State x_e (n).
    pub x: Vec<f64>,
    /// Output y_e (p).
    pub y: Vec<f64>,
    /// Inputs u_e (m) that hold it there; empty for a system without inputs.
    pub u: Vec<f64>,
}

impl Equilibrium {
    pub(crate) fn as_rest(&self) -> Rest<'_> {
        Rest { x: &self.x, y: &self.y, u: &self.u }
    }
}

impl From<Rest<'_>> for Equilibrium {
    fn from(rest: Rest<'_>) -> Self {
        Equilibrium { x: rest.x.to_vec(), y: rest.y.to_vec(), u: rest.u.to_vec() }
    }
}

/// Settings of the estimator; every `None` is set by the documented rule of
/// [`defaults`](crate::defaults).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Horizon M ≥ 1.
    pub horizon: Option<usize>,
    /// Discount ρ in (0, 1).
    pub rho: Option<f64>,
    /// Noise weight μ > 0 of (17), in (unit of x / unit of y)², or without a unit where `weights`
    /// say so.
    pub mu: Option<f64>,
    /// What ρ and μ are meant in.
    pub weights: Weighting,
    /// Prior x̄(0) (n); the last recorded state when absent.
    pub x_prior: Option<Vec<f64>>,
    /// Box on every state of the window (16c).
    pub x_bounds: Option<Bounds>,
    /// What `x_bounds` are relative to.
    pub x_center: Center,
    /// Box on the fitted noise (16d).
    pub v_bounds: Option<Bounds>,
    /// The disturbance that is fitted.
    pub process_noise: ProcessNoise,
    /// Box on the fitted disturbance.
    pub w_bounds: Option<Bounds>,
    /// Prices of leaving the bounds; None: they are hard.
    pub soft: Option<Soft>,
    /// A known rest, added to the data as constant windows when the recording is noisy.
    pub equilibrium: Option<Equilibrium>,
    /// Where a run starts; `x_prior` needs [`Start::State`].
    pub start: Start,
    /// Which windows count as trajectories.
    pub space: Space,
    /// A certificate's weights 2η^M P and η^{j-1} R in the place of ρ and μ.
    pub certificate: Option<Certificate>,
    /// What is known of the true trajectory: with a certificate, each estimate then carries an
    /// error bound.
    pub disturbance: Option<Disturbance>,
    /// Standard deviation of the noise of later outputs (p, or one for all); None: what the recording
    /// has. Evidence alone uses it.
    pub output_noise: Option<Vec<f64>>,
    /// Covariance (n·n, by rows) that a sample adds to the error of states which outputs do not show.
    pub drift: Option<Vec<f64>>,
    /// Whether estimates carry evidence: a covariance, and reasons not to trust them.
    pub evidence: bool,
}

impl Default for Config {
    fn default() -> Self {
        Config {
            horizon: None,
            rho: None,
            mu: None,
            weights: Weighting::default(),
            x_prior: None,
            x_bounds: None,
            x_center: Center::default(),
            v_bounds: None,
            process_noise: ProcessNoise::default(),
            w_bounds: None,
            soft: None,
            equilibrium: None,
            start: Start::default(),
            space: Space::default(),
            certificate: None,
            disturbance: None,
            output_noise: None,
            drift: None,
            evidence: true,
        }
    }
}

impl Config {
    /// Every setting alone, for the sizes of a recording; [`DdMhe::new`](crate::DdMhe::new) begins
    /// with it.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`] or [`Error::Value`] naming the setting.
    pub fn check(&self, history: &History) -> Result<(), Error> {
        validate(history, self)
    }

    /// The disturbance that is fitted, with `Auto` decided.
    pub(crate) fn disturbance_to_fit(&self) -> &ProcessNoise {
        match &self.process_noise {
            ProcessNoise::Auto if self.weighting() == Weighting::Recorded => {
                &ProcessNoise::Recorded
            }
            ProcessNoise::Auto => &ProcessNoise::None,
            given => given,
        }
    }

    /// Whether there are bounds on the states, on the fitted noise and on the fitted disturbance.
    pub(crate) fn bounded(&self) -> [bool; 3] {
        [&self.x_bounds, &self.v_bounds, &self.w_bounds].map(Option::is_some)
    }

    /// The known rest.
    pub(crate) fn rest(&self) -> Option<Rest<'_>> {
        self.equilibrium.as_ref().map(Equilibrium::as_rest)
    }

    /// What the cost is measured in, with `Auto` decided.
    pub(crate) fn weighting(&self) -> Weighting {
        let stated = self.rho.is_some() || self.mu.is_some() || self.certificate.is_some();
        match self.weights {
            Weighting::Auto if stated => Weighting::Paper,
            Weighting::Auto => Weighting::Scaled,
            given => given,
        }
    }
}

/// The settings in force after the defaults are filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Horizon M.
    pub horizon: usize,
    /// Discount ρ, or a certificate's η.
    pub rho: f64,
    /// Noise weight μ, in (unit of x / unit of y)² for the weights of (17) as printed, else without
    /// a unit; of a certificate, the mean of R's diagonal.
    pub mu: f64,
    /// What the cost is measured in; never `Auto`.
    pub weights: Weighting,
    /// The disturbance that is fitted; never `Auto`.
    pub process_noise: ProcessNoise,
    /// Directions kept at full depth.
    pub rank: usize,
    /// Weight λ on ‖a‖² (see [`space`](crate::space)), 0 for none.
    pub lambda: f64,
    /// Whether the equilibrium was added to the data (a noise-free recording does better without
    /// it).
    pub equilibrium_used: bool,
    /// For what was left open, in a sentence each, how it was chosen: (name of the setting, why).
    pub why: Vec<(&'static str, String)>,
}

/// Every setting alone, before anything is computed.
pub(crate) fn validate(history: &History, config: &Config) -> Result<(), Error> {
    let (n, p) = (history.n(), history.p());
    check_weights(config, n, p, history.m())?;
    if config.horizon == Some(0) {
        return Err(Error::value("horizon", "at least 1", 0));
    }
    check_space(config.space)?;
    if let Some(x) = &config.x_prior {
        check_vector("x_prior", x, n)?;
        check_start(config.start)?;
    }
    check_beside(config, config.start)?;
    if let Some(bounds) = &config.x_bounds {
        check_box("x_bounds", bounds, &[n])?;
    }
    if let Some(bounds) = &config.v_bounds {
        check_box("v_bounds", bounds, &[p])?;
    }
    check_process_noise(config, n)?;
    check_evidence(config, n, p)?;
    if let Some(soft) = config.soft {
        soft.check(config.bounded())?;
    }
    if let Some(Equilibrium { x, y, u }) = &config.equilibrium {
        check_vector("equilibrium", x, n)?;
        check_vector("equilibrium", y, p)?;
        check_vector("equilibrium", u, history.m())?;
    }
    Ok(())
}

/// ρ and μ, or a certificate in their place.
fn check_weights(config: &Config, n: usize, p: usize, m: usize) -> Result<(), Error> {
    match config.rho {
        Some(rho) if !(rho > 0.0 && rho < 1.0) => {
            return Err(Error::value("rho", "a number in (0, 1)", rho));
        }
        _ => {}
    }
    match config.mu {
        Some(mu) if !(mu > 0.0 && mu.is_finite()) => {
            return Err(Error::value("mu", "a positive finite number", mu));
        }
        _ => {}
    }
    if let Some(certificate) = &config.certificate {
        certificate.check(n, p, m)?;
        check_beside_certificate(config)?;
    }
    if let Some(disturbance) = &config.disturbance {
        disturbance.check()?;
        if config.certificate.is_none() {
            return Err(Error::value("disturbance", "a certificate beside it", "none"));
        }
    }
    Ok(())
}

/// What only evidence uses.
fn check_evidence(config: &Config, n: usize, p: usize) -> Result<(), Error> {
    let unused = |name: &'static str| Error::value(name, "none without evidence", "some");
    if let Some(noise) = &config.output_noise {
        if noise.len() != 1 {
            check_vector("output_noise", noise, p)?;
        }
        if let Some(bad) = noise.iter().find(|sd| !(**sd >= 0.0 && sd.is_finite())) {
            let expected = "standard deviations, finite and not negative";
            return Err(Error::value("output_noise", expected, bad));
        }
        (config.evidence).then_some(()).ok_or_else(|| unused("output_noise"))?;
    }
    if let Some(drift) = &config.drift {
        check_covariance("drift", drift, n)?;
        (config.evidence).then_some(()).ok_or_else(|| unused("drift"))?;
    }
    Ok(())
}

/// A disturbance, its box, and what does not go with it.
fn check_process_noise(config: &Config, n: usize) -> Result<(), Error> {
    let recorded = config.weighting() == Weighting::Recorded;
    if recorded {
        check_beside_recorded(config)?;
    }
    let none = *config.disturbance_to_fit() == ProcessNoise::None;
    if none && recorded {
        let expected = "a disturbance beside weights = \"recorded\"";
        return Err(Error::value("process_noise", expected, "none"));
    }
    if let ProcessNoise::Given(Q) = &config.process_noise {
        check_covariance("process_noise", Q, n)?;
    }
    if let Some(bounds) = &config.w_bounds {
        if none {
            return Err(Error::value("w_bounds", "none without process_noise", "some"));
        }
        check_box("w_bounds", bounds, &[n])?;
    }
    if !none && config.certificate.is_some() {
        let expected = "none beside a certificate, which holds for undisturbed windows";
        return Err(Error::value("process_noise", expected, "a disturbance"));
    }
    Ok(())
}

/// The weights of the recording leave none of these open.
fn check_beside_recorded(config: &Config) -> Result<(), Error> {
    let expected = |what: &str| format!("{what} beside weights = \"recorded\"");
    for (name, value) in [("rho", config.rho), ("mu", config.mu)] {
        if let Some(value) = value {
            return Err(Error::value(name, expected("none"), value));
        }
    }
    if config.space != Space::Auto {
        let found = "another";
        return Err(Error::value(
            "space",
            expected("\"auto\", windows of the linear model,"),
            found,
        ));
    }
    if config.equilibrium.is_some() {
        return Err(Error::value("equilibrium", expected("none"), "one"));
    }
    if config.x_center != Center::Absolute {
        return Err(Error::value("x_center", expected("none"), "\"history\""));
    }
    Ok(())
}

/// A certificate holds the weights, in the user's units.
fn check_beside_certificate(config: &Config) -> Result<(), Error> {
    for (name, value) in [("rho", config.rho), ("mu", config.mu)] {
        if let Some(value) = value {
            let expected = "none beside a certificate, which holds the weights";
            return Err(Error::value(name, expected, value));
        }
    }
    if matches!(config.weights, Weighting::Scaled | Weighting::Recorded) {
        let expected = "\"paper\" or \"auto\" beside a certificate, whose units are the user's";
        return Err(Error::value("weights", expected, config.weights));
    }
    Ok(())
}

fn check_space(space: Space) -> Result<(), Error> {
    match space {
        Space::Truncated { rank: Some(0), .. } => {
            Err(Error::value("space", "Truncated with rank at least 1", 0))
        }
        Space::Truncated { tol: Some(tol), .. } if !(0.0..1.0).contains(&tol) => {
            Err(Error::value("space", "Truncated with tol in [0, 1)", tol))
        }
        Space::Ridge { weight, .. } if !(weight > 0.0 && weight.is_finite()) => {
            Err(Error::value("space", "Ridge with a positive finite weight", weight))
        }
        _ => Ok(()),
    }
}

/// A state to start from belongs to one start alone.
pub(crate) fn check_start(start: Start) -> Result<(), Error> {
    match start {
        Start::State => Ok(()),
        other => Err(Error::value(
            "start",
            "\"state\" beside x_prior, which is the state it starts from",
            other,
        )),
    }
}

/// An error bound begins with one on x̄(0), which an unknown start has not.
pub(crate) fn check_beside(config: &Config, start: Start) -> Result<(), Error> {
    match start {
        Start::Unknown if config.disturbance.is_some() => {
            let expected = "\"state\" or \"recording\" beside disturbance, which bounds the \
            error of a known start";
            Err(Error::value("start", expected, start))
        }
        _ => Ok(()),
    }
}

/// Sizes, no NaN, lo ≤ hi, and neither side beyond reach.
pub(crate) fn check_box(
    argument: &'static str,
    bounds: &Bounds,
    lengths: &[usize],
) -> Result<(), Error> {
    for side in [&bounds.lo, &bounds.hi] {
        if !lengths.contains(&side.len()) || side.len() != bounds.lo.len() {
            let allowed: Vec<String> = lengths.iter().map(ToString::to_string).collect();
            return Err(Error::shape(
                argument,
                format!("{} numbers in lo and in hi", allowed.join(" or ")),
                side.len(),
            ));
        }
    }
    for (i, (&lo, &hi)) in bounds.lo.iter().zip(&bounds.hi).enumerate() {
        let crossed = !(lo <= hi) || lo > tol::BOUND || hi < -tol::BOUND;
        if crossed {
            return Err(Error::value(
                argument,
                "lo <= hi in every entry",
                format!("lo = {lo}, hi = {hi} in entry {i}"),
            ));
        }
    }
    Ok(())
}

pub(crate) fn check_output(y: &[f64], p: usize) -> Result<(), Error> {
    if y.len() != p {
        return Err(Error::shape("y", format!("{p} numbers"), y.len()));
    }
    check_measured("y", y, p)
}

/// NaN means "not measured"; infinity is an error.
pub(crate) fn check_measured(argument: &'static str, y: &[f64], p: usize) -> Result<(), Error> {
    match y.iter().position(|v| v.is_infinite()) {
        None => Ok(()),
        Some(k) => Err(Error::NotFinite { argument, row: k / p, column: k % p, value: y[k] }),
    }
}
