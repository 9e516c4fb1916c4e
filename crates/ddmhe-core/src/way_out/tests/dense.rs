//! Windows by plain loops.

use ddmhe_run::active_set::Windows;
use faer::Mat;

/// c + A z with c = 0.
pub(crate) struct Dense(pub Mat<f64>);

impl Windows for Dense {
    fn window(&self, z: &[f64], w: &mut [f64]) {
        let A = &self.0;
        let along = |i: usize| z.iter().enumerate().map(|(j, z)| A[(i, j)] * z).sum();
        (0..A.nrows()).for_each(|i| w[i] = along(i));
    }
}
