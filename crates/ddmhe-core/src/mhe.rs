//! Data-driven moving horizon estimation: Algorithm 1 of Liu 2026.
//!
//! At time t the window is y(t-M_t) … y(t-1) with M_t = min(t, M); the estimate is x̂(t), made from outputs up to
//! y(t-1). The prior x̄(t-M_t) is x̄(0) while the window grows and afterwards the estimate made at that time
//! (filtering update).

use crate::certificate::ErrorBound;
use crate::config::{
    Bounds, Center, Config, Settings, check_box, check_measured, check_output, check_vector, validate,
};
use crate::defaults::Defaults;
use crate::error::Error;
use crate::estimate::{Estimate, Log};
use crate::hankel::check_excitation;
use crate::history::{History, check_finite};
use crate::space::{Penalty, Scaling, Selection, Space, WindowStack};
use crate::tol;
use crate::weights::Weights;
use crate::window::{Rows, Scratch, WindowProblem};
use rayon::prelude::*;

/// The estimator.
pub struct DdMhe {
    history: History,
    config: Config,
    settings: Settings,
    scaling: Scaling,
    weights: Weights,
    bound: Option<ErrorBound>,
    problems: Vec<WindowProblem>, // problems[m-1] is of depth m; with a warm start the short ones may be missing
    spectral_radius: f64,
    warnings: Vec<String>,
    outputs: Vec<f64>, // y(t-M_t) … y(t-1), scaled, NaN where not measured
    states: Vec<f64>,  // x̂(t-M_t) … x̂(t), scaled
    t: usize,
    estimate: Estimate,
    scratch: Scratch,
}

impl DdMhe {
    /// Prepares the estimator: checks every argument, fills in the defaults and factors the problems of all depths.
    ///
    /// # Errors
    /// [`Error::Value`], [`Error::Shape`] or [`Error::NotFinite`] naming the setting at fault; [`Error::Rank`] when the
    /// recording is too short for the horizon or violates the rank condition (7).
    pub fn new(history: &History, config: Config) -> Result<Self, Error> {
        validate(history, &config)?;
        let scaling = Scaling::new(history)?;
        let rest = config.equilibrium.as_ref().map(|(x, y)| (&x[..], &y[..]));
        let rule = Defaults::new(history, &scaling, rest);
        let unit = (scaling.s_y / scaling.s_x).powi(2); // μ in scaled units is μ·unit
        let weights = Weights::new(&config, &rule, unit, history.n(), history.p())?;
        let horizon = rule.horizon_for(&config)?;
        check_excitation(history, horizon)?;

        let equilibrium_used = rest.is_some() && rule.noisy;
        let stack = WindowStack::new(history, &scaling, horizon, rest.filter(|_| equilibrium_used));
        let centered = config.x_center == Center::History;
        let problem = |depth: usize, selection: &Selection| {
            let rows = Rows { n: history.n(), p: history.p(), depth };
            WindowProblem::new(rows, stack.space(depth, selection), &weights, centered, None).map_err(factorisation)
        };
        let mut selection = select(&config.space, &rule, weights.mu(), history.n());
        let mut deepest = problem(horizon, &selection)?;
        let mut radius = spectral_radius(&deepest);
        for _ in 0..tol::GUARD {
            let guarded = config.space == Space::Auto && !stable(radius);
            let Some(heavier) = selection.heavier().filter(|_| guarded) else { break };
            selection = heavier;
            deepest = problem(horizon, &selection)?;
            radius = spectral_radius(&deepest);
        }
        let settings = Settings {
            horizon,
            rho: weights.rho,
            mu: weights.mu() / unit,
            rank: deepest.space.rank(),
            lambda: deepest.space.lambda,
            equilibrium_used,
        };
        let first = (filled(history, &config, horizon) + 1).min(horizon);
        let mut problems = (first..horizon).map(|depth| problem(depth, &selection)).collect::<Result<Vec<_>, _>>()?;
        problems.push(deepest);
        let bound = match (&config.certificate, &config.disturbance) {
            (Some(c), Some(d)) => ErrorBound::new(c, d, history.n(), history.p()),
            _ => None,
        };
        let mut mhe = DdMhe {
            history: history.clone(),
            config,
            settings,
            scaling,
            weights,
            bound,
            problems,
            spectral_radius: radius,
            warnings: Vec::new(),
            outputs: Vec::new(),
            states: Vec::new(),
            t: 0,
            estimate: Estimate::default(),
            scratch: Scratch::default(),
        };
        mhe.warnings = mhe.warn();
        mhe.restart();
        Ok(mhe)
    }

    /// Consumes y(t-1) (p numbers, NaN = this entry was not measured) and returns the estimate x̂(t).
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] (infinite entry); the estimator is then unchanged.
    pub fn step(&mut self, y: &[f64]) -> Result<&Estimate, Error> {
        self.step_within(y, None)
    }

    /// [`step`](Self::step) with other state bounds for this step alone: lo and hi hold n numbers each, or one row per state of
    /// the window, (M_t+1)·n with M_t = [`next_depth`](Self::next_depth).
    ///
    /// # Errors
    /// As [`step`](Self::step), and for bounds of the wrong size, NaN or crossed.
    pub fn step_within(&mut self, y: &[f64], x_bounds: Option<&Bounds>) -> Result<&Estimate, Error> {
        check_output(y, self.history.p())?;
        if let Some(bounds) = x_bounds {
            let n = self.history.n();
            check_box("x_bounds", bounds, &[n, (self.next_depth() + 1) * n])?;
        }
        self.advance(y, x_bounds)
    }

    /// All steps of a log `ys` (N·p, time-major): the same numbers as N calls of [`step`](Self::step).
    ///
    /// # Errors
    /// As [`step`](Self::step); the whole log is checked first, so a bad row leaves the estimator unchanged.
    pub fn run(&mut self, ys: &[f64]) -> Result<Log, Error> {
        let p = self.history.p();
        if !ys.len().is_multiple_of(p) {
            return Err(Error::shape("Y", format!("a multiple of p = {p} numbers"), ys.len()));
        }
        check_measured("Y", ys, p)?;
        let mut log = Log::default();
        for y in ys.chunks_exact(p) {
            let estimate = self.advance(y, None)?;
            log.x.extend_from_slice(&estimate.x);
            log.cost.push(estimate.cost);
            log.status.push(estimate.status);
            log.active.push(estimate.active);
            log.iterations.push(estimate.iterations);
            log.bound.extend(estimate.bound);
        }
        Ok(log)
    }

    /// Back to t = 0, with another prior x̄(0) (n) if given.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] for `x_prior`.
    pub fn reset(&mut self, x_prior: Option<&[f64]>) -> Result<(), Error> {
        if let Some(x) = x_prior {
            check_vector("x_prior", x, self.history.n())?;
            self.config.x_prior = Some(x.to_vec());
        }
        self.restart();
        Ok(())
    }

    /// Number of states n.
    pub fn n(&self) -> usize {
        self.history.n()
    }

    /// Number of outputs p.
    pub fn p(&self) -> usize {
        self.history.p()
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The configuration that was asked for.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Steps taken since the start or the last reset.
    pub fn t(&self) -> usize {
        self.t
    }

    /// Depth M_t of the next step's window.
    pub fn next_depth(&self) -> usize {
        (self.outputs.len() / self.history.p() + 1).min(self.settings.horizon)
    }

    /// Spectral radius of the map x̄(t-M) → x̂(t) without new information: above 1 errors grow.
    pub fn spectral_radius(&self) -> f64 {
        self.spectral_radius
    }

    /// What a user should know about these settings, in words.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The latest estimate (empty before the first step).
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The recording behind the estimator.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Scaled outputs and states of the current window.
    pub(crate) fn window(&self) -> (&[f64], &[f64]) {
        (&self.outputs, &self.states)
    }

    /// Error bounds of the states in [`window`](Self::window), empty without.
    pub(crate) fn bounds(&self) -> &[f64] {
        self.bound.as_ref().map_or(&[], ErrorBound::errors)
    }

    /// Continues from a saved window.
    pub(crate) fn resume(
        &mut self,
        outputs: Vec<f64>,
        states: Vec<f64>,
        bounds: Vec<f64>,
        t: usize,
    ) -> Result<(), Error> {
        let samples = outputs.len() / self.p();
        let fits = samples <= self.settings.horizon
            && outputs.len() == samples * self.p()
            && states.len() == (samples + 1) * self.n()
            && bounds.len() == if self.bound.is_some() { samples + 1 } else { 0 }
            && bounds.iter().all(|e| *e >= 0.0);
        if !fits || samples < self.problems[0].rows.depth - 1 {
            return Err(Error::value("blob", "a window that fits the horizon", format!("{samples} samples")));
        }
        check_measured("blob", &outputs, self.p())?;
        check_finite("blob", &states, self.n())?;
        (self.outputs, self.states, self.t) = (outputs, states, t);
        if let Some(bound) = &mut self.bound {
            bound.resume(bounds);
        }
        Ok(())
    }

    fn restart(&mut self) {
        let (n, p) = (self.history.n(), self.history.p());
        self.t = 0;
        self.estimate = Estimate::default();
        let last = self.history.recordings() - 1;
        let filled = filled(&self.history, &self.config, self.settings.horizon);
        let (x, y) = (self.history.x(last), self.history.y(last));
        self.outputs = y[y.len() - filled * p..].iter().map(|v| v / self.scaling.s_y).collect();
        self.states = x[x.len() - (filled + 1) * n..].iter().map(|v| v / self.scaling.s_x).collect();
        if let Some(prior) = &self.config.x_prior {
            let start = self.states.len() - n;
            self.states[start..].iter_mut().zip(prior).for_each(|(s, v)| *s = v / self.scaling.s_x);
        }
        if let Some(bound) = &mut self.bound {
            bound.restart(filled + 1);
        }
    }

    /// One pass of Algorithm 1's loop, on checked input.
    fn advance(&mut self, y: &[f64], x_bounds: Option<&Bounds>) -> Result<&Estimate, Error> {
        let (n, p) = (self.history.n(), self.history.p());
        let depth = self.next_depth();
        if self.outputs.len() == depth * p {
            self.outputs.drain(..p);
            self.states.drain(..n);
            if let Some(bound) = &mut self.bound {
                bound.forget();
            }
        }
        self.outputs.extend(y.iter().map(|v| v / self.scaling.s_y));

        // f = [x̄(t-M_t); y(t-M_t) … y(t-1)]
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.f.clear();
        scratch.f.extend(self.states[..n].iter().chain(&self.outputs).map(|&v| if v.is_nan() { 0.0 } else { v }));
        let first = self.problems[0].rows.depth;
        let mut reduced = self.without_missing(depth)?;
        let problem = reduced.as_mut().unwrap_or(&mut self.problems[depth - first]);
        let box_x = x_bounds.or(self.config.x_bounds.as_ref());
        let box_v = self.config.v_bounds.as_ref();
        let bounded = box_x.is_some() || box_v.is_some();
        if bounded {
            let center = box_x.and_then(|_| problem.centre(&scratch.f[n..]));
            let sides = (&mut scratch.lo, &mut scratch.hi);
            problem.rows.limits(&self.scaling, (box_x, center.as_deref()), box_v, &self.outputs, sides);
        }
        let found = problem.solve(&mut scratch, bounded);

        let (s_x, s_y) = (self.scaling.s_x, self.scaling.s_y);
        let (rows, w, f) = (problem.rows, &scratch.window, &scratch.f);
        let estimate = &mut self.estimate;
        estimate.window.clear();
        estimate.window.extend((0..=depth).flat_map(|k| rows.x(k)).map(|i| w[i] * s_x));
        estimate.v.clear();
        estimate.v.extend((0..depth).flat_map(|k| rows.y(k)).zip(&self.outputs).map(|(i, y)| (y - w[i]) * s_y));
        estimate.x.clear();
        estimate.x.extend_from_slice(&estimate.window[depth * n..]);
        let v = (0..depth).flat_map(|k| rows.y(k)).zip(&self.outputs).map(|(i, y)| y - w[i]);
        estimate.cost = s_x * s_x * self.weights.cost(rows.x(0).map(|i| w[i]), &f[..n], v);
        (estimate.status, estimate.active, estimate.iterations) = (found.status, found.active, found.iterations);
        estimate.bound = self.bound.as_mut().map(|bound| {
            let outputs: Vec<f64> = self.outputs.iter().map(|y| y * s_y).collect();
            let past: Vec<f64> = self.states.iter().map(|x| x * s_x).collect();
            bound.advance(&estimate.window, &outputs, &estimate.v, &past)
        });
        self.states.extend(rows.x(depth).map(|i| w[i]));
        self.scratch = scratch;
        self.t += 1;
        Ok(&self.estimate)
    }

    /// The problem without the outputs that were not measured; None when all were.
    fn without_missing(&self, depth: usize) -> Result<Option<WindowProblem>, Error> {
        if self.outputs.iter().all(|v| v.is_finite()) {
            return Ok(None);
        }
        let measured: Vec<bool> = self.outputs.iter().map(|v| v.is_finite()).collect();
        let full = &self.problems[depth - self.problems[0].rows.depth];
        let centered = self.config.x_center == Center::History;
        WindowProblem::new(full.rows, full.space.clone(), &self.weights, centered, Some(&measured))
            .map(Some)
            .map_err(factorisation)
    }

    fn warn(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if !stable(self.spectral_radius) {
            warnings.push(format!(
                "the map from prior to estimate has spectral radius {:.4} (limit {}): estimation errors may grow; try another horizon, a larger mu or a smaller rank",
                self.spectral_radius,
                tol::SPECTRAL_RADIUS
            ));
        }
        if self.config.equilibrium.is_some() && !self.settings.equilibrium_used {
            warnings.push("equilibrium: not used, the recording shows no noise and is more accurate without it".into());
        }
        warnings
    }
}

/// [`DdMhe::run`] of many estimators over as many logs, on all cores (rayon): the same numbers, in the same order.
///
/// # Errors
/// The first log's error, in order; as for [`DdMhe::run`] its estimator is then unchanged, the others have run.
pub fn run_many(estimators: &mut [&mut DdMhe], logs: &[&[f64]]) -> Result<Vec<Log>, Error> {
    if estimators.len() != logs.len() {
        return Err(Error::shape("logs", format!("{} logs, one per estimator", estimators.len()), logs.len()));
    }
    let found: Vec<Result<Log, Error>> =
        estimators.par_iter_mut().zip(logs).map(|(estimator, log)| estimator.run(log)).collect();
    found.into_iter().collect()
}

/// Outputs that are in the window before the first step: a warm start takes them from the last recording.
fn filled(history: &History, config: &Config, horizon: usize) -> usize {
    let recorded = history.y(history.recordings() - 1).len() / history.p();
    if config.warm_start { recorded.min(horizon) } else { 0 }
}

/// The chosen space in normalised units.
fn select(space: &Space, rule: &Defaults, mu: f64, n: usize) -> Selection {
    match *space {
        Space::Auto => rule.selection(mu),
        Space::Exact => Selection { rank: None, tol: None, penalty: Penalty::None },
        Space::Truncated { rank: None, tol: None } => Selection { rank: Some(n), tol: None, penalty: Penalty::None },
        Space::Truncated { rank, tol } => Selection { rank, tol, penalty: Penalty::None },
        Space::Ridge { weight, normalised } => {
            let penalty = if normalised { Penalty::Normalised(weight) } else { Penalty::Alpha(weight) };
            Selection { rank: None, tol: None, penalty }
        }
    }
}

fn spectral_radius(problem: &WindowProblem) -> f64 {
    // An eigenvalue iteration that fails (never seen on finite data) must not pass as stable.
    problem
        .prior_to_estimate()
        .eigenvalues()
        .map_or(f64::NAN, |values| values.iter().map(|z| z.norm()).fold(0.0, f64::max))
}

/// False also for NaN, which no finite data should give.
fn stable(spectral_radius: f64) -> bool {
    spectral_radius <= tol::SPECTRAL_RADIUS
}

fn factorisation(_: faer::linalg::solvers::SvdError) -> Error {
    Error::rank(
        "history",
        "data whose singular values can be computed",
        "data on which the decomposition does not converge",
    )
}
