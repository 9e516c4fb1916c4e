//! What a recording's channels do from sample to sample: what the state before explains of them,
//! and what is noise.

use crate::history::History;
use crate::tol;
use crate::watch::still_inputs;
use faer::Mat;
use faer::linalg::solvers::SolveLstsq;

/// How often a known rest counts beside `recorded` windows.
pub(crate) fn copies(recorded: usize) -> usize {
    (3 * recorded / 10).max(2)
}

/// Of each channel of x(k+1) and of y(k) (n + p): the variance that an affine function of x(k) and
/// the known inputs u(k) leaves unexplained, corrected for its n + m + 1 degrees of freedom, and
/// the variance itself. A rest counts as often as in the space.
pub(crate) fn one_step(history: &History, rest: Option<Rest<'_>>) -> Vec<[f64; 2]> {
    left_by(history, 1, rest)
}

/// The same of an affine function of the `lag` latest instants.
pub(crate) fn left_by(history: &History, lag: usize, rest: Option<Rest<'_>>) -> Vec<[f64; 2]> {
    let Steps { regressors, targets } = Steps::new(history, lag);
    let (recorded, columns) = (targets.nrows(), targets.ncols());
    let still = Steps::still_inputs(history, lag);
    let parameters = regressors.ncols() - still.len();
    let (mut X, mut Y) = (regressors, targets);
    if let Some(rest) = rest {
        let copies = copies(recorded);
        let row = Steps::at_rest(rest, lag);
        let target: Vec<f64> = rest.x.iter().chain(rest.y).copied().collect();
        let more = |M: &Mat<f64>, row: &[f64]| {
            Mat::from_fn(recorded + copies, M.ncols(), |i, j| {
                if i < recorded { M[(i, j)] } else { row[j] }
            })
        };
        (X, Y) = (more(&X, &row), more(&Y, &target));
    }
    let samples = X.nrows();
    if samples <= parameters + 1 {
        return vec![[1.0; 2]; columns]; // no degree of freedom is left to tell noise from motion
    }
    // Centred columns: the ones column is taken care of, and large offsets cost no digits.
    let (X, Y) = (centred(X), centred(Y));
    let residual = match history.m() {
        0 => &Y - &X * X.col_piv_qr().solve_lstsq(&Y),
        _ => left_of(X, &still, &Y), // inputs may move together, or not at all
    };
    // The variance is that of the recording alone: it is what scales the space.
    let Y = centred(Y.submatrix(0, 0, recorded, columns).to_owned());
    let mean_square =
        |M: &Mat<f64>, column: usize, count: usize| M.col(column).squared_norm_l2() / count as f64;
    (0..columns)
        .map(|j| {
            [mean_square(&residual, j, samples - parameters - 1), mean_square(&Y, j, recorded)]
        })
        .collect()
}

/// What least squares leave of Y, whatever the rank of X, without the columns `still`.
fn left_of(mut X: Mat<f64>, still: &[usize], Y: &Mat<f64>) -> Mat<f64> {
    for j in 0..X.ncols() {
        let length = X.col(j).norm_l2();
        let scale = if still.contains(&j) || length == 0.0 { 0.0 } else { 1.0 / length };
        X.col_mut(j).iter_mut().for_each(|v| *v *= scale);
    }
    Y - &X * least_squares(&X, Y, 0.0)
}

/// argmin ‖X Θ - Y‖² + γ N ‖Θ‖²; of least norm, with singular values at rounding left out, for γ =
/// 0.
pub(crate) fn least_squares(X: &Mat<f64>, Y: &Mat<f64>, ridge: f64) -> Mat<f64> {
    let Ok(svd) = X.thin_svd() else {
        // The iteration has no known failure on finite data; no response is what is left.
        return Mat::zeros(X.ncols(), Y.ncols());
    };
    let sigma: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let size = X.nrows().max(X.ncols()) as f64;
    let floor = tol::RANK_EPS * size * sigma.first().copied().unwrap_or(0.0);
    let penalty = ridge * X.nrows() as f64;
    let inverse = |s: f64| match ridge > 0.0 {
        true => s / (s * s + penalty),
        false if s > floor => 1.0 / s,
        false => 0.0,
    };
    let along = svd.U().transpose() * Y;
    let shrunk =
        Mat::from_fn(along.nrows(), along.ncols(), |i, j| inverse(sigma[i]) * along[(i, j)]);
    svd.V() * shrunk
}

/// A known rest, in the user's units.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rest<'a> {
    pub x: &'a [f64],
    pub y: &'a [f64],
    pub u: &'a [f64],
}

/// One row a step of the recording, none across a seam: [x(k+1); y(k)] and what comes before it,
/// \[x(k); u(k); x(k-1); y(k-1); u(k-1); …\] of `lag` instants, in the user's units.
pub(crate) struct Steps {
    pub regressors: Mat<f64>,
    pub targets: Mat<f64>,
}

impl Steps {
    pub fn new(history: &History, lag: usize) -> Self {
        let (n, p, m) = (history.n(), history.p(), history.m());
        let steps: Vec<(usize, usize)> = (0..history.recordings())
            .flat_map(|i| (lag - 1..history.outputs(i).len() / p).map(move |k| (i, k)))
            .collect();
        let sample = |i: usize, k: usize| {
            (
                &history.states(i)[k * n..(k + 1) * n],
                &history.outputs(i)[k * p..(k + 1) * p],
                &history.inputs(i)[k * m..(k + 1) * m],
            )
        };
        let mut regressors = Mat::zeros(steps.len(), lag * (n + p + m) - p);
        let mut targets = Mat::zeros(steps.len(), n + p);
        for (row, &(i, k)) in steps.iter().enumerate() {
            let (x, y, u) = sample(i, k);
            let mut entries: Vec<f64> = x.iter().chain(u).copied().collect();
            for before in (k + 1 - lag..k).rev() {
                let (x, y, u) = sample(i, before);
                entries.extend(x.iter().chain(y).chain(u));
            }
            entries.iter().enumerate().for_each(|(j, v)| regressors[(row, j)] = *v);
            let next = history.states(i)[(k + 1) * n..(k + 2) * n].iter().chain(y);
            next.enumerate().for_each(|(j, v)| targets[(row, j)] = *v);
        }
        Steps { regressors, targets }
    }

    /// Columns of inputs that never moved: all they hold is rounding.
    fn still_inputs(history: &History, lag: usize) -> Vec<usize> {
        let (n, p, m) = (history.n(), history.p(), history.m());
        let still: Vec<usize> = still_inputs(history).collect();
        let first = |j: usize| if j == 0 { n } else { n + m + (j - 1) * (n + p + m) + n + p };
        (0..lag).flat_map(|j| still.iter().map(move |i| first(j) + i)).collect()
    }

    fn at_rest(Rest { x, y, u }: Rest<'_>, lag: usize) -> Vec<f64> {
        let now = x.iter().chain(u);
        let before = (1..lag).flat_map(|_| x.iter().chain(y).chain(u));
        now.chain(before).copied().collect()
    }
}

pub(crate) fn centred(mut M: Mat<f64>) -> Mat<f64> {
    for j in 0..M.ncols() {
        let mean = M.col(j).iter().sum::<f64>() / M.nrows() as f64;
        M.col_mut(j).iter_mut().for_each(|v| *v -= mean);
    }
    M
}

/// Standard deviations of the white noise on each channel of x (n) and of y (p), in their units,
/// from fifth differences; 0 where no recording has more than five samples.
pub fn noise_levels(history: &History) -> (Vec<f64>, Vec<f64>) {
    let level = |signal: fn(&History, usize) -> &[f64], width: usize| {
        (0..width).map(|i| fifth_differences(history, signal, (i, width)).sqrt()).collect()
    };
    (level(History::states, history.n()), level(History::outputs, history.p()))
}

/// Variance of the noise on one channel of a signal, (its number, how many there are): Δ⁵ of white
/// noise of variance σ² has variance (1 + 25 + 100 + 100 + 25 + 1) σ² = 252 σ², and Δ⁵ of a smooth
/// signal is next to nothing. 0 where no recording is long enough.
pub(crate) fn fifth_differences(
    history: &History,
    signal: fn(&History, usize) -> &[f64],
    channel: (usize, usize),
) -> f64 {
    const DELTA: [f64; 6] = [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0];
    let (i, width) = channel;
    let (mut squares, mut count) = (0.0, 0.0_f64);
    for r in 0..history.recordings() {
        let s = signal(history, r);
        for k in (i..s.len().saturating_sub(5 * width)).step_by(width) {
            squares +=
                DELTA.iter().enumerate().map(|(j, c)| c * s[k + j * width]).sum::<f64>().powi(2);
            count += 1.0;
        }
    }
    squares / count.max(1.0) / 252.0
}
