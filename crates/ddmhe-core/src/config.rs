//! Settings of the estimator, and the checks of every argument.

use crate::certificate::{Certificate, Disturbance};
use crate::soft::Soft;
use crate::space::Space;
use crate::variation::Rest;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// A box lo ≤ · ≤ hi; infinite entries are no bounds.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Bounds {
    /// Lower bounds, one per channel.
    pub lo: Vec<f64>,
    /// Upper bounds, one per channel.
    pub hi: Vec<f64>,
}

/// What the box on the states is relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Center {
    /// Nothing: the bounds are absolute.
    #[default]
    Absolute,
    /// x_c(t) = H_x H_y† y, the window that the recording alone associates with the measured
    /// outputs (Liu 2026, IV-A1, in affine form).
    History,
}

/// What the cost (17) is measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
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
    /// the error covariance P that a Kalman filter settles to with them; ρ = 1, no μ, and windows
    /// of the recording's linear model.
    Recorded,
}

/// The disturbance ŵ(k) that is fitted between x(k) and x(k+1) (Remark 1), by its covariance.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Start {
    /// [`Recording`](Start::Recording) as long as the first M windows are like those of a run that
    /// goes on from the recording's end; else [`Unknown`](Start::Unknown), from the run's first
    /// output on. That takes evidence. [`State`](Start::State) beside `x_prior` or a disturbance,
    /// and without evidence.
    #[default]
    Auto,
    /// From a known state, `x_prior` or the last recorded one, with the weight that (17) gives
    /// every prior; the window grows from 1 to M (Algorithm 1).
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
            Start::Auto => "\"auto\"",
            Start::State => "\"state\"",
            Start::Recording => "\"recording\"",
            Start::Unknown => "\"unknown\"",
        })
    }
}

/// From how many deviations on an output is rejected: see [`ddmhe_run::gating`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Gate {
    /// None is.
    #[default]
    None,
    /// [`AUTO`](Gate::AUTO); none where an exact recording shows no noise and none is stated.
    Auto,
    /// From so many, more than 1.
    At(f64),
}

impl Gate {
    /// Deviations of [`Gate::Auto`], chosen by measuring: docs/evidence.md.
    pub const AUTO: f64 = 4.0;
}

/// What becomes of an output that repeats one value longer than it ever did in the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Stuck {
    /// It is told.
    #[default]
    Tell,
    /// It counts as not measured, with its repetitions.
    Missing,
}

/// A known rest of the system, in the user's units.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Equilibrium {
    /// State x_e (n).
    pub x: Vec<f64>,
    /// Output y_e (p).
    pub y: Vec<f64>,
    /// Inputs u_e (m) that hold it there; empty for a system without inputs.
    #[cfg_attr(feature = "serde", serde(default))]
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
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(default, deny_unknown_fields))]
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
    /// Standard deviation of the noise of later outputs (p, or one for all); None: what the
    /// recording has. Evidence alone uses it.
    pub output_noise: Option<Vec<f64>>,
    /// Covariance (n·n, by rows) that a sample adds to the error of states which outputs do not
    /// show.
    pub drift: Option<Vec<f64>>,
    /// Whether estimates carry evidence: a covariance, and reasons not to trust them.
    pub evidence: bool,
    /// From how many deviations on an output is rejected.
    pub gate: Gate,
    /// What becomes of an output that is stuck.
    pub stuck: Stuck,
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
            gate: Gate::default(),
            stuck: Stuck::default(),
        }
    }
}

impl Config {
    /// Where a run starts, with what decides it beforehand: a prior, or what an automatic start
    /// needs and has not.
    pub(crate) fn resolved(&self, start: Start, prior: bool) -> Start {
        let known = prior || !self.evidence || self.disturbance.is_some();
        if start == Start::Auto && known { Start::State } else { start }
    }

    /// Where a new run starts.
    pub(crate) fn begins(&self) -> Start {
        self.resolved(self.start, self.x_prior.is_some())
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
#[cfg_attr(feature = "serde", derive(Serialize))]
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
