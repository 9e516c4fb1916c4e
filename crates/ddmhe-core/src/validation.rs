//! Many settings tried on held-out parts of a recording, in parallel: the work behind tuning.

use crate::check::{check_finite, check_vector};
use crate::config::{Config, Start};
use crate::depths::keeps_every_depth;
use crate::error::Error;
use crate::filter::{Filters, is_linear};
use crate::history::History;
use crate::interrupt::on_all_cores;
use crate::mhe::{DdMhe, Signals};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A part of a recording to learn from, and another to estimate.
#[derive(Debug, Clone)]
pub struct Fold {
    /// What the estimator learns from.
    pub history: History,
    /// The state before the first estimate (n), for settings that start from a state.
    pub x_prior: Vec<f64>,
    /// Outputs to estimate from, N·p, time-major; NaN where not measured. None at all: only the
    /// stability is looked at.
    pub outputs: Vec<f64>,
    /// Known inputs at the same instants, N·m; empty for a recording without.
    pub inputs: Vec<f64>,
    /// The states that should come out, N·n.
    pub truth: Vec<f64>,
    /// How many of the first estimates each error covers; each from 1 to N.
    pub spans: Vec<usize>,
    /// What the error of each state is relative to (n), > 0.
    pub spread: Vec<f64>,
}

/// How one setting did on one fold.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// Mean over states of the squares of (x̂ - x)/spread, and over the estimates of each span,
    /// infinite if the setting cannot be used on this fold.
    pub errors: Vec<f64>,
    /// Spectral radius of the map prior → estimate, infinite likewise.
    pub spectral_radius: f64,
}

impl Fold {
    /// Checks the sizes.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] naming the field.
    pub fn check(&self) -> Result<(), Error> {
        let (n, p) = (self.history.n(), self.history.p());
        check_vector("x_prior", &self.x_prior, n)?;
        if !self.outputs.len().is_multiple_of(p) {
            return Err(Error::shape(
                "outputs",
                format!("a multiple of p = {p} numbers"),
                self.outputs.len(),
            ));
        }
        let inputs = self.outputs.len() / p * self.history.m();
        if self.inputs.len() != inputs {
            return Err(Error::shape("inputs", format!("{inputs} numbers"), self.inputs.len()));
        }
        check_finite("inputs", &self.inputs, self.history.m().max(1))?;
        let expected = self.outputs.len() / p * n;
        if self.truth.len() != expected {
            return Err(Error::shape("truth", format!("{expected} numbers"), self.truth.len()));
        }
        if let Some(span) = self.spans.iter().find(|s| **s == 0 || **s > expected / n) {
            return Err(Error::value("spans", format!("1 to {} estimates", expected / n), span));
        }
        check_vector("spread", &self.spread, n)?;
        if let Some(spread) = self.spread.iter().find(|s| **s <= 0.0) {
            return Err(Error::value("spread", "positive numbers", spread));
        }
        check_finite("truth", &self.truth, n)
    }

    /// What an estimator is given.
    fn signals(&self) -> Signals<'_> {
        Signals { y: &self.outputs, u: &self.inputs }
    }

    /// Of settings that differ in weights and space only, or of one of any kind; None for those
    /// that cannot be used.
    fn scores(&self, configs: &[&Config], stopped: &AtomicBool) -> Vec<Option<Score>> {
        let linear = is_linear(configs[0]) && self.outputs.iter().all(|y| y.is_finite());
        let filters = linear.then(|| Filters::new(&self.history, configs, stopped).ok()).flatten();
        let scored = |(k, config): (usize, &&Config)| {
            if stopped.load(Ordering::Relaxed) {
                return None;
            }
            match filters.as_ref().and_then(|filters| filters.run(k, &self.x_prior, self.signals()))
            {
                Some((spectral_radius, x)) => self.compared(&x, spectral_radius),
                None => self.score(config, stopped),
            }
        };
        configs.iter().enumerate().map(scored).collect()
    }

    fn score(&self, config: &Config, stopped: &AtomicBool) -> Option<Score> {
        let mut config = config.clone();
        config.x_prior =
            (config.resolved(config.start, true) == Start::State).then(|| self.x_prior.clone());
        let mut mhe = DdMhe::new(&self.history, config).ok()?;
        let spectral_radius = mhe.spectral_radius();
        let log = mhe.run_until(self.signals(), &mut || stopped.load(Ordering::Relaxed)).ok()?;
        self.compared(&log.x, spectral_radius)
    }

    /// The score of estimates (N·n), unless it is infinite.
    fn compared(&self, x: &[f64], spectral_radius: f64) -> Option<Score> {
        let n = self.history.n();
        let squares = |span: usize| -> f64 {
            let pairs = x.iter().zip(&self.truth).zip(self.spread.iter().cycle());
            pairs.take(span * n).map(|((a, b), spread)| ((a - b) / spread).powi(2)).sum()
        };
        let errors: Vec<f64> =
            self.spans.iter().map(|&span| squares(span) / (span * n) as f64).collect();
        let finite = spectral_radius.is_finite() && errors.iter().all(|e| e.is_finite());
        finite.then_some(Score { errors, spectral_radius })
    }
}

/// Scores of (fold, setting) pairs, in their order, on all cores; `x_prior` of a setting that
/// starts from a state is the fold's.
///
/// `stop` is asked every 50 ms, with the number of pairs done; after true, what was not scored by
/// then is None.
///
/// # Errors
/// [`Error::Value`] for a fold that does not exist, and as [`Fold::check`]. A setting that a fold
/// is too short for is no error but an infinite score.
pub fn validate(
    folds: &[Fold],
    jobs: &[(usize, Config)],
    stop: &mut dyn FnMut(usize) -> bool,
) -> Result<Vec<Option<Score>>, Error> {
    folds.iter().try_for_each(Fold::check)?;
    if let Some((fold, _)) = jobs.iter().find(|(fold, _)| *fold >= folds.len()) {
        return Err(Error::value("jobs", format!("folds below {}", folds.len()), fold));
    }
    let useless = |fold: &Fold| Score {
        errors: vec![f64::INFINITY; fold.spans.len()],
        spectral_radius: f64::INFINITY,
    };
    // estimates are the same without evidence, and made sooner
    let bare = |config: &Config| Config {
        evidence: false,
        output_noise: None,
        drift: None,
        ..config.clone()
    };
    let jobs: Vec<(usize, Config)> = jobs.iter().map(|(k, config)| (*k, bare(config))).collect();
    let (groups, done) = (grouped(&jobs), AtomicUsize::new(0));
    let scores = |group: &Vec<usize>, stopped: &AtomicBool| -> Vec<Option<Score>> {
        let fold = &folds[jobs[group[0]].0];
        let configs: Vec<&Config> = group.iter().map(|&k| &jobs[k].1).collect();
        let found = fold.scores(&configs, stopped);
        done.fetch_add(group.len(), Ordering::Relaxed);
        // what was stopped has no score
        found
            .into_iter()
            .map(|s| (!stopped.load(Ordering::Relaxed)).then(|| s.unwrap_or_else(|| useless(fold))))
            .collect()
    };
    let found =
        on_all_cores(groups.iter().collect(), scores, &mut |_| stop(done.load(Ordering::Relaxed)))?;
    let mut all = vec![None; jobs.len()];
    for (group, scores) in groups.iter().zip(found) {
        group.iter().zip(scores.unwrap_or_default()).for_each(|(&k, score)| all[k] = score);
    }
    Ok(all)
}

/// Jobs that can share the decomposition of their windows, by number, in the order in which the
/// first of each comes.
fn grouped(jobs: &[(usize, Config)]) -> Vec<Vec<usize>> {
    let alike = |a: &(usize, Config), b: &(usize, Config)| {
        let shared = |config: &Config| {
            let depths = keeps_every_depth(config);
            (config.horizon, config.start, config.equilibrium.clone(), depths)
        };
        let linear = is_linear(&a.1) && is_linear(&b.1) && a.1.horizon.is_some();
        a.0 == b.0 && linear && shared(&a.1) == shared(&b.1)
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (k, job) in jobs.iter().enumerate() {
        match groups.iter_mut().find(|group| alike(&jobs[group[0]], job)) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    groups
}
