//! The rows of a window that bounds may be set on.

use crate::active_set::working_set::ActiveBound;
use crate::panels::{Root, WIDTH, each, halve, larger};
use crate::tol;

/// The rows c + A z, padded to whole panels with rows that are always 0.
#[derive(Debug, Clone, Copy)]
pub struct Rows<'a> {
    /// Columns of A.
    pub r: usize,
    /// Each row of A to unit length (or zeros), [`stride`](Self::stride) numbers a row.
    pub normals: &'a [f64],
    /// c.
    pub offset: &'a [f64],
    /// 1 / length of the row of A, 1 where it is 0: from a distance of the window to one along the
    /// normal.
    pub inverse: &'a [f64],
    /// Violation that counts as none.
    pub slack: &'a [f64],
    /// What the tolerances are in units of.
    pub unit: &'a [f64],
}

/// Where [`Rows`] are written.
#[derive(Debug)]
pub struct RowsMut<'a> {
    /// See [`Rows::normals`].
    pub normals: &'a mut [f64],
    /// See [`Rows::inverse`].
    pub inverse: &'a mut [f64],
    /// See [`Rows::slack`].
    pub slack: &'a mut [f64],
}

impl RowsMut<'_> {
    /// From the entries of A (padded rows of zeros included), with `r` columns, and the unit of
    /// each row. What is written to must be zeros.
    pub fn write(self, r: usize, entry: impl Fn(usize, usize) -> f64, unit: &[f64]) {
        let stride = Rows::stride_of(r);
        for (i, unit) in unit.iter().enumerate() {
            let length = (0..r).map(|j| entry(i, j) * entry(i, j)).sum::<f64>().root();
            self.slack[i] = tol::VIOLATED * unit;
            self.inverse[i] = 1.0;
            if length > 0.0 {
                (0..r).for_each(|j| self.normals[i * stride + j] = entry(i, j) / length);
                self.inverse[i] = 1.0 / length;
            }
        }
    }
}

impl Rows<'_> {
    /// Numbers that a normal with r entries takes.
    #[inline(always)]
    pub const fn stride_of(r: usize) -> usize {
        r.next_multiple_of(4)
    }

    /// Numbers that each normal takes.
    #[inline(always)]
    pub fn stride(&self) -> usize {
        Self::stride_of(self.r)
    }

    /// Number of rows, padding included.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.offset.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.offset.is_empty()
    }

    /// Entry of A.
    #[inline(always)]
    pub fn entry(&self, row: usize, j: usize) -> f64 {
        self.normals[row * self.stride() + j] / self.inverse[row]
    }

    /// A row of A to unit length (or zeros), padded.
    #[inline(always)]
    pub fn normal(&self, row: usize) -> &[f64] {
        let stride = self.stride();
        &self.normals[row * stride..(row + 1) * stride]
    }

    /// The side that is violated most in units of its row's length, if any by more than the
    /// tolerance so many times.
    #[inline(always)]
    pub fn worst(&self, w: &[f64], lo: &[f64], hi: &[f64], times: f64) -> Option<ActiveBound> {
        // lane by lane: the largest excess; where that is, only if there is one
        let mut most = [0.0_f64; WIDTH];
        let chunks = w
            .as_chunks::<WIDTH>()
            .0
            .iter()
            .zip(lo.as_chunks::<WIDTH>().0)
            .zip(hi.as_chunks::<WIDTH>().0);
        let rows =
            self.slack.as_chunks::<WIDTH>().0.iter().zip(self.inverse.as_chunks::<WIDTH>().0);
        for (((w, lo), hi), (slack, inverse)) in chunks.zip(rows) {
            let (below, above) = (each(*lo, *w, |l, w| l - w), each(*w, *hi, |w, h| w - h));
            let excess = each(each(below, above, larger), *slack, |e, slack| e - slack * times);
            most = each(each(excess, *inverse, |e, inverse| e * inverse), most, larger);
        }
        if !(halve(most, larger) > 0.0) {
            return None;
        }
        let lane = (1..WIDTH).fold(0, |best, i| if most[i] > most[best] { i } else { best });
        let excess = |row: &usize| {
            let excess = larger(lo[*row] - w[*row], w[*row] - hi[*row]);
            (excess - self.slack[*row] * times) * self.inverse[*row]
        };
        let row = (lane..self.len()).step_by(WIDTH).find(|row| excess(row) == most[lane])?;
        let sign = if lo[row] - w[row] < w[row] - hi[row] { -1.0 } else { 1.0 };
        Some(ActiveBound { row, sign })
    }
}
