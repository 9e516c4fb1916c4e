//! Many settings tried on held-out parts of a recording, in parallel: the work behind tuning.

use crate::config::{Config, check_vector};
use crate::error::Error;
use crate::history::{History, check_finite};
use crate::mhe::DdMhe;
use crate::start::Start;
use rayon::prelude::*;

/// A part of a recording to learn from, and another to estimate.
#[derive(Debug, Clone)]
pub struct Fold {
    /// What the estimator learns from.
    pub history: History,
    /// The state before the first estimate (n), for settings that start from a state.
    pub x_prior: Vec<f64>,
    /// Outputs to estimate from, N·p, time-major; NaN where not measured. None at all: only the stability is looked at.
    pub outputs: Vec<f64>,
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
    /// Mean over states of the squares of (x̂ - x)/spread, and over the estimates of each span, infinite if the setting cannot be used on this fold.
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
            return Err(Error::shape("outputs", format!("a multiple of p = {p} numbers"), self.outputs.len()));
        }
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

    fn score(&self, config: &Config) -> Option<Score> {
        let mut config = config.clone();
        config.x_prior = (config.start == Start::State).then(|| self.x_prior.clone());
        let mut mhe = DdMhe::new(&self.history, config).ok()?;
        let spectral_radius = mhe.spectral_radius();
        let log = mhe.run(&self.outputs).ok()?;
        let n = self.history.n();
        let squares = |span: usize| -> f64 {
            let pairs = log.x.iter().zip(&self.truth).zip(self.spread.iter().cycle());
            pairs.take(span * n).map(|((a, b), spread)| ((a - b) / spread).powi(2)).sum()
        };
        let errors: Vec<f64> = self.spans.iter().map(|&span| squares(span) / (span * n) as f64).collect();
        let finite = spectral_radius.is_finite() && errors.iter().all(|e| e.is_finite());
        finite.then_some(Score { errors, spectral_radius })
    }
}

/// Scores of (fold, setting) pairs, in their order, on all cores; `x_prior` of a setting that starts from a state is the fold's.
///
/// # Errors
/// [`Error::Value`] for a fold that does not exist, and as [`Fold::check`]. A setting that a fold is too short for is no error but an
/// infinite score.
pub fn validate(folds: &[Fold], jobs: &[(usize, Config)]) -> Result<Vec<Score>, Error> {
    folds.iter().try_for_each(Fold::check)?;
    if let Some((fold, _)) = jobs.iter().find(|(fold, _)| *fold >= folds.len()) {
        return Err(Error::value("jobs", format!("folds below {}", folds.len()), fold));
    }
    let useless = |fold: &Fold| Score { errors: vec![f64::INFINITY; fold.spans.len()], spectral_radius: f64::INFINITY };
    let score = |(k, config): &(usize, Config)| folds[*k].score(config).unwrap_or_else(|| useless(&folds[*k]));
    Ok(jobs.par_iter().map(score).collect())
}
