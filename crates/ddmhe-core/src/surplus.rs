//! Exact spaces with more directions than the cost sees, once bounds are active: first the cost,
//! then the least norm.
//!
//! Among the windows within the bounds let those of least cost (17) be found first, then the
//! shortest α among them. In the coordinates z of [`ddmhe_run`] the two do not meet:
//! with K an orthonormal basis of what the cost does not see (K = Q_Gᵀ of [F; G] = Q R), the cost
//! is ‖z - z*‖² across K, and ‖α‖² is ‖Kᵀz‖² and a number that what the cost sees determines.
//! Without active bounds Kᵀz = Kᵀz* = 0 serves both.
//!
//! *First stage.* The proximal point method: minimise the cost + δ²‖Kᵀz - y‖², set y to Kᵀz, and
//! again until y stays. Each is a least-distance problem with the same rows, so that the active
//! bounds and their factor stay. What remains of the second term's gradient in the end, δ² times
//! the last change of y, is all that the answer lacks of the least cost.
//!
//! *Second stage.* What the cost sees is fixed now; minimise ‖y‖² for z = z_1 + K y within the
//! bounds, from y = 0. Where the first answer stands on a bound or, by rounding, beyond it, the
//! bound is moved to where it stands.

use crate::own::{OwnRows, OwnSet};
use crate::tol;
use ddmhe_run::Status;
use ddmhe_run::active_set::{Erased, Rows, Trust, Windows, WorkingSet, work_len};
use ddmhe_run::fallback::{Fallback, decide_erased};
use ddmhe_run::panels::padded;
use faer::Mat;

/// What the two stages need beside the problem of one depth.
pub(crate) struct Surplus {
    K: Mat<f64>,     // r × q
    stretch: f64,    // 1/δ
    first: OwnRows,  // of A (I + (1/δ - 1) K Kᵀ)
    second: OwnRows, // of A K
}

/// z = (I + (1/δ - 1) K Kᵀ) ζ.
struct Stretched<'a> {
    surplus: &'a Surplus,
    windows: &'a dyn Windows,
}

/// A K y.
struct Unseen<'a> {
    surplus: &'a Surplus,
    windows: &'a dyn Windows,
    seen: &'a [f64], // z_1
    base: &'a [f64], // its window
}

impl Windows for Stretched<'_> {
    fn window(&self, zeta: &[f64], window: &mut [f64]) {
        self.windows.window(&self.surplus.stretched(zeta, self.surplus.stretch), window);
    }

    fn erased(&self) -> &dyn Windows {
        self
    }
}

impl Windows for Unseen<'_> {
    fn window(&self, y: &[f64], window: &mut [f64]) {
        self.windows.window(&self.surplus.moved(self.seen, y), window);
        window.iter_mut().zip(self.base).for_each(|(w, base)| *w -= base);
    }

    fn erased(&self) -> &dyn Windows {
        self
    }
}

impl Surplus {
    /// From the rows of the window and K.
    pub fn new(rows: &Rows<'_>, K: Mat<f64>) -> Self {
        let (len, r) = (rows.len(), rows.r);
        let A = Mat::from_fn(len, r, |i, j| rows.entry(i, j));
        let AK = &A * &K;
        let across = &A - &AK * K.transpose();
        // both of the same size in units of the rows, then δ
        let size = |M: &Mat<f64>| {
            let row = |i: usize| M.row(i).squared_norm_l2() / rows.unit[i].powi(2);
            (0..len).filter(|&i| rows.unit[i] > 0.0).map(row).sum::<f64>().sqrt()
        };
        let ratio = size(&across) / size(&AK);
        let stretch = if ratio.is_finite() && ratio > 0.0 {
            ratio / tol::PROXIMAL
        } else {
            1.0 / tol::PROXIMAL
        };
        let all = &across + &AK * K.transpose() * faer::Scale(stretch);
        Surplus {
            first: OwnRows::new(all.as_ref(), rows.offset.to_vec(), rows.unit.to_vec()),
            second: OwnRows::new(AK.as_ref(), vec![0.0; len], rows.unit.to_vec()),
            K,
            stretch,
        }
    }

    /// Kᵀ z.
    fn unseen(&self, z: &[f64]) -> Vec<f64> {
        (0..self.K.ncols())
            .map(|k| z.iter().zip(0..).map(|(z, j)| self.K[(j, k)] * z).sum())
            .collect()
    }

    /// z + K y.
    fn moved(&self, z: &[f64], y: &[f64]) -> Vec<f64> {
        let along = |j: usize| y.iter().zip(0..).map(|(y, k)| self.K[(j, k)] * y).sum::<f64>();
        z.iter().zip(0..).map(|(z, j)| z + along(j)).collect()
    }

    /// z with its part along K times a factor.
    fn stretched(&self, z: &[f64], factor: f64) -> Vec<f64> {
        let y: Vec<f64> = self.unseen(z).iter().map(|y| (factor - 1.0) * y).collect();
        self.moved(z, &y)
    }

    /// The answer to a problem with the identity as Hessian, into z and w; the memory is that of
    /// the active-set method.
    #[cold]
    pub fn solve(
        &self,
        problem: &Erased<'_>,
        fallback: &impl Fallback,
        (kept, work): (&mut WorkingSet<'_>, &mut [f64]),
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Status, u32) {
        let (r, w) = (self.K.nrows(), &mut w[..problem.rows.len()]);
        let (first, mut iterations) = self.first_stage(problem, fallback, (kept, work), z, w);
        if !matches!(first, Status::Optimal | Status::AlmostOptimal) {
            z[..r].copy_from_slice(&problem.unconstrained[..r]);
            problem.windows.window(&z[..r], w);
            return (first, iterations);
        }
        let (second, more) = self.second_stage(problem, fallback, z, w);
        iterations += more;
        let optimal = first == Status::Optimal && second == Status::Optimal && problem.inside(w);
        (if optimal { Status::Optimal } else { Status::AlmostOptimal }, iterations)
    }

    /// A window of least cost.
    fn first_stage(
        &self,
        problem: &Erased<'_>,
        fallback: &impl Fallback,
        (kept, work): (&mut WorkingSet<'_>, &mut [f64]),
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Status, u32) {
        let r = self.K.nrows();
        let windows = Stretched { surplus: self, windows: problem.windows };
        let (mut y, mut iterations) = (vec![0.0; self.K.ncols()], 0);
        let (mut zeta, mut lacks) = (vec![0.0; padded(r)], f64::INFINITY);
        let mut free = zeta.clone();
        for _ in 0..tol::PROXIMAL_STEPS {
            let step: Vec<f64> = y.iter().map(|y| y / self.stretch).collect();
            free[..r].copy_from_slice(
                &self.moved(&self.stretched(&problem.unconstrained[..r], 0.0), &step),
            );
            let Erased { lo, hi, .. } = *problem;
            let near = Erased {
                rows: self.first.rows(),
                lo,
                hi,
                unconstrained: &free,
                hessian_factor: None,
                windows: &windows,
                trust: Trust::CERTAIN,
                prices: problem.prices,
            };
            let (status, changes) = decide_erased(&near, fallback, (kept, work), &mut zeta, w);
            iterations += changes;
            if !matches!(status, Status::Optimal | Status::AlmostOptimal) {
                return (status, iterations);
            }
            z[..r].copy_from_slice(&self.stretched(&zeta[..r], self.stretch));
            let next = self.unseen(&z[..r]);
            let change = next.iter().zip(&y).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let size = z[..r].iter().chain(&next).map(|z| z.abs()).fold(0.0, f64::max);
            y = next;
            if change <= tol::PROXIMAL_CHANGE * size || status != Status::Optimal {
                return (status, iterations);
            }
            lacks = change / (self.stretch * self.stretch * size);
        }
        // a price bends the cost a little where it does not see: y stays when nothing is lacking
        let lacks_nothing = problem.prices.is_some() && lacks <= tol::ACTIVE_SET;
        (if lacks_nothing { Status::Optimal } else { Status::AlmostOptimal }, iterations)
    }

    /// From a window of least cost in z and w to the one of least norm among them.
    fn second_stage(
        &self,
        problem: &Erased<'_>,
        fallback: &impl Fallback,
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Status, u32) {
        let (r, q) = self.K.shape();
        let back: Vec<f64> = self.unseen(&z[..r]).iter().map(|y| -y).collect();
        let seen = self.moved(&z[..r], &back);
        let mut base = vec![0.0; w.len()];
        problem.windows.window(&seen, &mut base);
        let distance = |bounds: &[f64], outer: fn(f64, f64) -> f64| -> Vec<f64> {
            (0..w.len()).map(|i| outer(bounds[i], w[i]) - base[i]).collect()
        };
        let (lo, hi) = (distance(problem.lo, f64::min), distance(problem.hi, f64::max));
        let windows = Unseen { surplus: self, windows: problem.windows, seen: &seen, base: &base };
        let free = vec![0.0; padded(q)];
        let (mut y, mut moved) = (free.clone(), vec![0.0; w.len()]);
        let least = Erased {
            rows: self.second.rows(),
            lo: &lo,
            hi: &hi,
            unconstrained: &free,
            hessian_factor: None,
            windows: &windows,
            trust: Trust::CERTAIN,
            prices: None,
        };
        let (mut set, mut memory) = (OwnSet::new(q), vec![0.0; work_len(q)]);
        let room = (&mut set.working(), &mut memory[..]);
        let (status, changes) = decide_erased(&least, fallback, room, &mut y, &mut moved);
        if matches!(status, Status::Optimal | Status::AlmostOptimal) {
            z[..r].copy_from_slice(&self.moved(&seen, &y[..q]));
            problem.windows.window(&z[..r], w);
        }
        (status, changes)
    }
}
