//! The default rule: horizon, weights and trajectory space from the recording alone.
//!
//! Everything hangs on one number, the *misfit* f in [0, 1]: the share of the recording's variance
//! that an affine model x(k+1), y(k) ← x(k), fitted by least squares, leaves unexplained. It is
//! rounding for a noise-free linear system with a full state, the relative noise variance for a
//! noisy one (3-DOF detumbling: 1e-6 to 1e-1), and close to 1 when the recorded x is only part of
//! the system's state (a gyroscope on a swinging body: 0.8 to 1).
//!
//! | setting | rule |
//! |---|---|
//! | weight | λ = max(0.03 f, 1e-7) μ; 0 when f is rounding |
//! | rank | all directions above rounding |
//! | μ | 0.1 in scaled units, 0.1 s_x²/s_y² in those of (17) |
//! | ρ | 0.95 |
//! | M | 20 + f (M₁ - 20), at most 100 |
//!
//! *Weight.* In the coordinates a (see [`space`](crate::space)) a window is a draw of zero mean and
//! unit variance, and its outputs deviate by a share f of their variance: λ/μ grows like f. The
//! factor and the floor (a curved system leaves the recorded region) are measured.
//!
//! *Rank.* The weight fades out what the noise has filled; a cut at a rank made 3-DOF estimates
//! diverge on noisy recordings.
//!
//! *μ* is measured; 0.1 to 1 do.
//!
//! *ρ.* Anything from 0.9 to 0.97 does. The rule does not aim at 4ρ^M < 1 as in (33): it seeks
//! accuracy, a certificate contraction.
//!
//! *Horizon.* M₁ is the longest horizon with 0.4 T windows left (0.6 T in one recording). A
//! complete state needs a few samples; hidden parts must be read off the outputs' past.
//!
//! With f at rounding level the weight is zero and the space exact. n + 1 samples are fitted by
//! some affine model whatever they are: without degrees of freedom f counts as 1. Should the map
//! from prior to estimate come out unstable (spectral radius above
//! [`tol::SPECTRAL_RADIUS`]), the weight is raised tenfold until it is not.
//!
//! A large f says that x(k) alone does not tell x(k+1), but not why. Hidden parts of the state ask
//! for long windows, noise that drives the state for short ones and a weak prior. Above f = 0.1 the
//! recording decides: see the module `challenge`.
//!
//! `make study-defaults` measures the rule against the best settings in hindsight.

use crate::config::{Config, Weighting};
use crate::error::Error;
use crate::history::History;
use crate::scaling::{EXACT, Scaling, shared};
use crate::space::{Penalty, Selection};
use crate::tol;
use crate::variation::{Rest, fifth_differences, one_step};

/// λ / (f μ).
const WEIGHT: f64 = 0.03;
/// Smallest λ / μ for a recording that is not exactly linear.
const FLOOR: f64 = 1e-7;
/// μ in scaled units.
const MU: f64 = 0.1;
/// Discount ρ.
pub const RHO: f64 = 0.95;
/// Horizon for a recording without hidden states, and the share of T for one that is all hidden.
const HORIZON: (usize, f64) = (20, 0.6);
/// Longest default horizon: construction grows with its third power.
const LONGEST: usize = 100;
/// A misfit above this may be hidden parts of the state or noise that drives it: others may then do
/// better than the rule. Below it the motion is known, and what counts is how far it leaves the
/// recording, of which the recording says nothing.
const HIDDEN: f64 = 0.1;
/// Relative noise above which a recording counts as noisy.
const NOISY: f64 = 1e-6;

/// Fewest samples of a noisy recording, for each of the n + 1 numbers that an affine model has per
/// channel: with fewer, neither the misfit nor the weak directions mean much. Measured: below,
/// errors on the logs at hand were the size of the motion or above.
const SAMPLES: usize = 10;
/// Fewest windows likewise: what 0.4 T leaves of that.
const WINDOWS: usize = 4;

/// What the rule says about one recording, in scaled units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Defaults {
    pub horizon: usize,
    pub rho: f64,
    pub mu: f64,
    /// λ / μ; 0 for an exact space.
    pub ratio: f64,
    /// Short and long horizon of the settings that may take the rule's place (see
    /// [`challenge`](crate::challenge)), if any may.
    pub challengers: Option<(usize, usize)>,
    /// Whether the recording itself carries noise: decides if a known equilibrium helps.
    pub noisy: bool,
    /// The misfit f.
    pub misfit: f64,
    /// The horizon of a recording that is long enough, between those of a complete state and of one
    /// that is all hidden.
    pub wanted: usize,
    pub complete: usize,
    pub hidden: usize,
    /// Whether the recording chose, see [`challenge`](crate::challenge).
    pub challenged: bool,
}

impl Defaults {
    /// Applies the rule.
    ///
    /// `rest` is a known equilibrium; on a noisy recording it counts as part of the data, as in
    /// [`space`](crate::space).
    pub fn new(history: &History, scaling: &Scaling, rest: Option<Rest<'_>>) -> Self {
        let [f_x, f_y] = scaling.misfit(&scaling.one_step);
        let [noise_x, noise_y] = relative_noise(history, scaling);
        // Noise leaves a residual *and* fifth differences; curvature alone leaves one of the two.
        let noisy = noise_x.min(f_x.sqrt()).max(noise_y.min(f_y.sqrt())) > NOISY;
        let [f_x, f_y] = if noisy && rest.is_some() {
            scaling.misfit(&one_step(history, rest))
        } else {
            [f_x, f_y]
        };
        let misfit = f_x.max(f_y);
        // With one recording of T outputs: 0.6 T. Seams cost windows, and so shorten the horizon.
        let enough = ((1.0 - HORIZON.1) * history.T() as f64).ceil() as usize;
        let longest = |windows: usize| {
            (1..=history.T()).rev().find(|&m| history.windows(m) >= windows).unwrap_or(1)
        };
        let hidden = longest(enough.max(1)).min(LONGEST) as f64;
        let complete = HORIZON.0 as f64;
        let wanted = (complete + misfit * (hidden - complete)).round().max(1.0) as usize;
        let most = longest(2 * history.n() + 1);
        let long = (hidden as usize).min(most);
        let short = HORIZON.0.min((history.T() / 10).max(5)).min(long);
        Defaults {
            horizon: wanted.min(most),
            rho: RHO,
            mu: MU,
            ratio: if misfit < EXACT { 0.0 } else { (WEIGHT * misfit).max(FLOOR) },
            challengers: (misfit > HIDDEN).then_some((short, long)),
            noisy,
            misfit,
            wanted,
            complete: HORIZON.0,
            hidden: hidden as usize,
            challenged: false,
        }
    }

    /// The horizon asked for, or the rule's; with a certificate at least as long as its contraction
    /// 4η^M < 1 asks.
    pub fn horizon_for(&self, config: &Config) -> Result<usize, Error> {
        let Some(c) = &config.certificate else {
            // with the weights of the recording the prior holds all that was before the window
            let recorded = config.weighting() == Weighting::Recorded;
            let rule = if recorded { self.horizon.min(HORIZON.0) } else { self.horizon };
            return Ok(config.horizon.unwrap_or(rule));
        };
        let needed = c.minimum_horizon();
        match config.horizon {
            Some(M) if M < needed => {
                let expected = format!(
                    "at least {needed}, the smallest M with 4 eta^M < 1 for the certificate's \
                    eta = {}",
                    c.eta
                );
                Err(Error::value("horizon", expected, M))
            }
            Some(M) => Ok(M),
            None => Ok(self.horizon.max(needed)),
        }
    }

    /// Fewest outputs that tell motion from noise in a recording of n states and inputs; None for
    /// one that is exactly linear. The horizon, given or the shortest of the rule, costs windows.
    pub fn needed(&self, n: usize, horizon: Option<usize>) -> Option<usize> {
        let horizon = horizon.unwrap_or(HORIZON.0);
        (self.ratio > 0.0).then_some(((n + 1) * SAMPLES).max((n + 1) * WINDOWS + horizon - 1))
    }

    /// The space `auto` for the noise weight `mu` in force.
    pub fn selection(&self, mu: f64) -> Selection {
        let penalty =
            if self.ratio > 0.0 { Penalty::Normalised(self.ratio * mu) } else { Penalty::None };
        Selection { rank: None, tol: None, penalty }
    }
}

/// Noise of x and of y as fifth differences show it, relative to the deviations of each unit; root
/// mean square over channels.
fn relative_noise(history: &History, scaling: &Scaling) -> [f64; 2] {
    let level = |signal: fn(&History, usize) -> &[f64], units: &[f64], groups: &[Vec<usize>]| {
        let noise: Vec<f64> = (0..units.len())
            .map(|i| fifth_differences(history, signal, (i, units.len())))
            .collect();
        let variance: Vec<f64> = units.iter().map(|unit| unit * unit).collect();
        let (noise, variance) = (shared(&noise, groups), shared(&variance, groups));
        let ratios = noise.iter().zip(&variance).map(|(noise, variance)| noise / variance);
        (ratios.sum::<f64>() / units.len() as f64).sqrt()
    };
    [
        level(History::states, &scaling.unit_x, &scaling.groups_x),
        level(History::outputs, &scaling.unit_y, &scaling.groups_y),
    ]
}

/// Whether errors of the prior do not grow. False also for NaN, which no finite data should give.
pub(crate) fn stable(spectral_radius: f64) -> bool {
    spectral_radius <= tol::SPECTRAL_RADIUS
}
