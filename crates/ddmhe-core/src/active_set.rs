//! A dense dual active-set method for the least-distance problem: minimise ½‖t‖² subject to lo ≤ A t ≤ hi.
//!
//! D. Goldfarb, A. Idnani, "A numerically stable dual method for solving strictly convex quadratic programs" (1983), with the
//! identity as Hessian. It starts at the unconstrained minimiser, t = 0, which is where a window without active bounds
//! would stop, and takes in the most violated row at a time while every multiplier stays at least 0; rows whose multiplier
//! would change sign are dropped on the way. The normals of the active rows are kept as N = Q R.
//!
//! The answer is recomputed from the final active set in the order of its rows, so it depends on that set alone, and is checked against the
//! optimality conditions. Whatever is not certain (nearly dependent rows, too many changes, a check that fails) is left to
//! the interior-point solver: the method then returns None.

use crate::tol;
use faer::{Mat, MatRef};

/// What the method is certain of.
pub(crate) enum Outcome {
    /// The minimiser, and how many rows were taken in or dropped.
    Optimal(Vec<f64>, u32),
    /// No t satisfies all bounds: a combination of rows proves it.
    Infeasible(u32),
}

/// Normals of the active rows, N = Q R, and their multipliers.
struct Active {
    r: usize,
    sides: Vec<(usize, f64)>, // row, and +1 for its lower bound, -1 for its upper one
    u: Vec<f64>,
    q: Vec<f64>,     // Q by columns
    upper: Vec<f64>, // R by columns, r numbers each
}

impl Active {
    fn new(r: usize) -> Self {
        Active { r, sides: Vec::new(), u: Vec::new(), q: vec![0.0; r * r], upper: vec![0.0; r * r] }
    }

    fn len(&self) -> usize {
        self.sides.len()
    }

    fn column(&self, j: usize) -> &[f64] {
        &self.q[j * self.r..(j + 1) * self.r]
    }

    /// Qᵀn and the part of n that is orthogonal to the active normals, orthogonalised twice.
    fn split(&self, n: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (mut d, mut z) = (vec![0.0; self.len()], n.to_vec());
        for _ in 0..2 {
            for (j, d) in d.iter_mut().enumerate() {
                let part = dot(self.column(j), &z);
                *d += part;
                z.iter_mut().zip(self.column(j)).for_each(|(z, q)| *z -= part * q);
            }
        }
        (d, z)
    }

    /// R⁻¹ d.
    fn back(&self, d: &[f64]) -> Vec<f64> {
        let mut x = d.to_vec();
        for j in (0..x.len()).rev() {
            x[j] /= self.upper[j * self.r + j];
            for i in 0..j {
                x[i] -= self.upper[j * self.r + i] * x[j];
            }
        }
        x
    }

    /// R⁻ᵀ b.
    fn forward(&self, b: &[f64]) -> Vec<f64> {
        let mut x = b.to_vec();
        for j in 0..x.len() {
            x[j] = (x[j] - (0..j).map(|i| self.upper[j * self.r + i] * x[i]).sum::<f64>()) / self.upper[j * self.r + j];
        }
        x
    }

    /// Takes in a side whose normal splits into d and z.
    fn add(&mut self, side: (usize, f64), u: f64, d: &[f64], z: &[f64]) {
        let (k, r) = (self.len(), self.r);
        let norm = dot(z, z).sqrt();
        self.upper[k * r..k * r + k].copy_from_slice(d);
        self.upper[k * r + k] = norm;
        self.q[k * r..(k + 1) * r].iter_mut().zip(z).for_each(|(q, z)| *q = z / norm);
        self.sides.push(side);
        self.u.push(u);
    }

    /// Drops side j: R loses a column, rotations make it triangular again.
    fn drop(&mut self, j: usize) {
        let (k, r) = (self.len(), self.r);
        self.sides.remove(j);
        self.u.remove(j);
        self.upper.copy_within((j + 1) * r..k * r, j * r);
        for i in j..k - 1 {
            let (a, b) = (self.upper[i * r + i], self.upper[i * r + i + 1]);
            let norm = a.hypot(b);
            if norm == 0.0 {
                continue;
            }
            let (c, s) = (a / norm, b / norm);
            for column in i..k - 1 {
                let at = column * r + i;
                let (x, y) = (self.upper[at], self.upper[at + 1]);
                (self.upper[at], self.upper[at + 1]) = (c * x + s * y, c * y - s * x);
            }
            for row in 0..r {
                let (x, y) = (self.q[i * r + row], self.q[(i + 1) * r + row]);
                (self.q[i * r + row], self.q[(i + 1) * r + row]) = (c * x + s * y, c * y - s * x);
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves for A (rows × r) with the norms of its rows; infinite bounds are none. None: not certain.
pub(crate) fn solve(A: MatRef<'_, f64>, norms: &[f64], lo: &[f64], hi: &[f64]) -> Option<Outcome> {
    let r = A.ncols();
    let mut active = Active::new(r);
    let (mut t, mut image) = (vec![0.0; r], vec![0.0; A.nrows()]);
    let mut changes = 0;
    let most = tol::ACTIVE_SET_CHANGES as u32 + 4 * r as u32;
    let bound = |(row, sign): (usize, f64)| if sign > 0.0 { lo[row] } else { -hi[row] };
    loop {
        let Some((row, sign)) = worst(norms, &image, lo, hi) else {
            return verified(A, norms, lo, hi, &active).map(|t| Outcome::Optimal(t, changes));
        };
        if norms[row] == 0.0 {
            return Some(Outcome::Infeasible(changes)); // 0ᵀt cannot be above 0
        }
        if active.sides.iter().any(|side| side.0 == row && side.1 == sign) {
            return None; // violated although active: accuracy is lost
        }
        let n: Vec<f64> = (0..r).map(|j| sign * A[(row, j)]).collect();
        let mut u = 0.0;
        loop {
            changes += 1;
            if changes > most {
                return None;
            }
            let (d, z) = active.split(&n);
            let length = dot(&z, &z);
            let step_back = active.back(&d);
            // how far until an active row's multiplier is 0
            let mut partial = (f64::INFINITY, usize::MAX);
            for (j, &v) in step_back.iter().enumerate() {
                if v > tol::MULTIPLIER && active.u[j] / v < partial.0 {
                    partial = (active.u[j] / v, j);
                }
            }
            let ratio = length.sqrt() / norms[row];
            let dependent = ratio <= tol::DEPENDENT.0;
            if !dependent && ratio < tol::DEPENDENT.1 {
                return None;
            }
            let missing = bound((row, sign)) - sign * image_at(A, row, &t);
            let full = if dependent { f64::INFINITY } else { missing / length };
            if partial.0.is_infinite() && full.is_infinite() {
                // n = N v with v ≤ 0: no t has N ᵀt ≥ b and nᵀt ≥ b_n unless b_n ≤ vᵀb
                let reach: f64 = step_back.iter().zip(&active.sides).map(|(v, &side)| v * bound(side)).sum();
                let gap = bound((row, sign)) - reach;
                return (gap > tol::INFEASIBLE * norms[row]).then_some(Outcome::Infeasible(changes));
            }
            let step = partial.0.min(full);
            active.u.iter_mut().zip(&step_back).for_each(|(u, v)| *u = (*u - step * v).max(0.0));
            u += step;
            if !dependent {
                t.iter_mut().zip(&z).for_each(|(t, z)| *t += step * z);
                for (j, z) in z.iter().enumerate() {
                    image.iter_mut().zip(A.col(j).iter()).for_each(|(w, a)| *w += step * z * a);
                }
            }
            if full <= partial.0 {
                active.add((row, sign), u, &d, &z);
                break;
            }
            active.drop(partial.1);
        }
    }
}

fn image_at(A: MatRef<'_, f64>, row: usize, t: &[f64]) -> f64 {
    t.iter().enumerate().map(|(j, t)| A[(row, j)] * t).sum()
}

/// The side that is violated most in units of its row's length, if any by more than the tolerance.
fn worst(norms: &[f64], image: &[f64], lo: &[f64], hi: &[f64]) -> Option<(usize, f64)> {
    let mut found = (0.0, None);
    for (row, ((&w, &norm), (&l, &h))) in image.iter().zip(norms).zip(lo.iter().zip(hi)).enumerate() {
        let (below, above) = (l - w, w - h);
        let excess = below.max(above);
        if excess > tol::VIOLATED && excess > found.0 * norm.max(f64::MIN_POSITIVE) {
            found = (excess / norm.max(f64::MIN_POSITIVE), Some((row, if below >= above { 1.0 } else { -1.0 })));
        }
    }
    found.1
}

/// t = N (NᵀN)⁻¹ b from the active sides in the order of their rows, if it satisfies every row and every multiplier its sign.
fn verified(A: MatRef<'_, f64>, norms: &[f64], lo: &[f64], hi: &[f64], found: &Active) -> Option<Vec<f64>> {
    let r = found.r;
    let mut sides = found.sides.clone();
    sides.sort_unstable_by_key(|side| side.0);
    let mut active = Active::new(r);
    for &(row, sign) in &sides {
        let n: Vec<f64> = (0..r).map(|j| sign * A[(row, j)]).collect();
        let (d, z) = active.split(&n);
        if dot(&z, &z).sqrt() < tol::DEPENDENT.0 * norms[row] {
            return None;
        }
        active.add((row, sign), 0.0, &d, &z);
    }
    let b: Vec<f64> = sides.iter().map(|&(row, sign)| if sign > 0.0 { lo[row] } else { -hi[row] }).collect();
    let weights = active.forward(&b);
    let multipliers = active.back(&weights);
    let mut t = vec![0.0; r];
    for (j, w) in weights.iter().enumerate() {
        t.iter_mut().zip(active.column(j)).for_each(|(t, q)| *t += w * q);
    }
    // a row whose multiplier has the wrong sign would, dropped, move t by at most |u| times its length
    let size = dot(&t, &t).sqrt().max(1.0);
    if multipliers.iter().zip(&sides).any(|(u, side)| u * norms[side.0] < -tol::WRONG_SIGN * size) {
        return None;
    }
    let inside = |row: usize| {
        let w = image_at(A, row, &t);
        w >= lo[row] - tol::ACTIVE_SET && w <= hi[row] + tol::ACTIVE_SET
    };
    (0..A.nrows()).all(inside).then_some(t)
}

/// Lengths of the rows of A.
pub(crate) fn norms(A: &Mat<f64>) -> Vec<f64> {
    (0..A.nrows()).map(|i| (0..A.ncols()).map(|j| A[(i, j)].powi(2)).sum::<f64>().sqrt()).collect()
}
