//! The error covariance that a Kalman filter settles to.

use faer::Mat;
use faer::linalg::solvers::Solve;

/// Doublings at most: each squares the number of steps that were taken.
const DOUBLINGS: usize = 60;
/// Relative change at which it has settled.
const SETTLED: f64 = 1e-14;
/// Largest relative change that is still taken for settled when no doubling helps.
const ALMOST: f64 = 1e-9;

/// P = A (P - P Cᵀ (C P Cᵀ + R)⁻¹ C P) Aᵀ + Q with R diagonal, by doubling: after k of them H is
/// the covariance after 2^k steps from 0 (Anderson 1978). None where it does not settle: a mode that
/// does not decay is seen by no output, or reached by no disturbance.
pub(crate) fn stationary(A: &Mat<f64>, C: &Mat<f64>, Q: &Mat<f64>, R: &[f64]) -> Option<Mat<f64>> {
    let n = A.nrows();
    let identity = Mat::<f64>::identity(n, n);
    let mut F = A.transpose().to_owned();
    let mut G = Mat::from_fn(n, n, |i, j| (0..R.len()).map(|k| C[(k, i)] * C[(k, j)] / R[k]).sum());
    let mut H = Q.clone();
    let mut change = f64::INFINITY;
    for _ in 0..DOUBLINGS {
        let W = (&identity + &G * &H).partial_piv_lu();
        let next = &H + F.transpose() * &H * W.solve(&F);
        let moved = (&next - &H).norm_max() / next.norm_max();
        let through = W.solve(&G * F.transpose());
        G = &G + &F * through;
        F = &F * W.solve(&F);
        H = Mat::from_fn(n, n, |i, j| 0.5 * (next[(i, j)] + next[(j, i)]));
        if !H.is_all_finite() {
            return None;
        }
        if moved <= SETTLED {
            return Some(H);
        }
        if moved >= change && moved < ALMOST {
            return Some(H);
        }
        change = moved;
    }
    None
}
