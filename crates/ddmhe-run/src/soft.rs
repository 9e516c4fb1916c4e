//! What a window pays for leaving its bounds.

use crate::prices::RowPrices;
use crate::problem::{Scratch, Spared, WindowProblem};
use crate::tol;

impl WindowProblem<'_> {
    /// What the window in the scratch pays, in the units of the cost, and how many of its bounds
    /// hold or are left.
    pub(crate) fn paid(&self, prices: RowPrices, s: &mut Scratch<'_>) -> (f64, usize) {
        let (mut paid, mut active) = (0.0, 0);
        let Spared { lo, hi, .. } = s.spare.parts();
        let rows = s.window.iter().zip(lo).zip(hi).zip(self.rows.unit);
        for (row, (((w, lo), hi), unit)) in rows.enumerate() {
            let outside = (*lo - w).max(w - *hi);
            active += usize::from(outside >= -tol::ACTIVE_SET * unit);
            // what is closer is on its bound, up to rounding
            if outside > tol::FEASIBLE * unit && prices.of(row) > 0.0 {
                let e = outside / unit;
                paid += prices.of(row) * (e + e * e);
            }
        }
        (self.shared.unit * paid, active)
    }
}
