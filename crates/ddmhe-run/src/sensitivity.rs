//! What one window's problem says of its own minimum, and, where outputs were lost, how its answer
//! depends on x̄ and on the newest output.

use crate::active_set::solve_lower;
use crate::evidence::{Minimum, OfDepth};
use crate::panels::dot;
use crate::problem::{Data, Scratch, Spared, WindowProblem, WindowSolution};
use crate::reweight::reduced;

/// Where the maps of a window with lost outputs are, in numbers of [`sensitivity_len`].
#[derive(Debug)]
pub(crate) struct Sensitivity<'a> {
    /// Φ (n × n).
    pub carry: &'a mut [f64],
    /// Covariance of x̂(t) where the cost is -2 log of the likelihood (n × n).
    pub covariance: &'a mut [f64],
    /// What that is with all outputs.
    pub usual: &'a mut [f64],
    /// H_nn (p × p).
    pub newest: &'a mut [f64],
    /// What x̄ makes of the newest output (p × n).
    pub of_prior: &'a mut [f64],
    columns: &'a mut [f64], // L⁻¹ of the rows of x̂(t), x̂(t-m) and the newest output
}

/// Numbers for windows of n states, p outputs and up to r directions.
pub(crate) fn sensitivity_len(n: usize, p: usize, r: usize) -> usize {
    3 * n * n + p * p + p * n + ((2 * n + p) * r).max(p * p + p * n)
}

impl<'a> Sensitivity<'a> {
    /// The same as those of a depth, for a unit of the cost of V₀ over the number of outputs:
    /// (I - H_nn)⁻¹ takes the place of H_nn.
    pub fn into_depth(self, full: &OfDepth<'a>, unit: f64) -> OfDepth<'a> {
        let Sensitivity { carry, covariance, usual, newest, of_prior, columns } = self;
        for ((own, usual), error) in covariance.iter_mut().zip(&*usual).zip(full.error) {
            *own = error + unit * (*own - usual);
        }
        let p = full.innovation.len();
        let n = of_prior.len() / p;
        let (deleted, carried) = columns.split_at_mut(p * p);
        invert_rest(newest, p, deleted);
        for k in 0..p * n {
            let along = |l: usize| deleted[k / n * p + l] * of_prior[l * n + k % n];
            carried[k] = (0..p).map(along).sum();
        }
        OfDepth { carry, error: covariance, deleted, of_prior: &carried[..p * n], ..*full }
    }

    pub fn new([n, p]: [usize; 2], room: &'a mut [f64]) -> Self {
        let (carry, room) = room.split_at_mut(n * n);
        let (covariance, room) = room.split_at_mut(n * n);
        let (usual, room) = room.split_at_mut(n * n);
        let (newest, room) = room.split_at_mut(p * p);
        let (of_prior, columns) = room.split_at_mut(p * n);
        Sensitivity { carry, covariance, usual, newest, of_prior, columns }
    }
}

/// (I - H)⁻¹ (p × p) into `out`, by Gauss and Jordan: of a positive semidefinite H below 1 no pivot
/// is 0.
fn invert_rest(H: &mut [f64], p: usize, out: &mut [f64]) {
    for k in 0..p * p {
        let one = if k / p == k % p { 1.0 } else { 0.0 };
        (H[k], out[k]) = (one - H[k], one);
    }
    for i in 0..p {
        let pivot = 1.0 / H[i * p + i];
        for j in 0..p {
            (H[i * p + j], out[i * p + j]) = (H[i * p + j] * pivot, out[i * p + j] * pivot);
        }
        for row in (0..p).filter(|&row| row != i) {
            let part = H[row * p + i];
            for j in 0..p {
                H[row * p + j] -= part * H[i * p + j];
                out[row * p + j] -= part * out[i * p + j];
            }
        }
    }
}

impl WindowProblem<'_> {
    /// V of the window in the scratch, which is the minimum of its problem, with fitted noise v.
    #[inline(always)]
    pub(crate) fn judge(
        &self,
        data: &Data<'_>,
        s: &mut Scratch<'_>,
        v: &[f64],
        found: &WindowSolution,
    ) -> Minimum {
        let reweighted = data.is_reweighted() && !found.filtered;
        if reweighted {
            self.sensitivities(data, s, found.downdated);
        }
        // Fᵀ(f - F b) = λ b at the minimum, so fᵀ(f - F b) = J + λ‖b‖²
        let value = match self.depth.kind.penalised {
            false => found.cost,
            true => self.inner(data, s, v) + self.beyond(s, found),
        };
        Minimum { value, reweighted }
    }

    /// fᵀ(f - F b), of weighted data and residuals.
    #[inline(always)]
    fn inner(&self, data: &Data<'_>, s: &mut Scratch<'_>, v: &[f64]) -> f64 {
        let Some(known) = &self.shared.evidence else { return 0.0 };
        let (layout, offset) = (self.depth.layout, self.rows.offset);
        let y = data.outputs.iter().zip(&offset[layout.split()..]).map(|(y, c)| y - c);
        let prior = self.inner_of_prior(data, s);
        let weights = known.weights.len().checked_sub(v.len());
        let outputs = match weights {
            Some(first) if !known.weights.is_empty() => {
                let mut sums = [0.0; 4];
                let entries = y.zip(v).zip(&known.weights[first..]);
                for (k, ((y, v), weight)) in entries.enumerate() {
                    let part = weight * y * v;
                    sums[k % 4] += if data.missing && part.is_nan() { 0.0 } else { part };
                }
                (sums[0] + sums[1]) + (sums[2] + sums[3])
            }
            _ => self.inner_of_outputs(data, s, v),
        };
        prior + outputs
    }

    /// The part of x̄.
    #[inline(always)]
    fn inner_of_prior(&self, data: &Data<'_>, s: &mut Scratch<'_>) -> f64 {
        let (n, per_s_x) = (data.prior.len(), self.shared.per_s_x);
        let (U, weight) = (self.prior, self.depth.prior_weight);
        let given = |i: usize| data.prior[i] - self.rows.offset[i] * per_s_x[i];
        let left = |i: usize| data.prior[i] - s.window[i] * per_s_x[i];
        if self.depth.kind.plain_prior {
            return weight * (0..n).map(|i| U[i] * U[i] * given(i) * left(i)).sum::<f64>();
        }
        let along = |row: &[f64], of: &dyn Fn(usize) -> f64| -> f64 {
            row.iter().enumerate().map(|(i, u)| u * of(i)).sum()
        };
        weight * U.chunks_exact(n).map(|row| along(row, &given) * along(row, &left)).sum::<f64>()
    }

    /// The part of the outputs, for a certificate's R.
    #[cold]
    fn inner_of_outputs(&self, data: &Data<'_>, s: &mut Scratch<'_>, v: &[f64]) -> f64 {
        let (p, s_y, first) = (self.depth.layout.p, self.shared.s_y, self.depth.layout.split());
        let block = &mut s.spare.parts().block[..p * p];
        let mut sum = 0.0;
        for (k, (y, v)) in data.outputs.chunks_exact(p).zip(v.chunks_exact(p)).enumerate() {
            reduced(self.shared.R, p, |i| v[i].is_finite(), block);
            let c = &self.rows.offset[first + k * p..];
            let mut own = 0.0;
            for (i, j) in (0..p * p).map(|e| (e / p, e % p)) {
                if v[i].is_finite() && v[j].is_finite() {
                    own += block[i * p + j] * (y[i] - c[i]) * v[j] / s_y[j];
                }
            }
            sum = self.shared.rho * sum + own;
        }
        self.shared.unit * sum
    }

    /// zᵀH(z - z*): what active bounds add to it.
    #[inline(always)]
    fn beyond(&self, s: &mut Scratch<'_>, found: &WindowSolution) -> f64 {
        if !found.constrained {
            return 0.0;
        }
        let r = self.depth.rank;
        let Spared { z, hessian_factor, .. } = s.spare.parts();
        let (z, free) = (&z[..r], &s.unconstrained[..r]);
        let moved = |i: usize| z[i] - free[i];
        if !found.downdated {
            return self.shared.unit * (0..r).map(|i| z[i] * moved(i)).sum::<f64>();
        }
        // H = L Lᵀ
        let (L, stride) = (&*hessian_factor, self.rows.stride());
        let column = |j: usize, of: &dyn Fn(usize) -> f64| -> f64 {
            (j..r).map(|i| L[i * stride + j] * of(i)).sum()
        };
        let along = |j: usize| column(j, &|i| z[i]) * column(j, &moved);
        self.shared.unit * (0..r).map(along).sum::<f64>()
    }

    /// The maps of this window's problem, whose Hessian is I, or L Lᵀ in the scratch.
    #[cold]
    #[inline(never)]
    fn sensitivities(&self, data: &Data<'_>, s: &mut Scratch<'_>, downdated: bool) {
        let (layout, r, shared) = (self.depth.layout, self.depth.rank, &self.shared);
        let (n, p) = (layout.n, layout.p);
        let Spared { sensitivity, hessian_factor, block, .. } = s.spare.parts();
        let own = Sensitivity::new([n, p], sensitivity);
        let newest = layout.split() + layout.outputs_len() - p;
        let rows = |k: usize| match k {
            k if k < n => layout.depth * n + k,
            k if k < 2 * n => k - n,
            k => newest + k - 2 * n,
        };
        for k in 0..2 * n + p {
            let column = &mut own.columns[k * r..(k + 1) * r];
            column.iter_mut().enumerate().for_each(|(j, to)| *to = self.rows.entry(rows(k), j));
        }
        for k in 0..n * n {
            let [a, b] = [k / n, k % n].map(|i| &own.columns[i * r..(i + 1) * r]);
            own.usual[k] = dot(a, b);
        }
        if downdated {
            let stride = self.rows.stride();
            let columns = own.columns[..(2 * n + p) * r].chunks_exact_mut(r);
            columns.for_each(|column| solve_lower(hessian_factor, column, stride));
        }
        let product = |a: usize, b: usize| {
            dot(&own.columns[a * r..(a + 1) * r], &own.columns[b * r..(b + 1) * r])
        };
        (0..n * n).for_each(|k| own.covariance[k] = product(k / n, k % n));
        // from an error of x̄ in the user's units
        let scale = self.depth.prior_weight / shared.unit;
        let weight = |i: usize, j: usize| {
            let square = match self.depth.kind.plain_prior {
                true if i == j => self.prior[i] * self.prior[i],
                true => 0.0,
                false => (0..n).map(|k| self.prior[k * n + i] * self.prior[k * n + j]).sum(),
            };
            // the rows of x̂(t-m) are in the user's units
            scale * square * shared.per_s_x[i] * shared.per_s_x[j]
        };
        let by_prior =
            |row: usize, j: usize| (0..n).map(|i| product(row, n + i) * weight(i, j)).sum::<f64>();
        (0..n * n).for_each(|k| own.carry[k] = by_prior(k / n, k % n));
        for k in 0..p * n {
            own.of_prior[k] = by_prior(2 * n + k / n, k % n) * shared.s_y[k / n];
        }
        let y = &data.outputs[layout.outputs_len() - p..];
        reduced(shared.R, p, |i| y[i].is_finite(), &mut block[..p * p]);
        for (i, j) in (0..p * p).map(|k| (k / p, k % p)) {
            let by = |l: usize| product(2 * n + i, 2 * n + l) * block[l * p + j];
            own.newest[i * p + j] = (0..p).map(by).sum::<f64>() * shared.s_y[i] / shared.s_y[j];
        }
    }
}
