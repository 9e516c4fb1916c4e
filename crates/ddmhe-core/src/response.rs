//! The response to known inputs, identified from the recording: Θ of [`ddmhe_run::response`].
//!
//! > \[x(k+1); y(k)\] ≈ Θᵀ s(k),  s(k) = \[x(k); u(k); x(k-1); y(k-1); u(k-1); …\] of L instants
//!
//! over all steps of the recording, none across a seam, columns centred and each channel in units
//! of its own deviation; Θ = argmin Σ‖·‖² + γ N ‖Θ‖² with γ = min(1e-6, f₁/1000). At a misfit f₁ of
//! rounding γ = 0, and Θ is the one of least norm. The numbers are exact where eliminating u from
//! the windows (Willems' lemma with inputs) is exact, and need only rank n + m + 1 of \[x; u; 1\]
//! in the place of m M + n + 1 of the windows: u may be a sine, or leave its recorded range later.
//!
//! *L* is 1, or 2 where a second instant takes the misfit below [`SECOND`] of f₁: the recorded x is
//! then only part of the state. A second instant whose response grows beyond [`PEAK`] within the
//! horizon is not believed.

use crate::history::History;
use crate::linear_model::LinearModel;
use crate::scaling::{EXACT, Scaling};
use crate::variation::{Steps, centred, least_squares, left_by};
use ddmhe_run::panels::{padded, write_panels};
use ddmhe_run::response::{Response, ResponseSizes};

/// Largest γ, and γ/f₁.
const RIDGE: (f64, f64) = (1e-6, 1e-3);
/// A second instant has to take the misfit below this share of the first's.
const SECOND: f64 = 0.8;
/// Largest response of a state to one deviation of an input, in deviations of its own.
pub(crate) const PEAK: f64 = 100.0;

/// The response with numbers of its own, in scaled units.
#[derive(Debug, Clone)]
pub(crate) struct OwnResponse {
    sizes: ResponseSizes,
    theta: Vec<f64>, // Θᵀ in panels
    /// Largest response of a state to a pulse of one deviation within the horizon.
    pub peak: f64,
}

impl OwnResponse {
    /// Of windows up to `horizon`; None for a recording without inputs.
    pub fn new(history: &History, scaling: &Scaling, horizon: usize) -> Option<Self> {
        (history.m() > 0).then_some(())?;
        let larger = |[f_x, f_y]: [f64; 2]| f_x.max(f_y);
        let first = larger(scaling.misfit(&scaling.one_step));
        // without a degree of freedom every recording is fitted exactly
        let exact = first < EXACT || history.T() <= history.n() + history.m() + 1;
        let of_two = || larger(scaling.misfit(&left_by(history, 2, None)));
        let second = !exact && of_two() < SECOND * first;
        let ridge = if exact { 0.0 } else { RIDGE.0.min(RIDGE.1 * first) };
        let of_lag = |lag: usize| OwnResponse::of_lag(history, scaling, horizon, (lag, ridge));
        if second {
            return Some(of_lag(2)).filter(|found| found.peak <= PEAK).or_else(|| Some(of_lag(1)));
        }
        Some(of_lag(1))
    }

    /// That of a linear model, of one instant.
    pub fn of_model(model: &LinearModel, scaling: &Scaling, horizon: usize) -> Option<Self> {
        let LinearModel { A, B, C, D, .. } = model;
        let (n, p, m) = (A.nrows(), C.nrows(), B.ncols());
        (m > 0).then_some(())?;
        let sizes = ResponseSizes { n, p, m, lag: 1 };
        let entry = |i: usize, j: usize| match (i.checked_sub(n), j.checked_sub(n)) {
            (None, None) => A[(i, j)],
            (None, Some(j)) => B[(i, j)],
            (Some(i), None) => C[(i, j)],
            (Some(i), Some(j)) => D[(i, j)],
        };
        Some(OwnResponse::of(sizes, entry, scaling, horizon))
    }

    fn of_lag(
        history: &History,
        scaling: &Scaling,
        horizon: usize,
        (lag, ridge): (usize, f64),
    ) -> Self {
        let sizes = ResponseSizes { n: history.n(), p: history.p(), m: history.m(), lag };
        let Steps { regressors, targets } = Steps::new(history, lag);
        let mut X = centred(regressors);
        // an input that never moved says nothing of its effect: it has none
        let units = per_regressor(lag, [&scaling.unit_x, &scaling.unit_y, &scaling.unit_u]);
        let moved = per_regressor(lag, [&scaling.moved[0], &scaling.moved[1], &scaling.moved_u]);
        for (j, (unit, moved)) in units.iter().zip(moved).enumerate() {
            X.col_mut(j).iter_mut().for_each(|v| *v = if moved { *v / unit } else { 0.0 });
        }
        let theta = least_squares(&X, &centred(targets), ridge);
        // from deviations in units of each channel's own to those of the estimator
        let from = per_regressor(lag, [&scaling.s_x, &scaling.s_y, &scaling.unit_u]);
        let to: Vec<f64> = scaling.s_x.iter().chain(&scaling.s_y).copied().collect();
        let entry = |i: usize, j: usize| theta[(j, i)] * from[j] / units[j] / to[i];
        OwnResponse::of(sizes, entry, scaling, horizon)
    }

    /// Of the effects of each regressor on [x; y], in scaled units.
    fn of(
        sizes: ResponseSizes,
        entry: impl Fn(usize, usize) -> f64,
        scaling: &Scaling,
        horizon: usize,
    ) -> Self {
        let order = columns(sizes);
        let mut own = OwnResponse { sizes, theta: vec![0.0; sizes.panels_len()], peak: 0.0 };
        let entry = |i: usize, column: usize| entry(i, order[column]);
        write_panels((sizes.n + sizes.p, order.len()), entry, &mut own.theta);
        own.peak = own.largest_pulse(scaling, horizon);
        own
    }

    /// Of a state, in units of its deviation, to an input of one deviation at the first instant.
    fn largest_pulse(&self, scaling: &Scaling, horizon: usize) -> f64 {
        let ResponseSizes { n, m, .. } = self.sizes;
        let mut peak = 0.0_f64;
        for j in 0..m {
            let mut u = vec![0.0; horizon * m];
            u[j] = 1.0;
            let (x, _) = self.forced(&u);
            let own =
                |(k, x): (usize, &f64)| (x * scaling.s_x[k % n] / scaling.unit_x[k % n]).abs();
            peak = x.iter().enumerate().map(own).fold(peak, f64::max);
        }
        peak
    }

    /// x_f and y_f of a window with these inputs, all as scaled deviations.
    pub fn forced(&self, u: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let ResponseSizes { n, p, m, .. } = self.sizes;
        let depth = u.len() / m;
        let (mut x, mut y) = (vec![0.0; (depth + 1) * n], vec![0.0; depth * p]);
        let room = &mut vec![0.0; padded(n + p)];
        Response::new(self.sizes, &self.theta).forced(u, &mut x[n..], &mut y, room);
        (x, y)
    }

    /// Sizes.
    pub fn sizes(&self) -> ResponseSizes {
        self.sizes
    }

    /// Θᵀ in panels.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }
}

/// Values of the channels of x, y and u, for each regressor.
fn per_regressor<T: Copy>(lag: usize, [x, y, u]: [&[T]; 3]) -> Vec<T> {
    let now = x.iter().chain(u);
    let before = (1..lag).flat_map(|_| x.iter().chain(y).chain(u));
    now.chain(before).copied().collect()
}

/// For each column of Θᵀ, in the order of a step, its regressor: see
/// [`ddmhe_run::response::Response::new`].
fn columns(ResponseSizes { n, p, m, lag }: ResponseSizes) -> Vec<usize> {
    let (now, width) = (n + m, n + p + m);
    let before = (0..lag - 1).rev().flat_map(|j| now + j * width..now + (j + 1) * width);
    before.chain(n..now).chain(0..n).collect()
}
