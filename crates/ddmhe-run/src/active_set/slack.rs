//! What a row that may be left is to the least-distance problem: see [`priced`](super::priced).

use crate::active_set::factor::Work;
use crate::active_set::problem::{LeastDistance, Windows};
use crate::active_set::working_set::{ActiveBound, WorkingSet};
use crate::panels::Root;

/// What a row that may be left is to the problem.
#[derive(Debug, Clone, Copy)]
pub struct Slack {
    /// c, the largest multiplier at which the row is not left.
    pub cap: f64,
    /// κ.
    pub kappa: f64,
    /// h.
    pub floor: f64,
    /// e for each unit of σ.
    pub deviations: f64,
}

impl<W: Windows + ?Sized> LeastDistance<'_, W> {
    /// Of a row; None where its bounds are hard.
    #[inline(always)]
    pub fn slack(&self, row: usize) -> Option<Slack> {
        let price = self.prices.map_or(0.0, |prices| prices.of(row));
        if !(price > 0.0) {
            return None;
        }
        let (unit, root) = (self.rows.unit[row] * self.rows.inverse[row], price.root());
        let (cap, kappa) = (0.5 * price / unit, unit / root);
        Some(Slack { cap, kappa, floor: 0.5 * root, deviations: 1.0 / root })
    }

    /// Whether no multiplier of the active bounds that [`solve`](Self::solve) has left in `kept`,
    /// with its numbers in `memory`, is above what its price allows.
    #[cold]
    pub fn below_prices(&self, kept: &WorkingSet<'_>, memory: &mut [f64]) -> bool {
        let work = Work::new(memory, self.rows.r);
        let below = |(side, u): (ActiveBound, &f64)| match self.slack(side.row) {
            Some(slack) => *u <= slack.cap,
            None => true,
        };
        kept.sides.iter().zip(&*work.u).all(below)
    }
}
