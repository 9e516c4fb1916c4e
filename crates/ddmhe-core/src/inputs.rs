//! What a user should know of the known inputs: of those that were recorded, and of those of a run.
//!
//! Nothing here is refused: an estimate with inputs that the recording hardly excited is as good as
//! the recorded kind of inputs goes on.

use crate::history::History;
use crate::response::{OwnResponse, PEAK};
use crate::scaling::{EXACT, Scaling};
use crate::tol;
use crate::variation::{Steps, centred, one_step};
use crate::watch::since;
use faer::Mat;
use faer::linalg::solvers::SolveLstsq;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Least share of an input's variance that the states must not explain.
const FREE: f64 = 1e-2;
/// Inputs that are recorded a sample late or early leave more than this times the misfit of those
/// that are not. Measured: 170 where they are, at most 1.13 on real recordings where they are not.
const SHIFTED: f64 = 3.0;
/// How far beyond its recorded range an input may go, relative to that.
const RANGE: f64 = 0.1;
/// In more than this share of the window.
const OFTEN: f64 = 0.05;

/// What the inputs of a run are compared with, in scaled deviations.
#[derive(Debug, Clone)]
pub(crate) struct InputWatch {
    still: Vec<bool>, // never moved in the recording
    range: Vec<(f64, f64)>,
}

/// Since which step each input does what it never did in the recording.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(crate) struct SeenInputs {
    moved: Vec<Option<usize>>,
    left: Vec<Option<usize>>,
}

impl InputWatch {
    pub fn new(history: &History, scaling: &Scaling) -> Self {
        let m = history.m();
        let range = |i: usize| {
            let all = (0..history.recordings()).flat_map(|r| history.inputs(r).chunks_exact(m));
            let values = all.map(|u| (u[i] - scaling.mean_u[i]) / scaling.unit_u[i]);
            let (lo, hi) = values
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
            (lo - RANGE * (hi - lo), hi + RANGE * (hi - lo))
        };
        let still = scaling.moved_u.iter().map(|moved| !moved).collect();
        InputWatch { still, range: (0..m).map(range).collect() }
    }

    /// Nothing seen yet.
    pub fn start(&self) -> SeenInputs {
        let none = vec![None; self.still.len()];
        SeenInputs { moved: none.clone(), left: none }
    }

    /// Whether saved notes may be those of a run.
    #[cfg(feature = "serde")]
    pub fn allows(&self, seen: &SeenInputs) -> bool {
        let m = self.still.len();
        seen.moved.len() == m && seen.left.len() == m
    }

    /// Takes note of the inputs of step t, the last of those in the window (scaled).
    #[inline]
    pub fn note(&self, seen: &mut SeenInputs, window: &[f64], t: usize) {
        let m = self.range.len();
        let Some(first) = window.len().checked_sub(m).filter(|_| m > 0) else { return };
        for (i, (u, &(lo, hi))) in window[first..].iter().zip(&self.range).enumerate() {
            if self.still[i] {
                if u.abs() > tol::UNMOVED {
                    seen.moved[i].get_or_insert(t);
                }
            } else if (*u < lo || *u > hi) && seen.left[i].is_none() {
                self.count(seen, window, (i, t));
            }
        }
    }

    #[cold]
    fn count(&self, seen: &mut SeenInputs, window: &[f64], (i, t): (usize, usize)) {
        let (m, (lo, hi)) = (self.range.len(), self.range[i]);
        let outside = window.iter().skip(i).step_by(m).filter(|u| **u < lo || **u > hi).count();
        if outside as f64 > OFTEN * (window.len() / m) as f64 {
            seen.left[i] = Some(t);
        }
    }

    /// What was seen, in words; `dt` in seconds.
    pub fn words(&self, seen: &SeenInputs, dt: f64) -> Vec<String> {
        let moved = seen.moved.iter().enumerate().filter_map(|(i, t)| {
            let since = since((*t)?, dt);
            Some(format!(
                "input {i} (counted from 0) moves {since}, which it never did in the recording: \
                its effect is unknown and it is ignored"
            ))
        });
        let left = seen.left.iter().enumerate().filter_map(|(i, t)| {
            let since = since((*t)?, dt);
            Some(format!(
                "input {i} (counted from 0) leaves its recorded range by more than a tenth of it \
                {since}: its effect is that of the recording, continued in proportion"
            ))
        });
        moved.chain(left).collect()
    }
}

/// What the recording cannot tell of its inputs, in words.
pub(crate) fn words(
    history: &History,
    scaling: &Scaling,
    response: Option<&OwnResponse>,
) -> Vec<String> {
    let Some(response) = response else { return Vec::new() };
    let mut words: Vec<String> = scaling
        .moved_u
        .iter()
        .enumerate()
        .filter(|(_, moved)| !**moved)
        .map(|(i, _)| {
            format!(
                "input {i} (counted from 0) never changed in the recording: its effect is unknown \
                and it is ignored"
            )
        })
        .collect();
    words.extend(apart(history, scaling));
    words.extend(shifted(history, scaling));
    if response.peak > PEAK {
        words.push(format!(
            "the response to the inputs grows to {:.0} deviations of a state within the horizon: \
            errors of the identified response grow with it; try a shorter horizon",
            response.peak
        ));
    }
    words
}

/// Whether the effects of states and inputs can be told apart.
fn apart(history: &History, scaling: &Scaling) -> Vec<String> {
    let n = history.n();
    let moved: Vec<usize> = (0..history.m()).filter(|&i| scaling.moved_u[i]).collect();
    let all = centred(Steps::new(history, 1).regressors);
    let unit = |j: usize| if j < n { scaling.unit_x[j] } else { scaling.unit_u[j - n] };
    let columns: Vec<usize> = (0..n).chain(moved.iter().map(|i| n + i)).collect();
    let M =
        Mat::from_fn(all.nrows(), columns.len(), |k, j| all[(k, columns[j])] / unit(columns[j]));
    let sigma = M.singular_values().unwrap_or_default();
    let floor = tol::RANK_EPS * M.nrows().max(M.ncols()) as f64;
    let full = M.nrows() > columns.len()
        && sigma.last().zip(sigma.first()).is_some_and(|(least, most)| *least > floor * most);
    if !full {
        return vec![
            "the effects of the inputs cannot be told apart in the recording (u follows the state, \
            or inputs move together): estimates hold for inputs of the recorded kind only"
                .to_string(),
        ];
    }
    let X = M.subcols(0, n).to_owned();
    let U = M.subcols(n, moved.len()).to_owned();
    let left = &U - &X * X.col_piv_qr().solve_lstsq(&U);
    moved
        .iter()
        .enumerate()
        .filter_map(|(j, i)| {
            let share = left.col(j).squared_norm_l2() / U.col(j).squared_norm_l2();
            (share < FREE).then(|| {
                format!(
                    "input {i} (counted from 0) is to {:.2} % a function of the states in the \
                    recording: its own effect is uncertain; record it with some dither",
                    100.0 * (1.0 - share)
                )
            })
        })
        .collect()
}

/// Whether the inputs seem to be those of the sample before or after.
fn shifted(history: &History, scaling: &Scaling) -> Option<String> {
    let fit = |one_step: &[[f64; 2]]| {
        let [f_x, f_y] = scaling.misfit(one_step);
        f_x.max(f_y)
    };
    let own = fit(&scaling.one_step);
    if own < EXACT {
        return None;
    }
    let better = |late: bool| {
        let other = fit(&one_step(&history.shifted_inputs(late)?, None));
        (SHIFTED * other < own).then_some(own / other.max(EXACT))
    };
    let (way, gain) = [("a sample later", true), ("a sample earlier", false)]
        .into_iter()
        .find_map(|(way, late)| better(late).map(|gain| (way, gain)))?;
    Some(format!(
        "the inputs fit {gain:.0} times better when each counts {way}: u(k) is what acts on x(k+1) \
        and, if at all, on y(k); check the log's time stamps"
    ))
}
