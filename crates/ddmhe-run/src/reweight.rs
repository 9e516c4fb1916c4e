//! Outputs that count for less than they were prepared for: those that were not measured.
//!
//! Without the rows J of the cost the Hessian is I - Σ A_kᵀ D_k A_k over the samples k with a
//! missing entry, D_k what their weight loses: an r × r matrix, factored at the step instead of the
//! whole problem.

use crate::active_set::factor::{cholesky, solve_lower, solve_transposed};
use crate::active_set::rows::Rows;
use crate::plan::common::Shared;
use crate::problem::{Data, Scratch, Spared, WindowProblem};
use crate::tol;

/// The weight R of one sample (p × p, by rows, into `out`) without the channels that were not
/// measured: these are free to be anything, so what is left for the others is the Schur complement
/// of their block, and zeros.
pub fn reduced(R: &[f64], p: usize, measured: impl Fn(usize) -> bool, out: &mut [f64]) {
    out.copy_from_slice(R);
    for q in (0..p).filter(|&q| !measured(q)) {
        let pivot = out[q * p + q];
        for i in (0..p).filter(|&i| i != q) {
            let part = out[i * p + q] / pivot;
            (0..p).for_each(|j| out[i * p + j] -= part * out[q * p + j]);
        }
        (0..p).for_each(|i| (out[i * p + q], out[q * p + i]) = (0.0, 0.0));
    }
}

/// What the weight of y(t-j), j = `age`, loses (p × p, by rows, into `out`) with the channels that
/// were not measured.
fn lost(shared: &Shared<'_>, age: usize, measured: impl Fn(usize) -> bool, out: &mut [f64]) {
    let discount = shared.discount[age - 1];
    reduced(shared.R, shared.sizes.p, measured, out);
    out.iter_mut().zip(shared.R).for_each(|(r, R)| *r = discount * (R - *r));
}

impl WindowProblem<'_> {
    /// z* without the outputs that were not measured: true with the factor of the Hessian in the
    /// scratch, false where the problem was made for these outputs. None where the downdate would
    /// lose too many digits.
    #[inline(always)]
    pub(crate) fn without_missing(&self, data: &Data<'_>, s: &mut Scratch<'_>) -> Option<bool> {
        let (layout, r, rows) = (self.depth.layout, self.depth.rank, &self.rows);
        let (stride, first) = (rows.stride(), layout.split());
        let Spared { outputs, hessian_factor, block, .. } = s.spare.parts();
        let y = &mut outputs[..layout.outputs_len()];
        // the mean window in the place of what is missing: it adds nothing to K ([x̄; y] - c)
        for ((y, measured), c) in y.iter_mut().zip(data.outputs).zip(&rows.offset[first..]) {
            *y = if measured.is_finite() { *measured } else { *c };
        }
        self.minimiser(data.prior, y, s.unconstrained);
        if self.depth.kind.for_pattern {
            return Some(false);
        }
        if self.depth.kind.centered {
            return None;
        }
        let L = &mut hessian_factor[..r * stride];
        L.fill(0.0);
        (0..r).for_each(|i| L[i * stride + i] = 1.0);
        self.downdate(data, rows, y, (block, L, s.unconstrained));
        if let Some(lacking) = data.lacking {
            self.downdate_prior(data, lacking, (L, s.unconstrained));
        }
        cholesky(L, r, stride, tol::DOWNDATE)?;
        // z* = L⁻ᵀ L⁻¹ (K ([x̄; y] - c) - …)
        let z = &mut s.unconstrained[..r];
        solve_lower(L, z, stride);
        solve_transposed(L, z, stride);
        Some(true)
    }

    /// Takes what the prior's weight lacks (n × n) out of the Hessian and of the right-hand side.
    fn downdate_prior(&self, data: &Data<'_>, lacking: &[f64], (L, z): (&mut [f64], &mut [f64])) {
        let (n, r, rows) = (self.depth.layout.n, self.depth.rank, &self.rows);
        let (stride, per_s) = (rows.stride(), self.shared.per_s_x);
        for (i, j) in (0..n * n).map(|e| (e / n, e % n)) {
            let lost = lacking[i * n + j] * per_s[i] * per_s[j];
            let known = lost * (data.prior[j] * self.shared.s_x[j] - rows.offset[j]);
            for row in 0..r {
                let a_row = rows.entry(i, row);
                z[row] -= a_row * known;
                (0..=row).for_each(|column| {
                    L[row * stride + column] -= lost * a_row * rows.entry(j, column);
                });
            }
        }
    }

    /// Takes what is missing out of the Hessian (lower triangle) and of the right-hand side.
    #[inline(always)]
    fn downdate(
        &self,
        data: &Data<'_>,
        rows: &Rows<'_>,
        y: &[f64],
        (block, L, z): (&mut [f64], &mut [f64], &mut [f64]),
    ) {
        let (p, m) = (self.depth.layout.p, self.depth.layout.depth);
        let (r, stride, first) = (self.depth.rank, rows.stride(), self.depth.layout.split());
        let gap = |k: &usize| data.outputs[k * p..(k + 1) * p].iter().any(|y| y.is_nan());
        for k in (0..m).filter(gap) {
            let measured = |i: usize| data.outputs[k * p + i].is_finite();
            lost(&self.shared, m - k, measured, &mut block[..p * p]);
            for (i, j) in (0..p * p).map(|e| (e / p, e % p)) {
                let (lost, a, b) = (block[i * p + j], first + k * p + i, first + k * p + j);
                if lost == 0.0 {
                    continue;
                }
                let known = lost * (y[k * p + j] - rows.offset[b]);
                for row in 0..r {
                    let a_row = rows.entry(a, row);
                    z[row] -= a_row * known;
                    (0..=row).for_each(|column| {
                        L[row * stride + column] -= lost * a_row * rows.entry(b, column);
                    });
                }
            }
        }
    }
}
