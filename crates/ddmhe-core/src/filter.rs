//! The estimator where nothing is bounded and every output was measured: a linear map, and all that
//! scoring settings needs.
//!
//! z* is linear in [x̄; y] and x̂(t) is the last state of c + A z*, so that x̂ = g + G [x̄; y] with
//! n rows: a step costs next to nothing, and settings that differ in weights and trajectory space
//! only share the decomposition of the windows. Numbers agree with [`DdMhe`](crate::DdMhe) to
//! rounding; what goes beyond numbers that can be computed with is left to it.

use crate::choices::{guarded, prepared, select};
use crate::config::{Config, ProcessNoise, Start};
use crate::config_checks::validate;
use crate::defaults::Defaults;
use crate::depths::depths;
use crate::design::Design;
use crate::error::Error;
use crate::excitation::check_excitation;
use crate::first_window::filled;
use crate::history::History;
use crate::magnitude::{check_ridge, check_weights};
use crate::mhe::{DdMhe, Signals};
use crate::needs::Needs;
use crate::reduction::gain;
use crate::response::OwnResponse;
use crate::scaling::Scaling;
use crate::space::{Selection, TrajectorySpace, WindowStack};
use crate::tol;
use crate::variation::Rest;
use crate::weights::Weights;
use ddmhe_run::layout::Layout;
use faer::Mat;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether an estimator with these settings is such a map. From an unknown state its first windows
/// are another's.
pub(crate) fn is_linear(config: &Config) -> bool {
    let bounded = config.x_bounds.is_some() || config.v_bounds.is_some();
    let driven = *config.disturbance_to_fit() != ProcessNoise::None;
    !bounded && !driven && config.certificate.is_none() && config.start != Start::Unknown
}

/// x̂ = constant + G [x̄; y] of one depth, in scaled deviations.
struct Gain {
    constant: Vec<f64>, // n
    G: Mat<f64>,        // (n + m p) × n: transposed, so that a row of G is contiguous
}

/// One setting and its maps, that of the deepest window first.
struct Setting {
    weights: Weights,
    selection: Selection,
    spectral_radius: f64,
    gains: Vec<(usize, Gain)>, // with their depths
}

/// Settings of one horizon, rest and kind of start on one recording.
pub(crate) struct Filters<'a> {
    history: &'a History,
    config: &'a Config,
    scaling: Scaling,
    response: Option<OwnResponse>,
    horizon: usize,
    settings: Vec<Option<Setting>>, // None: it cannot be used here
    // where the recording chooses its own weights: a filter already
    general: Option<DdMhe>,
}

impl<'a> Filters<'a> {
    /// For configurations that differ in weights and space only, or for one that leaves the horizon
    /// open: with it the recording may choose other scales, see [`challenge`](crate::challenge).
    /// Unfinished when `stopped`.
    ///
    /// # Errors
    /// As [`DdMhe::new`](crate::DdMhe::new), for what all settings share.
    pub fn new(
        history: &'a History,
        configs: &[&'a Config],
        stopped: &AtomicBool,
    ) -> Result<Self, Error> {
        let config = configs[0];
        let going = || !stopped.load(Ordering::Relaxed);
        let Some(horizon) = config.horizon else {
            // with a full window from the start: the one depth at which the choice is made
            let design = Design::new(history, config, Needs::of(config, Start::Recording))?;
            let (horizon, rested) = (design.settings.horizon, design.settings.equilibrium_used);
            let scales = (&design.scaling, design.response.as_ref());
            let rest = config.rest().filter(|_| rested);
            if design.driving.is_some() {
                let general = Some(DdMhe::new(history, config.clone())?);
                let (scaling, settings) = (design.scaling.clone(), vec![None]);
                return Ok(Filters {
                    history,
                    config,
                    scaling,
                    response: None,
                    horizon,
                    settings,
                    general,
                });
            }
            let windows = Windows::new(history, scales, horizon, rest);
            let settings = vec![windows.setting(design.weights.clone(), design.selection)];
            let settings = windows.deepened(settings, config, &going);
            let Design { scaling, response, .. } = design;
            let general = None;
            return Ok(Filters { history, config, scaling, response, horizon, settings, general });
        };
        let (scaling, rule) = prepared(history, config)?;
        check_excitation(history, horizon)?;
        let response = OwnResponse::new(history, &scaling, horizon);
        let (scales, rest) = ((&scaling, response.as_ref()), config.rest());
        let windows = Windows::new(history, scales, horizon, rest.filter(|_| rule.noisy));
        let setting = |config: &&Config| going().then(|| windows.guarded(config, &rule)).flatten();
        let settings = windows.deepened(configs.iter().map(setting).collect(), config, &going);
        let general = None;
        Ok(Filters { history, config, scaling, response, horizon, settings, general })
    }

    /// Where its runs start: from a prior, unless at the recording's end.
    fn start(&self) -> Start {
        self.config.resolved(self.config.start, true)
    }

    /// Spectral radius of setting `k` and its estimates (N·n) of outputs (N·p) and inputs (N·m),
    /// from a prior if it starts from a state; None if it cannot be used, or if a number is out of
    /// reach.
    pub fn run(
        &self,
        k: usize,
        x_prior: &[f64],
        Signals { y: outputs, u }: Signals<'_>,
    ) -> Option<(f64, Vec<f64>)> {
        if let Some(general) = &self.general {
            let mut mhe = general.clone();
            mhe.reset((self.start() == Start::State).then_some(x_prior)).ok()?;
            let log = mhe.run_until(Signals { y: outputs, u }, &mut || false).ok()?;
            return Some((mhe.spectral_radius(), log.x));
        }
        let setting = self.settings[k].as_ref()?;
        let (n, p) = (self.history.n(), self.history.p());
        let last = self.history.recordings() - 1;
        let filled = filled(self.history, self.start(), self.horizon);
        let (x, y) = (self.history.states(last), self.history.outputs(last));
        let recorded = &x[x.len() - (filled + 1) * n..];
        let first = if self.start() == Start::State { x_prior } else { recorded };
        let mut states: Vec<f64> =
            first.chunks_exact(n).flat_map(|x| self.scaling.deviations(x, &[])).collect();
        let before = y[y.len() - filled * p..].chunks_exact(p);
        let mut past: Vec<f64> = before.flat_map(|y| self.scaling.deviations(&[], y)).collect();
        let m = self.history.m();
        let mut inputs: Vec<f64> = {
            let before = self.history.window_inputs(last, y.len() / p - filled, filled);
            self.scaling.input_deviations(before).chain(self.scaling.input_deviations(u)).collect()
        };
        inputs.truncate((filled + outputs.len() / p) * m);
        let mut estimates = Vec::with_capacity(outputs.len() / p * n);
        for y in outputs.chunks_exact(p) {
            past.extend(self.scaling.deviations(&[], y));
            let seen = past.len() / p;
            let (depth, gain) = setting.gains.iter().find(|(depth, _)| *depth <= seen)?;
            let start = seen - depth;
            let (prior, window) = (&states[start * n..(start + 1) * n], &past[start * p..]);
            let next: Vec<f64> = match &self.response {
                None => (0..n).map(|i| gain.row(i, prior, window)).collect(),
                Some(response) => {
                    let (x_f, y_f) = response.forced(&inputs[start * m..seen * m]);
                    let free: Vec<f64> = window.iter().zip(&y_f).map(|(y, f)| y - f).collect();
                    let moved = &x_f[depth * n..];
                    (0..n).map(|i| gain.row(i, prior, &free) + moved[i]).collect()
                }
            };
            estimates.extend(next.iter().enumerate().map(|(i, x)| self.scaling.state(i, *x)));
            states.extend(next);
        }
        let within = states.iter().chain(&past).all(|v| v.abs() <= tol::MEASURABLE);
        within.then_some((setting.spectral_radius, estimates))
    }
}

/// What the settings share while their maps are made.
struct Windows<'a> {
    history: &'a History,
    scaling: &'a Scaling,
    horizon: usize,
    stack: WindowStack<'a>,
}

impl<'a> Windows<'a> {
    fn new(
        history: &'a History,
        scales: (&'a Scaling, Option<&'a OwnResponse>),
        horizon: usize,
        rest: Option<Rest<'a>>,
    ) -> Self {
        let stack = WindowStack::new(history, scales, horizon, rest);
        Windows { history, scaling: scales.0, horizon, stack }
    }

    /// A setting with the map of the deepest window.
    fn setting(&self, weights: Weights, selection: Selection) -> Option<Setting> {
        let deepest = self.gain(self.horizon, &weights, &selection)?;
        Some(Setting {
            spectral_radius: deepest.spectral_radius(),
            weights,
            selection,
            gains: vec![(self.horizon, deepest)],
        })
    }

    /// The same of a configuration, its weight raised as [`Design`] does.
    fn guarded(&self, config: &Config, rule: &Defaults) -> Option<Setting> {
        validate(self.history, config).ok()?;
        let weights = Weights::new(config, rule, (self.scaling, None)).ok()?;
        check_weights(&weights, config, self.scaling).ok()?;
        let selection = select(&config.space, rule, &weights, self.history.n());
        check_ridge(&weights, config, self.stack.space(self.horizon, &selection).lambda).ok()?;
        guarded(config, selection, |selection| {
            let setting = self.setting(weights.clone(), selection).ok_or(())?;
            Ok::<_, ()>((setting.spectral_radius, setting))
        })
        .ok()
    }

    /// Settings with the maps of the shorter windows that a run begins with.
    fn deepened(
        &self,
        mut settings: Vec<Option<Setting>>,
        config: &Config,
        going: &impl Fn() -> bool,
    ) -> Vec<Option<Setting>> {
        let filled = filled(self.history, config.resolved(config.start, true), self.horizon);
        for depth in depths(config, self.horizon, filled).into_iter().skip(1) {
            for slot in settings.iter_mut().filter(|_| going()) {
                let Some(setting) = slot else { continue };
                match self.gain(depth, &setting.weights, &setting.selection) {
                    Some(gain) => setting.gains.push((depth, gain)),
                    None => *slot = None,
                }
            }
        }
        settings
    }

    fn gain(&self, depth: usize, weights: &Weights, selection: &Selection) -> Option<Gain> {
        let (n, p) = (self.history.n(), self.history.p());
        let layout = Layout { n, p, depth, driven: false };
        Gain::new(layout, &self.stack.space(depth, selection), weights)
    }
}

impl Gain {
    fn new(layout: Layout, space: &TrajectorySpace, weights: &Weights) -> Option<Self> {
        let G = gain(layout, space, weights).ok()?;
        let constant = |(i, row): (usize, usize)| {
            let seen = layout.seen().enumerate().map(|(j, seen)| G[(j, i)] * space.mean[seen]);
            space.mean[row] - seen.sum::<f64>()
        };
        Some(Gain { constant: layout.x(layout.depth).enumerate().map(constant).collect(), G })
    }

    /// Entry i of the estimate.
    fn row(&self, i: usize, prior: &[f64], outputs: &[f64]) -> f64 {
        let gains = self.G.col(i).iter();
        self.constant[i]
            + prior.iter().chain(outputs).zip(gains).map(|(v, gain)| v * gain).sum::<f64>()
    }

    /// Of the map x̄(t-m) → x̂(t); NaN where the iteration fails.
    fn spectral_radius(&self) -> f64 {
        let n = self.constant.len();
        let map = self.G.subrows(0, n).transpose().to_owned();
        map.eigenvalues()
            .map_or(f64::NAN, |values| values.iter().map(|z| z.norm()).fold(0.0, f64::max))
    }
}
