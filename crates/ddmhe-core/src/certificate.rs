//! Stability certificates: weights for which the estimation error is known to shrink.
//!
//! # Derivation
//! For two trajectories of x(t+1) = A x + e + w, y = C x + r + v, one of them (the estimate)
//! without w, the difference d = x̂ - x obeys d⁺ = A d - w. Matrices P, Q, R and η < 1 with
//!
//! > \[\[AᵀPA - ηP - CᵀRC, AᵀP\], \[PA, P - Q\]\] ⪯ 0
//!
//! make ‖d‖²_P an incremental input/output-to-state Lyapunov function with exponential discount
//! (Schiller, Muntwiler, Köhler, Zeilinger, Müller 2023):
//!
//! > ‖d⁺‖²_P ≤ η‖d‖²_P + ‖w‖²_Q + ‖C d‖²_R.    (L)
//!
//! With prior weight 2η^M P and noise weights η^{j-1} R in the place of (17)'s scalars the error
//! contracts when 4η^M < 1. The scalar weights of (17) are the case P = I, R = μI, η = ρ, Q = 3I:
//! (24) implies (L) for them.
//!
//! # The bound of a step
//! [`ErrorBound`] walks (L) along the estimated window instead of bounding it in advance as (34)
//! does: everything that (34) must assume the worst of, the fitted noise and the distance to the
//! prior, is known by then. From s(0) = ‖x̂(t-m|t) - x̄‖_P + E(t-m), E the bound of the prior,
//!
//! > s(k+1)² = η s(k)² + (‖ŵ(k)‖_Q + W)² + (‖v̂(k)‖_R + V)²,  E(t) = s(m),
//!
//! where W, V bound ‖w‖_Q, ‖v‖_R, v̂ = y - C x̂ - r and ŵ(k) = x̂(k+1) - A x̂(k) - e is what the
//! window lacks of being a trajectory of the certificate's model (nothing, if the recording was
//! noise-free). By optimality E(t) is never above (34)'s weighted form. Three further facts can
//! only lower it: past estimates are known (‖x̂(k|t) - x̂(k)‖_P + E(k)), d⁺ = A d - w gives s(k+1)
//! ≤ ‖A‖_P s(k) + W without any output (Q ⪰ P), and the second serves where y(k) is missing.
//!
//! # When there is a bound
//! (L) speaks of the true system, and the windows are those of the recording. With a noisy one they
//! are trajectories of no system at all: ŵ and v̂ must then be known, and for that A, e, C and r of
//! the true system, exactly or with an [`Uncertainty`]. A bound is handed out when they are, or
//! when the recording itself is a trajectory to rounding: every window is then one too, and e and r
//! are what the recording says. It is not when the model was fitted to a noisy recording whose
//! noise nobody stated.

use crate::check::{check_finite, check_vector};
use crate::error::Error;
use crate::history::History;
use crate::tol;
use faer::linalg::solvers::SolveLstsq;
use faer::{Mat, Side};
use serde::{Deserialize, Serialize};

/// P, Q, R and η that satisfy (L) for a system, all in the user's units. Matrices are row-major.
///
/// Whether they do is for the designer to verify: the estimator does not know (A, C).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// Symmetric positive definite (n·n), cost per unit of x².
    pub P: Vec<f64>,
    /// Symmetric positive definite (n·n), Q ⪰ P.
    pub Q: Vec<f64>,
    /// Symmetric positive definite (p·p), cost per unit of y².
    pub R: Vec<f64>,
    /// Discount η in (0, 1) per sample.
    pub eta: f64,
    /// Largest ‖A d‖_P / ‖d‖_P, if known: carries an error bound over samples that were not
    /// measured.
    pub growth: Option<f64>,
    /// The model behind the certificate, if known: windows that are not its trajectories are then
    /// accounted for.
    pub model: Option<Model>,
}

/// x(t+1) = A x + e, y = C x + r, and how far the true system may be from it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Model {
    /// (n·n)
    pub A: Vec<f64>,
    /// (n); empty with r: both are taken from the recording, if that is a trajectory of (A, C).
    pub e: Vec<f64>,
    /// (p·n)
    pub C: Vec<f64>,
    /// (p), or empty with e.
    pub r: Vec<f64>,
    /// Whether it was fitted to a noisy recording whose noise is not known: how far the true system
    /// is from it, nobody knows then.
    pub identified: bool,
    /// For the true system, ‖ΔA x + Δe‖_Q ≤ `w`·q(x) and ‖ΔC x + Δr‖_R ≤ `v`·q(x) with q(x)² = \[x;
    /// 1\]ᵀ metric \[x; 1\].
    pub uncertainty: Option<Uncertainty>,
}

/// The distance between the model and the true system, see [`Model::uncertainty`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Symmetric positive semidefinite ((n+1)·(n+1)).
    pub metric: Vec<f64>,
    /// Factor of the states' equation.
    pub w: f64,
    /// Factor of the outputs' equation.
    pub v: f64,
}

/// What a user knows of the true trajectory: Euclidean norms, in the user's units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Disturbance {
    /// ‖x̄(0) - x(0)‖, and with a warm start of every recorded state.
    pub initial: f64,
    /// ‖w(t)‖ at every t.
    pub w: f64,
    /// ‖v(t)‖ at every t.
    pub v: f64,
}

impl Certificate {
    /// Smallest M with 4η^M < 1.
    pub fn minimum_horizon(&self) -> usize {
        smallest_contracting(self.eta)
    }

    /// Sizes, finite numbers, symmetry, definiteness, η.
    pub(crate) fn check(&self, n: usize, p: usize) -> Result<(), Error> {
        if !(self.eta > 0.0 && self.eta < 1.0) {
            return Err(Error::value("certificate", "eta in (0, 1)", self.eta));
        }
        for (name, matrix, size) in [("P", &self.P, n), ("Q", &self.Q, n), ("R", &self.R, p)] {
            check_square(name, matrix, size)?;
            if factor(matrix, size).is_none() {
                let expected = format!("a symmetric positive definite {name}");
                return Err(Error::value("certificate", expected, "one that is not"));
            }
        }
        if let Some(growth) = self.growth.filter(|g| !(*g >= 0.0 && g.is_finite())) {
            return Err(Error::value("certificate", "a finite growth of at least 0", growth));
        }
        let Some(model) = &self.model else { return Ok(()) };
        let offsets = !(model.e.is_empty() && model.r.is_empty());
        for (values, len) in [(&model.A, n * n), (&model.C, p * n)] {
            check_vector("certificate", values, len)?;
        }
        for (values, len) in [(&model.e, n), (&model.r, p)] {
            check_vector("certificate", values, if offsets { len } else { 0 })?;
        }
        if let Some(u) = &model.uncertainty {
            check_square("metric", &u.metric, n + 1)?;
            check_factor("w", u.w)?;
            check_factor("v", u.v)?;
        }
        Ok(())
    }
}

impl Disturbance {
    /// Finite and not negative.
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, value) in [("initial", self.initial), ("w", self.w), ("v", self.v)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::value(
                    "disturbance",
                    format!("a finite {name} of at least 0"),
                    value,
                ));
            }
        }
        Ok(())
    }
}

/// Smallest M with 4ρ^M < 1 (Liu 2026, (33)).
///
/// # Errors
/// [`Error::Value`] unless ρ is in (0, 1).
pub fn minimum_horizon(rho: f64) -> Result<usize, Error> {
    if !(rho > 0.0 && rho < 1.0) {
        return Err(Error::value("rho", "a number in (0, 1)", rho));
    }
    Ok(smallest_contracting(rho))
}

/// [`minimum_horizon`] of a checked ρ. Rounding of the logarithm is mended by looking at both
/// neighbours.
pub(crate) fn smallest_contracting(rho: f64) -> usize {
    let contracts = |M: usize| 4.0 * rho.powf(M as f64) < 1.0;
    let mut M = (0.25_f64.ln() / rho.ln()).floor().max(1.0) as usize;
    while M > 1 && contracts(M - 1) {
        M -= 1;
    }
    while !contracts(M) {
        M += 1;
    }
    M
}

fn check_factor(name: &str, value: f64) -> Result<(), Error> {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::value(
        "certificate",
        format!("an uncertainty with a finite {name} of at least 0"),
        value,
    ))
}

fn check_square(name: &str, matrix: &[f64], size: usize) -> Result<(), Error> {
    if matrix.len() != size * size {
        return Err(Error::shape(
            "certificate",
            format!("a {size} x {size} {name}"),
            format!("{} numbers", matrix.len()),
        ));
    }
    check_finite("certificate", matrix, size)?;
    let largest = matrix.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let skew = (0..size * size)
        .map(|k| (matrix[k] - matrix[(k % size) * size + k / size]).abs())
        .fold(0.0, f64::max);
    if skew > tol::SYMMETRIC * largest {
        return Err(Error::value(
            "certificate",
            format!("a symmetric {name}"),
            format!("one that is off by {skew:.3e}"),
        ));
    }
    Ok(())
}

/// Upper triangular U with matrix = UᵀU; None unless positive definite.
pub(crate) fn factor(matrix: &[f64], size: usize) -> Option<Mat<f64>> {
    let full = Mat::from_fn(size, size, |i, j| 0.5 * (matrix[i * size + j] + matrix[j * size + i]));
    Some(full.llt(Side::Lower).ok()?.L().transpose().to_owned())
}

/// ‖U x‖.
pub(crate) fn norm(U: &Mat<f64>, x: &[f64]) -> f64 {
    (0..U.nrows())
        .map(|i| x.iter().enumerate().map(|(j, v)| U[(i, j)] * v).sum::<f64>().powi(2))
        .sum::<f64>()
        .sqrt()
}

/// The running error bound of one estimator.
#[derive(Clone)]
pub(crate) struct ErrorBound {
    n: usize,
    p: usize,
    eta: f64,
    growth: f64, // infinite when unknown
    model: Option<Model>,
    U_P: Mat<f64>,
    U_Q: Mat<f64>,
    U_R: Mat<f64>,
    euclidean: f64, // ‖d‖ ≤ euclidean · ‖d‖_P
    initial: f64,   // in ‖·‖_P
    W: f64,
    V: f64,
    errors: Vec<f64>, // E of each state in the estimator's memory
    room: Vec<f64>,   // n + p
}

impl ErrorBound {
    /// None without a certificate or a disturbance, and in words why there is no bound where it
    /// could not be relied on.
    pub fn new(
        certificate: Option<&Certificate>,
        disturbance: Option<&Disturbance>,
        history: &History,
    ) -> Result<Option<Self>, String> {
        let (Some(certificate), Some(disturbance)) = (certificate, disturbance) else {
            return Ok(None);
        };
        let (n, p, model) = (history.n(), history.p(), true_model(certificate, history)?);
        Ok(ErrorBound::of(certificate, model, disturbance, n, p))
    }

    /// None when the certificate's matrices cannot be factored (they were checked before).
    fn of(
        c: &Certificate,
        model: Option<Model>,
        disturbance: &Disturbance,
        n: usize,
        p: usize,
    ) -> Option<Self> {
        let (U_P, U_Q, U_R) = (factor(&c.P, n)?, factor(&c.Q, n)?, factor(&c.R, p)?);
        let [(smallest, largest), (_, largest_Q), (_, largest_R)] =
            [&U_P, &U_Q, &U_R].map(|U| extremes(U).unwrap_or((0.0, f64::INFINITY)));
        // 0 · ∞ must not become NaN
        let scaled = |factor: f64, size: f64| if size == 0.0 { 0.0 } else { factor * size };
        Some(ErrorBound {
            n,
            p,
            eta: c.eta,
            growth: c.growth.unwrap_or(f64::INFINITY),
            model,
            euclidean: 1.0 / smallest,
            initial: scaled(largest, disturbance.initial),
            W: scaled(largest_Q, disturbance.w),
            V: scaled(largest_R, disturbance.v),
            U_P,
            U_Q,
            U_R,
            errors: Vec::new(),
            room: vec![0.0; n + p],
        })
    }

    /// Starts over with `known` states in memory, all of the initial error.
    pub fn restart(&mut self, known: usize) {
        self.errors.clear();
        self.errors.resize(known, self.initial);
    }

    /// Room for `states` bounds.
    pub fn reserve(&mut self, states: usize) {
        self.errors.reserve(states.saturating_sub(self.errors.len()));
    }

    /// The bounds in memory, for a snapshot.
    pub fn errors(&self) -> &[f64] {
        &self.errors
    }

    /// Continues from saved bounds.
    pub fn resume(&mut self, errors: &[f64]) {
        self.errors.clear();
        self.errors.extend_from_slice(errors);
    }

    /// The states in memory are no estimates any more.
    pub fn forget_all(&mut self) {
        self.errors.fill(f64::INFINITY);
    }

    /// The states in memory but the newest are others now.
    pub fn forget_past(&mut self) {
        if let [past @ .., _] = &mut self.errors[..] {
            past.fill(f64::INFINITY);
        }
    }

    /// The newest state in memory was moved.
    pub fn moved(&mut self, by: impl Fn(usize) -> f64) {
        let (x, _) = self.room.split_at_mut(self.n);
        x.iter_mut().enumerate().for_each(|(i, x)| *x = by(i));
        let far = norm(&self.U_P, x);
        self.errors.last_mut().into_iter().for_each(|error| *error += far);
    }

    /// Forgets the oldest state.
    pub fn forget(&mut self) {
        self.errors.remove(0);
    }

    /// The bound on ‖x̂(t) - x(t)‖ from the window x̂(·|t) ((m+1)·n), its outputs by entry with
    /// their fitted noise (m·p, NaN where not measured), and the past estimates of the same times
    /// by entry (the prior first), all in the user's units.
    pub fn advance(
        &mut self,
        window: &[f64],
        output: impl Fn(usize) -> f64,
        v_hat: &[f64],
        past: impl Fn(usize) -> f64,
    ) -> f64 {
        let (n, p) = (self.n, self.p);
        let mut room = std::mem::take(&mut self.room);
        let (w, v) = room.split_at_mut(n);
        let mut s = f64::INFINITY;
        for k in 0..v_hat.len() / p {
            let (x, x_next) = window[k * n..(k + 2) * n].split_at(n);
            (0..n).for_each(|i| w[i] = x[i] - past(k * n + i));
            s = s.min(norm(&self.U_P, w) + self.errors[k]);
            // ŵ and v̂; without a model the window counts as a trajectory of the true system
            match &self.model {
                Some(model) => {
                    residual(&model.A, &model.e, x, |i| x_next[i], w);
                    residual(&model.C, &model.r, x, |i| output(k * p + i), v);
                }
                None => {
                    w.fill(0.0);
                    v.copy_from_slice(&v_hat[k * p..(k + 1) * p]);
                }
            }
            s = self.across(x, w, v, s);
        }
        self.room = room;
        self.errors.push(s);
        self.euclidean * s
    }

    /// (L) over one sample from x with the residuals ŵ and v̂: s(k+1) from s(k).
    fn across(&self, x: &[f64], w_hat: &[f64], v_hat: &[f64], s: f64) -> f64 {
        let (spread_w, spread_v) = self.spread(x);
        let W = norm(&self.U_Q, w_hat) + spread_w + self.W;
        let blind = if s == 0.0 { W } else { self.growth * s + W };
        if v_hat.iter().any(|v| v.is_nan()) {
            return blind;
        }
        let V = norm(&self.U_R, v_hat) + spread_v + self.V;
        blind.min((self.eta * s * s + W * W + V * V).sqrt())
    }

    /// How far the true system's next state and output at x may be from the model's, in ‖·‖_Q and
    /// ‖·‖_R.
    fn spread(&self, x: &[f64]) -> (f64, f64) {
        let Some(u) = self.model.as_ref().and_then(|m| m.uncertainty.as_ref()) else {
            return (0.0, 0.0);
        };
        let size = x.len() + 1;
        let z = |i: usize| x.get(i).copied().unwrap_or(1.0);
        let square: f64 = (0..size * size).map(|k| z(k / size) * u.metric[k] * z(k % size)).sum();
        let q = square.max(0.0).sqrt();
        (u.w * q, u.v * q)
    }
}

/// The model that residuals are to be taken from; None where every window is a trajectory of the
/// true system. Why neither is known, in words.
fn true_model(certificate: &Certificate, history: &History) -> Result<Option<Model>, String> {
    const NONE: &str = "certificate: no error bound is given";
    match &certificate.model {
        Some(model) if model.identified => Err(format!(
            "{NONE}: its model was fitted to a noisy recording, and how far the true system is \
            from it is not known; state the \
             recording's noise, or give the true A, C, e and r"
        )),
        Some(model) if model.e.is_empty() => match offsets(model, history) {
            Some((e, r)) => Ok(Some(Model { e, r, ..model.clone() })),
            None => Err(format!(
                "{NONE}: the recording is not a trajectory of its (A, C), so that its windows \
                are not either and say nothing reliable of \
                 the offsets; give e and r with A and C"
            )),
        },
        Some(model) => Ok(Some(model.clone())),
        None if is_affine(history) => Ok(None),
        None => Err(format!(
            "{NONE}: the recording shows noise or curvature, so that its windows are not the \
            true system's trajectories; give the \
             model A, C, e and r with the certificate"
        )),
    }
}

/// Samples [x(k); x(k+1); y(k)] of a recording.
fn samples(history: &History) -> impl Iterator<Item = [&[f64]; 3]> {
    let n = history.n();
    (0..history.recordings()).flat_map(move |i| {
        let (x, y) = (history.states(i), history.outputs(i));
        let next = x.chunks_exact(n).skip(1);
        x.chunks_exact(n)
            .zip(next)
            .zip(y.chunks_exact(history.p()))
            .map(|((x, next), y)| [x, next, y])
    })
}

/// e and r of a recording that is a trajectory of (A, C) to rounding.
fn offsets(model: &Model, history: &History) -> Option<(Vec<f64>, Vec<f64>)> {
    let (n, p, T) = (history.n(), history.p(), history.T() as f64);
    // what a sample leaves of entry i of [x(k+1); y(k)], and the size of the numbers behind it
    let left = |[x, next, y]: [&[f64]; 3], i: usize| {
        let (row, target) =
            if i < n { (&model.A[i * n..], next[i]) } else { (&model.C[(i - n) * n..], y[i - n]) };
        row.iter().zip(x).fold((target, target.abs()), |(left, size), (a, x)| {
            (left - a * x, size + (a * x).abs())
        })
    };
    let mut offset = Vec::new();
    for i in 0..n + p {
        let mean = samples(history).map(|sample| left(sample, i).0 / T).sum::<f64>();
        let size = samples(history).map(|sample| left(sample, i).1).fold(0.0, f64::max);
        if samples(history).any(|sample| (left(sample, i).0 - mean).abs() > tol::TRAJECTORY * size)
        {
            return None;
        }
        offset.push(mean);
    }
    let r = offset.split_off(n);
    Some((offset, r))
}

/// Whether some affine system has the recording as its trajectory, to rounding and with a sample to
/// spare.
fn is_affine(history: &History) -> bool {
    let (n, p, T) = (history.n(), history.p(), history.T());
    let all: Vec<[&[f64]; 3]> = samples(history).collect();
    if T <= n + 1 {
        return false;
    }
    let mean = |part: usize, i: usize| all.iter().map(|s| s[part][i]).sum::<f64>() / T as f64;
    let centred = |width: usize, pick: &dyn Fn(usize) -> (usize, usize)| {
        let means: Vec<f64> = (0..width).map(|i| mean(pick(i).0, pick(i).1)).collect();
        Mat::from_fn(T, width, |k, i| all[k][pick(i).0][pick(i).1] - means[i])
    };
    let X = centred(n, &|i| (0, i));
    let Y = centred(n + p, &|i| if i < n { (1, i) } else { (2, i - n) });
    let theta = X.col_piv_qr().solve_lstsq(&Y); // n × (n+p)
    let residual = &Y - &X * &theta;
    let largest = |part: usize, i: usize| all.iter().fold(0.0_f64, |m, s| m.max(s[part][i].abs()));
    (0..n + p).all(|i| {
        let own = if i < n { largest(1, i) } else { largest(2, i - n) };
        let size = own + (0..n).map(|j| theta[(j, i)].abs() * largest(0, j)).sum::<f64>();
        residual.col(i).iter().all(|r| r.abs() <= tol::TRAJECTORY * size)
    })
}

/// target - (matrix x + offset), into `out`.
fn residual(
    matrix: &[f64],
    offset: &[f64],
    x: &[f64],
    target: impl Fn(usize) -> f64,
    out: &mut [f64],
) {
    for (i, out) in out.iter_mut().enumerate() {
        let row = &matrix[i * x.len()..(i + 1) * x.len()];
        *out = target(i) - offset[i] - row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
    }
}

/// Smallest and largest singular value.
fn extremes(U: &Mat<f64>) -> Option<(f64, f64)> {
    let sigma = U.singular_values().ok()?;
    Some((*sigma.last()?, *sigma.first()?))
}
