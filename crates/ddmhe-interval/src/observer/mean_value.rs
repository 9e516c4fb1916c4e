//! Later states as functions of earlier ones, in mean-value form.

use crate::interval::{Interval, dot};

/// A later state is in offset + slope (x - c) for every x of a box, row by row.
#[derive(Debug, Clone)]
pub(super) struct MeanValue {
    pub c: Vec<f64>,           // (n)
    pub offset: Vec<Interval>, // A c + f(c) + B u + D1 w, for one step (n)
    pub slope: Vec<Interval>,  // A + [Df] over the box (n·n)
}

impl MeanValue {
    /// x - c.
    pub(super) fn shifted(&self, x: &[Interval]) -> Vec<Interval> {
        x.iter().zip(&self.c).map(|(x, &c)| *x - Interval::point(c)).collect()
    }

    /// What x leads to.
    pub(super) fn image(&self, x: &[Interval]) -> Vec<Interval> {
        let shifted = self.shifted(x);
        let rows = self.slope.chunks_exact(x.len()).zip(&self.offset);
        rows.map(|(row, &offset)| offset + dot(row, &shifted)).collect()
    }

    /// This map applied to what `first` leads to.
    pub(super) fn after(&self, first: &MeanValue) -> MeanValue {
        let n = self.c.len();
        let entry = |row: &[Interval], j: usize| {
            (0..n).fold(Interval::ZERO, |s, l| s + row[l] * first.slope[l * n + j])
        };
        let mut slope = Vec::with_capacity(n * n);
        for row in self.slope.chunks_exact(n) {
            slope.extend((0..n).map(|j| entry(row, j)));
        }
        MeanValue { c: first.c.clone(), offset: self.image(&first.offset), slope }
    }
}
