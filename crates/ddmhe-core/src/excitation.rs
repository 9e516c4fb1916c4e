//! Whether a recording excites the system: the rank condition (7) and the length that Lemma 1 asks
//! for.

use crate::error::Error;
use crate::history::History;
use crate::tol;
use crate::watch::still_states;
use faer::Mat;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// The outcome of the rank condition (7).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct RankReport {
    /// Numerical rank of [H_1(x[0..T-L]); 1ᵀ]: singular values above `tolerance`.
    pub rank: usize,
    /// n + 1.
    pub required: usize,
    /// Singular values, largest first, of the matrix with each state channel divided by its largest
    /// magnitude, so that units do not decide the rank.
    pub singular_values: Vec<f64>,
    /// Threshold below which a singular value is rounding.
    pub tolerance: f64,
    /// σ_{n+1} / σ_1: the relative perturbation of the recording that would break the condition
    /// (0 when there are fewer than n + 1 windows).
    pub margin: f64,
}

impl RankReport {
    pub(crate) fn new(history: &History, depth: usize) -> Self {
        let n = history.n();
        let starts: Vec<&[f64]> = history
            .hankel(depth)
            .flat_map(|(H_x, _)| H_x.columns().map(move |x| &x[..n]))
            .collect();
        let largest = |i: usize| starts.iter().fold(0.0_f64, |m, x| m.max(x[i].abs()));
        let scale: Vec<f64> = (0..n).map(largest).map(|s| if s > 0.0 { s } else { 1.0 }).collect();
        // (n+1) × N
        let M =
            Mat::from_fn(
                n + 1,
                starts.len(),
                |i, k| if i < n { starts[k][i] / scale[i] } else { 1.0 },
            );
        // The singular value iteration cannot fail on finite data; an empty list would read as rank
        // 0.
        let singular_values = M.singular_values().unwrap_or_default();
        let sigma_1 = singular_values.first().copied().unwrap_or(0.0);
        let tolerance = tol::RANK_EPS * starts.len().max(n + 1) as f64 * sigma_1;
        let rank = singular_values.iter().filter(|&&s| s > tolerance).count();
        let margin = singular_values.get(n).map_or(0.0, |s| s / sigma_1);
        RankReport { rank, required: n + 1, singular_values, tolerance, margin }
    }

    /// Whether the condition holds.
    pub fn satisfied(&self) -> bool {
        self.rank == self.required
    }
}

/// Length and rank condition of Lemma 1: T ≥ M + n and (7).
pub(crate) fn check_excitation(history: &History, horizon: usize) -> Result<(), Error> {
    let n = history.n();
    if history.windows(horizon) < n + 1 {
        let longest = (1..=history.T()).rev().find(|&m| history.windows(m) > n);
        return Err(match longest {
            Some(m) => Error::value(
                "horizon",
                format!(
                    "1 to {m}: a recording of T = {} outputs and n = {n} states has n + 1 \
                    windows of that length",
                    history.T()
                ),
                horizon,
            ),
            None => {
                Error::rank("history", format!("at least n + 1 = {} outputs", n + 1), history.T())
            }
        });
    }
    let report = history.rank(horizon)?;
    if !report.satisfied() {
        let still: Vec<String> = still_states(history).map(|i| i.to_string()).collect();
        let which = match still.is_empty() {
            true => "some combination of the states never changes".to_string(),
            false => format!("state {} (counted from 0) never changes", still.join(", ")),
        };
        return Err(Error::rank(
            "history",
            format!("states that span rank n + 1 = {} with the ones row (7)", report.required),
            format!("rank {}: {which}; record a richer motion or drop a state", report.rank),
        ));
    }
    Ok(())
}

impl History {
    /// The rank condition (7) for windows of `depth` outputs:
    /// rank [H_1(x[0..T-depth]); 1ᵀ] = n + 1.
    ///
    /// # Errors
    /// [`Error::Value`] when `depth` is 0 or no recording is that long.
    pub fn rank(&self, depth: usize) -> Result<RankReport, Error> {
        if depth == 0 || self.windows(depth) == 0 {
            let lengths = (0..self.recordings()).map(|i| self.outputs(i).len() / self.p());
            let longest = lengths.max().unwrap_or(0);
            return Err(Error::value(
                "depth",
                format!("1 to {longest}, the longest recording's T"),
                depth,
            ));
        }
        Ok(RankReport::new(self, depth))
    }
}
