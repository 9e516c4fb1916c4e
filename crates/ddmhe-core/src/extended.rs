//! [`way_out`] where bounds may be left at a price: the same problem with the violations written
//! down as coordinates of their own, all of them.
//!
//! See [`ddmhe_run::active_set::priced`] for s, κ and the floors s ≥ h. A row that may be left
//! becomes one row for each of its bounds, sign · w + unit e ≥ sign · bound, and one for its floor;
//! what is left is a least-distance problem in (z, s) like any other.

use crate::own::OwnRows;
use crate::way_out::way_out;
use ddmhe_run::Status;
use ddmhe_run::active_set::{ActiveBound, Erased, Rows, Slack, Trust, Windows};
use ddmhe_run::panels::padded;
use faer::Mat;

/// One row of the extended problem.
enum Row {
    /// A row whose bounds are hard.
    Hard(usize),
    /// A bound of a row that may be left by what its slot says.
    Soft(ActiveBound, usize),
    /// The floor of a slot.
    Floor(usize),
}

/// All rows, and each slot's row.
struct Extended<'a, 'b> {
    problem: &'a Erased<'b>,
    rows: Vec<Row>,
    slots: Vec<(usize, Slack)>,
}

/// Into z and its window w: the answer, or z* with its window if there is none.
#[cold]
pub(crate) fn way_out_priced(problem: &Erased<'_>, z: &mut [f64], w: &mut [f64]) -> (Status, u32) {
    let extended = Extended::new(problem);
    let (r, all) = (problem.rows.r, problem.rows.r + extended.slots.len());
    let own = extended.own_rows();
    let len = own.rows().len();
    let (mut lo, mut hi) = (vec![f64::NEG_INFINITY; len], vec![f64::INFINITY; len]);
    for (k, row) in extended.rows.iter().enumerate() {
        match *row {
            Row::Hard(row) => (lo[k], hi[k]) = (problem.lo[row], problem.hi[row]),
            Row::Soft(side, _) => lo[k] = side.sign * problem.bound(side),
            Row::Floor(slot) => lo[k] = extended.slots[slot].1.floor,
        }
    }
    let mut free = vec![0.0; padded(all)];
    free[..r].copy_from_slice(&problem.unconstrained[..r]);
    let factor = problem.hessian_factor.map(|L| block_factor(L, r, all));
    let plain = Erased {
        rows: own.rows(),
        lo: &lo,
        hi: &hi,
        unconstrained: &free,
        hessian_factor: factor.as_deref(),
        windows: &extended,
        trust: Trust::CERTAIN,
        prices: None,
    };
    let (mut point, mut window) = (vec![0.0; padded(all)], vec![0.0; len]);
    let (status, iterations) = way_out(&plain, &mut point, &mut window);
    z[..r].copy_from_slice(&point[..r]);
    problem.windows.window(&z[..r], w);
    (status, iterations)
}

/// L and the identity, by rows.
fn block_factor(L: &[f64], r: usize, all: usize) -> Vec<f64> {
    let (from, to) = (Rows::stride_of(r), Rows::stride_of(all));
    let mut block = vec![0.0; all * to];
    for i in 0..all {
        match i < r {
            true => block[i * to..i * to + i + 1].copy_from_slice(&L[i * from..i * from + i + 1]),
            false => block[i * to + i] = 1.0,
        }
    }
    block
}

impl<'a, 'b> Extended<'a, 'b> {
    fn new(problem: &'a Erased<'b>) -> Self {
        let (mut rows, mut slots) = (Vec::new(), Vec::new());
        let sides = |row: usize| [1.0, -1.0].map(|sign| ActiveBound { row, sign });
        for row in 0..problem.rows.len() {
            let bounded = |side: &ActiveBound| problem.bound(*side).is_finite();
            let sides = sides(row).into_iter().filter(bounded);
            match problem.slack(row) {
                None => rows.extend(sides.take(1).map(|side| Row::Hard(side.row))),
                Some(slack) => {
                    let before = rows.len();
                    rows.extend(sides.map(|side| Row::Soft(side, slots.len())));
                    if rows.len() > before {
                        rows.push(Row::Floor(slots.len()));
                        slots.push((row, slack));
                    }
                }
            }
        }
        Extended { problem, rows, slots }
    }

    /// Deviations in the row's own unit for each unit of s.
    fn per_s(&self, slot: usize) -> f64 {
        let (row, slack) = self.slots[slot];
        self.problem.rows.unit[row] * slack.deviations
    }

    /// The rows in coordinates (z, s).
    fn own_rows(&self) -> OwnRows {
        let (of, r) = (&self.problem.rows, self.problem.rows.r);
        let len = padded(self.rows.len());
        let mut A = Mat::zeros(len, r + self.slots.len());
        let (mut offset, mut unit) = (vec![0.0; len], vec![0.0; len]);
        for (k, row) in self.rows.iter().enumerate() {
            let mut fill = |row: usize, sign: f64| {
                (0..r).for_each(|j| A[(k, j)] = sign * of.entry(row, j));
                (offset[k], unit[k]) = (sign * of.offset[row], of.unit[row]);
            };
            match *row {
                Row::Hard(row) => fill(row, 1.0),
                Row::Soft(side, slot) => {
                    fill(side.row, side.sign);
                    A[(k, r + slot)] = self.per_s(slot);
                    offset[k] -= self.per_s(slot) * self.slots[slot].1.floor;
                }
                Row::Floor(slot) => {
                    A[(k, r + slot)] = 1.0;
                    unit[k] = 1.0 / self.slots[slot].1.deviations;
                }
            }
        }
        OwnRows::new(A.as_ref(), offset, unit)
    }
}

impl Windows for Extended<'_, '_> {
    fn erased(&self) -> &dyn Windows {
        self
    }

    fn window(&self, point: &[f64], window: &mut [f64]) {
        let r = self.problem.rows.r;
        let mut w = vec![0.0; self.problem.rows.len()];
        self.problem.windows.window(&point[..r], &mut w);
        for (row, value) in self.rows.iter().zip(window) {
            *value = match *row {
                Row::Hard(row) => w[row],
                Row::Soft(side, slot) => {
                    let s = point[r + slot] - self.slots[slot].1.floor;
                    side.sign * w[side.row] + self.per_s(slot) * s
                }
                Row::Floor(slot) => point[r + slot],
            };
        }
    }
}

#[cfg(test)]
mod tests;
