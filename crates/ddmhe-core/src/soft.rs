//! Bounds that may be left at a price: the setting, and its checks.

use crate::error::Error;
use crate::tol;
use ddmhe_run::Prices;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// What leaving a bound costs; a bound without a price is hard. A row that is left by e of its
/// channel's recorded deviations adds price · (e + e²) to the cost in scaled units: see
/// [`ddmhe_run::prices`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(default, deny_unknown_fields))]
pub struct Soft {
    /// Price of `x_bounds`, and of those of a step.
    pub x: Option<f64>,
    /// Price of `v_bounds`.
    pub v: Option<f64>,
    /// Price of `w_bounds`.
    pub w: Option<f64>,
}

impl Soft {
    /// One price for all bounds.
    pub fn all(price: f64) -> Self {
        Soft { x: Some(price), v: Some(price), w: Some(price) }
    }

    /// 0 for hard bounds, and for those on a disturbance that is not fitted.
    pub(crate) fn prices(self, driven: bool) -> Prices {
        let [x, v, w] = [self.x, self.v, self.w].map(|price| price.unwrap_or(0.0));
        Prices { x, v, w: if driven { w } else { 0.0 } }
    }

    /// Positive finite prices, at least one of bounds that there are; `bounded`: whether there are
    /// bounds on x, on v, on w.
    pub(crate) fn check(self, bounded: [bool; 3]) -> Result<(), Error> {
        let prices = [self.x, self.v, self.w];
        for price in prices.into_iter().flatten() {
            let (least, most) = tol::SIZES;
            if !(least..=most).contains(&price) {
                let expected = format!("a positive finite price, from {least:e} to {most:e}");
                return Err(Error::value("soft", expected, price));
            }
        }
        if !prices.iter().zip(bounded).any(|(price, bounded)| price.is_some() && bounded) {
            let expected = "bounds beside it that it is the price of leaving (x_bounds of ±inf \
            where only single steps have some)";
            return Err(Error::value("soft", expected, "none"));
        }
        Ok(())
    }
}
