//! How far a state is from the recorded ones.

use crate::covariance::inverse_factor;
use crate::scaling::Scaling;
use faer::Mat;

/// States by their mean and covariance, in scaled units.
pub(crate) struct Cloud {
    mean: Vec<f64>,
    pub inverse: Mat<f64>,
}

impl Cloud {
    /// Of states in the user's units.
    pub fn new<'a>(states: impl Iterator<Item = &'a [f64]>, scaling: &Scaling) -> Self {
        let scaled: Vec<Vec<f64>> = states.map(|x| scaling.deviations(x, &[]).collect()).collect();
        let (n, count) = (scaling.s_x.len(), scaled.len() as f64);
        let mean: Vec<f64> =
            (0..n).map(|i| scaled.iter().map(|x| x[i]).sum::<f64>() / count).collect();
        let moment = |i: usize, j: usize| {
            scaled.iter().map(|x| (x[i] - mean[i]) * (x[j] - mean[j])).sum::<f64>() / count
        };
        let mut S = Mat::from_fn(n, n, moment);
        let trace = S.diagonal().column_vector().iter().sum::<f64>();
        let floor = LEAST_SPREAD * trace / n as f64;
        (0..n).for_each(|i| S[(i, i)] += floor.max(f64::MIN_POSITIVE.sqrt()));
        let inverse = match inverse_factor(&S) {
            Some(U) => U.transpose() * &U,
            None => Mat::zeros(n, n),
        };
        Cloud { mean, inverse }
    }

    /// D of a state in the user's units.
    pub fn distance(&self, x: &[f64], scaling: &Scaling) -> f64 {
        let d: Vec<f64> =
            scaling.deviations(x, &[]).zip(&self.mean).map(|(x, mean)| x - mean).collect();
        let row =
            |i: usize| d.iter().enumerate().map(|(j, d)| self.inverse[(i, j)] * d).sum::<f64>();
        d.iter().enumerate().map(|(i, d)| d * row(i)).sum()
    }
}

/// Added to a covariance of states, in units of the mean of its diagonal.
const LEAST_SPREAD: f64 = 1e-9;
