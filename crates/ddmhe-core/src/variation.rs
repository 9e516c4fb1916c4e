//! What a recording's channels do from sample to sample: what the state before explains of them,
//! and what is noise.

use crate::history::History;
use faer::Mat;
use faer::linalg::solvers::SolveLstsq;

/// How often a known rest counts beside `recorded` windows.
pub(crate) fn copies(recorded: usize) -> usize {
    (3 * recorded / 10).max(2)
}

/// Of each channel of x(k+1) and of y(k) (n + p): the variance that an affine function of x(k)
/// leaves unexplained, corrected for its n + 1 degrees of freedom, and the variance itself. A rest
/// counts as often as in the space.
pub(crate) fn one_step(history: &History, rest: Option<(&[f64], &[f64])>) -> Vec<[f64; 2]> {
    let (n, p) = (history.n(), history.p());
    let mut regressor: Vec<&[f64]> = Vec::new(); // x(k)
    let mut target: Vec<[&[f64]; 2]> = Vec::new(); // x(k+1), y(k)
    for i in 0..history.recordings() {
        let x: Vec<&[f64]> = history.states(i).chunks_exact(n).collect();
        target.extend(x[1..].iter().zip(history.outputs(i).chunks_exact(p)).map(|(x, y)| [*x, y]));
        regressor.extend(&x[..x.len() - 1]);
    }
    let recorded = regressor.len();
    if let Some((x, y)) = rest {
        for _ in 0..copies(regressor.len()) {
            regressor.push(x);
            target.push([x, y]);
        }
    }
    let samples = regressor.len();
    if samples <= n + 1 {
        return vec![[1.0; 2]; n + p]; // no degree of freedom is left to tell noise from motion
    }
    // Centred columns: the ones column is taken care of, and large offsets cost no digits.
    let X = centred(Mat::from_fn(samples, n, |i, j| regressor[i][j]));
    let Y = centred(Mat::from_fn(samples, n + p, |i, j| {
        if j < n { target[i][0][j] } else { target[i][1][j - n] }
    }));
    let residual = &Y - &X * X.col_piv_qr().solve_lstsq(&Y);
    // The variance is that of the recording alone: it is what scales the space.
    let Y = centred(Y.submatrix(0, 0, recorded, n + p).to_owned());
    let mean_square =
        |M: &Mat<f64>, column: usize, count: usize| M.col(column).squared_norm_l2() / count as f64;
    (0..n + p)
        .map(|j| [mean_square(&residual, j, samples - n - 1), mean_square(&Y, j, recorded)])
        .collect()
}

fn centred(mut M: Mat<f64>) -> Mat<f64> {
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
