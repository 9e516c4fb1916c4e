//! Covariances, and roots of their inverses.

use crate::history::History;
use crate::scaling::Scaling;
use faer::{Mat, Side};

/// Covariance of the recorded states, in scaled units, with enough of a diagonal to have an
/// inverse.
pub(crate) fn spread(history: &History, scaling: &Scaling) -> Mat<f64> {
    let n = history.n();
    let mut S = Mat::zeros(n, n);
    let mut samples = 0.0;
    for x in (0..history.recordings()).flat_map(|i| history.states(i).chunks_exact(n)) {
        let d: Vec<f64> = scaling.deviations(x, &[]).collect();
        (0..n * n).for_each(|k| S[(k / n, k % n)] += d[k / n] * d[k % n]);
        samples += 1.0;
    }
    S *= faer::Scale(1.0 / samples);
    let floor = 1e-9 * S.diagonal().column_vector().iter().sum::<f64>() / n as f64;
    (0..n).for_each(|i| S[(i, i)] += floor);
    S
}

/// U with UᵀU = S⁻¹.
pub(crate) fn inverse_factor(S: &Mat<f64>) -> Option<Mat<f64>> {
    let n = S.nrows();
    let llt = S.llt(Side::Lower).ok()?;
    let mut U = Mat::from_fn(n, n, |i, j| if i == j { 1.0 } else { 0.0 });
    llt.L().solve_lower_triangular_in_place(U.as_mut());
    Some(U)
}
