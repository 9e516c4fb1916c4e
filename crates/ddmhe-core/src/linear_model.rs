//! The affine model that least squares find in a recording, in scaled deviations:
//!
//! > x(k+1) = A x(k) + B u(k) + e + ε(k),  y(k) = C x(k) + D u(k) + r + s(k)
//!
//! It says how a disturbance moves a window, and what the residuals ε and s are like. Estimates do
//! not depend on it where neither is asked for.

use crate::history::History;
use crate::scaling::Scaling;
use crate::variation::{Steps, centred, least_squares};
use faer::Mat;

/// The model and what it leaves.
#[derive(Debug, Clone)]
pub(crate) struct LinearModel {
    pub A: Mat<f64>, // n × n
    pub B: Mat<f64>, // n × m, of inputs as scaled deviations
    pub e: Vec<f64>,
    pub C: Mat<f64>, // p × n
    pub D: Mat<f64>,
    pub r: Vec<f64>,
    /// [ε s], a row for each step of the recording (N × (n+p)).
    pub residuals: Mat<f64>,
    /// N less the unknowns of a row, at least 1.
    pub freedom: usize,
}

impl LinearModel {
    /// Of a recording. Inputs that never moved have no effect.
    pub fn new(history: &History, scaling: &Scaling) -> Self {
        let (n, p, m) = (history.n(), history.p(), history.m());
        let Steps { mut regressors, mut targets } = Steps::new(history, 1);
        let scaled = |M: &mut Mat<f64>, j: usize, mean: f64, s: f64| {
            M.col_mut(j).iter_mut().for_each(|v| *v = (*v - mean) / s);
        };
        for i in 0..n {
            scaled(&mut regressors, i, scaling.mean_x[i], scaling.s_x[i]);
            scaled(&mut targets, i, scaling.mean_x[i], scaling.s_x[i]);
        }
        for i in 0..p {
            scaled(&mut targets, n + i, scaling.mean_y[i], scaling.s_y[i]);
        }
        for i in 0..m {
            scaled(&mut regressors, n + i, scaling.mean_u[i], scaling.unit_u[i]);
        }
        let (before, after) = (means(&regressors), means(&targets));
        let (mut X, Y) = (centred(regressors), centred(targets));
        // columns of one length: what is small beside the others is no rounding of theirs
        let still: Vec<bool> = (0..n + m).map(|j| j >= n && !scaling.moved_u[j - n]).collect();
        let lengths: Vec<f64> = (0..n + m).map(|j| X.col(j).norm_l2()).collect();
        let kept = |j: usize| if still[j] || lengths[j] == 0.0 { 0.0 } else { 1.0 / lengths[j] };
        for j in 0..n + m {
            let scale = kept(j);
            X.col_mut(j).iter_mut().for_each(|v| *v *= scale);
        }
        let theta = least_squares(&X, &Y, 0.0);
        let residuals = &Y - &X * &theta;
        let entry = |row: usize, j: usize| theta[(j, row)] * kept(j);
        let offset =
            |row: usize| after[row] - (0..n + m).map(|j| entry(row, j) * before[j]).sum::<f64>();
        let unknowns = n + 1 + still[n..].iter().filter(|still| !**still).count();
        LinearModel {
            A: Mat::from_fn(n, n, entry),
            B: Mat::from_fn(n, m, |i, j| entry(i, n + j)),
            e: (0..n).map(offset).collect(),
            C: Mat::from_fn(p, n, |i, j| entry(n + i, j)),
            D: Mat::from_fn(p, m, |i, j| entry(n + i, n + j)),
            r: (n..n + p).map(offset).collect(),
            freedom: residuals.nrows().saturating_sub(unknowns).max(1),
            residuals,
        }
    }

    /// Γ, covariance of ε (n × n).
    pub fn of_states(&self) -> Mat<f64> {
        self.covariance(0, self.e.len())
    }

    /// Γ_s, covariance of s (p × p).
    pub fn of_outputs(&self) -> Mat<f64> {
        self.covariance(self.e.len(), self.r.len())
    }

    fn covariance(&self, first: usize, width: usize) -> Mat<f64> {
        let E = self.residuals.subcols(first, width);
        let mut S = E.transpose() * E;
        S *= faer::Scale(1.0 / self.freedom as f64);
        S
    }
}

fn means(M: &Mat<f64>) -> Vec<f64> {
    let rows = M.nrows() as f64;
    (0..M.ncols()).map(|j| M.col(j).iter().sum::<f64>() / rows).collect()
}
