//! Whether the recording itself shows other settings to be clearly better than the default rule's.
//!
//! *Ridge form.* Over the N windows of a depth M the estimator is a ridge regression of x(M) on z =
//! [x(0); y], centred: x̂ = S_xz (S_zz + R)⁻¹ z with R = λ s_x²/(2ρ^M) on the prior and λ s_y²
//! ρ^-(age-1)/μ on an output. Scales, μ and λ are nothing but R.
//!
//! *Held-out error.* Windows are cut into contiguous blocks, each estimated from the others but for
//! those that overlap it most. With the outputs projected out, C is the moment of [x(0); x(M)] that
//! is left in the others and Ξ that of the block's residuals; a prior of covariance P is used with
//! K = (C_00 + R_x)⁻¹ C_0M and leaves Ξ_MM - Ξ_M0 K - KᵀΞ_0M + KᵀΞ_00 K + KᵀP K. Iterated to a
//! fixed point this is the error of an estimator whose prior carries its own error. J is the
//! geometric mean over states of its root, in units of the states' deviations.
//!
//! *Challengers.* A short and a long window with the outputs weighted by their own noise and R_x =
//! P of that fixed point. One is taken only where its J is smaller than the rule's by [`MARGIN`]:
//! held-out blocks lie inside the recording, and differences there that are small say nothing of
//! what comes after it.

use crate::defaults::Defaults;
use crate::history::History;
use crate::response::OwnResponse;
use crate::scaling::Scaling;
use crate::space::free_window;
use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef, Side};

/// Contiguous blocks of windows that are held out in turn. With three the long windows lose so many
/// that short ones win on pendulums, wrongly.
const BLOCKS: usize = 6;
/// Windows left out on each side of a block.
const GAP: usize = 3;
/// What log J has to be smaller by at T samples: MARGIN.0, a quarter of the error, or MARGIN.1 / T
/// where that is less. A long recording shows smaller differences: at T = 800 those of 6 % were
/// real in every case tried, at T = 150 some of 25 % were not.
const MARGIN: (f64, f64) = (0.3, 45.0);
/// Iterations towards the stationary error.
const ITERATIONS: usize = 12;
/// Smallest variance of the prior relative to the state's own.
const LEAST: f64 = 1e-10;

/// What one block leaves (2n × 2n): C and Ξ, and the block's share of all windows.
struct Block {
    C: Mat<f64>,
    Xi: Mat<f64>,
    share: f64,
}

/// The scales and the rule that are clearly better than an incumbent with weight `lambda`; None
/// where there are none.
pub(crate) fn challenge(
    history: &History,
    (scaling, response): (&Scaling, Option<&OwnResponse>),
    rule: &Defaults,
    lambda: f64,
) -> Option<(Scaling, Defaults)> {
    let (short, long) = rule.challengers?;
    let (n, p) = (history.n(), history.p());
    let spread: Vec<f64> =
        scaling.unit_x.iter().zip(&scaling.s_x).map(|(unit, s)| unit / s).collect();
    let held =
        blocks(history, (scaling, response), rule, rule.horizon, &vec![lambda / rule.mu; p])?;
    let prior = vec![lambda / (2.0 * rule.rho.powi(rule.horizon as i32)); n];
    let incumbent = size(&stationary(&held, &spread, Some(&prior)), &spread);

    let noise: Vec<f64> =
        scaling.noise_y.iter().zip(&scaling.s_y).map(|(noise, s)| noise / (s * s)).collect();
    let margin = MARGIN.0.min(MARGIN.1 / history.T() as f64);
    let mut best: Option<(f64, usize, Mat<f64>)> = None;
    for depth in if short == long { vec![short] } else { vec![short, long] } {
        let Some(held) = blocks(history, (scaling, response), rule, depth, &noise) else {
            continue;
        };
        let P = stationary(&held, &spread, None);
        let J = size(&P, &spread);
        if J < best.as_ref().map_or(incumbent, |(J, ..)| *J) - margin {
            best = Some((J, depth, P));
        }
    }
    let (_, horizon, P) = best?;
    let mut scales = scaling.clone();
    for i in (0..n).filter(|&i| scaling.moved[0][i]) {
        scales.s_x[i] *= P[(i, i)].max(LEAST * spread[i].powi(2)).sqrt();
    }
    for i in (0..p).filter(|&i| scaling.moved[1][i]) {
        scales.s_y[i] = scaling.noise_y[i].sqrt();
    }
    // R_x = s_x² and R_y = s_y² ρ^-(age-1) with λ = μ = 2ρ^M
    let mu = 2.0 * rule.rho.powi(horizon as i32);
    Some((
        scales,
        Defaults { horizon, mu, ratio: 1.0, challengers: None, challenged: true, ..*rule },
    ))
}

/// Mean log of the error in units of the spread.
fn size(P: &Mat<f64>, spread: &[f64]) -> f64 {
    let share = |(i, spread): (usize, &f64)| (P[(i, i)] / spread.powi(2)).clamp(1e-16, 1e16).ln();
    0.5 * spread.iter().enumerate().map(share).sum::<f64>() / spread.len() as f64
}

/// Windows of `depth` as rows: outputs over the roots of their ridge (`noise` of the newest, a
/// channel), and [x(0) x(M)].
fn windows(
    history: &History,
    (scaling, response): (&Scaling, Option<&OwnResponse>),
    rho: f64,
    depth: usize,
    noise: &[f64],
) -> (Mat<f64>, Mat<f64>) {
    let (n, p, N) = (history.n(), history.p(), history.windows(depth));
    let (mut U, mut A) = (Mat::zeros(N, depth * p), Mat::zeros(N, 2 * n));
    let mut row = 0;
    for r in 0..history.recordings() {
        let (x, y) = (history.states(r), history.outputs(r));
        for k in 0..(y.len() / p + 1).saturating_sub(depth) {
            let u = history.window_inputs(r, k, depth);
            let window = (&x[k * n..(k + depth + 1) * n], &y[k * p..(k + depth) * p], u);
            let free = free_window(scaling, response, window);
            for (j, sample) in free[..depth * (n + p)].chunks_exact(n + p).enumerate() {
                let fading = rho.powi((depth - 1 - j) as i32).sqrt();
                for (i, v) in sample[n..].iter().enumerate() {
                    U[(row, j * p + i)] =
                        if noise[i] > 0.0 { v * fading / noise[i].sqrt() } else { 0.0 };
                }
            }
            for (half, at) in [0, depth].into_iter().enumerate() {
                let state = &free[at * (n + p)..at * (n + p) + n];
                state.iter().enumerate().for_each(|(i, v)| A[(row, half * n + i)] = *v);
            }
            row += 1;
        }
    }
    (U, A)
}

/// What each block leaves; None where there are too few windows, or nothing finite comes out.
fn blocks(
    history: &History,
    (scaling, response): (&Scaling, Option<&OwnResponse>),
    rule: &Defaults,
    depth: usize,
    noise: &[f64],
) -> Option<Vec<Block>> {
    let (U, A) = windows(history, (scaling, response), rule.rho, depth, noise);
    let N = U.nrows();
    if N < 2 * BLOCKS {
        return None;
    }
    let gap = GAP.min(N / (2 * BLOCKS));
    let bound = |b: usize| (b * N).div_ceil(BLOCKS);
    (0..BLOCKS)
        .map(|b| {
            let (first, end) = (bound(b), bound(b + 1));
            let learnt: Vec<usize> =
                (0..first.saturating_sub(gap)).chain((end + gap).min(N)..N).collect();
            left(U.as_ref(), A.as_ref(), &learnt, first..end)
        })
        .collect()
}

fn left(
    U: MatRef<'_, f64>,
    A: MatRef<'_, f64>,
    learnt: &[usize],
    held: std::ops::Range<usize>,
) -> Option<Block> {
    let k = learnt.len() as f64;
    let mean = |M: MatRef<'_, f64>| -> Vec<f64> {
        (0..M.ncols()).map(|j| learnt.iter().map(|&i| M[(i, j)]).sum::<f64>() / k).collect()
    };
    let (mean_u, mean_a) = (mean(U), mean(A));
    let centred = |M: MatRef<'_, f64>, mean: &[f64], rows: &[usize]| {
        Mat::from_fn(rows.len(), M.ncols(), |i, j| M[(rows[i], j)] - mean[j])
    };
    let (U_l, A_l) = (centred(U, &mean_u, learnt), centred(A, &mean_a, learnt));
    let rows: Vec<usize> = held.collect();
    let (U_h, A_h) = (centred(U, &mean_u, &rows), centred(A, &mean_a, &rows));
    let shifted =
        |G: Mat<f64>| Mat::from_fn(G.nrows(), G.ncols(), |i, j| G[(i, j)] / k + f64::from(i == j));
    // W = (UᵀU/k + I)⁻¹ UᵀA/k, by the smaller of the two Gram matrices
    let W = if learnt.len() < U.ncols() {
        U_l.transpose() * shifted(&U_l * U_l.transpose()).llt(Side::Lower).ok()?.solve(&A_l)
    } else {
        shifted(U_l.transpose() * &U_l).llt(Side::Lower).ok()?.solve(U_l.transpose() * &A_l)
    } * faer::Scale(1.0 / k);
    let C = (A_l.transpose() * &A_l - (A_l.transpose() * &U_l) * &W) * faer::Scale(1.0 / k);
    let residual = A_h - U_h * W;
    let Xi = residual.transpose() * &residual * faer::Scale(1.0 / rows.len() as f64);
    Some(Block { C, Xi, share: rows.len() as f64 / U.nrows() as f64 })
}

/// The stationary error (n × n); `fixed`: R_x of the prior's weight (n), or that of the error
/// itself.
fn stationary(blocks: &[Block], spread: &[f64], fixed: Option<&[f64]>) -> Mat<f64> {
    let n = spread.len();
    let mut P = Mat::from_fn(n, n, |i, j| if i == j { spread[i].powi(2) } else { 0.0 });
    for _ in 0..ITERATIONS {
        let mut next = Mat::zeros(n, n);
        for Block { C, Xi, share } in blocks {
            let ridge = |i: usize, j: usize| match fixed {
                Some(R) if i == j => R[i],
                Some(_) => 0.0,
                None if i == j => P[(i, j)] + 1e-14 * spread[i].powi(2),
                None => P[(i, j)],
            };
            let G = Mat::from_fn(n, n, |i, j| C[(i, j)] + ridge(i, j));
            let K = G.partial_piv_lu().solve(C.submatrix(0, n, n, n));
            let (Xi_00, Xi_0M, Xi_MM) =
                (Xi.submatrix(0, 0, n, n), Xi.submatrix(0, n, n, n), Xi.submatrix(n, n, n, n));
            let cross = K.transpose() * Xi_0M;
            let error = Xi_MM - &cross - cross.transpose() + K.transpose() * (Xi_00 + &P) * &K;
            next += error * faer::Scale(*share);
        }
        P = Mat::from_fn(n, n, |i, j| (0.5 * (next[(i, j)] + next[(j, i)])).clamp(-1e30, 1e30));
    }
    P
}
