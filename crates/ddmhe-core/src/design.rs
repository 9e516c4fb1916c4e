//! What an estimator computes at construction: settings, weights and the problems of all depths.

use crate::certificate::smallest_contracting;
use crate::challenge::challenge;
use crate::config::{Bounds, Center, Config, Settings, Start, Weighting, validate};
use crate::defaults::Defaults;
use crate::error::Error;
use crate::error_bound::ErrorBound;
use crate::excitation::check_excitation;
use crate::history::History;
use crate::plan_builder::{Draft, Ground, Prepared, factorisation};
use crate::scaling::Scaling;
use crate::space::{Penalty, Selection, Space, WindowStack};
use crate::tol;
use crate::watch::Watch;
use crate::weights::Weights;
use ddmhe_run::layout::Layout;
use ddmhe_run::plan::{Sizes, kept_depths};
use std::sync::Arc;

/// One signal of a recording, time-major.
type Signal = fn(&History, usize) -> &[f64];

/// What follows from the recording and the settings; shared by the copies of an estimator.
pub(crate) struct Design {
    pub history: History,
    pub settings: Settings,
    pub scaling: Scaling,
    pub weights: Weights,
    pub selection: Selection,
    pub x_bounds: Option<Bounds>,
    pub units: pulp::Arch,       // the machine's vector units
    pub ground: Arc<Ground>,     // what all depths share
    pub problems: Vec<Prepared>, // of the depths that are kept, ascending, the last M
    place: Vec<usize>,           // in it, of the deepest that so many outputs fill
    pub spectral_radius: f64,
    pub warnings: Vec<String>,
    pub watch: Watch,
    pub bound: Option<ErrorBound>, // as it starts
    pub centered: bool,
}

impl Design {
    /// As [`DdMhe::new`](crate::DdMhe::new), with the problems that runs from this start need.
    pub fn new(history: &History, config: &Config, start: Start) -> Result<Self, Error> {
        Design::by(history, config, start, prepared(history, config)?)
    }

    /// With these scales and this rule for what the configuration leaves open.
    fn by(
        history: &History,
        config: &Config,
        start: Start,
        (scaling, rule): (Scaling, Defaults),
    ) -> Result<Self, Error> {
        let rest = config.rest();
        let weights = Weights::new(config, &rule, &scaling)?;
        check_weights(&weights, config, &scaling)?;
        let horizon = rule.horizon_for(config)?;
        check_excitation(history, horizon)?;

        let equilibrium_used = rest.is_some() && rule.noisy;
        let stack = WindowStack::new(history, &scaling, horizon, rest.filter(|_| equilibrium_used));
        let centered = config.x_center == Center::History;
        let problem = |depth: usize, selection: &Selection| {
            let layout = Layout { n: history.n(), p: history.p(), depth };
            let (space, bounds) = (stack.space(depth, selection), config.x_bounds.as_ref());
            Draft::new(layout, space, &scaling, &weights, (bounds, centered), None)
                .map_err(factorisation)
        };
        let mut selection = select(&config.space, &rule, &weights, history.n());
        let mut deepest = problem(horizon, &selection)?;
        check_ridge(&weights, config, deepest.space.lambda)?;
        let mut radius = spectral_radius(&deepest);
        for _ in 0..tol::GUARD {
            let guarded = config.space == Space::Auto && !stable(radius);
            let Some(heavier) = selection.heavier().filter(|_| guarded) else { break };
            selection = heavier;
            deepest = problem(horizon, &selection)?;
            radius = spectral_radius(&deepest);
        }
        let weighting = config.weighting();
        let open = config.horizon.is_none()
            && config.rho.is_none()
            && config.mu.is_none()
            && config.space == Space::Auto;
        if open
            && weighting == Weighting::Scaled
            && !equilibrium_used
            && let Some((scaling, rule)) = challenge(history, &scaling, &rule, deepest.space.lambda)
        {
            return Design::by(history, config, start, (scaling, rule));
        }
        let settings = Settings {
            horizon,
            rho: weights.rho,
            mu: if weighting == Weighting::Scaled {
                weights.mu()
            } else {
                weights.mu_as_printed(&scaling)
            },
            weights: weighting,
            rank: deepest.rank(),
            lambda: deepest.space.lambda,
            equilibrium_used,
        };
        let filled = filled(history, start, horizon);
        let depths = depths(config, horizon, filled);
        let of_depth = |depth: &usize| problem(*depth, &selection);
        let mut problems = depths[1..].iter().rev().map(of_depth).collect::<Result<Vec<_>, _>>()?;
        problems.push(deepest);
        let rank = problems.iter().map(Draft::rank).max().unwrap_or(0);
        let sizes = Sizes {
            n: history.n(),
            p: history.p(),
            horizon,
            rank,
            filled,
            x_bounded: config.x_bounds.is_some(),
            v_bounded: config.v_bounds.is_some(),
            centered,
            plain_noise: config.certificate.is_none(),
        };
        let boxes = (config.x_bounds.as_ref(), config.v_bounds.as_ref());
        let (states, outputs) =
            first_window(history, &scaling, start, filled, config.x_prior.as_deref());
        let ground = Arc::new(Ground::new(sizes, &scaling, &weights, boxes, (&states, &outputs)));
        let problems: Vec<Prepared> = problems.into_iter().map(|draft| draft.on(&ground)).collect();
        let (watch, mut words) = Watch::new(history);
        words.extend(too_little(history, config, &rule, horizon));
        words.extend(warnings(config, &settings, radius));
        let bound =
            ErrorBound::new(config.certificate.as_ref(), config.disturbance.as_ref(), history)
                .unwrap_or_else(|why| {
                    words.push(why);
                    None
                });
        Ok(Design {
            history: history.clone(),
            warnings: words,
            watch,
            bound,
            x_bounds: config.x_bounds.clone(),
            units: pulp::Arch::new(),
            ground,
            place: places(&problems, horizon),
            spectral_radius: radius,
            settings,
            scaling,
            weights,
            selection,
            problems,
            centered,
        })
    }

    /// The problem of the deepest window that so many outputs fill.
    #[inline(always)]
    pub fn problem(&self, outputs: usize) -> &Prepared {
        &self.problems[self.place[outputs]]
    }

    /// Where that is among the problems.
    pub fn place(&self, outputs: usize) -> usize {
        self.place[outputs]
    }

    /// Whether no window of a new run is shorter than this.
    pub fn reaches(&self, outputs: usize) -> bool {
        self.problems[0].layout().depth <= outputs
    }

    /// A full problem without the outputs that were not measured, factored anew.
    pub fn without_missing(
        &self,
        full: &Prepared,
        weights: &Weights,
        outputs: &[f64],
    ) -> Result<Prepared, Error> {
        let measured: Vec<bool> = outputs.iter().map(|v| v.is_finite()).collect();
        let (layout, space) = (full.layout(), full.space.clone());
        let bounds = (self.x_bounds.as_ref(), self.centered);
        Draft::new(layout, space, &self.scaling, weights, bounds, Some(&measured))
            .map(|draft| draft.on(&self.ground))
            .map_err(factorisation)
    }
}

/// Depths of the windows of a run that begins with so many outputs, the horizon first: every one
/// where the weights are stated in the user's units or by a certificate, Algorithm 1 as printed;
/// otherwise few of them.
pub(crate) fn depths(config: &Config, horizon: usize, filled: usize) -> Vec<usize> {
    let mut depths: Vec<usize> = kept_depths(horizon, keeps_every_depth(config)).collect();
    // with outputs in the window before the first step, shorter ones are never reached
    let longer = depths.iter().filter(|depth| **depth > filled + 1).count();
    depths.truncate(longer + 1);
    depths
}

/// Whether windows grow through every depth.
pub(crate) fn keeps_every_depth(config: &Config) -> bool {
    config.certificate.is_some() || config.weighting() == Weighting::Paper
}

/// For each number of outputs up to the horizon, which problem is the deepest that they fill.
fn places(problems: &[Prepared], horizon: usize) -> Vec<usize> {
    let deep = |outputs: usize| {
        problems.partition_point(|problem| problem.layout().depth <= outputs).saturating_sub(1)
    };
    (0..=horizon).map(deep).collect()
}

/// States and outputs in the window of a new run, as scaled deviations: the recording's end, the
/// prior, or the recording's mean.
pub(crate) fn first_window(
    history: &History,
    scaling: &Scaling,
    start: Start,
    filled: usize,
    x_prior: Option<&[f64]>,
) -> (Vec<f64>, Vec<f64>) {
    let (n, p, last) = (history.n(), history.p(), history.recordings() - 1);
    let (x, y) = (history.states(last), history.outputs(last));
    let mut states = x[x.len() - (filled + 1) * n..].to_vec();
    match (start, x_prior) {
        (Start::State, Some(prior)) => states.copy_from_slice(prior),
        (Start::Unknown, _) => states.copy_from_slice(&scaling.mean_x),
        _ => {}
    }
    let outputs = &y[y.len() - filled * p..];
    (
        states.chunks_exact(n).flat_map(|x| scaling.deviations(x, &[])).collect(),
        outputs.chunks_exact(p).flat_map(|y| scaling.deviations(&[], y)).collect(),
    )
}

/// The scales and the rule of checked settings.
pub(crate) fn prepared(history: &History, config: &Config) -> Result<(Scaling, Defaults), Error> {
    validate(history, config)?;
    check_sizes(history)?;
    let scaling = Scaling::new(history)?;
    check_scales(&scaling)?;
    check_reach("x_prior", &scaling, config.x_prior.as_deref().unwrap_or(&[]), &[])?;
    let rest = config.rest();
    let (x_e, y_e) = rest.unwrap_or_default();
    check_reach("equilibrium", &scaling, x_e, y_e)?;
    let rule = Defaults::new(history, &scaling, rest);
    Ok((scaling, rule))
}

/// That the recording is too short for its noise, with the length that would do.
fn too_little(
    history: &History,
    config: &Config,
    rule: &Defaults,
    horizon: usize,
) -> Option<String> {
    let (T, windows) = (history.T(), history.windows(horizon));
    let needed = rule.needed(history.n(), config.horizon)?;
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

/// Numbers whose squares and quotients are numbers too; a channel of zeros alone is one that never
/// moved.
fn check_sizes(history: &History) -> Result<(), Error> {
    let (least, most) = tol::SIZES;
    let fits = |v: &f64| *v == 0.0 || (least..=most).contains(v);
    for (name, of, width) in
        [("x", History::states as Signal, history.n()), ("y", History::outputs, history.p())]
    {
        let mut largest = vec![0.0_f64; width];
        for row in (0..history.recordings()).flat_map(|k| of(history, k).chunks_exact(width)) {
            largest.iter_mut().zip(row).for_each(|(largest, v)| *largest = largest.max(v.abs()));
        }
        if let Some(i) = largest.iter().position(|v| !fits(v)) {
            let expected = format!(
                "{name}{} of magnitudes between {least:e} and {most:e} (in other units, if need \
                be)",
                i + 1
            );
            return Err(Error::value("history", expected, largest[i]));
        }
    }
    Ok(())
}

/// The same of deviations.
fn check_scales(scaling: &Scaling) -> Result<(), Error> {
    let (least, most) = tol::SIZES;
    for (name, s) in [("x", &scaling.s_x), ("y", &scaling.s_y)] {
        if let Some(&s) = s.iter().find(|s| !(least..=most).contains(*s)) {
            let expected =
                format!("{name} with standard deviations between {least:e} and {most:e}");
            return Err(Error::value("history", expected, s));
        }
    }
    Ok(())
}

/// Weights that leave something of both terms of (17).
pub(crate) fn check_weights(
    weights: &Weights,
    config: &Config,
    scaling: &Scaling,
) -> Result<(), Error> {
    let [(P, P_most), (R, R_most)] = weights.ranges();
    let fits = |least: f64, most: f64| least > 0.0 && most / least <= tol::WEIGHTS;
    let found = format!("weights between {:.1e} and {:.1e}", P.min(R), P_most.max(R_most));
    if fits(P.min(R), P_most.max(R_most)) {
        return Ok(());
    }
    if config.certificate.is_some() {
        let expected = format!("P and R that differ by at most {:e} in scaled units", tol::WEIGHTS);
        return Err(Error::value("certificate", expected, found));
    }
    let paper = config.weighting() == Weighting::Paper;
    let per_mu = scaling.s_y.iter().map(|s| if paper { s * s / weights.unit } else { 1.0 });
    let (low, high) =
        per_mu.fold((f64::INFINITY, 0.0_f64), |(low, high), w| (low.min(w), high.max(w)));
    let (least, most) = (P_most / tol::WEIGHTS / low, P * tol::WEIGHTS / high);
    match config.mu {
        Some(mu) if least <= most => Err(Error::value(
            "mu",
            format!("between {least:.1e} and {most:.1e} for this recording"),
            format!("{mu:e}"),
        )),
        _ => Err(Error::value("weights", "units less far apart, or \"scaled\"", found)),
    }
}

/// A weight on ‖α‖² that leaves something of the cost (17), and of which something is left beside
/// it.
pub(crate) fn check_ridge(weights: &Weights, config: &Config, lambda: f64) -> Result<(), Error> {
    let Space::Ridge { weight, .. } = config.space else { return Ok(()) };
    let [(P, P_most), (R, R_most)] = weights.ranges();
    let (least, most) = (P_most.max(R_most) / tol::WEIGHTS, P.min(R) * tol::WEIGHTS);
    if (least..=most).contains(&lambda) {
        return Ok(());
    }
    let per_weight = lambda / weight;
    let expected = format!(
        "a weight between {:.1e} and {:.1e} for these settings, or Exact or Truncated",
        least / per_weight,
        most / per_weight
    );
    Err(Error::value("space", expected, format!("{weight:e}")))
}

/// A state or an output (either may be empty) that is not beyond [`MEASURABLE`](tol::MEASURABLE).
pub(crate) fn check_reach(
    argument: &'static str,
    scaling: &Scaling,
    x: &[f64],
    y: &[f64],
) -> Result<(), Error> {
    match scaling.deviations(x, y).position(|v| !(v.abs() <= tol::MEASURABLE)) {
        None => Ok(()),
        Some(k) => {
            let expected = format!(
                "at most {:.1e} standard deviations of the recording from its mean",
                tol::MEASURABLE
            );
            Err(Error::value(argument, expected, if k < x.len() { x[k] } else { y[k - x.len()] }))
        }
    }
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
    let asked_for =
        config.certificate.is_none() && (config.horizon.is_some() || config.rho.is_some());
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

/// Outputs that are in the window before the first step: those at the end of the last recording, if
/// that is where it starts.
pub(crate) fn filled(history: &History, start: Start, horizon: usize) -> usize {
    let recorded = history.outputs(history.recordings() - 1).len() / history.p();
    if start == Start::Recording { recorded.min(horizon) } else { 0 }
}

/// The chosen space in normalised units.
pub(crate) fn select(space: &Space, rule: &Defaults, weights: &Weights, n: usize) -> Selection {
    match *space {
        Space::Auto => rule.selection(weights.mu()),
        Space::Exact => Selection { rank: None, tol: None, penalty: Penalty::None },
        Space::Truncated { rank: None, tol: None } => {
            Selection { rank: Some(n), tol: None, penalty: Penalty::None }
        }
        Space::Truncated { rank, tol } => Selection { rank, tol, penalty: Penalty::None },
        Space::Ridge { weight, normalised } => {
            let penalty = if normalised {
                Penalty::Normalised(weight)
            } else {
                Penalty::Alpha(weight / weights.unit)
            };
            Selection { rank: None, tol: None, penalty }
        }
    }
}

fn spectral_radius(problem: &Draft) -> f64 {
    // An eigenvalue iteration that fails (never seen on finite data) must not pass as stable.
    problem
        .prior_map
        .eigenvalues()
        .map_or(f64::NAN, |values| values.iter().map(|z| z.norm()).fold(0.0, f64::max))
}

/// False also for NaN, which no finite data should give.
pub(crate) fn stable(spectral_radius: f64) -> bool {
    spectral_radius <= tol::SPECTRAL_RADIUS
}
