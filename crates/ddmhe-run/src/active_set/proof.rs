//! What shows that no window satisfies its bounds: a combination of them (Farkas).

use crate::active_set::factor::{Work, solve_lower};
use crate::active_set::problem::{LeastDistance, Windows};
use crate::active_set::working_set::{ActiveBound, Sides};
use crate::panels::{Root, axpy, dot};
use crate::tol;

/// A combination of sides with multipliers of at least 0: what [`LeastDistance::weigh`] adds up,
/// with the length of what is left of their normals. If that is rounding and the bounds add up to
/// more than what they are loosened by, nothing satisfies them all.
#[derive(Debug, Clone, Copy, Default)]
pub struct Combination {
    rest: f64,
    bounds: f64,
    size: f64,
    largest: f64,
    tolerance: f64,
    multipliers: f64,
}

impl Combination {
    /// Of no bounds yet, with normals of which so much is left.
    pub fn new(rest: f64) -> Self {
        Combination { rest, ..Combination::default() }
    }

    /// Whether nothing satisfies them all.
    pub fn proves(&self) -> bool {
        let parallel = self.rest <= tol::PARALLEL * self.multipliers;
        // what is left of the normals could make up for the bounds only this far away
        let reach = tol::REACH * self.largest * self.rest;
        parallel && self.bounds > self.tolerance + tol::PARALLEL * self.size + reach
    }
}

impl<W: Windows + ?Sized> LeastDistance<'_, W> {
    /// Whether n = N v with v ≤ 0 (in `back`) proves that no window is within the bounds: not even
    /// one that exceeds each of them by the tolerance of an optimal one, and after one refinement
    /// of v. See [`Combination`].
    #[cold]
    pub(super) fn proof(
        &self,
        side: ActiveBound,
        sides: &Sides<'_>,
        norm: f64,
        work: &mut Work<'_>,
    ) -> bool {
        let k = sides.len();
        for again in [true, false] {
            self.normal(side, work);
            for (j, other) in sides.iter().enumerate() {
                work.back[j] = work.back[j].min(0.0);
                self.add_normal(other, -work.back[j], work);
            }
            if again && k > 0 {
                work.t[..k].copy_from_slice(&work.back[..k]);
                work.split(k);
                work.solve_upper(k);
                work.back[..k].iter_mut().zip(&*work.t).for_each(|(back, v)| *back += v);
            }
        }
        let mut sum = Combination::new(dot(work.n, work.n).root() / norm.max(f64::MIN_POSITIVE));
        self.weigh(side, 1.0, &mut sum);
        sides.iter().zip(&*work.back).for_each(|(side, v)| self.weigh(side, -v, &mut sum));
        sum.proves()
    }

    /// Adds a side's bound, times its multiplier, to a combination.
    pub fn weigh(&self, side: ActiveBound, multiplier: f64, sum: &mut Combination) {
        let ActiveBound { row, sign } = side;
        let bound = sign * (self.bound(side) - self.rows.offset[row]) * self.rows.inverse[row];
        sum.bounds += multiplier * bound;
        sum.size += multiplier * bound.abs();
        sum.largest = sum.largest.max(bound.abs());
        sum.tolerance +=
            multiplier * self.rows.unit[row] * self.rows.inverse[row] * tol::ACTIVE_SET;
        sum.multipliers += multiplier;
    }

    /// n plus a multiple of a side's normal.
    fn add_normal(&self, side: ActiveBound, multiplier: f64, work: &mut Work<'_>) {
        let Work { n, rest, stride, .. } = work;
        rest[..*stride]
            .iter_mut()
            .zip(self.rows.normal(side.row))
            .for_each(|(n, a)| *n = side.sign * a);
        if let Some(L) = self.hessian_factor {
            solve_lower(L, &mut rest[..self.rows.r], *stride);
        }
        axpy(multiplier, &rest[..*stride], n);
    }
}
