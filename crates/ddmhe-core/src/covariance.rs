//! Covariances, and roots of their inverses.

use crate::check::check_vector;
use crate::error::Error;
use crate::history::History;
use crate::scaling::Scaling;
use faer::{Mat, MatRef, Side};

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

/// L⁻¹ X L⁻ᵀ of a symmetric X, with S = L Lᵀ: what X is in units of S.
pub(crate) fn in_units_of(L: MatRef<'_, f64>, X: &Mat<f64>) -> Mat<f64> {
    let mut half = X.clone();
    L.solve_lower_triangular_in_place(half.as_mut());
    let mut whole = half.transpose().to_owned();
    L.solve_lower_triangular_in_place(whole.as_mut());
    whole
}

/// A covariance (n·n, by rows): symmetric, positive semidefinite, not 0.
pub(crate) fn check_covariance(argument: &'static str, Q: &[f64], n: usize) -> Result<(), Error> {
    check_vector(argument, Q, n * n)?;
    let size = Q.iter().fold(0.0_f64, |size, q| size.max(q.abs()));
    let uneven = (0..n * n).any(|k| (Q[k] - Q[k % n * n + k / n]).abs() > 1e-9 * size);
    // entries in units of their own rows: channels may have very different units
    let root = |i: usize| Q[i * n + i].max(0.0).sqrt();
    let own = |i: usize| if root(i) > 0.0 { root(i) } else { 1.0 };
    let unit = Mat::from_fn(n, n, |i, j| Q[i * n + j] / (own(i) * own(j)));
    let least = unit.self_adjoint_eigenvalues(Side::Lower).ok().and_then(|v| v.first().copied());
    let negative = least.is_none_or(|least| least < -1e-9 * n as f64);
    if size == 0.0 || uneven || negative {
        let expected = "a covariance, symmetric and positive semidefinite, not 0";
        let found = match least {
            _ if size == 0.0 => "zeros".to_string(),
            _ if uneven => "one that is not symmetric".into(),
            Some(least) => {
                format!("one with the least eigenvalue {least:.3e} in units of its diagonal")
            }
            None => "one whose eigenvalues cannot be computed".into(),
        };
        return Err(Error::value(argument, expected, found));
    }
    Ok(())
}
