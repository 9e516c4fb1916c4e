//! Which part of a recording's one-step residuals drives the system, and which is reading noise.
//!
//! The residual covariance of the states is Γ = Q + N + A N Aᵀ: a disturbance Q, and noise N on the
//! recorded states, at k+1 and through A at k. One share θ splits it: Q = θΓ, N + A N Aᵀ = (1-θ)Γ
//! (cut to what a covariance can be), and R = Γ_s - C N Cᵀ, diagonal, at least
//! [`LEAST_SHARE`] of Γ_s. θ is the one of [`SHARES`] under which the recording itself is most
//! likely, by a Kalman filter on [x recorded; y].

use crate::covariance::{in_units_of, spread};
use crate::history::History;
use crate::linear_model::LinearModel;
use crate::scaling::Scaling;
use crate::variation::least_squares;
use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef, Side};

/// Largest share of reading noise in the recorded states, in any direction, beside which least
/// squares find the model: they shrink a mode by that share at every sample.
pub(crate) const SHARE: f64 = 0.03;
/// θ in decades: from all of Γ to a millionth, two a decade.
const SHARES: (usize, f64) = (13, 0.5);
/// Outputs keep at least this share of their residual as noise, whatever the noise of the states
/// explains: a share of few samples is uncertain by as much.
const LEAST_SHARE: f64 = 0.05;
/// Added to covariances, in units of the channels' own variances: rounding, squared.
const LEAST_NOISE: f64 = 1e-18;

/// What the recording says of its noise, in scaled units.
#[derive(Debug, Clone)]
pub(crate) struct RecordedNoise {
    /// Covariance of the disturbance (n × n).
    pub Q: Mat<f64>,
    /// Of the noise on recorded states (n × n).
    pub N: Mat<f64>,
    /// Variances of the outputs' noise (p).
    pub R: Vec<f64>,
}

impl RecordedNoise {
    /// Of a recording and its model.
    pub fn new(history: &History, scaling: &Scaling, model: &LinearModel) -> Self {
        let readings = Readings::new(history, scaling, model);
        let (count, step) = SHARES;
        let splits = (0..count).map(|k| split(model, &readings, 10f64.powf(-step * k as f64)));
        let mut best: Option<(f64, RecordedNoise)> = None;
        for found in splits {
            let likelihood = readings.log_likelihood(model, &found);
            if best.as_ref().is_none_or(|(most, _)| likelihood > *most) {
                best = Some((likelihood, found));
            }
        }
        best.map_or_else(|| split(model, &readings, 1.0), |(_, found)| found)
    }

    /// The largest correlation of what drives the states with the outputs' noise: the largest
    /// canonical one of ε and s, but for what reading noise makes of it, A N Cᵀ. Near 1 they are
    /// one signal; the weights of the recording take them for two.
    pub fn shared_with_outputs(&self, model: &LinearModel) -> f64 {
        let factor = |mut S: Mat<f64>| {
            let size = S.diagonal().column_vector().iter().copied().fold(0.0, f64::max);
            let floor = (LEAST_NOISE * size).max(f64::MIN_POSITIVE);
            (0..S.nrows()).for_each(|i| S[(i, i)] += floor.max(1e-12 * S[(i, i)]));
            S.llt(Side::Lower).ok()
        };
        let both = model.of_both() - &model.A * &self.N * model.C.transpose();
        let (Some(L), Some(L_s)) = (factor(model.of_states()), factor(model.of_outputs())) else {
            return 0.0;
        };
        let mut half = both;
        L.L().solve_lower_triangular_in_place(half.as_mut());
        let mut whole = half.transpose().to_owned();
        L_s.L().solve_lower_triangular_in_place(whole.as_mut());
        let values = whole.singular_values();
        values.ok().and_then(|values| values.first().copied()).unwrap_or(0.0)
    }

    /// The largest share of reading noise in what the recorded states do, in any direction: the
    /// largest eigenvalue of N Σ_x⁻¹, Σ_x their covariance.
    pub fn share_of_states(&self, history: &History, scaling: &Scaling) -> f64 {
        let spread = spread(history, scaling);
        let Ok(L) = spread.llt(Side::Lower) else { return f64::INFINITY };
        let values = in_units_of(L.L(), &self.N).self_adjoint_eigenvalues(Side::Lower);
        values.ok().and_then(|values| values.last().copied()).unwrap_or(f64::INFINITY)
    }
}

/// Q, N and R of a share θ.
fn split(model: &LinearModel, readings: &Readings, share: f64) -> RecordedNoise {
    let (gamma, gamma_s) = (model.of_states(), model.of_outputs());
    let n = gamma.nrows();
    // N + A N Aᵀ = (1-θ)Γ, entry by entry
    let A = &model.A;
    let equation = Mat::from_fn(n * n, n * n, |row, column| {
        let (i, j, k, l) = (row / n, row % n, column / n, column % n);
        let own = if row == column { 1.0 } else { 0.0 };
        own + A[(i, k)] * A[(j, l)]
    });
    let rest = Mat::from_fn(n * n, 1, |row, _| (1.0 - share) * gamma[(row / n, row % n)]);
    let N = least_squares(&equation, &rest, 0.0);
    let N = positive(&Mat::from_fn(n, n, |i, j| N[(i * n + j, 0)]));
    let explained = &model.C * &N * model.C.transpose();
    let R = noise_left(&gamma_s, &explained, &readings.least_y);
    let mut Q = gamma;
    Q *= faer::Scale(share);
    RecordedNoise { Q, N, R }
}

/// Diagonal of Γ_s - C N Cᵀ, in the directions of both at least [`LEAST_SHARE`] of Γ_s.
fn noise_left(gamma_s: &Mat<f64>, explained: &Mat<f64>, least: &[f64]) -> Vec<f64> {
    let p = gamma_s.nrows();
    let mut whole = gamma_s.clone();
    (0..p).for_each(|i| whole[(i, i)] += least[i]);
    let own = || (0..p).map(|i| whole[(i, i)]).collect::<Vec<_>>();
    let Ok(L) = whole.llt(Side::Lower) else { return own() };
    // S = L⁻¹ C N Cᵀ L⁻ᵀ: the share that N explains, in whitened outputs
    let S = in_units_of(L.L(), explained);
    let S = Mat::from_fn(p, p, |i, j| 0.5 * (S[(i, j)] + S[(j, i)]));
    let Ok(eigen) = S.self_adjoint_eigen(Side::Lower) else { return own() };
    let along = L.L() * eigen.U();
    let share = |j: usize| (1.0 - eigen.S().column_vector()[j]).max(LEAST_SHARE);
    (0..p).map(|i| (0..p).map(|j| along[(i, j)].powi(2) * share(j)).sum()).collect()
}

/// The nearest matrix that a covariance can be.
fn positive(S: &Mat<f64>) -> Mat<f64> {
    let n = S.nrows();
    let S = Mat::from_fn(n, n, |i, j| 0.5 * (S[(i, j)] + S[(j, i)]));
    let Ok(eigen) = S.self_adjoint_eigen(Side::Lower) else { return Mat::zeros(n, n) };
    let (U, values) = (eigen.U(), eigen.S().column_vector());
    Mat::from_fn(n, n, |i, j| (0..n).map(|k| U[(i, k)] * values[k].max(0.0) * U[(j, k)]).sum())
}

/// The recording as readings z = [x; y] of a system without inputs.
struct Readings {
    /// One recording each: x (T+1, n), y without what u adds (T, p), what u adds to x(k+1) (T, n).
    parts: Vec<[Vec<f64>; 3]>,
    least_x: Vec<f64>,
    least_y: Vec<f64>,
}

impl Readings {
    fn new(history: &History, scaling: &Scaling, model: &LinearModel) -> Self {
        let (p, m) = (history.p(), history.m());
        let parts = (0..history.recordings()).map(|i| {
            let x: Vec<f64> =
                scaling_of(history.states(i), history.n(), |x| scaling.deviations(x, &[]));
            let mut y = scaling_of(history.outputs(i), p, |y| scaling.deviations(&[], y));
            let u: Vec<f64> = scaling.input_deviations(history.inputs(i)).collect();
            let times =
                |M: &Mat<f64>, u: &[f64], i: usize| (0..m).map(|j| M[(i, j)] * u[j]).sum::<f64>();
            let T = y.len() / p;
            let mut pushed = Vec::with_capacity(T * model.e.len());
            for k in 0..T {
                let u = &u[k * m..(k + 1) * m];
                (0..p).for_each(|i| y[k * p + i] -= times(&model.D, u, i));
                pushed.extend((0..model.e.len()).map(|i| times(&model.B, u, i)));
            }
            [x, y, pushed]
        });
        let least = |units: &[f64], s: &[f64]| {
            units.iter().zip(s).map(|(unit, s)| LEAST_NOISE * (unit / s).powi(2)).collect()
        };
        Readings {
            parts: parts.collect(),
            least_x: least(&scaling.unit_x, &scaling.s_x),
            least_y: least(&scaling.unit_y, &scaling.s_y),
        }
    }

    /// Of the recordings, less a constant, where x is read with noise N and y with R; -∞ where a
    /// covariance cannot be factored. The first state is where the filter starts; the last one,
    /// which has no output, is left out.
    fn log_likelihood(&self, model: &LinearModel, noise: &RecordedNoise) -> f64 {
        let (n, p) = (model.e.len(), model.r.len());
        let H = Mat::from_fn(n + p, n, |i, j| match i.checked_sub(n) {
            None => f64::from(u8::from(i == j)),
            Some(i) => model.C[(i, j)],
        });
        let read = Mat::from_fn(n + p, n + p, |i, j| {
            let least = if i == j {
                if i < n { self.least_x[i] } else { self.least_y[i - n] }
            } else {
                0.0
            };
            least
                + match (i.checked_sub(n), j.checked_sub(n)) {
                    (None, None) => noise.N[(i, j)],
                    (Some(i), Some(j)) if i == j => noise.R[i],
                    _ => 0.0,
                }
        });
        let mut total = 0.0;
        for [x, y, pushed] in &self.parts {
            let mut state = Mat::from_fn(n, 1, |i, _| x[i]);
            let mut P = noise.N.clone();
            (0..n).for_each(|i| P[(i, i)] += self.least_x[i]);
            for (k, (y, pushed)) in y.chunks_exact(p).zip(pushed.chunks_exact(n)).enumerate() {
                let first = if k == 0 { n } else { 0 };
                let H = H.subrows(first, n + p - first);
                let S = read.submatrix(first, first, n + p - first, n + p - first);
                let reading = |i: usize| match i.checked_sub(n) {
                    None => x[k * n + i],
                    Some(i) => y[i] - model.r[i],
                };
                let predicted = H * &state;
                let error =
                    Mat::from_fn(H.nrows(), 1, |i, _| reading(first + i) - predicted[(i, 0)]);
                let Some((gain, part)) = gain(&P, H, S, &error) else { return f64::NEG_INFINITY };
                total += part;
                state = &model.A * (&state + &gain * &error);
                (0..n).for_each(|i| state[(i, 0)] += model.e[i] + pushed[i]);
                P = following(model.A.as_ref(), noise.Q.as_ref(), &updated(&P, &gain, H, S));
            }
        }
        total
    }
}

/// K = P Hᵀ (H P Hᵀ + S)⁻¹ and the log-likelihood of an innovation.
fn gain(
    P: &Mat<f64>,
    H: MatRef<'_, f64>,
    S: MatRef<'_, f64>,
    error: &Mat<f64>,
) -> Option<(Mat<f64>, f64)> {
    let HP = H * P;
    let whole = &HP * H.transpose() + S;
    let factor = whole.llt(Side::Lower).ok()?;
    let mut white = error.clone();
    factor.L().solve_lower_triangular_in_place(white.as_mut());
    let determinant: f64 = (0..whole.nrows()).map(|i| factor.L()[(i, i)].ln()).sum();
    let gain = factor.solve(&HP).transpose().to_owned();
    Some((gain, -0.5 * white.squared_norm_l2() - determinant))
}

/// (I - K H) P (I - K H)ᵀ + K S Kᵀ.
fn updated(P: &Mat<f64>, K: &Mat<f64>, H: MatRef<'_, f64>, S: MatRef<'_, f64>) -> Mat<f64> {
    let n = P.nrows();
    let rest = Mat::<f64>::identity(n, n) - K * H;
    &rest * P * rest.transpose() + K * S * K.transpose()
}

/// A P Aᵀ + Q.
fn following(A: MatRef<'_, f64>, Q: MatRef<'_, f64>, P: &Mat<f64>) -> Mat<f64> {
    A * P * A.transpose() + Q
}

fn scaling_of<'a, I: Iterator<Item = f64>>(
    signal: &'a [f64],
    width: usize,
    scaled: impl Fn(&'a [f64]) -> I,
) -> Vec<f64> {
    signal.chunks_exact(width).flat_map(scaled).collect()
}
