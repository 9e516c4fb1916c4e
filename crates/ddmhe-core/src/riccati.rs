//! The error covariance that a Kalman filter settles to, and that filter.

use crate::covariance::inverse_factor;
use crate::linear_model::LinearModel;

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// Doublings at most: each squares the number of steps that were taken.
const DOUBLINGS: usize = 60;
/// Relative change at which it has settled.
const SETTLED: f64 = 1e-14;
/// Largest relative change that is still taken for settled when no doubling helps.
const ALMOST: f64 = 1e-9;

/// P = A (P - P Cᵀ (C P Cᵀ + R)⁻¹ C P) Aᵀ + Q with R diagonal, by doubling: after k of them H is
/// the covariance after 2^k steps from 0 (Anderson 1978). None where it does not settle: a mode
/// that does not decay is seen by no output, or reached by no disturbance.
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

/// The stationary filter and the smoother behind it, as [`ddmhe_run::kalman`] reads them.
pub(crate) struct Filter {
    /// \[x̂(k+1); ν(k)\] of \[x̂(k); y(k); u(k)\].
    pub ahead: Mat<f64>,
    /// What is added to it.
    pub offset: Vec<f64>,
    /// \[P λ(k); Q λ(k); λ(k-1)\] of \[λ(k); ν(k-1)\].
    pub smoother: Mat<f64>,
    /// P, and its inverse.
    pub P: Mat<f64>,
    /// See [`P`](Self::P).
    pub information: Mat<f64>,
}

impl Filter {
    /// L (n × p): x̂(k+1) takes up L (y - C x̂(k) - …).
    pub fn gain(&self, p: usize) -> Mat<f64> {
        let n = self.P.nrows();
        self.ahead.submatrix(0, n, n, p).to_owned()
    }

    /// None where S cannot be factored.
    pub fn new(model: &LinearModel, (P, Q, R): (&Mat<f64>, &Mat<f64>, &[f64])) -> Option<Self> {
        let LinearModel { A, B, e, C, D, r, .. } = model;
        let (n, p, m) = (A.nrows(), C.nrows(), B.ncols());
        let mut S = C * P * C.transpose();
        (0..p).for_each(|i| S[(i, i)] += R[i]);
        let factor = S.llt(Side::Lower).ok()?;
        let L = A * factor.solve(C * P).transpose();
        // W = S^{-½}
        let mut W = Mat::<f64>::identity(p, p);
        factor.L().solve_lower_triangular_in_place(W.as_mut());
        let mut ahead = Mat::zeros(n + p, n + p + m);
        ahead.submatrix_mut(0, 0, n, n).copy_from(A - &L * C);
        ahead.submatrix_mut(0, n, n, p).copy_from(&L);
        ahead.submatrix_mut(0, n + p, n, m).copy_from(B - &L * D);
        ahead.submatrix_mut(n, 0, p, n).copy_from(-(&W * C));
        ahead.submatrix_mut(n, n, p, p).copy_from(&W);
        ahead.submatrix_mut(n, n + p, p, m).copy_from(-(&W * D));
        let through = |M: &Mat<f64>, i: usize| (0..p).map(|j| M[(i, j)] * r[j]).sum::<f64>();
        let next = (0..n).map(|i| e[i] - through(&L, i));
        let offset = next.chain((0..p).map(|i| -through(&W, i))).collect();
        let mut smoother = Mat::zeros(3 * n, n + p);
        smoother.submatrix_mut(0, 0, n, n).copy_from(P);
        smoother.submatrix_mut(n, 0, n, n).copy_from(Q);
        smoother.submatrix_mut(2 * n, 0, n, n).copy_from((A - &L * C).transpose());
        smoother.submatrix_mut(2 * n, n, n, p).copy_from(C.transpose() * W.transpose());
        let U = inverse_factor(P)?;
        let information = U.transpose() * &U;
        Some(Filter { ahead, offset, smoother, P: P.clone(), information })
    }
}
