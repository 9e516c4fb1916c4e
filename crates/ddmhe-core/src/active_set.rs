//! A dense dual active-set method for the least-distance problem: minimise ½‖z - z*‖² subject to lo
//! ≤ c + A z ≤ hi.
//!
//! D. Goldfarb, A. Idnani, "A numerically stable dual method for solving strictly convex quadratic
//! programs" (1983), with the identity as Hessian. It takes in the most violated row at a time
//! while every multiplier stays at least 0; rows whose multiplier would change sign are dropped on
//! the way. The unit normals of the active rows are kept as N = Q R.
//!
//! *Warm start.* The active rows stay from one call to the next, with their factor, since only z*
//! and the bounds change. Rows whose multiplier is negative there are dropped first: what is left
//! is optimal for its own rows, as the method needs.
//!
//! *One set, one answer.* The factor at the end is always that of taking in the active rows in the
//! order of the list, so that an answer depends on that list alone, not on how it was reached: a
//! saved list continues with the same numbers.
//!
//! *Certainty.* The answer is checked against the optimality conditions, and the number of changes
//! is bounded. That no window satisfies the bounds is said only of a combination of rows that
//! proves it (Farkas). Whatever is not certain (nearly dependent rows, too many changes, a check
//! that fails) is [`Outcome::Uncertain`] and left to [`way_out`](crate::way_out).
//!
//! Nothing here allocates: the numbers live in the caller's memory, [`work_len`] of them.

use crate::panels::{WIDTH, axpy, dot, each, padded};
use crate::status::Status;
use crate::tol;
use faer::MatRef;
use serde::{Deserialize, Serialize};

/// What the method is certain of, with the number of rows that were taken in or dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    Optimal(u32),
    /// No z satisfies all bounds: a combination of rows proves it.
    Infeasible(u32),
    Uncertain,
}

/// The rows c + A z that bounds may be set on, padded to whole panels with rows that are always 0.
pub(crate) struct Rows {
    r: usize,
    stride: usize,
    normals: Vec<f64>, // unit length, `stride` numbers a row
    offset: Vec<f64>,  // c
    inverse: Vec<f64>, // 1 / length of the row of A; 1 where it is 0
    slack: Vec<f64>,   // violation that counts as none
    unit: Vec<f64>,    // what the tolerances are in units of
    zero: Vec<bool>,
}

impl Rows {
    /// From A and c (padded rows of zeros included) and the unit of each row.
    pub fn new(A: MatRef<'_, f64>, offset: Vec<f64>, unit: Vec<f64>) -> Self {
        let (r, stride) = (A.ncols(), A.ncols().next_multiple_of(4));
        let lengths: Vec<f64> =
            (0..A.nrows()).map(|i| (0..r).map(|j| A[(i, j)].powi(2)).sum::<f64>().sqrt()).collect();
        let mut normals = vec![0.0; A.nrows() * stride];
        for (i, &length) in lengths.iter().enumerate().filter(|(_, length)| **length > 0.0) {
            (0..r).for_each(|j| normals[i * stride + j] = A[(i, j)] / length);
        }
        Rows {
            r,
            stride,
            normals,
            inverse: lengths.iter().map(|&l| if l > 0.0 { 1.0 / l } else { 1.0 }).collect(),
            slack: unit.iter().map(|u| tol::VIOLATED * u).collect(),
            zero: lengths.iter().map(|&l| l == 0.0).collect(),
            offset,
            unit,
        }
    }

    pub fn r(&self) -> usize {
        self.r
    }

    /// c + A z = offset + normal·z / inverse.
    pub fn offset(&self) -> &[f64] {
        &self.offset
    }

    /// Number of rows, padding included.
    pub fn len(&self) -> usize {
        self.offset.len()
    }

    pub fn unit(&self) -> &[f64] {
        &self.unit
    }

    /// Entry of A.
    pub fn entry(&self, row: usize, j: usize) -> f64 {
        if self.zero[row] { 0.0 } else { self.normals[row * self.stride + j] / self.inverse[row] }
    }

    /// A row of A to unit length (or zeros), padded.
    #[inline(always)]
    pub fn normal(&self, row: usize) -> &[f64] {
        &self.normals[row * self.stride..(row + 1) * self.stride]
    }

    /// 1 / length of a row of A: from a distance of the window to one along the normal.
    #[inline(always)]
    pub fn inverse(&self, row: usize) -> f64 {
        self.inverse[row]
    }

    /// The side that is violated most in units of its row's length, if any by more than the
    /// tolerance so many times.
    #[inline(always)]
    fn worst(&self, w: &[f64], lo: &[f64], hi: &[f64], times: f64) -> Option<ActiveBound> {
        // lane by lane: the largest excess and the chunk of eight rows that it is in
        let (mut most, mut at) = ([0.0_f64; WIDTH], [0.0_f64; WIDTH]);
        let chunks = w
            .as_chunks::<WIDTH>()
            .0
            .iter()
            .zip(lo.as_chunks::<WIDTH>().0)
            .zip(hi.as_chunks::<WIDTH>().0);
        let rows =
            self.slack.as_chunks::<WIDTH>().0.iter().zip(self.inverse.as_chunks::<WIDTH>().0);
        let mut chunk = 0.0;
        for (((w, lo), hi), (slack, inverse)) in chunks.zip(rows) {
            let (below, above) = (each(*lo, *w, |l, w| l - w), each(*w, *hi, |w, h| w - h));
            let excess =
                each(below, above, |below, above| if below > above { below } else { above });
            let excess =
                each(each(excess, *slack, |e, slack| e - slack * times), *inverse, |e, inverse| {
                    e * inverse
                });
            let larger = each(excess, most, |e, most| if e > most { 1.0 } else { 0.0 });
            at = each(at, larger, |at, larger| if larger > 0.0 { chunk } else { at });
            most = each(most, excess, |most, e| if e > most { e } else { most });
            chunk += WIDTH as f64;
        }
        let lane = (1..WIDTH).fold(0, |best, i| if most[i] > most[best] { i } else { best });
        let row = at[lane] as usize + lane;
        let sign = if most[lane] > 0.0 && lo[row] - w[row] < w[row] - hi[row] { -1.0 } else { 1.0 };
        (most[lane] > 0.0).then_some(ActiveBound { row, sign })
    }
}

/// An active bound: its row, and +1 for the lower one, -1 for the upper one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct ActiveBound {
    pub row: usize,
    pub sign: f64,
}

/// The active bounds of the last call, and how they move from call to call.
#[derive(Debug, Clone, Default)]
pub(crate) struct WorkingSet {
    pub sides: Vec<ActiveBound>,
    /// Whether the last call's active bounds were better foretold by those before moved on with the
    /// window (a bound that was active at a certain time) than by the same rows again (one that is
    /// active at a certain age).
    pub moves: bool,
    before: Vec<ActiveBound>,
    factored: bool, // whether Q and R in memory are of these sides
}

impl WorkingSet {
    pub fn new(sides: Vec<ActiveBound>, moves: bool) -> Self {
        WorkingSet { sides, moves, before: Vec::new(), factored: false }
    }

    /// Room for `most` active bounds.
    pub fn reserve(&mut self, most: usize) {
        self.sides.reserve(most - self.sides.len());
        self.before.reserve(most - self.before.len());
    }

    pub fn clear(&mut self) {
        self.sides.clear();
        self.factored = false;
    }

    /// The next call is about another problem: the rows may serve again, their factor not.
    pub fn forget_factor(&mut self) {
        self.factored = false;
    }

    /// To the bounds that are likely to be active next; `older` is where a row is when the window
    /// has moved on by a sample.
    pub fn predict(&mut self, older: impl Fn(usize) -> Option<usize>) {
        self.before.clone_from(&self.sides);
        if self.moves && !self.sides.is_empty() {
            self.sides.retain_mut(|side| older(side.row).map(|row| side.row = row).is_some());
            self.factored = false;
        }
    }

    /// Learns from what the active bounds became.
    pub fn adapt(&mut self, older: impl Fn(usize) -> Option<usize>) {
        let stayed = self.before.iter().filter(|side| self.sides.contains(side)).count();
        let moved = |side: &&ActiveBound| {
            older(side.row).is_some_and(|row| self.sides.contains(&ActiveBound { row, ..**side }))
        };
        let moved = self.before.iter().filter(moved).count();
        if stayed != moved {
            self.moves = moved > stayed;
        }
    }
}

/// What reconstructs windows.
pub(crate) trait Windows {
    /// c + A z (padded) from z.
    fn window(&self, z: &[f64], window: &mut [f64]);
}

/// What the method trusts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trust {
    pub dependent: (f64, f64),
    pub multipliers: f64,
    /// Whether z is moved back onto the active bounds before others are looked at: where z* is so
    /// far away that its digits end above the tolerance.
    pub far: bool,
}

impl Trust {
    /// Enough for an answer without a second look.
    pub const CERTAIN: Trust =
        Trust { dependent: tol::DEPENDENT, multipliers: tol::MULTIPLIERS, far: false };
    /// Whatever can be computed at all: the answer is then checked from the outside.
    pub const ANYTHING: Trust =
        Trust { dependent: (tol::PARALLEL, tol::PARALLEL), multipliers: f64::INFINITY, far: true };
}

/// One problem. Its window is c + A z for z = z* + t, or z* + L⁻ᵀt for a Hessian L Lᵀ.
pub(crate) struct Problem<'a, W: Windows> {
    pub rows: &'a Rows,
    pub lo: &'a [f64],
    pub hi: &'a [f64],
    pub free: &'a [f64],                   // z*, padded
    pub hessian_factor: Option<&'a [f64]>, // L by rows of `stride` numbers
    pub windows: &'a W,
    pub trust: Trust,
}

/// Numbers that [`solve`] works with at rank r.
pub(crate) fn work_len(r: usize) -> usize {
    let stride = r.next_multiple_of(4);
    2 * r * stride + 5 * stride + 2 * padded(r)
}

/// The caller's memory, by name.
struct Work<'a> {
    stride: usize,
    q: &'a mut [f64],     // Q by columns
    upper: &'a mut [f64], // R by columns
    b: &'a mut [f64],     // what is missing to each active bound at z*
    u: &'a mut [f64],     // multipliers
    t: &'a mut [f64],
    n: &'a mut [f64],    // normal of the row that is taken in …
    d: &'a mut [f64],    // … = Q d + rest
    rest: &'a mut [f64], // padded, as is
    back: &'a mut [f64], // R⁻¹ d
}

impl<'a> Work<'a> {
    fn new(memory: &'a mut [f64], r: usize) -> Self {
        let stride = r.next_multiple_of(4);
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
    fn split(&mut self, k: usize) -> f64 {
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
    fn append(&mut self, k: usize, length: f64) {
        let s = self.stride;
        self.upper[k * s..k * s + k].copy_from_slice(&self.d[..k]);
        self.upper[k * s + k] = length.sqrt();
        let inverse = 1.0 / length.sqrt();
        for (q, z) in self.q[k * s..(k + 1) * s].iter_mut().zip(&*self.rest) {
            *q = z * inverse;
        }
    }

    /// `back` = R⁻¹ d for k columns.
    #[inline(always)]
    fn solve_upper(&mut self, k: usize) {
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
    fn point(&mut self, k: usize) {
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
    fn drop(&mut self, j: usize, sides: &mut Vec<ActiveBound>) {
        let (k, s) = (sides.len(), self.stride);
        sides.remove(j);
        self.u.copy_within(j + 1..k, j);
        self.b.copy_within(j + 1..k, j);
        self.upper.copy_within((j + 1) * s..k * s, j * s);
        for i in j..k - 1 {
            let (a, b) = (self.upper[i * s + i], self.upper[i * s + i + 1]);
            let norm = (a * a + b * b).sqrt();
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

impl<W: Windows> Problem<'_, W> {
    /// Into z and its window w (both padded), starting from the kept active bounds and leaving the
    /// new ones there. z and w say nothing unless the outcome is [`Outcome::Optimal`].
    #[inline(always)]
    pub fn solve(
        &self,
        kept: &mut WorkingSet,
        memory: &mut [f64],
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        let mut work = Work::new(memory, self.rows.r);
        let warm = !kept.sides.is_empty();
        let mut outcome = self.attempt(kept, &mut work, z, w);
        if warm && outcome == Outcome::Uncertain {
            kept.clear();
            outcome = self.attempt(kept, &mut work, z, w);
        }
        if !matches!(outcome, Outcome::Optimal(_)) {
            kept.clear();
        }
        outcome
    }

    /// From no active bounds, in memory of its own: what it found, the bounds that it held active
    /// last and their multipliers. z and w are the last point and its window, whatever was found.
    #[cold]
    pub fn anew(&self, z: &mut [f64], w: &mut [f64]) -> (Outcome, Vec<ActiveBound>, Vec<f64>) {
        let mut memory = vec![0.0; work_len(self.rows.r)];
        let (mut kept, mut work) = (WorkingSet::default(), Work::new(&mut memory, self.rows.r));
        let outcome = self.attempt(&mut kept, &mut work, z, w);
        let multipliers = work.u[..kept.sides.len()].to_vec();
        (outcome, kept.sides, multipliers)
    }

    #[inline(always)]
    fn attempt(
        &self,
        kept: &mut WorkingSet,
        work: &mut Work<'_>,
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        let mut changes = 0;
        let mut rotated = false; // whether the factor is another than that of the list
        let bounded = |side: &ActiveBound| self.bound(*side).is_finite();
        if !kept.sides.iter().all(bounded) {
            kept.sides.retain(bounded);
            kept.factored = false;
        }
        if !kept.factored && !self.refactor(&kept.sides, work) {
            return Outcome::Uncertain;
        }
        self.missing(&kept.sides, work);
        loop {
            let k = kept.sides.len();
            work.point(k);
            match (0..k).min_by(|&a, &b| work.u[a].total_cmp(&work.u[b])) {
                Some(j) if work.u[j] < 0.0 => work.drop(j, &mut kept.sides),
                _ => break,
            }
            (changes, rotated) = (changes + 1, true);
        }
        let most = tol::ACTIVE_SET_CHANGES as u32 + 4 * self.rows.r as u32;
        loop {
            self.reconstruct(work, z, w);
            let Some(side) = self.violated(&kept.sides, work, z, w) else { break };
            if kept.sides.contains(&side) {
                return Outcome::Uncertain; // violated although active: accuracy is lost
            }
            if let Some(outcome) = self.add_constraint(
                side,
                w,
                &mut kept.sides,
                work,
                (&mut changes, most),
                &mut rotated,
            ) {
                return outcome;
            }
        }
        if rotated {
            if !self.refactor(&kept.sides, work) {
                return Outcome::Uncertain;
            }
            work.point(kept.sides.len());
            self.reconstruct(work, z, w);
            self.violated(&kept.sides, work, z, w);
        }
        kept.factored = true;
        if self.verified(&kept.sides, work, w) {
            Outcome::Optimal(changes)
        } else {
            Outcome::Uncertain
        }
    }

    /// Takes in a violated side, dropping others where their multipliers ask for it. Some: the end.
    #[inline(always)]
    fn add_constraint(
        &self,
        side: ActiveBound,
        w: &[f64],
        sides: &mut Vec<ActiveBound>,
        work: &mut Work<'_>,
        (changes, most): (&mut u32, u32),
        rotated: &mut bool,
    ) -> Option<Outcome> {
        if self.rows.zero[side.row] {
            let proved = self.proof(side, &[], 0.0, work);
            return Some(if proved { Outcome::Infeasible(*changes) } else { Outcome::Uncertain }); // 0ᵀz cannot be above 0
        }
        self.normal(side, work);
        let missing = match self.trust.far {
            false => self.gap(side),
            true => {
                let to_bound =
                    side.sign * (self.bound(side) - w[side.row]) * self.rows.inverse[side.row];
                dot(work.n, work.t) + to_bound
            }
        };
        let norm = dot(work.n, work.n).sqrt();
        loop {
            *changes += 1;
            if *changes > most {
                return Some(Outcome::Uncertain);
            }
            let k = sides.len();
            let length = work.split(k);
            work.solve_upper(k);
            // how far until an active row's multiplier is 0
            let (mut partial, mut blocking) = (f64::INFINITY, usize::MAX);
            for j in 0..k {
                if work.back[j] > tol::MULTIPLIER && work.u[j] / work.back[j] < partial {
                    (partial, blocking) = (work.u[j] / work.back[j], j);
                }
            }
            let ratio = length.sqrt() / norm;
            let dependent = k == self.rows.r || ratio <= self.trust.dependent.0;
            if !dependent && ratio < self.trust.dependent.1 {
                return Some(Outcome::Uncertain);
            }
            let full =
                if dependent { f64::INFINITY } else { (missing - dot(work.n, work.t)) / length };
            if partial.is_infinite() && full.is_infinite() {
                // n = N v with v ≤ 0: no t has Nᵀt ≥ b and nᵀt ≥ b_n unless b_n ≤ vᵀb
                let proved = self.proof(side, sides, norm, work);
                return Some(if proved {
                    Outcome::Infeasible(*changes)
                } else {
                    Outcome::Uncertain
                });
            }
            let step = partial.min(full);
            if full <= partial {
                work.append(k, length);
                work.b[k] = missing;
                sides.push(side);
                work.point(k + 1);
                return None;
            }
            if blocking == usize::MAX {
                return Some(Outcome::Uncertain); // a step that is not a number
            }
            for (u, v) in work.u[..k].iter_mut().zip(&*work.back) {
                *u = (*u - step * v).max(0.0);
            }
            if !dependent {
                axpy(step, &work.rest[..work.stride], work.t);
            }
            work.drop(blocking, sides);
            *rotated = true;
        }
    }

    /// Whether n = N v with v ≤ 0 (in `back`) proves that no window is within the bounds: not even
    /// one that exceeds each of them by the tolerance of an optimal one, and after one refinement
    /// of v. See [`Combination`].
    #[cold]
    fn proof(
        &self,
        side: ActiveBound,
        sides: &[ActiveBound],
        norm: f64,
        work: &mut Work<'_>,
    ) -> bool {
        let k = sides.len();
        for again in [true, false] {
            self.normal(side, work);
            for (j, &other) in sides.iter().enumerate() {
                work.back[j] = work.back[j].min(0.0);
                self.add_normal(other, -work.back[j], work);
            }
            if again && k > 0 {
                work.t[..k].copy_from_slice(&work.back[..k]);
                work.split(k);
                work.solve_upper(k);
                work.back[..k].iter_mut().zip(&*work.t).for_each(|(back, v)| *back += v);
            }
        }
        let mut sum = Combination::new(dot(work.n, work.n).sqrt() / norm.max(f64::MIN_POSITIVE));
        self.weigh(side, 1.0, &mut sum);
        sides.iter().zip(&*work.back).for_each(|(&side, v)| self.weigh(side, -v, &mut sum));
        sum.proves()
    }

    /// Adds a side's bound, times its multiplier, to a combination.
    pub fn weigh(&self, side: ActiveBound, multiplier: f64, sum: &mut Combination) {
        let ActiveBound { row, sign } = side;
        let bound = sign * (self.bound(side) - self.rows.offset[row]) * self.rows.inverse[row];
        sum.bounds += multiplier * bound;
        sum.size += multiplier * bound.abs();
        sum.largest = sum.largest.max(bound.abs());
        sum.tolerance +=
            multiplier * self.rows.unit[row] * self.rows.inverse[row] * tol::ACTIVE_SET;
        sum.multipliers += multiplier;
    }

    /// Q and R of the sides in their order; false if they are dependent.
    #[inline(always)]
    fn refactor(&self, sides: &[ActiveBound], work: &mut Work<'_>) -> bool {
        for (k, &side) in sides.iter().enumerate() {
            self.normal(side, work);
            let norm = dot(work.n, work.n);
            let length = work.split(k);
            if k >= self.rows.r || length.sqrt() < self.trust.dependent.0 * norm.sqrt() {
                return false;
            }
            work.append(k, length);
        }
        true
    }

    /// The outward unit normal of a side, in the coordinates of t.
    #[inline(always)]
    fn normal(&self, side: ActiveBound, work: &mut Work<'_>) {
        for (n, a) in work.n.iter_mut().zip(self.rows.normal(side.row)) {
            *n = side.sign * a;
        }
        if let Some(L) = self.hessian_factor {
            solve_lower(L, &mut work.n[..self.rows.r], work.stride);
        }
    }

    /// n plus a multiple of a side's normal.
    fn add_normal(&self, side: ActiveBound, multiplier: f64, work: &mut Work<'_>) {
        let Work { n, rest, stride, .. } = work;
        rest[..*stride]
            .iter_mut()
            .zip(self.rows.normal(side.row))
            .for_each(|(n, a)| *n = side.sign * a);
        if let Some(L) = self.hessian_factor {
            solve_lower(L, &mut rest[..self.rows.r], *stride);
        }
        axpy(multiplier, &rest[..*stride], n);
    }

    /// How far z* is from a side's bound, along its unit normal.
    #[inline(always)]
    fn gap(&self, ActiveBound { row, sign }: ActiveBound) -> f64 {
        let along = dot(self.rows.normal(row), &self.free[..self.rows.stride]);
        sign * ((self.bound(ActiveBound { row, sign }) - self.rows.offset[row])
            * self.rows.inverse[row]
            - along)
    }

    #[inline(always)]
    pub fn bound(&self, side: ActiveBound) -> f64 {
        if side.sign > 0.0 { self.lo[side.row] } else { self.hi[side.row] }
    }

    #[inline(always)]
    fn missing(&self, sides: &[ActiveBound], work: &mut Work<'_>) {
        for (&side, b) in sides.iter().zip(&mut *work.b) {
            *b = self.gap(side);
        }
    }

    /// z = z* + t (L⁻ᵀt) and its window.
    #[inline(always)]
    fn reconstruct(&self, work: &mut Work<'_>, z: &mut [f64], w: &mut [f64]) {
        let (r, s) = (self.rows.r, work.stride);
        work.back[..r].copy_from_slice(&work.t[..r]);
        if let Some(L) = self.hessian_factor {
            solve_transposed(L, &mut work.back[..r], s);
        }
        for ((z, free), t) in z[..r].iter_mut().zip(self.free).zip(&*work.back) {
            *z = free + t;
        }
        self.windows.window(&z[..r], w);
    }

    /// The side that is violated most. One that is active already is so by rounding, of z* far away
    /// from its bounds: z is then moved back onto all active bounds.
    #[inline(always)]
    fn violated(
        &self,
        sides: &[ActiveBound],
        work: &mut Work<'_>,
        z: &mut [f64],
        w: &mut [f64],
    ) -> Option<ActiveBound> {
        if self.trust.far && !sides.is_empty() {
            self.refine(sides, work, z, w);
        }
        let mut side = self.rows.worst(w, self.lo, self.hi, 1.0)?;
        for _ in 0..tol::REFINEMENTS {
            if !sides.contains(&side) {
                break;
            }
            self.refine(sides, work, z, w);
            side = self.rows.worst(w, self.lo, self.hi, 1.0)?;
        }
        Some(side)
    }

    /// The shortest step that puts the window w of z onto the active bounds.
    #[cold]
    fn refine(&self, sides: &[ActiveBound], work: &mut Work<'_>, z: &mut [f64], w: &mut [f64]) {
        let (r, s) = (self.rows.r, work.stride);
        work.rest.fill(0.0);
        for (j, &side) in sides.iter().enumerate() {
            let column = &work.upper[j * s..j * s + j + 1];
            let missing =
                side.sign * (self.bound(side) - w[side.row]) * self.rows.inverse[side.row];
            work.d[j] = (missing - dot(&column[..j], &work.d[..j])) / column[j];
            axpy(work.d[j], &work.q[j * s..(j + 1) * s], &mut work.rest[..s]);
        }
        if let Some(L) = self.hessian_factor {
            solve_transposed(L, &mut work.rest[..r], s);
        }
        axpy(1.0, &work.rest[..r], &mut z[..r]);
        self.windows.window(&z[..r], w);
    }

    /// Whether a row is at its bound, to the tolerance of an optimal one.
    #[inline(always)]
    fn at_bound(&self, side: ActiveBound, w: &[f64]) -> bool {
        (self.bound(side) - w[side.row]).abs() <= tol::ACTIVE_SET * self.rows.unit[side.row]
    }

    /// Whether a window is inside its bounds, to the tolerance of an optimal one.
    #[inline(always)]
    pub fn inside(&self, w: &[f64]) -> bool {
        self.rows.worst(w, self.lo, self.hi, tol::ACTIVE_SET / tol::VIOLATED).is_none()
    }

    /// The status of an answer whose rows, as they are handed out, may be out of their bounds by
    /// the rounding of large numbers.
    pub fn as_far_as_inside(&self, w: &[f64], status: Status) -> Status {
        let almost = tol::ALMOST.0 / tol::VIOLATED;
        match status {
            status if self.inside(w) => status,
            _ if self.rows.worst(w, self.lo, self.hi, almost).is_none() => Status::AlmostOptimal,
            _ => Status::Failed,
        }
    }

    /// Whether every row is inside its bounds and every multiplier has its sign.
    #[inline(always)]
    fn verified(&self, sides: &[ActiveBound], work: &Work<'_>, w: &[f64]) -> bool {
        let size = dot(work.t, work.t).sqrt().max(1.0);
        let u = &work.u[..sides.len()];
        let signs = u.iter().all(|&u| u >= -tol::WRONG_SIGN * size);
        // t = N u only up to rounding of that sum, and by so much t may miss the minimiser
        let accurate = u.iter().map(|u| u.abs()).sum::<f64>() <= self.trust.multipliers * size;
        let mut at_bounds = true; // by a loop, as in `panels`
        for &side in sides {
            at_bounds &= self.at_bound(side, w);
        }
        signs && accurate && at_bounds && self.inside(w)
    }
}

/// A combination of sides with multipliers of at least 0: what [`Problem::weigh`] adds up, with the
/// length of what is left of their normals. If that is rounding and the bounds add up to more than
/// what they are loosened by, nothing satisfies them all.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Combination {
    rest: f64,
    bounds: f64,
    size: f64,
    largest: f64,
    tolerance: f64,
    multipliers: f64,
}

impl Combination {
    pub fn new(rest: f64) -> Self {
        Combination { rest, ..Combination::default() }
    }

    pub fn proves(&self) -> bool {
        let parallel = self.rest <= tol::PARALLEL * self.multipliers;
        // what is left of the normals could make up for the bounds only this far away
        let reach = tol::REACH * self.largest * self.rest;
        parallel && self.bounds > self.tolerance + tol::PARALLEL * self.size + reach
    }
}

/// x ← L⁻¹ x, L by rows of `stride` numbers.
#[inline(always)]
pub(crate) fn solve_lower(L: &[f64], x: &mut [f64], stride: usize) {
    for i in 0..x.len() {
        let row = &L[i * stride..i * stride + i + 1];
        x[i] = (x[i] - dot(&row[..i], &x[..i])) / row[i];
    }
}

/// x ← L⁻ᵀ x, L by rows of `stride` numbers.
#[inline(always)]
pub(crate) fn solve_transposed(L: &[f64], x: &mut [f64], stride: usize) {
    for i in (0..x.len()).rev() {
        let row = &L[i * stride..i * stride + i + 1];
        x[i] /= row[i];
        let value = x[i];
        axpy(-value, &row[..i], &mut x[..i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::Status;
    use crate::way_out::way_out;
    use faer::Mat;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const INF: f64 = f64::INFINITY;

    impl Windows for Mat<f64> {
        fn window(&self, z: &[f64], w: &mut [f64]) {
            (0..self.nrows())
                .for_each(|i| w[i] = z.iter().enumerate().map(|(j, z)| self[(i, j)] * z).sum());
        }
    }

    /// The method with its memory, about z* = 0 and with windows A z.
    struct Solver {
        A: Mat<f64>,
        rows: Rows,
        kept: WorkingSet,
        memory: Vec<f64>,
    }

    impl Solver {
        fn new(A: &Mat<f64>) -> Self {
            let len = padded(A.nrows());
            let all =
                Mat::from_fn(len, A.ncols(), |i, j| if i < A.nrows() { A[(i, j)] } else { 0.0 });
            Solver {
                rows: Rows::new(all.as_ref(), vec![0.0; len], vec![1.0; len]),
                kept: WorkingSet::default(),
                memory: vec![0.0; work_len(A.ncols())],
                A: all,
            }
        }

        /// Padded bounds, z* = 0, and room for z and its window.
        fn room(&self, lo: &[f64], hi: &[f64]) -> [Vec<f64>; 5] {
            let (len, r) = (self.A.nrows(), padded(self.A.ncols()));
            let (mut lo, mut hi) = (lo.to_vec(), hi.to_vec());
            lo.resize(len, -INF);
            hi.resize(len, INF);
            [lo, hi, vec![0.0; r], vec![0.0; r], vec![0.0; len]]
        }

        fn solve(&mut self, lo: &[f64], hi: &[f64]) -> (Outcome, Vec<f64>) {
            let r = self.A.ncols();
            let [lo, hi, free, mut z, mut w] = self.room(lo, hi);
            let (mut kept, mut memory) =
                (std::mem::take(&mut self.kept), std::mem::take(&mut self.memory));
            let outcome = self.problem(&lo, &hi, &free, Trust::CERTAIN).solve(
                &mut kept,
                &mut memory,
                &mut z,
                &mut w,
            );
            (self.kept, self.memory) = (kept, memory);
            z.truncate(r);
            (outcome, z)
        }

        fn problem<'a>(
            &'a self,
            lo: &'a [f64],
            hi: &'a [f64],
            free: &'a [f64],
            trust: Trust,
        ) -> Problem<'a, Mat<f64>> {
            Problem {
                rows: &self.rows,
                lo,
                hi,
                free,
                hessian_factor: None,
                windows: &self.A,
                trust,
            }
        }

        /// What the way out finds.
        fn way_out(&self, lo: &[f64], hi: &[f64]) -> (Status, Vec<f64>) {
            let r = self.A.ncols();
            let [lo, hi, free, mut z, mut w] = self.room(lo, hi);
            let (status, _) =
                way_out(&self.problem(&lo, &hi, &free, Trust::CERTAIN), &mut z, &mut w);
            z.truncate(r);
            (status, z)
        }
    }

    fn solve(rows: &[[f64; 2]], lo: &[f64], hi: &[f64]) -> (Outcome, Vec<f64>) {
        Solver::new(&Mat::from_fn(rows.len(), 2, |i, j| rows[i][j])).solve(lo, hi)
    }

    fn close((outcome, z): (Outcome, Vec<f64>), expected: [f64; 2]) -> bool {
        matches!(outcome, Outcome::Optimal(_))
            && z.iter().zip(expected).all(|(z, e)| (z - e).abs() < 1e-12)
    }

    #[test]
    fn the_origin_is_the_answer_when_it_is_inside() {
        assert!(close(solve(&[[1.0, 0.0], [1.0, 2.0]], &[-1.0, -INF], &[1.0, 3.0]), [0.0, 0.0]));
    }

    #[test]
    fn projections_that_can_be_done_by_hand() {
        // onto x ≥ 1; onto the line x + y = 2; onto the corner of x ≥ 1, y ≥ 2
        assert!(close(solve(&[[1.0, 0.0]], &[1.0], &[INF]), [1.0, 0.0]));
        assert!(close(solve(&[[1.0, 1.0]], &[2.0], &[2.0]), [1.0, 1.0]));
        assert!(close(solve(&[[1.0, 0.0], [0.0, 1.0]], &[1.0, 2.0], &[INF, INF]), [1.0, 2.0]));
    }

    #[test]
    fn redundant_and_repeated_rows_do_no_harm() {
        assert!(close(
            solve(&[[1.0, 0.0], [1.0, 0.0], [2.0, 0.0]], &[1.0, 1.0, 2.0], &[INF, 3.0, INF]),
            [1.0, 0.0]
        ));
    }

    #[test]
    fn contradicting_bounds_are_infeasible() {
        let (outcome, _) = solve(&[[1.0, 0.0], [1.0, 0.0]], &[1.0, -INF], &[INF, 0.0]);
        assert!(matches!(outcome, Outcome::Infeasible(_)));
    }

    /// Random windows with redundant, equal, opposite and nearly parallel rows, bounds that touch,
    /// and contradictions. The last number is the closest that two rows come to being parallel
    /// without being so: rounding of the data moves the answer by its inverse.
    fn random_problem(rng: &mut ChaCha8Rng) -> (Mat<f64>, Vec<f64>, f64) {
        let mut closest = 1.0_f64;
        let (rows, r) = (rng.random_range(1..40), rng.random_range(1..12));
        let mut A = Mat::from_fn(rows, r, |_, _| rng.random_range(-1.0..1.0_f64));
        let inside: Vec<f64> = (0..r).map(|_| rng.random_range(-2.0..2.0)).collect();
        for i in 1..rows {
            let other = rng.random_range(0..i);
            let (scale, off): (f64, f64) = match rng.random_range(0..16) {
                0 => (1.0, 0.0),
                1 => (-2.0, 0.0),
                2 if rng.random_bool(0.2) => (1.0, 1e-8),
                2 => (1.0, 1e-4),
                3 => (0.0, 0.0),
                _ => continue,
            };
            closest = closest.min(if off > 0.0 { off } else { 1.0 });
            (0..r).for_each(|j| {
                A[(i, j)] = scale * A[(other, j)] + off * rng.random_range(-1.0..1.0);
            });
        }
        (A, inside, closest)
    }

    /// Bounds about a point: some touch, and sometimes they contradict each other.
    fn random_bounds(rng: &mut ChaCha8Rng, A: &Mat<f64>, inside: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let rows = A.nrows();
        let (mut lo, mut hi) = (vec![-INF; rows], vec![INF; rows]);
        let contradiction = rng.random_bool(0.1);
        for i in 0..rows {
            let w: f64 = (0..A.ncols()).map(|j| A[(i, j)] * inside[j]).sum();
            let shift = if contradiction && rng.random_bool(0.2) { 1.5 } else { 0.0 };
            match rng.random_range(0..6) {
                0 => (lo[i], hi[i]) = (w + shift, w + shift), // touch
                1 => lo[i] = w + shift - rng.random_range(0.0..0.3),
                2 => hi[i] = w - shift + rng.random_range(0.0..0.3),
                3 => {}
                _ => {
                    (lo[i], hi[i]) = (
                        w + shift - rng.random_range(0.0..0.5),
                        w + shift + rng.random_range(0.0..0.5),
                    );
                }
            }
        }
        (lo, hi)
    }

    #[test]
    fn warm_or_cold_it_gives_the_interior_point_s_answer() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let (mut optimal, mut infeasible, mut left, mut kept, mut refuted) = (0, 0, 0, 0, 0);
        // a fifth without optimisation, which takes seven times as long
        let share = if cfg!(debug_assertions) { 5 } else { 1 };
        for k in 0..25_000 / share {
            let (A, mut inside, closest) = random_problem(&mut rng);
            let mut warm = Solver::new(&A);
            for _ in 0..4 {
                let (lo, hi) = random_bounds(&mut rng, &A, &inside);
                inside.iter_mut().for_each(|v| *v += rng.random_range(-0.1..0.1));
                let reference = warm.way_out(&lo, &hi);
                kept += usize::from(!warm.kept.sides.is_empty());
                for (outcome, z) in [warm.solve(&lo, &hi), Solver::new(&A).solve(&lo, &hi)] {
                    match outcome {
                        Outcome::Optimal(_) => {
                            let excess = |i: usize| {
                                let w: f64 = (0..z.len()).map(|j| A[(i, j)] * z[j]).sum();
                                (lo[i] - w).max(w - hi[i])
                            };
                            assert!((0..A.nrows()).all(|i| excess(i) < 1e-9), "{k}");
                            if reference.0 == Status::Optimal {
                                let size = z.iter().fold(1.0_f64, |m, v| m.max(v.abs()));
                                let off = z
                                    .iter()
                                    .zip(&reference.1)
                                    .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                                assert!(closest < 1e-6 || off <= 1e-9 * size, "{k}: {off:e}");
                            }
                            // with a point in hand that satisfies all bounds, the reference is
                            // wrong: seen far from z*
                            refuted += usize::from(reference.0 == Status::Infeasible);
                            optimal += 1;
                        }
                        Outcome::Infeasible(_) => {
                            // proved of windows within a million times the bounds' size
                            let size = reference.1.iter().map(|z| z.abs()).fold(0.0, f64::max);
                            assert!(reference.0 != Status::Optimal || size > 1e6, "{k}: {size:e}");
                            infeasible += 1;
                        }
                        Outcome::Uncertain => left += 1,
                    }
                }
            }
        }
        // it must do nearly all of the work, from kept bounds as well, and see contradictions
        assert!(
            share * optimal > 180_000 && share * infeasible > 10_000 && share * kept > 50_000,
            "{optimal} {infeasible} {kept}"
        );
        assert!(share * left < 2000 && refuted < 5, "{left} {refuted}");
    }

    #[test]
    fn an_answer_depends_on_the_kept_list_alone() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for k in 0..300 {
            let (A, mut inside, _) = random_problem(&mut rng);
            let mut running = Solver::new(&A);
            for _ in 0..20 {
                let (lo, hi) = random_bounds(&mut rng, &A, &inside);
                inside.iter_mut().for_each(|v| *v += rng.random_range(-0.05..0.05));
                let mut restored = Solver::new(&A);
                restored.kept = WorkingSet::new(running.kept.sides.clone(), false);
                let (found, again) = (running.solve(&lo, &hi), restored.solve(&lo, &hi));
                assert!(
                    found.0 == again.0
                        && (found.1 == again.1 || !matches!(found.0, Outcome::Optimal(_))),
                    "{k}"
                );
                assert_eq!(running.kept.sides, restored.kept.sides);
            }
        }
    }
}
