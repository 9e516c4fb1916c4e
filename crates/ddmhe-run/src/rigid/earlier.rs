//! Recordings of the same body before the one that a run goes on from: each begins at a rate of its
//! own and shares θ.
//!
//! > R_i d_i + B_i d_θ = q_i
//!
//! Rows of recording i depend on (ω_i, θ), ω_i its first rate. Folded into a factor of (ω, θ) in
//! the place of ω, they leave these three, which give the step d_i once d_θ is known; those below
//! them are of θ alone, and the next recording's are added to them.

use crate::panels::Root;
use crate::rigid::factor::Factor;
use crate::rigid::small::Vector;

/// The most of them: what is kept of them has a fixed size.
pub const EARLIER: usize = 7;

/// Recordings one after the other.
#[derive(Debug, Clone, Copy)]
pub struct Earlier<'a, const P: usize> {
    /// Rates of the first, of the second, …: one more of each than outputs.
    pub x: &'a [Vector],
    /// Outputs.
    pub y: &'a [[f64; P]],
    /// How many outputs each has; at most [`EARLIER`].
    pub lengths: &'a [usize],
}

impl<'a, const P: usize> Earlier<'a, P> {
    /// Without any.
    pub const NONE: Self = Earlier { x: &[], y: &[], lengths: &[] };

    /// Rates and outputs of recording i; None behind the last.
    pub fn part(&self, i: usize) -> Option<(&'a [Vector], &'a [[f64; P]])> {
        let length = *self.lengths.get(i)?;
        let before: usize = self.lengths[..i].iter().sum();
        let y = self.y.get(before..before + length)?;
        Some((self.x.get(before + i..before + i + length + 1)?, y))
    }
}

/// First rates ω_i of the recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Firsts {
    w: [Vector; EARLIER],
    count: usize,
}

impl Firsts {
    /// Without any.
    pub const NONE: Self = Firsts { w: [[0.0; 3]; EARLIER], count: 0 };

    /// These, up to [`EARLIER`] of them.
    pub fn of(given: impl Iterator<Item = Vector>) -> Self {
        let mut firsts = Firsts::NONE;
        for (own, w) in firsts.w.iter_mut().zip(given) {
            *own = w;
            firsts.count += 1;
        }
        firsts
    }

    /// They.
    pub fn rates(&self) -> &[Vector] {
        &self.w[..self.count]
    }

    /// Those a step further.
    pub fn moved(&self, steps: &Firsts) -> Self {
        let both = self.rates().iter().zip(steps.rates());
        Firsts::of(both.map(|(w, d)| [0, 1, 2].map(|i| w[i] + d[i])))
    }
}

/// The rows [R_i B_i | q_i] of each recording that a pass has gone over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eliminated<const N: usize> {
    rows: [Top<N>; EARLIER],
    count: usize,
}

/// The rows of ω in a factor.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Top<const N: usize> {
    R: [[f64; N]; 3],
    q: Vector,
}

impl<const N: usize> Top<N> {
    const EMPTY: Self = Top { R: [[0.0; N]; 3], q: [0.0; 3] };

    /// Changes places with those of a factor.
    fn exchange(&mut self, factor: &mut Factor<N>) {
        self.R.swap_with_slice(&mut factor.R[..3]);
        self.q.swap_with_slice(&mut factor.q[..3]);
    }

    /// d_i = R_i⁻¹ (q_i - B_i d_θ)
    fn step(&self, d: &[f64; N]) -> Vector {
        let mut own = [0.0; 3];
        for i in (0..3).rev() {
            let later: f64 = (i + 1..3).map(|k| self.R[i][k] * own[k]).sum();
            let theta: f64 = (3..N).map(|k| self.R[i][k] * d[k]).sum();
            own[i] = (self.q[i] - later - theta) / self.R[i][i];
        }
        own
    }
}

impl<const N: usize> Eliminated<N> {
    /// Of no recording.
    pub const NONE: Self = Eliminated { rows: [Top::EMPTY; EARLIER], count: 0 };

    /// The rows of one more recording's first rate, out of a factor, which has none of ω then.
    pub fn take(&mut self, factor: &mut Factor<N>) {
        if let Some(top) = self.rows.get_mut(self.count) {
            *top = Top::EMPTY;
            top.exchange(factor);
            self.count += 1;
        }
    }

    /// The damped step of (ω, θ) and those of the first rates that minimise
    /// ‖R d - q‖² + Σ ‖R_i d_i + B_i d_θ - q_i‖² + λ Σ (length of the column · step)² over all.
    pub fn damped_step(&self, factor: &Factor<N>, lambda: f64) -> ([f64; N], Firsts) {
        let (mut damped, weight) = (*factor, lambda.root());
        let mut lengths = factor.lengths();
        let (mut own, mut last) = (*self, Top::EMPTY);
        last.exchange(&mut damped);
        for top in &mut own.rows[..self.count] {
            let (mut rows, mut right) = ([[0.0; N]; 3], [0.0; 3]);
            for (k, row) in rows.iter_mut().enumerate() {
                let length: f64 = top.R.iter().map(|row| row[k] * row[k]).sum();
                row[k] = weight * length.root();
            }
            for row in &top.R {
                let theta = lengths.iter_mut().zip(row).skip(3);
                theta.for_each(|(sum, v)| *sum += v * v);
            }
            top.exchange(&mut damped);
            damped.fold(&mut rows, &mut right);
            top.exchange(&mut damped);
        }
        last.exchange(&mut damped);
        let d = damped.damped(&lengths, weight).solve();
        (d, Firsts::of(own.rows[..self.count].iter().map(|top| top.step(&d))))
    }

    /// Σ log |R_ii| of their diagonals.
    pub fn log_determinant(&self) -> f64 {
        let diagonal = |top: &Top<N>| [0, 1, 2].map(|i| libm::log(top.R[i][i].abs()));
        self.rows[..self.count].iter().flat_map(diagonal).sum()
    }

    /// Σ ‖q_i‖²
    pub fn squares(&self) -> f64 {
        self.rows[..self.count].iter().flat_map(|top| top.q).map(|q| q * q).sum()
    }
}
