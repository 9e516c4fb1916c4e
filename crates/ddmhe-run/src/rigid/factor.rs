//! The triangular factor of stacked rows, which are folded into it a few at a time: least squares
//! without normal equations, whose condition would be the square.

use crate::panels::Root;

/// R (N × N, upper triangular) and q (N): ‖R d - q‖ is ‖A d - e‖ of all rows [A | e] so far, but
/// for a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor<const N: usize> {
    /// R, 0 below its diagonal.
    pub R: [[f64; N]; N],
    /// q.
    pub q: [f64; N],
}

impl<const N: usize> Factor<N> {
    /// Of no row.
    pub const EMPTY: Self = Factor { R: [[0.0; N]; N], q: [0.0; N] };

    /// Takes in rows a and right sides e, by one reflection a column. All columns are gone through
    /// for each, also those before it, which are 0: so many at once are what vector units do.
    #[inline(always)]
    pub fn fold(&mut self, a: &mut [[f64; N]], e: &mut [f64]) {
        for j in 0..N {
            let below: f64 = a.iter().map(|row| row[j] * row[j]).sum();
            if below == 0.0 {
                continue;
            }
            let own = self.R[j][j];
            let length = (own * own + below).root();
            let beta = if own > 0.0 { -length } else { length };
            let (scale, tau) = (1.0 / (own - beta), (beta - own) / beta);
            let (mut sum, mut right) = (self.R[j], self.q[j]);
            for (row, e) in a.iter_mut().zip(e.iter()) {
                let v = row[j] * scale;
                sum.iter_mut().zip(row.iter()).for_each(|(sum, entry)| *sum += v * entry);
                right += v * e;
                row[j] = v;
            }
            self.R[j].iter_mut().zip(&sum).for_each(|(own, sum)| *own -= tau * sum);
            self.R[j][j] = beta;
            self.q[j] -= tau * right;
            for (row, e) in a.iter_mut().zip(e.iter_mut()) {
                let v = tau * row[j];
                row.iter_mut().zip(&sum).for_each(|(entry, sum)| *entry -= v * sum);
                *e -= v * right;
                row[j] = 0.0;
            }
        }
    }

    /// Squared lengths of R's columns.
    pub fn lengths(&self) -> [f64; N] {
        let mut lengths = [0.0; N];
        for row in &self.R {
            lengths.iter_mut().zip(row).for_each(|(sum, v)| *sum += v * v);
        }
        lengths
    }

    /// The factor of ‖R d - q‖² + ‖weight · diag(√lengths) d‖².
    pub fn damped(&self, lengths: &[f64; N], weight: f64) -> Self {
        const ROWS: usize = 4;
        let mut damped = *self;
        for from in (0..N).step_by(ROWS) {
            let (mut rows, mut right) = ([[0.0; N]; ROWS], [0.0; ROWS]);
            let count = ROWS.min(N - from);
            (0..count).for_each(|i| rows[i][from + i] = weight * lengths[from + i].root());
            damped.fold(&mut rows[..count], &mut right[..count]);
        }
        damped
    }

    /// R⁻¹ q.
    pub fn solve(&self) -> [f64; N] {
        let mut d = self.q;
        for i in (0..N).rev() {
            let known: f64 = (i + 1..N).map(|k| self.R[i][k] * d[k]).sum();
            d[i] = (d[i] - known) / self.R[i][i];
        }
        d
    }

    /// R⁻¹ (upper triangular).
    pub fn inverse(&self) -> [[f64; N]; N] {
        let mut out = [[0.0; N]; N];
        for i in (0..N).rev() {
            let mut row = [0.0; N];
            row[i] = 1.0;
            for (k, below) in out.iter().enumerate().skip(i + 1) {
                let by = self.R[i][k];
                (k..N).for_each(|j| row[j] -= by * below[j]);
            }
            let own = 1.0 / self.R[i][i];
            out[i] = row.map(|v| v * own);
        }
        out
    }

    /// Σ log |R_ii|
    pub fn log_determinant(&self) -> f64 {
        (0..N).map(|i| libm::log(self.R[i][i].abs())).sum()
    }
}
