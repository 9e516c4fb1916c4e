//! When the weights of the recording are the default.
//!
//! They are right where the recorded x is the whole state of a linear system that noise drives, and
//! worse than the default rule elsewhere. So each of these must hold, and [`Settings::why`] says
//! which did not:
//!
//! - the recording is noisy, and long enough to tell noise from motion;
//! - ε and s are white: lag-1 autocorrelation of each column at most [`LAG`] (about -½ from reading
//!   noise, .7 and more where x is part of a state);
//! - no output that moves is an exact function of the recorded states: its noise would be theirs,
//!   or not in the recording;
//! - the states' own noise is a small share of what they do, [`SHARE`] in every direction: least
//!   squares on noisy states shrink a mode by that share at every sample;
//! - no product of two states explains a residual: an F test, [`CURVED`];
//! - what drives the states is not the outputs' noise: their largest canonical correlation is at
//!   most [`COMMON`] (an input that is not known, or a state that is not recorded, makes them one
//!   signal);
//! - the filter's innovations in the recording are as large as it says, within [`NIS`].
//!
//! The fourth and the fifth are what keeps tumbling bodies out: within their own recording the
//! affine fit absorbs the curvature, and the innovations do not show it. Chosen on masses,
//! oscillators, pendulums, noise-driven systems and tumbling bodies; judged on other seeds and
//! bodies: docs/disturbance-study.md.
//!
//! [`Settings::why`]: crate::Settings::why

use crate::config::{Center, Config, ProcessNoise, Weighting};
use crate::defaults::Defaults;
use crate::driving::Driving;
use crate::history::History;
use crate::linear_model::LinearModel;
use crate::recorded_noise::{RecordedNoise, SHARE};
use crate::riccati::Filter;
use crate::scaling::{EXACT, Scaling};
use crate::variation::{Steps, centred, least_squares};
use faer::Mat;

/// Largest lag-1 autocorrelation of a residual that counts as white.
const LAG: f64 = 0.3;
/// Largest score of the F test, in deviations of a normal variable (Wilson and Hilferty 1931).
const CURVED: f64 = 5.0;
/// Largest correlation of what drives the states with the noise of the outputs. Recordings of whole
/// states and known inputs have .72 at most (60 samples), others .9 to 1.
const COMMON: f64 = 0.8;
/// Smallest and largest mean square of the whitened innovations in the recording.
const NIS: (f64, f64) = (0.5, 1.5);

/// Whether the configuration leaves the choice open.
pub(crate) fn leaves_open(config: &Config) -> bool {
    config.weights == Weighting::Auto
        && config.process_noise == ProcessNoise::Auto
        && config.weighting() == Weighting::Scaled
        && config.x_center == Center::Absolute
        && config.equilibrium.is_none()
}

/// The disturbance with which the weights of the recording are the default, or why they are not.
pub(crate) fn recorded(
    history: &History,
    scaling: &Scaling,
    rule: &Defaults,
) -> Result<Driving, String> {
    if !rule.noisy {
        return Err("the recording shows no noise".into());
    }
    if scaling.misfit(&scaling.one_step)[0] < EXACT {
        return Err("the recorded states show no disturbance".into());
    }
    let unknowns = history.n() + history.m();
    if let Some(needed) = rule.needed(unknowns, None).filter(|needed| history.T() < *needed) {
        return Err(format!("{needed} outputs would tell noise from motion, not {}", history.T()));
    }
    let model = LinearModel::new(history, scaling);
    let told = telling(scaling, &model.residuals);
    let exact = |i: &usize| scaling.moved[1][*i] && !told.contains(&(history.n() + i));
    if let Some(i) = (0..history.p()).find(exact) {
        return Err(format!(
            "y{} is an exact function of the recorded states: its noise is theirs, or is unknown",
            i + 1
        ));
    }
    let lag = lag_one(history, &model.residuals, &told);
    if lag > LAG {
        return Err(format!(
            "what an affine step leaves is not white (lag-1 autocorrelation {lag:.2}, limit {LAG}\
            ): x is not the whole state, or its motion is curved"
        ));
    }
    let score = curvature(history, scaling, (&model.residuals, &told));
    if score > CURVED {
        return Err(format!(
            "products of states explain part of what an affine step leaves ({score:.1} deviations, \
            limit {CURVED}): the motion is curved"
        ));
    }
    let noise = RecordedNoise::new(history, scaling, &model);
    let share = noise.share_of_states(history, scaling);
    if share > SHARE {
        return Err(format!(
            "reading noise is {share:.2} of what the recorded states do in some direction (limit \
            {SHARE}): a model fitted to them would decay too fast"
        ));
    }
    let common = noise.shared_with_outputs(&model);
    if common > COMMON {
        return Err(format!(
            "what drives the states is nearly the outputs' noise (correlation {common:.2}, limit \
            {COMMON}): an input is not known, or x is not the whole state"
        ));
    }
    let driving = Driving::of_recording(scaling, model, (noise.Q, noise.R))
        .map_err(|error| error.to_string())?
        .with_readings(noise.N);
    let outputs: Vec<usize> =
        told.iter().filter_map(|channel| channel.checked_sub(history.n())).collect();
    let nis =
        driving.filter().map_or(f64::NAN, |filter| replayed(history, scaling, (&filter, &outputs)));
    if !(NIS.0..=NIS.1).contains(&nis) {
        return Err(format!(
            "the filter's innovations in the recording have {nis:.2} of the variance that it \
            states (limits {} and {})",
            NIS.0, NIS.1
        ));
    }
    Ok(driving)
}

/// Columns of more than rounding: a channel that never moved, or is an exact function of the state,
/// says nothing of noise.
fn telling(scaling: &Scaling, residuals: &Mat<f64>) -> Vec<usize> {
    let units = scaling.unit_x.iter().chain(&scaling.unit_y);
    let spreads: Vec<f64> =
        units.zip(scaling.s_x.iter().chain(&scaling.s_y)).map(|(unit, s)| unit / s).collect();
    let rows = residuals.nrows() as f64;
    let noise = |j: &usize| residuals.col(*j).squared_norm_l2() / rows;
    (0..residuals.ncols()).filter(|j| noise(j) > EXACT * spreads[*j].powi(2)).collect()
}

/// Whether what an affine step leaves of the recording is white, and whether products of states
/// explain nothing of it.
pub(crate) fn shape(history: &History, scaling: &Scaling) -> (bool, bool) {
    let model = LinearModel::new(history, scaling);
    let told = telling(scaling, &model.residuals);
    let white = lag_one(history, &model.residuals, &told) <= LAG;
    (white, curvature(history, scaling, (&model.residuals, &told)) <= CURVED)
}

/// The largest lag-1 autocorrelation of the columns, none across a seam.
fn lag_one(history: &History, residuals: &Mat<f64>, told: &[usize]) -> f64 {
    let mut first = 0;
    let mut sums = vec![[0.0; 2]; residuals.ncols()];
    for i in 0..history.recordings() {
        let steps = history.outputs(i).len() / history.p();
        for (j, [product, square]) in sums.iter_mut().enumerate() {
            for k in first..first + steps {
                *square += residuals[(k, j)].powi(2);
                if k + 1 < first + steps {
                    *product += residuals[(k, j)] * residuals[(k + 1, j)];
                }
            }
        }
        first += steps;
    }
    let lag = |[product, square]: &[f64; 2]| if *square > 0.0 { product / square } else { 0.0 };
    told.iter().map(|j| lag(&sums[*j])).fold(f64::NEG_INFINITY, f64::max)
}

/// The score of the F test that products of the regressors explain nothing of a residual, the
/// largest of all columns; -∞ where samples are too few to tell.
fn curvature(
    history: &History,
    scaling: &Scaling,
    (residuals, told): (&Mat<f64>, &[usize]),
) -> f64 {
    let (n, m) = (history.n(), history.m());
    let mut X = centred(Steps::new(history, 1).regressors);
    let units: Vec<f64> = scaling.unit_x.iter().chain(&scaling.unit_u).copied().collect();
    let moved = |j: &usize| *j < n || scaling.moved_u[j - n];
    let columns: Vec<usize> = (0..n + m).filter(moved).collect();
    for (j, unit) in units.iter().enumerate() {
        X.col_mut(j).iter_mut().for_each(|v| *v /= unit);
    }
    let linear = Mat::from_fn(X.nrows(), columns.len(), |k, j| X[(k, columns[j])]);
    let pairs: Vec<(usize, usize)> =
        (0..columns.len()).flat_map(|i| (0..=i).map(move |j| (i, j))).collect();
    let products = centred(Mat::from_fn(X.nrows(), pairs.len(), |k, l| {
        linear[(k, pairs[l].0)] * linear[(k, pairs[l].1)]
    }));
    let products = &products - &linear * least_squares(&linear, &products, 0.0);
    let freedom = X.nrows() as f64 - (columns.len() + 1 + pairs.len()) as f64;
    if freedom < 1.0 {
        return f64::NEG_INFINITY;
    }
    let explained = &products * least_squares(&products, residuals, 0.0);
    let (q, d) = (pairs.len() as f64, freedom);
    let score = |j: usize| {
        let all = residuals.col(j).squared_norm_l2();
        let by_products = explained.col(j).squared_norm_l2();
        if all == 0.0 {
            return f64::NEG_INFINITY;
        }
        let F = (by_products / q) / ((all - by_products).max(f64::EPSILON * all) / d);
        let (a, b, root) = (2.0 / (9.0 * q), 2.0 / (9.0 * d), F.cbrt());
        ((1.0 - b) * root - (1.0 - a)) / (b * root * root + a).sqrt()
    };
    told.iter().map(|j| score(*j)).fold(f64::NEG_INFINITY, f64::max)
}

/// Mean square of the innovations that the filter has in its own recording, from each first
/// recorded state on; of these outputs: others are at rest.
fn replayed(history: &History, scaling: &Scaling, (filter, outputs): (&Filter, &[usize])) -> f64 {
    let (n, p, m) = (history.n(), history.p(), history.m());
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for i in 0..history.recordings() {
        let mut x: Vec<f64> = scaling.deviations(&history.states(i)[..n], &[]).collect();
        for (k, y) in history.outputs(i).chunks_exact(p).enumerate() {
            let u = &history.inputs(i)[k * m..(k + 1) * m];
            let known: Vec<f64> = x
                .iter()
                .copied()
                .chain(scaling.deviations(&[], y))
                .chain(scaling.input_deviations(u))
                .collect();
            let row = |i: usize| {
                filter.offset[i]
                    + known.iter().enumerate().map(|(j, v)| filter.ahead[(i, j)] * v).sum::<f64>()
            };
            sum += outputs.iter().map(|i| row(n + i).powi(2)).sum::<f64>();
            count += outputs.len() as f64;
            x = (0..n).map(row).collect();
        }
    }
    sum / count.max(1.0)
}
