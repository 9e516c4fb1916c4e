//! What a user should know of a recording and of settings, in words, and what a run is watched
//! with.

use crate::certificate::smallest_contracting;
use crate::config::{Config, Settings, Weighting};
use crate::defaults::{Defaults, stable};

use crate::error_bound::ErrorBound;
use crate::history::History;
use crate::inputs::{self, InputWatch};
use crate::response::OwnResponse;
use crate::scaling::Scaling;
use crate::tol;
use crate::watch::Watch;

/// What a run is watched with, and what the recording and the settings give to say.
pub(crate) struct Remarks {
    pub watch: Watch,
    pub input_watch: InputWatch,
    pub bound: Option<ErrorBound>, // as it starts
    pub warnings: Vec<String>,
}

impl Remarks {
    pub fn new(
        history: &History,
        config: &Config,
        (scaling, response): (&Scaling, Option<&OwnResponse>),
        rule: &Defaults,
        (settings, radius): (&Settings, f64),
    ) -> Self {
        let (watch, mut words) = Watch::new(history);
        words.extend(too_little(history, config, rule, settings.horizon));
        words.extend(warnings(config, settings, radius));
        words.extend(inputs::words(history, scaling, response));
        let bound =
            ErrorBound::new(config.certificate.as_ref(), config.disturbance.as_ref(), history)
                .unwrap_or_else(|why| {
                    words.push(why);
                    None
                });
        let input_watch = InputWatch::new(history, scaling);
        Remarks { watch, input_watch, bound, warnings: words }
    }
}

/// That the recording is too short for its noise, with the length that would do.
fn too_little(
    history: &History,
    config: &Config,
    rule: &Defaults,
    horizon: usize,
) -> Option<String> {
    let (T, windows) = (history.T(), history.windows(horizon));
    let needed = rule.needed(history.n() + history.m(), config.horizon)?;
    (T < needed).then(|| {
        format!(
            "the recording is too short to tell motion from noise: {T} outputs, {windows} \
            windows of the horizon M = {horizon}, for n = \
             {} states; {} outputs would do",
            history.n(),
            needed,
        )
    })
}

/// What a user should know about these settings, in words.
fn warnings(config: &Config, settings: &Settings, spectral_radius: f64) -> Vec<String> {
    let mut warnings = Vec::new();
    if !stable(spectral_radius) {
        warnings.push(format!(
            "the map from prior to estimate has spectral radius {spectral_radius:.4} (limit {}): \
            estimation errors may grow; try another horizon, a larger mu or a smaller rank",
            tol::SPECTRAL_RADIUS
        ));
    }
    let contraction = 4.0 * settings.rho.powf(settings.horizon as f64);
    let asked_for = config.certificate.is_none()
        && settings.weights != Weighting::Recorded
        && (config.horizon.is_some() || config.rho.is_some());
    if asked_for && contraction >= 1.0 {
        warnings.push(format!(
            "4 rho^M = {contraction:.4} with rho = {:.6}, M = {}, not below 1 as (33) asks for \
            errors that are sure to shrink; M = {} would \
             do",
            settings.rho,
            settings.horizon,
            smallest_contracting(settings.rho)
        ));
    }
    if config.equilibrium.is_some() && !settings.equilibrium_used {
        warnings.push(
            "equilibrium: not used, the recording shows no noise and is more accurate without it"
                .into(),
        );
    }
    warnings
}
