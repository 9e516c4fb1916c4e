//! Process disturbance (Remark 1): how ŵ(k) between x(k) and x(k+1) moves a window, and what it
//! costs.
//!
//! With the model x(k+1) = A x(k) + … + w(k), y = C x + … of a recording and L Lᵀ = Q the
//! covariance of w, a window is w = c + B a + G d with
//!
//! > G\[x(k), j\] = A^{k-1-j} L,  G\[y(k), j\] = C A^{k-1-j} L  for j < k, else 0,
//!
//! and the cost grows by c‖d‖², that is c Σ‖ŵ(k)‖²_{Q⁻¹}. A fitted disturbance of its own deviation
//! costs as much as a fitted noise of its own: c = μ σ_v² in the weights of (17), 1 in those of the
//! recording.
//!
//! *Blocks.* Where d is constant over b instants it has the covariance Q/b, so that the sum over a
//! block has that of b single ones: r grows by n⌈m/b⌉ and not by n m. The last block of a window
//! may be shorter.

use crate::error::Error;
use crate::linear_model::LinearModel;
use crate::riccati::{Filter, stationary};
use crate::scaling::Scaling;
use crate::tol;
use ddmhe_run::layout::Layout;
use faer::{Mat, Side};

/// Smallest variance of the prior, in units of the states' own: where no disturbance reaches a
/// state, P is singular and its weight infinite.
const LEAST_PRIOR: f64 = 1e-18;

/// What drives the windows of all depths, in scaled units.
#[derive(Debug, Clone)]
pub(crate) struct Driving {
    pub model: LinearModel,
    /// Q (n × n).
    pub Q: Mat<f64>,
    /// L (n × q) with L Lᵀ = Q, q its rank.
    root: Mat<f64>,
    /// W (n × n) with ‖W w‖² = ‖w‖²_{Q⁻¹}; rows of zeros beyond the rank.
    whitening: Mat<f64>,
    /// Variances of the outputs' noise (p).
    pub R: Vec<f64>,
    /// Covariance of the noise on the recorded states (n × n), as far as it is known.
    pub N: Mat<f64>,
    block: usize,
    /// P, the error covariance that a Kalman filter settles to (n × n): with the weights of the
    /// recording.
    pub stationary: Option<Mat<f64>>,
}

/// The part of a trajectory space that a disturbance moves.
#[derive(Debug, Clone)]
pub(crate) struct Driven {
    /// Its coordinates d, the last of the space.
    pub coordinates: usize,
    /// ŵ (m n × r), a row for each entry.
    pub rows: Mat<f64>,
    /// What a tolerance on each channel of w is in units of (n), in the user's.
    pub units: Vec<f64>,
    /// Variances of the outputs' noise (p): see [`Weights::price`](crate::weights::Weights::price).
    pub variances: Vec<f64>,
}

impl Driving {
    /// With the weights of the recording.
    pub fn of_recording(
        scaling: &Scaling,
        model: LinearModel,
        noise: (Mat<f64>, Vec<f64>),
    ) -> Result<Self, Error> {
        let mut driving = Driving::of(scaling, model, noise, 1)?;
        driving.settle(scaling)?;
        Ok(driving)
    }

    /// With what is known of the noise on the recorded states.
    pub fn with_readings(self, N: Mat<f64>) -> Self {
        Driving { N, ..self }
    }

    /// The covariance that a Kalman filter settles to.
    fn settle(&mut self, scaling: &Scaling) -> Result<(), Error> {
        let Driving { model: LinearModel { A, C, .. }, Q, R, .. } = self;
        let Some(mut P) = stationary(A, C, Q, R) else {
            return Err(Error::value(
                "process_noise",
                "one with a stationary error covariance for this recording",
                "none: the outputs do not show, or the disturbance does not reach, every mode that \
                does not decay",
            ));
        };
        for (i, (unit, s)) in scaling.unit_x.iter().zip(&scaling.s_x).enumerate() {
            P[(i, i)] += LEAST_PRIOR * (unit / s).powi(2);
        }
        self.stationary = Some(P);
        Ok(())
    }

    /// The filter that a window without bounds is, with the weights of the recording.
    pub fn filter(&self) -> Option<Filter> {
        Filter::new(&self.model, (self.stationary.as_ref()?, &self.Q, &self.R))
    }

    /// With covariances Q and R, and disturbances that are constant over `block` instants.
    pub fn of(
        scaling: &Scaling,
        model: LinearModel,
        (Q, mut R): (Mat<f64>, Vec<f64>),
        block: usize,
    ) -> Result<Self, Error> {
        let n = Q.nrows();
        for ((R, unit), s) in R.iter_mut().zip(&scaling.unit_y).zip(&scaling.s_y) {
            *R = R.max((tol::START_NOISE * unit / s).powi(2));
        }
        let none = || {
            let expected = "a recording whose states show a disturbance";
            Error::value("process_noise", expected, "one without any")
        };
        let eigen = Q.self_adjoint_eigen(Side::Lower).map_err(|_| none())?;
        let (V, values) = (eigen.U(), eigen.S().column_vector());
        let largest = values.iter().copied().fold(0.0, f64::max);
        let kept: Vec<usize> =
            (0..n).rev().filter(|&j| values[j] > tol::RANK_EPS * n as f64 * largest).collect();
        if kept.is_empty() {
            return Err(none());
        }
        let root = Mat::from_fn(n, kept.len(), |i, j| V[(i, kept[j])] * values[kept[j]].sqrt());
        let whitening = Mat::from_fn(n, n, |i, j| match kept.get(i) {
            Some(&k) => V[(j, k)] / values[k].sqrt(),
            None => 0.0,
        });
        let N = Mat::zeros(n, n);
        Ok(Driving { model, Q, root, whitening, R, N, block, stationary: None })
    }

    /// G, rows in time (d × q⌈m/b⌉).
    pub fn columns(&self, layout: Layout) -> Mat<f64> {
        let LinearModel { A, C, .. } = &self.model;
        let disturbances = self.disturbances(layout);
        let Layout { n, p, depth, .. } = layout;
        let mut G = Mat::zeros(depth * (n + p) + n, disturbances.ncols());
        let mut x = Mat::zeros(n, disturbances.ncols());
        for k in 0..depth {
            G.subrows_mut(layout.y(k).start, p).copy_from(C * &x);
            x = A * &x + disturbances.subrows(k * n, n);
            G.subrows_mut(layout.x(k + 1).start, n).copy_from(&x);
        }
        G
    }

    /// ŵ of d (m n × q⌈m/b⌉).
    pub fn disturbances(&self, layout: Layout) -> Mat<f64> {
        let (n, q, m) = (layout.n, self.root.ncols(), layout.depth);
        let mut W = Mat::zeros(m * n, q * m.div_ceil(self.block));
        for k in 0..m {
            let first = k / self.block * self.block;
            let length = self.block.min(m - first) as f64;
            let block = &self.root * faer::Scale(1.0 / length.sqrt());
            W.submatrix_mut(k * n, k / self.block * q, n, q).copy_from(&block);
        }
        W
    }

    /// What a tolerance on each channel of w is in units of (n), in the user's: the deviation of w,
    /// or of the state where there is no w.
    pub fn units(&self, scaling: &Scaling) -> Vec<f64> {
        let unit = |(i, s): (usize, &f64)| match self.Q[(i, i)].sqrt() * s {
            deviation if deviation > 0.0 => deviation,
            _ => scaling.unit_x[i],
        };
        scaling.s_x.iter().enumerate().map(unit).collect()
    }

    /// Variances of the outputs' noise (p), NaN for one at rest.
    pub fn told_noise(&self, scaling: &Scaling) -> Vec<f64> {
        let told = |(R, moved): (&f64, &bool)| if *moved { *R } else { f64::NAN };
        self.R.iter().zip(&scaling.moved[1]).map(told).collect()
    }

    /// W for disturbances in the user's units (n × n, by rows).
    pub fn whitening(&self, scaling: &Scaling) -> Vec<f64> {
        let n = self.Q.nrows();
        (0..n * n).map(|k| self.whitening[(k / n, k % n)] / scaling.s_x[k % n]).collect()
    }
}

pub(crate) fn diagonal(S: &Mat<f64>) -> Vec<f64> {
    (0..S.nrows()).map(|i| S[(i, i)]).collect()
}
