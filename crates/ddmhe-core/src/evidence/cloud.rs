//! How far a state is from the recorded ones.

use crate::covariance::inverse_factor;
use crate::evidence::replay::folds;
use crate::history::History;
use crate::scaling::Scaling;
use faer::Mat;

/// Of the largest distance of recorded states, from where on leaving them counts.
const FAR: f64 = 0.7;

/// Σ_x⁻¹ / (.7 D_most) in scaled units: how far a state has left the recorded ones.
pub(crate) fn away(history: &History, scaling: &Scaling) -> Mat<f64> {
    let n = history.n();
    let all = 0..history.recordings();
    let own = Cloud::new(all.clone().flat_map(|i| history.states(i).chunks_exact(n)), scaling);
    let recorded = all.flat_map(|i| history.states(i).chunks_exact(n));
    let most = recorded.map(|x| own.distance(x, scaling)).fold(0.0, f64::max);
    let held = folds(history).iter().map(|fold| fold.farthest(scaling)).fold(0.0, f64::max);
    let most = (FAR * most.max(held)).max(f64::MIN_POSITIVE);
    own.inverse * faer::Scale(1.0 / most)
}

/// States by their mean and covariance, in scaled units.
pub(crate) struct Cloud {
    mean: Vec<f64>,
    inverse: Mat<f64>,
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
