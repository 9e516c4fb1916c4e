//! Windows by plain loops.

use crate::own::OwnRows;
use ddmhe_run::active_set::{Erased, Trust, Windows};
use faer::Mat;

/// c + A z with c = 0.
pub(crate) struct Dense(pub Mat<f64>);

impl Windows for Dense {
    fn window(&self, z: &[f64], w: &mut [f64]) {
        let A = &self.0;
        let along = |i: usize| z.iter().enumerate().map(|(j, z)| A[(i, j)] * z).sum();
        (0..A.nrows()).for_each(|i| w[i] = along(i));
    }

    fn erased(&self) -> &dyn Windows {
        self
    }
}

impl Dense {
    /// The nearest of these windows to that of z* within bounds; `rows` are those of A.
    pub fn problem<'a>(
        &'a self,
        rows: &'a OwnRows,
        lo: &'a [f64],
        hi: &'a [f64],
        unconstrained: &'a [f64],
    ) -> Erased<'a> {
        let (rows, trust) = (rows.rows(), Trust::CERTAIN);
        let (windows, hessian_factor, prices) = (self, None, None);
        Erased { rows, lo, hi, unconstrained, hessian_factor, windows, trust, prices }
    }
}
