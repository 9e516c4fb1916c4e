//! The bound on the error of each estimate that a certificate gives. (L) is the inequality of
//! [`certificate`](crate::certificate).
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
//! the true system, exactly or with an [`Uncertainty`](crate::Uncertainty). A bound is handed out
//! when they are, or when the recording itself is a trajectory to rounding: every window is then
//! one too, and e and r are what the recording says. It is not when the model was fitted to a noisy
//! recording whose noise nobody stated.

use crate::certificate::{Certificate, Disturbance, Model, factor};
use crate::history::History;
use crate::tol;
use faer::Mat;
use faer::linalg::solvers::SolveLstsq;

/// The running error bound of one estimator.
#[derive(Clone)]
pub(crate) struct ErrorBound {
    n: usize,
    p: usize,
    m: usize,
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
        let (sizes, model) =
            ((history.n(), history.p(), history.m()), true_model(certificate, history)?);
        Ok(ErrorBound::of(certificate, model, disturbance, sizes))
    }

    /// None when the certificate's matrices cannot be factored (they were checked before).
    fn of(
        c: &Certificate,
        model: Option<Model>,
        disturbance: &Disturbance,
        (n, p, m): (usize, usize, usize),
    ) -> Option<Self> {
        let (U_P, U_Q, U_R) = (factor(&c.P, n)?, factor(&c.Q, n)?, factor(&c.R, p)?);
        let [(smallest, largest), (_, largest_Q), (_, largest_R)] =
            [&U_P, &U_Q, &U_R].map(|U| extremes(U).unwrap_or((0.0, f64::INFINITY)));
        // 0 · ∞ must not become NaN
        let scaled = |factor: f64, size: f64| if size == 0.0 { 0.0 } else { factor * size };
        Some(ErrorBound {
            n,
            p,
            m,
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
    #[cfg(feature = "serde")]
    pub fn errors(&self) -> &[f64] {
        &self.errors
    }

    /// Continues from saved bounds.
    #[cfg(feature = "serde")]
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
    /// their fitted noise (m·p, NaN where not measured), its inputs by entry, and the past
    /// estimates of the same times by entry (the prior first), all in the user's units.
    pub fn advance(
        &mut self,
        window: &[f64],
        (output, v_hat): (impl Fn(usize) -> f64, &[f64]),
        input: impl Fn(usize) -> f64,
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
            let u = |j: usize| input(k * self.m + j);
            match &self.model {
                Some(Model { A, B, C, D, e, r, .. }) => {
                    residual([A, B, e], x, u, |i| x_next[i], w);
                    residual([C, D, r], x, u, |i| output(k * p + i), v);
                }
                None => {
                    w.fill(0.0);
                    v.copy_from_slice(&v_hat[k * p..(k + 1) * p]);
                }
            }
            s = self.across((x, u), (w, v), s);
        }
        self.room = room;
        self.errors.push(s);
        self.euclidean * s
    }

    /// (L) over one sample from x with the residuals ŵ and v̂: s(k+1) from s(k).
    fn across(
        &self,
        (x, u): (&[f64], impl Fn(usize) -> f64),
        (w_hat, v_hat): (&[f64], &[f64]),
        s: f64,
    ) -> f64 {
        let (spread_w, spread_v) = self.spread(x, u);
        let W = norm(&self.U_Q, w_hat) + spread_w + self.W;
        let blind = if s == 0.0 { W } else { self.growth * s + W };
        if v_hat.iter().any(|v| v.is_nan()) {
            return blind;
        }
        let V = norm(&self.U_R, v_hat) + spread_v + self.V;
        blind.min((self.eta * s * s + W * W + V * V).sqrt())
    }

    /// How far the true system's next state and output at x and u may be from the model's, in ‖·‖_Q
    /// and ‖·‖_R.
    fn spread(&self, x: &[f64], input: impl Fn(usize) -> f64) -> (f64, f64) {
        let Some(u) = self.model.as_ref().and_then(|m| m.uncertainty.as_ref()) else {
            return (0.0, 0.0);
        };
        let (n, size) = (x.len(), x.len() + self.m + 1);
        let z = |i: usize| match i {
            i if i < n => x[i],
            i if i + 1 < size => input(i - n),
            _ => 1.0,
        };
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

/// Samples [x(k); x(k+1); y(k); u(k)] of a recording.
fn samples(history: &History) -> impl Iterator<Item = [&[f64]; 4]> {
    let n = history.n();
    (0..history.recordings()).flat_map(move |i| {
        let (x, y) = (history.states(i), history.outputs(i));
        let next = x.chunks_exact(n).skip(1);
        x.chunks_exact(n)
            .zip(next)
            .zip(y.chunks_exact(history.p()))
            .enumerate()
            .map(move |(k, ((x, next), y))| [x, next, y, history.window_inputs(i, k, 1)])
    })
}

/// e and r of a recording that is a trajectory of (A, C) to rounding.
fn offsets(model: &Model, history: &History) -> Option<(Vec<f64>, Vec<f64>)> {
    let (n, p, m, T) = (history.n(), history.p(), history.m(), history.T() as f64);
    // what a sample leaves of entry i of [x(k+1); y(k)], and the size of the numbers behind it
    let left = |[x, next, y, u]: [&[f64]; 4], i: usize| {
        let (row, of_u, target) = if i < n {
            (&model.A[i * n..(i + 1) * n], &model.B[i * m..], next[i])
        } else {
            (&model.C[(i - n) * n..(i - n + 1) * n], &model.D[(i - n) * m..], y[i - n])
        };
        let entries = row.iter().zip(x).chain(of_u.iter().zip(u));
        entries.fold((target, target.abs()), |(left, size), (a, x)| {
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
    let (n, p, m, T) = (history.n(), history.p(), history.m(), history.T());
    let all: Vec<[&[f64]; 4]> = samples(history).collect();
    if T <= n + m + 1 {
        return false;
    }
    let mean = |part: usize, i: usize| all.iter().map(|s| s[part][i]).sum::<f64>() / T as f64;
    let centred = |width: usize, pick: &dyn Fn(usize) -> (usize, usize)| {
        let means: Vec<f64> = (0..width).map(|i| mean(pick(i).0, pick(i).1)).collect();
        Mat::from_fn(T, width, |k, i| all[k][pick(i).0][pick(i).1] - means[i])
    };
    let X = centred(n + m, &|i| if i < n { (0, i) } else { (3, i - n) });
    let Y = centred(n + p, &|i| if i < n { (1, i) } else { (2, i - n) });
    let theta = X.col_piv_qr().solve_lstsq(&Y); // (n+m) × (n+p)
    let residual = &Y - &X * &theta;
    let largest = |part: usize, i: usize| all.iter().fold(0.0_f64, |m, s| m.max(s[part][i].abs()));
    (0..n + p).all(|i| {
        let own = if i < n { largest(1, i) } else { largest(2, i - n) };
        let at = |j: usize| if j < n { largest(0, j) } else { largest(3, j - n) };
        let size = own + (0..n + m).map(|j| theta[(j, i)].abs() * at(j)).sum::<f64>();
        residual.col(i).iter().all(|r| r.abs() <= tol::TRAJECTORY * size)
    })
}

/// target - (A x + B u + offset), into `out`.
fn residual(
    [A, B, offset]: [&[f64]; 3],
    x: &[f64],
    u: impl Fn(usize) -> f64,
    target: impl Fn(usize) -> f64,
    out: &mut [f64],
) {
    let m = B.len() / out.len();
    for (i, out) in out.iter_mut().enumerate() {
        let row = &A[i * x.len()..(i + 1) * x.len()];
        *out = target(i) - offset[i] - row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
        *out -= (0..m).map(|j| B[i * m + j] * u(j)).sum::<f64>();
    }
}

/// Smallest and largest singular value.
fn extremes(U: &Mat<f64>) -> Option<(f64, f64)> {
    let sigma = U.singular_values().ok()?;
    Some((*sigma.last()?, *sigma.first()?))
}

/// ‖U x‖.
fn norm(U: &Mat<f64>, x: &[f64]) -> f64 {
    (0..U.nrows())
        .map(|i| x.iter().enumerate().map(|(j, v)| U[(i, j)] * v).sum::<f64>().powi(2))
        .sum::<f64>()
        .sqrt()
}
