//! What a step of the rigid body's estimator consumes.

use crate::check::check_finite;
use crate::config_checks::check_measured;
use crate::error::Error;

/// What is consumed: of one sample, or of a log (time-major).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Measured<'a> {
    /// y (p each), NaN = this entry was not measured.
    pub y: &'a [f64],
    /// Rates (3 each) that a sensor read at the instants of y, NaN = not measured.
    pub x: Option<&'a [f64]>,
    /// B (3 each) and K (p x 3 each) at those instants, for an estimator with a known field.
    pub field: Option<(&'a [f64], &'a [f64])>,
}

impl<'a> Measured<'a> {
    /// Sample k of a log of p outputs.
    pub(crate) fn at(&self, k: usize, p: usize) -> Self {
        let part = |of: &'a [f64], width: usize| &of[width * k..width * (k + 1)];
        Measured {
            y: part(self.y, p),
            x: self.x.map(|x| part(x, 3)),
            field: self.field.map(|(B, K)| (part(B, 3), part(K, 3 * p))),
        }
    }

    /// Whether rates and field of so many samples are as an estimator of n states and p outputs
    /// takes them, which has a field or none.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`], naming the rates by `of_x`.
    pub(crate) fn check(
        &self,
        of_x: &'static str,
        (n, p, has_field): (usize, usize, bool),
        count: usize,
    ) -> Result<(), Error> {
        if let Some(x) = self.x {
            if n != 3 {
                let expected = "no rates, beside a recording that is not of three";
                return Err(Error::shape(of_x, expected, x.len()));
            }
            if x.len() != 3 * count {
                return Err(Error::shape(of_x, format!("{} rates", 3 * count), x.len()));
            }
            check_measured(of_x, x, 3)?;
        }
        match (self.field, has_field) {
            (None, false) => Ok(()),
            (None, true) => {
                let expected = "B and K of each sample, as of the recording";
                Err(Error::shape("field", expected, "none"))
            }
            (Some(_), false) => {
                let expected = "none, as the estimator was made without one";
                Err(Error::shape("field", expected, "one"))
            }
            (Some((B, K)), true) => {
                let (b, k) = (3 * count, 3 * p * count);
                if (B.len(), K.len()) != (b, k) {
                    let expected = format!("B of {b} and K of {k} numbers");
                    let found = format!("{} and {}", B.len(), K.len());
                    return Err(Error::shape("field", expected, found));
                }
                check_finite("field", B, b)?;
                check_finite("field", K, k)
            }
        }
    }
}
