//! A response, four instants at a time.
//!
//! In the recursion of a [`Response`] each instant waits for the one before. The same linear map
//! over four of them,
//!
//! > \[x_f(k+1); …; x_f(k+4)\] = X h(k),  \[y_f(k); …; y_f(k+3)\] = Y h(k),
//! > h(k) = \[u(k-L+1); …; u(k+3); y_f(k-L+1); …; y_f(k-1); x_f(k-L+1); …; x_f(k)\],
//!
//! has rows that do not wait for each other, time-major as the window is, and inputs, which come
//! first in their sums, wait for no motion. Column j of X and Y is what the recursion makes of
//! h = e_j. The rows of X and then of Y lie in P whole panels, all panels of a column side by side:
//! each entry of h is read once, and the sums stay in registers.

use crate::panels::{Column, WIDTH, add, padded};
use crate::response::{Response, ResponseSizes};

/// Instants of a turn.
const INSTANTS: usize = 4;

/// The sizes of a response that is looked ahead with; its numbers are the caller's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LookAhead {
    sizes: ResponseSizes,
    columns: usize,
    panels: [usize; 2], // of X and of Y
}

impl LookAhead {
    /// Of small systems: with more rows an instant of the recursion is work enough.
    pub fn new(sizes: ResponseSizes) -> Option<Self> {
        let ResponseSizes { n, p, m, lag } = sizes;
        if m == 0 || n > 6 || p > 4 || n + p > WIDTH || lag > INSTANTS {
            return None;
        }
        let columns = sizes.regressors() + (INSTANTS - 1) * m;
        let panels = [n, p].map(|width| (INSTANTS * width).div_ceil(WIDTH));
        Some(LookAhead { sizes, columns, panels })
    }

    /// Numbers in X and Y.
    fn table_len(self) -> usize {
        (self.panels[0] + self.panels[1]) * self.columns * WIDTH
    }

    /// The same with room to make them in.
    pub fn len(self) -> usize {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        self.table_len() + padded((lag + INSTANTS) * (n + p + m)) + WIDTH
    }

    /// Numbers that x_f and y_f of so many instants are written in.
    pub fn motion_len(self, depth: usize) -> [usize; 2] {
        let ResponseSizes { n, p, .. } = self.sizes;
        let last = depth.next_multiple_of(INSTANTS).saturating_sub(INSTANTS);
        [last * n + self.panels[0] * WIDTH, last * p + self.panels[1] * WIDTH]
    }

    /// X and Y, in [`len`](Self::len) numbers.
    #[cold]
    pub fn make(self, response: &Response<'_>, numbers: &mut [f64]) {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        let (width, [of_x, of_y]) = (n + p + m, self.panels);
        let (table, room) = numbers.split_at_mut(self.table_len());
        let (instants, next) = room.split_at_mut(room.len() - WIDTH);
        for (column, table) in table.chunks_exact_mut((of_x + of_y) * WIDTH).enumerate() {
            let (of_x, of_y) = table.split_at_mut(of_x * WIDTH);
            instants.fill(0.0); // [x; y; u] of k-L+1, …
            instants[self.regressor(column)] = 1.0;
            for k in 0..INSTANTS {
                let (before, now) = instants[k * width..].split_at_mut((lag - 1) * width);
                response.next(before, &now[n + p..width], &now[..n], next);
                now[n..n + p].copy_from_slice(&next[n..n + p]);
                now[width..width + n].copy_from_slice(&next[..n]);
                of_x[k * n..(k + 1) * n].copy_from_slice(&next[..n]);
                of_y[k * p..(k + 1) * p].copy_from_slice(&next[n..n + p]);
            }
        }
    }

    /// Where the entry of h that belongs to a column is among the instants \[x; y; u\].
    fn regressor(self, column: usize) -> usize {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        let at = |entry: usize, size: usize, first: usize| {
            entry / size * (n + p + m) + first + entry % size
        };
        let (inputs, outputs) = ((lag - 1 + INSTANTS) * m, (lag - 1) * p);
        match (column.checked_sub(inputs), column.checked_sub(inputs + outputs)) {
            (None, _) => at(column, m, n + p),
            (Some(entry), None) => at(entry, p, n),
            (_, Some(entry)) => at(entry, n, 0),
        }
    }

    /// As [`Response::forced`], from what [`make`](Self::make) made; x and y have
    /// [`motion_len`](Self::motion_len) numbers.
    #[inline(always)]
    pub fn forced(self, numbers: &[f64], u: &[f64], x: &mut [f64], y: &mut [f64]) {
        let numbers = &numbers[..self.table_len()];
        match self.panels {
            [1, 1] => self.turns::<1, 1, 2>(numbers, u, x, y),
            [2, 1] => self.turns::<2, 1, 3>(numbers, u, x, y),
            [3, 1] => self.turns::<3, 1, 4>(numbers, u, x, y),
            [1, _] => self.turns::<1, 2, 3>(numbers, u, x, y),
            [2, _] => self.turns::<2, 2, 4>(numbers, u, x, y),
            _ => self.turns::<3, 2, 5>(numbers, u, x, y),
        }
    }

    /// The same with so many panels of X, of Y, and in all.
    #[inline(always)]
    fn turns<const X: usize, const Y: usize, const P: usize>(
        self,
        numbers: &[f64],
        u: &[f64],
        x: &mut [f64],
        y: &mut [f64],
    ) {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        let table = numbers.as_chunks::<WIDTH>().0.as_chunks::<P>().0;
        let (of_inputs, others) = table.split_at((lag - 1 + INSTANTS) * m);
        let (of_outputs, of_states) = others.split_at((lag - 1) * p);
        // nothing before the window
        let sums = with([[0.0; WIDTH]; P], &of_inputs[(lag - 1) * m..], u);
        write(sums.first_chunk::<X>(), x);
        write(sums.last_chunk::<Y>(), y);
        let [mut k_n, mut k_p, mut k_m] = [n, p, m].map(|width| INSTANTS * width);
        while k_m < u.len() {
            let (x_before, x) = x.split_at_mut(k_n);
            let (y_before, y) = y.split_at_mut(k_p);
            let sums = with([[0.0; WIDTH]; P], of_inputs, &u[k_m - (lag - 1) * m..]);
            let sums = with(sums, of_outputs, &y_before[k_p - (lag - 1) * p..]);
            let sums = with(sums, of_states, &x_before[k_n - lag * n..]);
            write(sums.first_chunk::<X>(), x);
            write(sums.last_chunk::<Y>(), y);
            [k_n, k_p, k_m] = [k_n + INSTANTS * n, k_p + INSTANTS * p, k_m + INSTANTS * m];
        }
    }
}

/// sums + Σ_j column_j h_j, as far as both go.
#[inline(always)]
fn with<const P: usize>(sums: [Column; P], columns: &[[Column; P]], h: &[f64]) -> [Column; P] {
    let mut sums = sums;
    for (columns, h) in columns.iter().zip(h) {
        for (sum, column) in sums.iter_mut().zip(columns) {
            add(sum, column, *h);
        }
    }
    sums
}

#[inline(always)]
fn write<const P: usize>(sums: Option<&[Column; P]>, to: &mut [f64]) {
    if let (Some(sums), Some(to)) = (sums, to.as_chunks_mut::<WIDTH>().0.first_chunk_mut::<P>()) {
        *to = *sums;
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::panels::write_panels;
    use std::{vec, vec::Vec};

    /// Numbers between -½ and ½ that look random.
    fn numbers(len: usize, seed: usize) -> Vec<f64> {
        let number = |k: usize| ((k * 31 + seed * 17 + 7) as f64).sin() * 1e4;
        (0..len).map(number).map(|x| x - x.floor() - 0.5).collect()
    }

    /// Whether the look-ahead is the recursion, of systems with n states, p outputs, m inputs and L
    /// instants, over a window of this depth; None where there is none.
    fn agree([n, p, m, lag]: [usize; 4], depth: usize) -> Option<bool> {
        let sizes = ResponseSizes { n, p, m, lag };
        let look_ahead = LookAhead::new(sizes)?;
        let (rows, columns) = (n + p, sizes.regressors());
        let entries = numbers(rows * columns, n + 2 * p + 3 * m + 5 * lag);
        let mut theta = vec![0.0; sizes.panels_len()];
        write_panels((rows, columns), |i, j| entries[i * columns + j], &mut theta);
        let (response, u) = (Response::new(sizes, &theta), numbers(depth * m, depth));
        let (mut x, mut y) = (vec![0.0; depth * n], vec![0.0; depth * p]);
        response.forced(&u, &mut x, &mut y, &mut vec![0.0; padded(rows)]);
        let mut own = vec![0.0; look_ahead.len()];
        look_ahead.make(&response, &mut own);
        let [mut x_f, mut y_f] = look_ahead.motion_len(depth).map(|len| vec![f64::NAN; len]);
        look_ahead.forced(&own, &u, &mut x_f, &mut y_f);
        let size = x.iter().chain(&y).fold(1.0_f64, |size, x| size.max(x.abs()));
        let mut pairs = x.iter().zip(&x_f).chain(y.iter().zip(&y_f));
        Some(pairs.all(|(a, b)| (a - b).abs() < 1e-12 * size))
    }

    #[test]
    fn four_instants_at_a_time_are_the_recursion() {
        let mut compared = 0;
        for size in 0..8 * 6 * 3 * 5 {
            let sizes = [size % 8 + 1, size / 8 % 6 + 1, size / 48 % 3 + 1, size / 144 + 1];
            for depth in [1, 3, 4, 5, 8, 22] {
                if let Some(same) = agree(sizes, depth) {
                    assert!(same, "n, p, m, L = {sizes:?}, depth {depth}");
                    compared += 1;
                }
            }
        }
        // 21 pairs of n ≤ 6 and p ≤ 4 with n + p ≤ 8, m ≤ 3 and L ≤ 4
        assert_eq!(compared, 21 * 3 * 4 * 6);
    }
}
