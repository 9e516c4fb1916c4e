//! The factor of the unit normals of the active rows, N = Q R, and the point on their bounds.

use crate::active_set::rows::Rows;
use crate::active_set::working_set::Sides;
use crate::panels::{Root, axpy, dot, padded};

/// Numbers that the method works with at rank r.
pub fn work_len(r: usize) -> usize {
    let stride = Rows::stride_of(r);
    2 * r * stride + 5 * stride + 2 * padded(r)
}

/// The caller's memory, by name.
pub(super) struct Work<'a> {
    pub stride: usize,
    pub q: &'a mut [f64],     // Q by columns
    pub upper: &'a mut [f64], // R by columns
    pub b: &'a mut [f64],     // what is missing to each active bound at z*
    pub u: &'a mut [f64],     // multipliers
    pub t: &'a mut [f64],
    pub n: &'a mut [f64],    // normal of the row that is taken in …
    pub d: &'a mut [f64],    // … = Q d + rest
    pub rest: &'a mut [f64], // padded, as is
    pub back: &'a mut [f64], // R⁻¹ d
}

impl<'a> Work<'a> {
    #[inline(always)]
    pub fn new(memory: &'a mut [f64], r: usize) -> Self {
        let stride = Rows::stride_of(r);
        let (q, memory) = memory.split_at_mut(r * stride);
        let (upper, memory) = memory.split_at_mut(r * stride);
        let (b, memory) = memory.split_at_mut(stride);
        let (u, memory) = memory.split_at_mut(stride);
        let (t, memory) = memory.split_at_mut(stride);
        let (n, memory) = memory.split_at_mut(stride);
        let (d, memory) = memory.split_at_mut(stride);
        let (rest, back) = memory.split_at_mut(padded(r));
        Work { stride, q, upper, b, u, t, n, d, rest, back }
    }

    /// Qᵀn and the part of n that is orthogonal to the first k columns of Q, into `d` and `rest`;
    /// the square of its length.
    #[inline(always)]
    pub fn split(&mut self, k: usize) -> f64 {
        let s = self.stride;
        self.rest[..s].copy_from_slice(self.n);
        self.d[..k].fill(0.0);
        let mut length = dot(self.n, self.n);
        // once more where much was taken away: twice is enough
        for _ in 0..2 {
            for (column, d) in self.q.chunks_exact(s).zip(&mut self.d[..k]) {
                let part = dot(column, &self.rest[..s]);
                *d += part;
                axpy(-part, column, &mut self.rest[..s]);
            }
            let left = dot(&self.rest[..s], &self.rest[..s]);
            let enough = left > 0.5 * length;
            length = left;
            if enough {
                break;
            }
        }
        length
    }

    /// Appends the column that was split, as number k.
    #[inline(always)]
    pub fn append(&mut self, k: usize, length: f64) {
        let s = self.stride;
        self.upper[k * s..k * s + k].copy_from_slice(&self.d[..k]);
        self.upper[k * s + k] = length.root();
        let inverse = 1.0 / length.root();
        for (q, z) in self.q[k * s..(k + 1) * s].iter_mut().zip(&*self.rest) {
            *q = z * inverse;
        }
    }

    /// `back` = R⁻¹ d for k columns.
    #[inline(always)]
    pub fn solve_upper(&mut self, k: usize) {
        self.back[..k].copy_from_slice(&self.d[..k]);
        for j in (0..k).rev() {
            let column = &self.upper[j * self.stride..j * self.stride + j + 1];
            self.back[j] /= column[j];
            let x = self.back[j];
            axpy(-x, &column[..j], &mut self.back[..j]);
        }
    }

    /// The least-norm t on k active bounds and their multipliers: t = Q R⁻ᵀ b, u = R⁻¹ R⁻ᵀ b.
    #[inline(always)]
    pub fn point(&mut self, k: usize) {
        let s = self.stride;
        self.t.fill(0.0);
        for j in 0..k {
            let column = &self.upper[j * s..j * s + j + 1];
            self.d[j] = (self.b[j] - dot(&column[..j], &self.d[..j])) / column[j];
            axpy(self.d[j], &self.q[j * s..(j + 1) * s], self.t);
        }
        self.solve_upper(k);
        self.u[..k].copy_from_slice(&self.back[..k]);
    }

    /// Drops active bound j of `sides`: R loses a column, rotations make it triangular again.
    pub fn drop(&mut self, j: usize, sides: &mut Sides<'_>) {
        let (k, s) = (sides.len(), self.stride);
        sides.remove(j);
        self.u.copy_within(j + 1..k, j);
        self.b.copy_within(j + 1..k, j);
        self.upper.copy_within((j + 1) * s..k * s, j * s);
        for i in j..k - 1 {
            let (a, b) = (self.upper[i * s + i], self.upper[i * s + i + 1]);
            let norm = (a * a + b * b).root();
            if norm == 0.0 {
                continue;
            }
            let (cos, sin) = (a / norm, b / norm);
            for column in i..k - 1 {
                let at = column * s + i;
                let (x, y) = (self.upper[at], self.upper[at + 1]);
                (self.upper[at], self.upper[at + 1]) = (cos * x + sin * y, cos * y - sin * x);
            }
            let (left, right) = self.q.split_at_mut((i + 1) * s);
            for (x, y) in left[i * s..].iter_mut().zip(&mut right[..s]) {
                (*x, *y) = (cos * *x + sin * *y, cos * *y - sin * *x);
            }
        }
    }
}

/// x ← L⁻¹ x, L by rows of `stride` numbers.
#[inline(always)]
pub fn solve_lower(L: &[f64], x: &mut [f64], stride: usize) {
    for i in 0..x.len() {
        let row = &L[i * stride..i * stride + i + 1];
        x[i] = (x[i] - dot(&row[..i], &x[..i])) / row[i];
    }
}

/// x ← L⁻ᵀ x, L by rows of `stride` numbers.
#[inline(always)]
pub fn solve_transposed(L: &[f64], x: &mut [f64], stride: usize) {
    for i in (0..x.len()).rev() {
        let row = &L[i * stride..i * stride + i + 1];
        x[i] /= row[i];
        let value = x[i];
        axpy(-value, &row[..i], &mut x[..i]);
    }
}

/// L of H = L Lᵀ in place (lower triangles by rows of `stride`); None when a pivot is not above
/// `least`.
#[inline(always)]
pub(crate) fn cholesky(H: &mut [f64], r: usize, stride: usize, least: f64) -> Option<()> {
    for i in 0..r {
        let (above, row) = H.split_at_mut(i * stride);
        for (j, other) in above.chunks_exact(stride).enumerate() {
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        if !(pivot > least) {
            return None;
        }
        row[i] = pivot.root();
    }
    Some(())
}
