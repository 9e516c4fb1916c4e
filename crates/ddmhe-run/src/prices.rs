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

/// Prices of leaving the bounds on each block of a window's rows; 0: they are hard.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Prices {
    /// Of a bound on a state.
    pub x: f64,
    /// Of a bound on the fitted noise.
    pub v: f64,
}

impl Prices {
    /// Whether any bound may be left.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.x > 0.0 || self.v > 0.0
    }

    /// Whether these are prices: finite, and not negative.
    pub fn valid(self) -> bool {
        [self.x, self.v].iter().all(|price| *price >= 0.0 && price.is_finite())
    }

    /// How many rows may be left, of blocks with so many: states, outputs.
    pub(crate) fn soft_rows(self, [x, v]: [usize; 2]) -> usize {
        let soft = |price: f64, rows: usize| if price > 0.0 { rows } else { 0 };
        soft(self.x, x) + soft(self.v, v)
    }

    /// Of each row of a window whose outputs begin at `split`; None where all bounds are hard.
    #[inline(always)]
    pub fn of_rows(self, split: usize) -> Option<RowPrices> {
        if self.any() { Some(RowPrices { split, prices: self }) } else { None }
    }
}

/// [`Prices`] by the rows of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowPrices {
    split: usize, // rows of the states, padded
    prices: Prices,
}

impl RowPrices {
    /// Of one row; 0: its bounds are hard.
    #[inline(always)]
    pub fn of(self, row: usize) -> f64 {
        if row < self.split { self.prices.x } else { self.prices.v }
    }
}
