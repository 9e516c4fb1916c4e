//! A zonotope cut by a strip: how far it reaches in a direction.

use crate::interval::Interval;
use crate::rounding::inflation;

/// Bounds of dᵀe over all e of ⟨0, M⟩ with aᵀe in `strip`; None if there is no such e.
///
/// One two-sided constraint leaves a linear programme whose dual has one variable: for every ν dᵀe
/// ≤ Σ|dᵀg - ν aᵀg| + max(ν strip), so whatever ν is found the bound holds; the best one is at a
/// kink dᵀg/aᵀg or at 0. `sums` are the row sums of |M|, rounded upward.
pub(crate) fn strip_range(
    columns: &[f64],
    sums: &[f64],
    d: &[f64],
    a: &[f64],
    strip: Interval,
) -> Option<Interval> {
    let n = d.len();
    let inner = |x: &[f64], g: &[f64]| x.iter().zip(g).map(|(x, g)| x * g).sum::<f64>();
    // what rounding may have taken from the images, summed over the generators; MIN_POSITIVE: below
    // the normal numbers
    let lost = |x: &[f64]| {
        let size: f64 = x.iter().zip(sums).map(|(x, s)| x.abs() * s).sum();
        (n as f64 + 2.0) * f64::EPSILON * size + f64::MIN_POSITIVE
    };
    let images = columns.chunks_exact(n).map(|g| (inner(d, g), inner(a, g))).collect();
    let cut = Images { images, lost: (lost(d), lost(a)), strip };
    let (lo, hi) = (-cut.upper(-1.0), cut.upper(1.0));
    // generators that have left all floats say nothing
    if lo.is_finite() && hi.is_finite() { Interval::new(lo, hi) } else { Some(Interval::ENTIRE) }
}

/// The generators as direction and strip see them.
struct Images {
    images: Vec<(f64, f64)>, // (dᵀg, aᵀg), one pair a generator
    lost: (f64, f64),        // by rounding, of either
    strip: Interval,
}

impl Images {
    /// max ±dᵀe, rounded upward.
    fn upper(&self, sign: f64) -> f64 {
        if !(self.strip.lo.is_finite() && self.strip.hi.is_finite()) {
            return self.bound(sign, 0.0);
        }
        let found = self.bound(sign, self.best(sign)).min(self.bound(sign, 0.0));
        found + 4.0 * f64::EPSILON * found.abs()
    }

    /// Σ|±dᵀg - ν aᵀg| + max(ν strip), rounded upward.
    fn bound(&self, sign: f64, nu: f64) -> f64 {
        let sum: f64 = self.images.iter().map(|(d, a)| (sign * d - nu * a).abs()).sum();
        let size: f64 = self.images.iter().map(|(d, a)| d.abs() + (nu * a).abs()).sum();
        let strip = if nu == 0.0 { 0.0 } else { (Interval::point(nu) * self.strip).hi };
        let rounding = self.lost.0 + nu.abs() * self.lost.1 + 4.0 * f64::EPSILON * size;
        (sum + rounding + strip.max(0.0)) * inflation(self.images.len()) + strip.min(0.0)
    }

    /// The ν of the smallest bound: where its slope turns positive.
    fn best(&self, sign: f64) -> f64 {
        let width = self.strip.hi - self.strip.lo;
        let mut kinks: Vec<(f64, f64)> = self
            .images
            .iter()
            .filter(|(_, a)| *a != 0.0)
            .map(|(d, a)| (sign * d / a, 2.0 * a.abs()))
            .filter(|(at, _)| at.is_finite())
            .collect();
        kinks.push((0.0, width));
        kinks.sort_unstable_by(|x, y| x.0.total_cmp(&y.0));
        let mut slope = self.strip.lo - kinks.iter().map(|k| k.1).sum::<f64>() / 2.0 + width / 2.0;
        for (at, change) in kinks {
            slope += change;
            if slope >= 0.0 {
                return at;
            }
        }
        0.0
    }
}
