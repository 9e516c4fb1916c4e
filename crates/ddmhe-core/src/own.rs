//! Rows and working sets with numbers of their own, for problems that are made at a step: a plan
//! holds neither.

use ddmhe_run::active_set::{Kept, Rows, RowsMut, Sides, WorkingSet};
use faer::MatRef;

/// Rows with numbers of their own.
pub(crate) struct OwnRows {
    r: usize,
    offset: Vec<f64>,
    unit: Vec<f64>,
    normals: Vec<f64>,
    inverse: Vec<f64>,
    slack: Vec<f64>,
}

impl OwnRows {
    /// From A and c (padded rows of zeros included) and the unit of each row.
    pub fn new(A: MatRef<'_, f64>, offset: Vec<f64>, unit: Vec<f64>) -> Self {
        let (len, r) = A.shape();
        let (mut normals, mut inverse, mut slack) =
            (vec![0.0; len * Rows::stride_of(r)], vec![0.0; len], vec![0.0; len]);
        RowsMut { normals: &mut normals, inverse: &mut inverse, slack: &mut slack }.write(
            r,
            |i, j| A[(i, j)],
            &unit,
        );
        OwnRows { r, offset, unit, normals, inverse, slack }
    }

    /// To be read.
    pub fn rows(&self) -> Rows<'_> {
        Rows {
            r: self.r,
            normals: &self.normals,
            offset: &self.offset,
            inverse: &self.inverse,
            slack: &self.slack,
            unit: &self.unit,
        }
    }
}

/// A working set with room for r active bounds.
pub(crate) struct OwnSet {
    codes: Vec<f64>,
    lengths: [usize; 2],
    kept: Kept,
}

impl OwnSet {
    /// Without an active bound.
    pub fn new(r: usize) -> Self {
        OwnSet { codes: vec![0.0; 2 * r], lengths: [0; 2], kept: Kept::default() }
    }

    /// To be worked with.
    pub fn working(&mut self) -> WorkingSet<'_> {
        let half = self.codes.len() / 2;
        let (sides, before) = self.codes.split_at_mut(half);
        let [len, len_before] = &mut self.lengths;
        WorkingSet {
            sides: Sides::new(sides, len),
            before: Sides::new(before, len_before),
            kept: &mut self.kept,
        }
    }
}
