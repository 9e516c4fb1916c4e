//! Prices of leaving bounds.
//!
//! Where a bound is soft, the cost of a window gets, for every row of it,
//!
//! > price (e + e²),  e = max(0, lo - w, w - hi) / the channel's own deviation
//!
//! in scaled units: deviations are those of the recording, so that a price means the same in any
//! unit. The linear part makes it exact: where the hard problem has a minimiser whose multipliers
//! stay below the price, that is the minimiser. The quadratic part makes it unique, and spreads
//! over the window what has to be exceeded. Where every bound is soft there always is a minimiser.

use crate::layout::Layout;

/// Prices of leaving the bounds on each block of a window's rows; 0: they are hard.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Prices {
    /// Of a bound on a state.
    pub x: f64,
    /// Of a bound on the fitted noise.
    pub v: f64,
    /// Of a bound on the fitted disturbance.
    pub w: f64,
}

impl Prices {
    /// Whether any bound may be left.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.x > 0.0 || self.v > 0.0 || self.w > 0.0
    }

    /// Whether these are prices: finite, and not negative.
    pub fn valid(self) -> bool {
        [self.x, self.v, self.w].iter().all(|price| *price >= 0.0 && price.is_finite())
    }

    /// How many rows of a window may be left.
    pub(crate) fn soft_rows(self, layout: Layout) -> usize {
        let soft = |price: f64, rows: usize| if price > 0.0 { rows } else { 0 };
        let (x, v) = (layout.split(), layout.second_split());
        soft(self.x, x) + soft(self.v, v - x) + soft(self.w, layout.apart() - v)
    }

    /// Of each row of a window; None where all bounds are hard.
    #[inline(always)]
    pub fn of_rows(self, layout: Layout) -> Option<RowPrices> {
        self.of_blocks([layout.split(), layout.second_split()])
    }

    /// The same where outputs and disturbances begin there.
    #[inline(always)]
    pub fn of_blocks(self, splits: [usize; 2]) -> Option<RowPrices> {
        if self.any() { Some(RowPrices { splits, prices: self }) } else { None }
    }
}

/// [`Prices`] by the rows of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowPrices {
    splits: [usize; 2], // where outputs and disturbances begin
    prices: Prices,
}

impl RowPrices {
    /// Of one row; 0: its bounds are hard.
    #[inline(always)]
    pub fn of(self, row: usize) -> f64 {
        let [outputs, disturbances] = self.splits;
        match row {
            row if row < outputs => self.prices.x,
            row if row < disturbances => self.prices.v,
            _ => self.prices.w,
        }
    }
}
