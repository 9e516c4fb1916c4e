//! The zonotope of the error, cut by what the outputs say: it keeps correlations between states
//! that the box of x has lost.

use crate::error::Error;
use crate::interval::{Interval, points, weighted};
use crate::observer::dynamics::Dynamics;
use crate::observer::error_zonotope::ErrorSet;
use crate::observer::plant::Plant;
use crate::observer::sample::Sample;
use crate::rounding::diagonal;
use crate::strip::strip_range;

/// e in ⟨0, M⟩ and C e in the strips.
pub(super) struct Cut<'a, D> {
    plant: &'a Plant<D>,
    sample: Sample,
    set: &'a ErrorSet,
    sums: Vec<f64>,        // row sums of |M|
    strips: Vec<Interval>, // C e (p)
}

impl<'a, D: Dynamics> Cut<'a, D> {
    /// `output`: what C x is (p).
    pub(super) fn new(
        plant: &'a Plant<D>,
        sample: Sample,
        set: &'a ErrorSet,
        output: &[Interval],
    ) -> Self {
        let estimate = points(&set.center);
        let rows = plant.system.C.chunks_exact(plant.n).zip(output);
        let strips = rows.map(|(row, output)| *output - weighted(row, &estimate)).collect();
        Cut { plant, sample, sums: set.half_widths(), set, strips }
    }

    /// x within what the cut zonotope leaves of each axis.
    pub(super) fn narrow(&self, x: &mut [Interval]) -> Result<(), Error> {
        let n = self.plant.n;
        for (i, axis) in diagonal(&vec![1.0; n]).chunks_exact(n).enumerate() {
            let known = Interval::point(self.set.center[i]) + self.along(axis, i)?;
            x[i] = self.sample.meet(i, x[i], known)?;
        }
        Ok(())
    }

    /// Bounds of row i of (A + \[J\]) e + D1 w; e = x - x̂ also lies in the box x.
    pub(super) fn row(&self, i: usize, J: &[Interval], x: &[Interval]) -> Result<Interval, Error> {
        let n = self.plant.n;
        let row = i * n..(i + 1) * n;
        let A = &self.plant.system.A[row.clone()];
        let slope = J[row].iter().zip(A).map(|(j, &a)| *j + Interval::point(a));
        let (mut middle, mut spread) = (Vec::with_capacity(n), self.plant.disturbance[i]);
        for (slope, (x, &c)) in slope.zip(x.iter().zip(&self.set.center)) {
            middle.push(slope.mid());
            spread = spread + (slope - Interval::point(slope.mid())) * (*x - Interval::point(c));
        }
        Ok(self.along(&middle, i)? + spread)
    }

    /// Bounds of dᵀe, cut by each output in turn.
    fn along(&self, d: &[f64], state: usize) -> Result<Interval, Error> {
        let mut known = Interval::ENTIRE;
        let rows = self.plant.system.C.chunks_exact(self.plant.n);
        for (row, &strip) in rows.zip(&self.strips) {
            known = match strip_range(&self.set.generators, &self.sums, d, row, strip) {
                Some(found) => self.sample.meet(state, found, known)?,
                None => return Err(self.sample.violation(state, [known])),
            };
        }
        Ok(known)
    }
}
