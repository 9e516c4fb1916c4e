//! The box of x: contracted with the measurements, backward and forward through the last
//! transitions, and with the zonotope.

use super::{Dynamics, IntervalObserver, Method};
use crate::error::Error;
use crate::interval::{Interval, dot, points, weighted};
use crate::rounding::{diagonal, row_sums};
use crate::zonotope::strip_range;
use serde::{Deserialize, Serialize};

/// Past transitions that a measurement is carried back through.
pub(super) const BACK: usize = 4;

/// One past transition: the box of x, B u, and what the output said about x.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Past {
    pub x: Vec<Interval>,
    pub input: Vec<Interval>,
    pub output: Vec<Interval>, // y - r - D2 v - δ, what C x is; all numbers where not measured
}

/// What cuts the present zonotope, the same for every direction that is asked for.
pub(super) struct Cut {
    sums: Vec<f64>,        // row sums of |M|
    strips: Vec<Interval>, // C e (p)
}

/// A later state is in offset + slope (x - c) for every x of a box: the mean-value form, row by
/// row.
#[derive(Debug, Clone)]
pub(super) struct MeanValue {
    c: Vec<f64>,
    offset: Vec<Interval>, // A c + f(c) + B u + D1 w, for one step
    slope: Vec<Interval>,  // A + [Df] over the box
}

impl MeanValue {
    fn shifted(&self, x: &[Interval]) -> Vec<Interval> {
        x.iter().zip(&self.c).map(|(x, &c)| *x - Interval::point(c)).collect()
    }

    pub(super) fn image(&self, x: &[Interval]) -> Vec<Interval> {
        let shifted = self.shifted(x);
        let rows = self.slope.chunks_exact(x.len()).zip(&self.offset);
        rows.map(|(row, &offset)| offset + dot(row, &shifted)).collect()
    }

    /// This map applied to what `first` leads to.
    fn after(&self, first: &MeanValue) -> MeanValue {
        let n = self.c.len();
        let mut slope = Vec::with_capacity(n * n);
        for row in self.slope.chunks_exact(n) {
            slope.extend(
                (0..n).map(|j| {
                    (0..n).fold(Interval::ZERO, |s, l| s + row[l] * first.slope[l * n + j])
                }),
            );
        }
        MeanValue { c: first.c.clone(), offset: self.image(&first.offset), slope }
    }
}

impl<D: Dynamics> IntervalObserver<D> {
    /// Contracts the boxes of the last transitions with their outputs, backward and forward;
    /// `Paper` only the last output.
    pub(super) fn contract(&self, past: &mut [Past]) -> Result<(), Error> {
        let last = past.len() - 1;
        self.contract_output(&mut past[last])?;
        if self.method == Method::Paper {
            return Ok(());
        }
        // maps from x(k) to x(k+1) and, composed, to the newest state; what is composed keeps the
        // correlations that boxes in between would lose
        let mut maps: Vec<(MeanValue, MeanValue)> = Vec::with_capacity(last);
        for k in (0..last).rev() {
            let one = self.linearised(&past[k])?;
            let whole = maps.last().map_or_else(|| one.clone(), |(_, later)| later.after(&one));
            let (before, after) = past.split_at_mut(k + 1);
            self.backward(&one, &mut before[k].x, &after[0].x)?;
            if k + 1 < last {
                self.backward(&whole, &mut before[k].x, &after[after.len() - 1].x)?;
            }
            self.contract_output(&mut before[k])?;
            maps.push((one, whole));
        }
        for (k, (one, whole)) in maps.iter().rev().enumerate() {
            let (next, newest) = (one.image(&past[k].x), whole.image(&past[k].x));
            self.narrow(&mut past[k + 1].x, &next)?;
            self.narrow(&mut past[last].x, &newest)?;
            self.contract_output(&mut past[k + 1])?;
        }
        self.contract_output(&mut past[last])
    }

    /// x within what the outputs say about C x.
    fn contract_output(&self, past: &mut Past) -> Result<(), Error> {
        for j in 0..self.p {
            if past.output[j] == Interval::ENTIRE {
                continue;
            }
            let row = points(&self.system.C[j * self.n..(j + 1) * self.n]);
            let x = past.x.clone();
            self.contract_row(&row, past.output[j], &x, &mut past.x)?;
        }
        Ok(())
    }

    /// x within what its image under the map allows, row by row.
    fn backward(
        &self,
        map: &MeanValue,
        x: &mut [Interval],
        image: &[Interval],
    ) -> Result<(), Error> {
        let shifted = map.shifted(x);
        let mut narrowed = shifted.clone();
        for (i, image) in image.iter().enumerate() {
            let sum = *image - map.offset[i];
            self.contract_row(
                &map.slope[i * self.n..(i + 1) * self.n],
                sum,
                &shifted,
                &mut narrowed,
            )?;
        }
        let back: Vec<Interval> =
            narrowed.iter().zip(&map.c).map(|(x, &c)| *x + Interval::point(c)).collect();
        self.narrow(x, &back)
    }

    /// x within other, entry by entry.
    fn narrow(&self, x: &mut [Interval], other: &[Interval]) -> Result<(), Error> {
        for (i, (x, other)) in x.iter_mut().zip(other).enumerate() {
            *x = x.intersect(*other).ok_or_else(|| self.violation(i, [*x, *other].into_iter()))?;
        }
        Ok(())
    }

    /// x(k) to x(k+1).
    pub(super) fn linearised(&self, past: &Past) -> Result<MeanValue, Error> {
        let c: Vec<f64> = past.x.iter().map(|x| x.mid()).collect();
        let mut slope = self.jacobian(&past.x)?;
        slope.iter_mut().zip(&self.system.A).for_each(|(j, &a)| *j = *j + Interval::point(a));
        let mut offset = vec![Interval::ZERO; self.n];
        self.dynamics.value(&c, &mut offset)?;
        for (i, value) in offset.iter_mut().enumerate() {
            *value = *value
                + weighted(&self.system.A[i * self.n..(i + 1) * self.n], &points(&c))
                + past.input[i]
                + self.disturbance[i];
        }
        Ok(MeanValue { c, offset, slope })
    }

    /// Narrows x to what row·x = sum leaves of it, entry by entry.
    fn contract_row(
        &self,
        row: &[Interval],
        sum: Interval,
        x: &[Interval],
        out: &mut [Interval],
    ) -> Result<(), Error> {
        for (j, a) in row.iter().enumerate() {
            if a.contains(0.0) {
                continue;
            }
            let others =
                (0..row.len()).filter(|&l| l != j).fold(Interval::ZERO, |s, l| s + row[l] * x[l]);
            let back = (sum - others) / *a;
            out[j] = out[j]
                .intersect(back)
                .ok_or_else(|| self.violation(j, [out[j], back].into_iter()))?;
        }
        Ok(())
    }

    /// The zonotope of e and what each output leaves of C e.
    pub(super) fn cut(&self, past: &Past) -> Cut {
        let estimate = points(&self.center);
        let rows = self.system.C.chunks_exact(self.n).zip(&past.output);
        let strips = rows.map(|(row, output)| *output - weighted(row, &estimate)).collect();
        Cut { sums: row_sums(self.n, &self.generators), strips }
    }

    /// x within what the zonotope, cut by the outputs, leaves of each axis.
    pub(super) fn cut_box(&self, cut: &Cut, past: &mut Past) -> Result<(), Error> {
        for (i, axis) in diagonal(&vec![1.0; self.n]).chunks_exact(self.n).enumerate() {
            let known = Interval::point(self.center[i]) + self.along(axis, cut, i)?;
            let x = past.x[i];
            past.x[i] =
                x.intersect(known).ok_or_else(|| self.violation(i, [x, known].into_iter()))?;
        }
        Ok(())
    }

    /// Bounds of row i of (A + \[J\]) e + D1 w, with the zonotope's correlations; e = x - x̂ also
    /// lies in the box of x.
    pub(super) fn along_row(
        &self,
        i: usize,
        J: &[Interval],
        cut: &Cut,
        past: &Past,
    ) -> Result<Interval, Error> {
        let row = i * self.n..(i + 1) * self.n;
        let slope =
            J[row.clone()].iter().zip(&self.system.A[row]).map(|(j, &a)| *j + Interval::point(a));
        let (mut middle, mut spread) = (Vec::with_capacity(self.n), self.disturbance[i]);
        for (slope, (x, &c)) in slope.zip(past.x.iter().zip(&self.center)) {
            middle.push(slope.mid());
            spread = spread + (slope - Interval::point(slope.mid())) * (*x - Interval::point(c));
        }
        Ok(self.along(&middle, cut, i)? + spread)
    }

    /// Bounds of dᵀe over the zonotope cut by each output in turn.
    fn along(&self, d: &[f64], cut: &Cut, state: usize) -> Result<Interval, Error> {
        let mut known = Interval::ENTIRE;
        for (row, &strip) in self.system.C.chunks_exact(self.n).zip(&cut.strips) {
            let found = strip_range(&self.generators, &cut.sums, d, row, strip);
            let sets = [known, found.unwrap_or(known)];
            known = found
                .and_then(|found| found.intersect(known))
                .ok_or_else(|| self.violation(state, sets.into_iter()))?;
        }
        Ok(known)
    }
}
