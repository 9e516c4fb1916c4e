//! The optimisation (16), (17) over the windows of one depth, reduced and factored.
//!
//! With the space w = c + B b of [`space`], everything in scaled units, and F the rows of B that the
//! cost (17) sees (x(0) and all y), each times the square root of its weight,
//!
//! > minimise ‖F b - f‖² + λ‖b‖²,  f = weighted [x̄(t-m) - c_x(0);  y - c_y]
//! > subject to  lo ≤ c + B b ≤ hi  (x rows: X of (16c);  y rows: y - V of (16d)).
//!
//! [F; √λ I] = Q R gives the unconstrained minimiser b* = K [x̄ - c_x(0); y - c_y] with a gain K known at construction.
//! When it satisfies every bound it is the answer. Otherwise t = R (b - b*) turns the rest into the
//! least-distance problem of [`qp`] with A = B R⁻¹.

use crate::config::Bounds;
use crate::qp::{LeastDistance, Status};
use crate::space::{Scaling, TrajectorySpace};
use crate::tol;
use crate::weights::Weights;
use faer::linalg::solvers::SvdError;
use faer::{Mat, MatRef};

/// Rows of the interleaved window: where x(k) and y(k) are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows {
    pub n: usize,
    pub p: usize,
    pub depth: usize,
}

impl Rows {
    pub fn x(self, k: usize) -> std::ops::Range<usize> {
        let start = k * (self.n + self.p);
        start..start + self.n
    }

    pub fn y(self, k: usize) -> std::ops::Range<usize> {
        let start = k * (self.n + self.p) + self.n;
        start..start + self.p
    }

    /// Rows that the cost sees, in the order of f: x(0), y(0), …, y(m-1).
    pub fn seen(self) -> impl Iterator<Item = usize> {
        self.x(0).chain((0..self.depth).flat_map(move |k| self.y(k)))
    }

    /// Number of rows d.
    pub fn len(self) -> usize {
        self.depth * (self.n + self.p) + self.n
    }

    /// Bounds on every row of the window, in scaled units, from boxes on the states (about `center`, if any) and on the noise of
    /// the scaled `outputs`; into lo and hi.
    pub fn limits(
        self,
        scaling: &Scaling,
        (x, center): (Option<&Bounds>, Option<&[f64]>),
        v: Option<&Bounds>,
        outputs: &[f64],
        (lo, hi): (&mut Vec<f64>, &mut Vec<f64>),
    ) {
        refill(lo, self.len(), f64::NEG_INFINITY);
        refill(hi, self.len(), f64::INFINITY);
        if let Some(bounds) = x {
            let len = bounds.lo.len();
            for (k, row) in (0..=self.depth).flat_map(|k| self.x(k)).enumerate() {
                let offset = center.map_or(0.0, |c| c[row]);
                lo[row] = offset + bounds.lo[k % len] / scaling.s_x;
                hi[row] = offset + bounds.hi[k % len] / scaling.s_x;
            }
        }
        if let Some(bounds) = v {
            // v = y - ŷ in [lo, hi]  ⇔  ŷ in [y - hi, y - lo]
            let measured =
                (0..self.depth).flat_map(|k| self.y(k)).zip(outputs).enumerate().filter(|(_, (_, y))| y.is_finite());
            for (k, (row, y)) in measured {
                lo[row] = y - bounds.hi[k % self.p] / scaling.s_y;
                hi[row] = y - bounds.lo[k % self.p] / scaling.s_y;
            }
        }
    }
}

/// Everything about one depth that depends only on the data.
pub(crate) struct WindowProblem {
    pub rows: Rows,
    pub space: TrajectorySpace,
    gain: Mat<f64>,           // K: r × (n + m p)
    center: Option<Mat<f64>>, // K_c: r × m p, x_c(t) of the experiment IV-A1
    least_distance: LeastDistance,
}

/// Vectors that are kept from step to step, so that none is allocated.
#[derive(Default)]
pub(crate) struct Scratch {
    pub f: Vec<f64>,      // prior and outputs
    pub lo: Vec<f64>,     // d
    pub hi: Vec<f64>,     // d
    pub window: Vec<f64>, // d, the answer in scaled units
    b: Vec<f64>,
}

/// How the answer of one window was found.
pub(crate) struct Found {
    pub status: Status,
    pub active: usize,
    pub iterations: u32,
}

impl WindowProblem {
    /// Factors the problem. `measured` (m·p, time-major) says which outputs exist; None: all of them.
    pub fn new(
        rows: Rows,
        space: TrajectorySpace,
        weights: &Weights,
        centered: bool,
        measured: Option<&[bool]>,
    ) -> Result<Self, SvdError> {
        let Rows { n, p, depth, .. } = rows;
        let all = vec![true; depth * p];
        let measured = measured.unwrap_or(&all);
        // √ of 2ρ^m P on the prior, of ρ^{j-1} R on y(t-j): the block of each sample with its first row in f
        let mut blocks = vec![(0, weights.prior(depth))];
        blocks.extend((0..depth).map(|k| (n + k * p, weights.noise(depth - k, &measured[k * p..(k + 1) * p]))));
        let seen: Vec<usize> = rows.seen().collect();
        let r = space.rank();
        let basis = Mat::from_fn(seen.len(), r, |i, j| space.basis[(seen[i], j)]);
        let mut F = Mat::zeros(seen.len(), r);
        for (first, W) in &blocks {
            F.subrows_mut(*first, W.nrows()).copy_from(W * basis.subrows(*first, W.nrows()));
        }
        let G = if space.lambda > 0.0 {
            Mat::from_fn(r, r, |i, j| if i == j { space.lambda.sqrt() } else { 0.0 })
        } else {
            least_norm(F.as_ref(), &space)?
        };
        let (K, R) = factor(F.as_ref(), G.as_ref());
        let mut gain = Mat::zeros(r, seen.len());
        for (first, W) in &blocks {
            gain.subcols_mut(*first, W.nrows()).copy_from(K.subcols(*first, W.nrows()) * W);
        }

        // A = B R⁻¹, from Rᵀ Aᵀ = Bᵀ
        let mut A_t = space.basis.transpose().to_owned();
        R.transpose().solve_lower_triangular_in_place(A_t.as_mut());
        let center =
            if centered { Some(center_gain(&space, &seen[n..], weights.mu(), |i| measured[i])?) } else { None };
        Ok(WindowProblem { rows, gain, center, least_distance: LeastDistance::new(A_t.transpose().to_owned()), space })
    }

    /// K's block from the prior to x(m): the map x̄(t-m) → x̂(t) with y = 0 (n × n).
    pub fn prior_to_estimate(&self) -> Mat<f64> {
        let last = self.rows.x(self.rows.depth);
        let n = self.rows.n;
        self.space.basis.as_ref().subrows(last.start, n) * self.gain.as_ref().subcols(0, n)
    }

    /// The whole window from coordinates b: c + B b.
    fn reconstruct(&self, b: &[f64], window: &mut Vec<f64>) {
        window.clone_from(&self.space.mean);
        for (j, &b_j) in b.iter().enumerate() {
            axpy(b_j, self.space.basis.col_as_slice(j), window);
        }
    }

    /// The unconstrained minimiser's window for f = [x̄; y] in scaled units; unmeasured y may be anything finite.
    fn unconstrained(&self, f: &[f64], b: &mut Vec<f64>, window: &mut Vec<f64>) {
        refill(b, self.space.rank(), 0.0);
        for (k, (row, value)) in self.rows.seen().zip(f).enumerate() {
            axpy(value - self.space.mean[row], self.gain.col_as_slice(k), b);
        }
        self.reconstruct(b, window);
    }

    /// x_c(t): the window that the recording alone associates with these outputs (m·p, scaled). Only for a centred problem.
    pub fn centre(&self, y: &[f64]) -> Option<Vec<f64>> {
        let center = self.center.as_ref()?;
        let mut b = vec![0.0; self.space.rank()];
        for (k, (row, value)) in self.rows.seen().skip(self.rows.n).zip(y).enumerate() {
            axpy(value - self.space.mean[row], center.col_as_slice(k), &mut b);
        }
        let mut window = Vec::new();
        self.reconstruct(&b, &mut window);
        Some(window)
    }

    /// The minimiser for `scratch.f` into `scratch.window`; if `bounded`, subject to lo ≤ window ≤ hi of the scratch (d each, scaled,
    /// infinite where there is no bound).
    pub fn solve(&mut self, scratch: &mut Scratch, bounded: bool) -> Found {
        let Scratch { f, lo, hi, window, b } = scratch;
        self.unconstrained(f, b, window);
        if !bounded {
            return Found { status: Status::Optimal, active: 0, iterations: 0 };
        }
        let inside = |(&w, (&l, &h)): (&f64, (&f64, &f64))| w >= l - tol::FEASIBLE && w <= h + tol::FEASIBLE;
        let (mut status, mut iterations) = (Status::Optimal, 0);
        if !window.iter().zip(lo.iter().zip(hi.iter())).all(inside) {
            let below: Vec<f64> = lo.iter().zip(window.iter()).map(|(l, w)| l - w).collect();
            let above: Vec<f64> = hi.iter().zip(window.iter()).map(|(h, w)| h - w).collect();
            let solution = self.least_distance.solve(&below, &above);
            (status, iterations) = (solution.status, solution.iterations);
            for (j, &t_j) in solution.t.iter().enumerate() {
                axpy(t_j, self.least_distance.matrix().col_as_slice(j), window);
            }
        }
        let touches = |w: f64, bound: f64| (w - bound).abs() <= tol::ACTIVE_SET;
        let active = window
            .iter()
            .zip(lo.iter().zip(hi.iter()))
            .filter(|&(&w, (&l, &h))| touches(w, l) || touches(w, h))
            .count();
        Found { status, active, iterations }
    }
}

/// `len` times the value, in the memory that is there.
fn refill(x: &mut Vec<f64>, len: usize, value: f64) {
    x.clear();
    x.resize(len, value);
}

/// y += a x.
fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Rows that single out the least-norm α among the minimisers when F does not determine b.
///
/// With Z a basis of the kernel of F and D = S/√N (b = D a), the shortest a satisfies Eᵀa = 0 for E an orthonormal basis of
/// D⁻¹Z. Minimising ‖F b‖ and Eᵀ D⁻¹ b do not compete (the kernel directions alone can satisfy the second), so a small
/// weight on the latter leaves the minimisers of (17) untouched and makes them unique.
fn least_norm(F: MatRef<'_, f64>, space: &TrajectorySpace) -> Result<Mat<f64>, SvdError> {
    let r = F.ncols();
    let svd = F.svd()?;
    let sigma: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let sigma_1 = sigma.first().copied().unwrap_or(0.0);
    let floor = tol::RANK_EPS * F.nrows().max(r) as f64 * sigma_1;
    let rank = sigma.iter().filter(|&&s| s > floor).count();
    if rank == r {
        return Ok(Mat::zeros(0, r));
    }
    let inverse_length = |i: usize| (space.windows as f64).sqrt() / space.singular_values[i];
    let V = svd.V();
    let DZ = Mat::from_fn(r, r - rank, |i, j| inverse_length(i) * V[(i, rank + j)]);
    let E = DZ.qr().compute_thin_Q();
    let mut G = Mat::from_fn(r - rank, r, |i, j| E[(j, i)] * inverse_length(j));
    let scale = tol::LEAST_NORM.sqrt() * sigma_1.max(f64::MIN_POSITIVE) / G.norm_max();
    G *= faer::Scale(scale);
    Ok(G)
}

/// K and R with [F; G] = Q R and K = R⁻¹ Q_Fᵀ, so that b* = K f.
fn factor(F: MatRef<'_, f64>, G: MatRef<'_, f64>) -> (Mat<f64>, Mat<f64>) {
    let r = F.ncols();
    let stacked =
        Mat::from_fn(F.nrows() + G.nrows(), r, |i, j| if i < F.nrows() { F[(i, j)] } else { G[(i - F.nrows(), j)] });
    let qr = stacked.qr();
    let R = qr.thin_R().to_owned();
    let mut K = qr.compute_thin_Q().subrows(0, F.nrows()).transpose().to_owned();
    R.solve_upper_triangular_in_place(K.as_mut());
    (K, R)
}

/// K_c with b = K_c (y - c_y): H_x H_y† of IV-A1 in affine form. The least-norm α whose outputs fit best; with a
/// regularised space, its weight relative to the outputs' (λ/μ) instead of the pseudo-inverse's cut at rounding.
fn center_gain(
    space: &TrajectorySpace,
    y_rows: &[usize],
    mu: f64,
    measured: impl Fn(usize) -> bool,
) -> Result<Mat<f64>, SvdError> {
    let r = space.rank();
    let length =
        |j: usize| if space.lambda > 0.0 { 1.0 } else { space.singular_values[j] / (space.windows as f64).sqrt() };
    let Y =
        Mat::from_fn(y_rows.len(), r, |i, j| if measured(i) { space.basis[(y_rows[i], j)] * length(j) } else { 0.0 });
    let svd = Y.thin_svd()?;
    let sigma = svd.S().column_vector();
    let k = sigma.nrows();
    let floor = if k > 0 { tol::RANK_EPS * r.max(y_rows.len()) as f64 * sigma[0] } else { 0.0 };
    let filter = |s: f64| if s > floor { s / (s * s + space.lambda / mu) } else { 0.0 };
    let (U, V) = (svd.U(), svd.V());
    let right = Mat::from_fn(r, k, |i, j| length(i) * V[(i, j)] * filter(sigma[j]));
    Ok(right * U.transpose())
}
