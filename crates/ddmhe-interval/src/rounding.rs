//! What rounding takes from sums and products of floats, and how a zonotope makes up for it.
//!
//! An addition's error is itself a float, and so is a product's unless it falls below the smallest
//! one (Knuth; Dekker): what was exact is told from what was rounded, and only the latter is paid
//! for.

use crate::tol;
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};

/// Smallest positive float: twice what a product below the normal numbers is off by at most.
pub(crate) const TINY: f64 = 5e-324;

/// Products at least this large have an error that is a float.
const SPLITS: f64 = 1e-280;

/// a + b or the next float above it.
pub(crate) fn add_up(a: f64, b: f64) -> f64 {
    let sum = a + b;
    // an error that is no number comes of an overflow on the way
    if error_of_sum(a, b, sum) <= 0.0 { sum } else { sum.next_up() }
}

/// (a + b) - sum, exactly, for sum = fl(a + b).
fn error_of_sum(a: f64, b: f64, sum: f64) -> f64 {
    let second = sum - a;
    (a - (sum - second)) + (b - second)
}

/// fl(a + b) and an upper bound of its error, which is 0 where the sum is exact.
pub(crate) fn sum(a: f64, b: f64) -> (f64, f64) {
    let found = a + b;
    (found, error_of_sum(a, b, found).abs())
}

/// Σ a_i b_i in floats and an upper bound of its error, which is 0 where no operation rounds.
/// Neither is finite if floats do not reach.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> (f64, f64) {
    let (mut total, mut lost) = (0.0, 0.0);
    for (&a, &b) in a.iter().zip(b) {
        if a == 0.0 || b == 0.0 {
            continue;
        }
        let product = a * b;
        let (next, of_sum) = sum(total, product);
        let below = if product.abs() < SPLITS { TINY } else { 0.0 };
        for part in [a.mul_add(b, -product).abs(), below, of_sum] {
            lost = add_up(lost, part);
        }
        total = next;
    }
    (total, lost)
}

/// A x, A row-major with x.len() columns.
pub(crate) fn map(A: &[f64], x: &[f64]) -> Vec<f64> {
    A.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
}

/// Σ|v| of k numbers is at most this times its floating-point value.
pub(crate) fn inflation(k: usize) -> f64 {
    1.0 + (k as f64 + 4.0) * f64::EPSILON
}

/// Row sums of |M|, rounded upward: M (n × m) by columns.
pub(crate) fn row_sums(n: usize, columns: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; n];
    for g in columns.chunks_exact(n) {
        sums.iter_mut().zip(g).for_each(|(s, v)| *s += v.abs());
    }
    let factor = inflation(columns.len() / n);
    sums.iter_mut().for_each(|s| *s *= factor);
    sums
}

/// Generators of the box with half widths r.
pub(crate) fn diagonal(r: &[f64]) -> Vec<f64> {
    let n = r.len();
    let mut columns = vec![0.0; n * n];
    (0..n).for_each(|i| columns[i * n + i] = r[i]);
    columns
}

/// Makes the zonotope ⟨p, M⟩ in n dimensions larger by the box |e_i| ≤ lost_i.
///
/// A generator along axis i takes lost_i if there is one. Otherwise, where M spans all directions
/// well, every generator is made longer by the same hair; and where it does not, up to n
/// axis-parallel generators are added.
pub(crate) fn widen(n: usize, columns: &mut Vec<f64>, lost: &[f64]) {
    let mut rest = lost.to_vec();
    let mut widened = columns.clone();
    for g in widened.chunks_exact_mut(n) {
        let mut used = (0..n).filter(|&i| g[i] != 0.0);
        if let (Some(i), None) = (used.next(), used.next()) {
            g[i] = (add_up(g[i].abs(), rest[i])).copysign(g[i]);
            rest[i] = 0.0;
        }
    }
    if rest.iter().all(|r| *r == 0.0) {
        *columns = widened;
        return;
    }
    if lengthened(n, columns, lost).is_some() {
        return;
    }
    *columns = widened;
    let added = diagonal(&rest);
    columns
        .extend(added.chunks_exact(n).zip(&rest).filter(|(_, r)| **r != 0.0).flat_map(|(g, _)| g));
}

/// Makes all generators longer by the factor 1 + δ that lets them hold the box `lost` besides; None
/// if δ is not small.
///
/// In units of the rows' sums h, with R = Mᵀ(M Mᵀ)⁻¹ and M R = I + Δ: any b is M ζ with |ζ_j| ≤ Σ_i
/// |R_ji| ‖b‖/(1 - ‖Δ‖). M (ξ + ζ) is (1 + δ) M times a point of the unit box if |ζ| ≤ δ. What the
/// products (1 + δ)M round is part of b: it depends on ζ, but continuously, so by Brouwer's theorem
/// there is a ζ with |ζ| ≤ δ all the same.
fn lengthened(n: usize, columns: &mut [f64], lost: &[f64]) -> Option<()> {
    let (m, h) = (columns.len() / n, row_sums(n, columns));
    if m < n || h.iter().any(|h| !tol::ROW_SUMS.contains(h)) {
        return None;
    }
    let M = Mat::from_fn(n, m, |i, j| columns[j * n + i] / h[i]);
    let R = M.transpose() * (&M * M.transpose()).llt(Side::Lower).ok()?.inverse();
    let product = &M * &R;
    let entries = |M: &Mat<f64>, i: usize| {
        (0..n).map(|j| (M[(i, j)] - f64::from(u8::from(i == j))).abs()).sum::<f64>()
    };
    let off = (0..n).map(|i| entries(&product, i)).fold(0.0, f64::max);
    let reach = (0..m).map(|j| (0..n).map(|i| R[(j, i)].abs()).sum::<f64>()).fold(0.0, f64::max);
    // the bounds on `off` and `reach` keep what these few floats are off by below a thousandth:
    // the factor 2 holds it, and 1/(1 - ‖Δ‖)
    let b = lost.iter().zip(&h).map(|(l, h)| l / h).fold(0.0, f64::max) + 4.0 * f64::EPSILON;
    let delta = 2.0 * reach * b;
    let proved = off < tol::INVERSE && reach < tol::INVERSE_SIZE && m < tol::GENERATORS;
    if !(proved && delta < tol::LONGER) {
        return None;
    }
    let factor = (1.0 + delta).next_up();
    columns.iter_mut().for_each(|v| *v *= factor);
    Some(())
}
