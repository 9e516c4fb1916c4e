//! The same dual method where some bounds may be left at a [price](crate::prices).
//!
//! Half of the price of row i, left by δ along its unit normal n, is
//!
//! > c δ + ½ g δ² = ½ (σ + h)² - ½ h²,  c = price / 2 u_i,  g = price / u_i²,
//! >
//! > σ = √price e = δ / κ,  κ = u_i / √price,  h = ½ √price
//!
//! with u_i the channel's deviation along n and e = δ / u_i. So with a coordinate s = σ + h for
//! every such row, the problem is again one of least distance:
//!
//! > minimise ½‖t‖² + ½‖s‖²  subject to  nᵀt + κ s ≥ b + κ h,  s ≥ h.
//!
//! It is solved by the method of Goldfarb and Idnani, with the bounds s ≥ h, the *floors*, active
//! in the beginning. They are at right angles to everything else: as long as the floor of a row is
//! active, the row's normal is n alone, and neither s nor the floor has to be written down. The
//! multiplier of a floor is h - κ u, u the row's own. It is 0, and the floor dropped, when u
//! arrives at h / κ = c: a multiplier beyond what the price allows. Only then does the row get a
//! *slot*, a coordinate of its own, and its floor is from then on a bound like any other. A side
//! with a row number beyond the window's is the floor of a slot.
//!
//! A row that may be left never contradicts others: it is left before its multiplier grows without
//! bound.

use crate::active_set::factor::{Work, solve_lower, solve_transposed, work_len};
use crate::active_set::problem::{Erased, Outcome};
use crate::active_set::working_set::{ActiveBound, Sides, WorkingSet};
use crate::panels::{Root, axpy, dot, padded};
use crate::tol;

/// Numbers that the methods work with: r directions, and `rows` rows of which `soft` may be left.
pub fn priced_len(r: usize, rows: usize, soft: usize) -> usize {
    match soft {
        0 => work_len(r),
        _ => 3 * padded(rows) + padded(soft) + padded(r + soft) + work_len(r + soft),
    }
}

impl Erased<'_> {
    /// Into z and its window w, from no active bounds, in [`priced_len`] numbers of memory.
    #[cold]
    pub fn priced(
        &self,
        kept: &mut WorkingSet<'_>,
        memory: &mut [f64],
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        let mut count = 0;
        match Extended::new(self, memory, &mut count).solve(z, w) {
            Outcome::Infeasible(changes) => self.hard_alone(changes, kept, memory, z, w),
            outcome => outcome,
        }
    }

    /// Whether the bounds that may not be left exclude every window by themselves.
    fn hard_alone(
        &self,
        changes: u32,
        kept: &mut WorkingSet<'_>,
        memory: &mut [f64],
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        let rows = self.rows.len();
        let (lo, memory) = memory.split_at_mut(rows);
        let (hi, memory) = memory.split_at_mut(rows);
        lo.copy_from_slice(&self.lo[..rows]);
        hi.copy_from_slice(&self.hi[..rows]);
        for row in (0..rows).filter(|row| self.slack(*row).is_some()) {
            (lo[row], hi[row]) = (f64::NEG_INFINITY, f64::INFINITY);
        }
        let hard = Erased { lo, hi, prices: None, ..*self };
        let outcome = hard.solve_erased(kept, memory, z, w);
        kept.clear();
        match outcome {
            Outcome::Infeasible(more) => Outcome::Infeasible(changes + more),
            _ => Outcome::Uncertain,
        }
    }
}

/// What stops a step towards a bound.
enum Event {
    /// Nothing: the bound is reached.
    Reached,
    /// The multiplier of active bound j is 0.
    Drop(usize),
    /// That of active bound j is all that its price allows …
    Leave(usize),
    /// … or that of the bound itself.
    LeaveOwn,
    /// Nothing, and the bound is not reached either.
    Never,
}

/// The problem in (t, s), s in the order in which rows were given their slots.
struct Extended<'p, 'a, 'm> {
    problem: &'p Erased<'a>,
    work: Work<'m>,
    sides: Sides<'m>,
    lo: &'m mut [f64], // bounds, moved by what they are left
    hi: &'m mut [f64],
    slot: &'m mut [f64], // of each row, from 1 on; 0: none
    row: &'m mut [f64],  // of each slot
    slots: usize,
    most: usize, // rows that may be left
    changes: u32,
}

impl<'p, 'a, 'm> Extended<'p, 'a, 'm> {
    fn new(problem: &'p Erased<'a>, memory: &'m mut [f64], count: &'m mut usize) -> Self {
        let (rows, r) = (problem.rows.len(), problem.rows.r);
        let bounded = |row: usize| problem.lo[row].is_finite() || problem.hi[row].is_finite();
        let may_be_left = |row: &usize| bounded(*row) && problem.slack(*row).is_some();
        let soft = (0..rows).filter(may_be_left).count();
        let (lo, memory) = memory.split_at_mut(rows);
        let (hi, memory) = memory.split_at_mut(rows);
        let (slot, memory) = memory.split_at_mut(rows);
        let (row, memory) = memory.split_at_mut(padded(soft));
        let (codes, memory) = memory.split_at_mut(padded(r + soft));
        lo.copy_from_slice(&problem.lo[..rows]);
        hi.copy_from_slice(&problem.hi[..rows]);
        slot.fill(0.0);
        let work = Work::new(memory, r + soft);
        let sides = Sides::new(codes, count);
        let (slots, most, changes) = (0, soft, 0);
        let extended = Extended { problem, work, sides, lo, hi, slot, row, slots, most, changes };
        extended.work.t.fill(0.0);
        extended
    }

    fn solve(mut self, z: &mut [f64], w: &mut [f64]) -> Outcome {
        let most = tol::ACTIVE_SET_CHANGES + 4 * (self.problem.rows.r + self.row.len());
        loop {
            self.reconstruct(z, w);
            let Some(side) = self.violated(z, w) else { break };
            if self.sides.contains(side) {
                return Outcome::Uncertain; // violated although active: accuracy is lost
            }
            if let Some(outcome) = self.add(side, most as u32) {
                return outcome;
            }
        }
        if !self.refactor() {
            return Outcome::Uncertain;
        }
        self.work.point(self.sides.len());
        self.reconstruct(z, w);
        self.violated(z, w);
        if self.verified(w) { Outcome::Optimal(self.changes) } else { Outcome::Uncertain }
    }

    /// Number of coordinates in use.
    fn size(&self) -> usize {
        self.problem.rows.r + self.slots
    }

    /// Where the coordinate of a row is.
    fn place(&self, row: usize) -> Option<usize> {
        let number = self.slot[row] as usize;
        (number > 0).then(|| self.problem.rows.r + number - 1)
    }

    /// The row of a floor, and where its coordinate is; None for a bound of a row.
    fn floor(&self, side: ActiveBound) -> Option<(usize, usize)> {
        let slot = side.row.checked_sub(self.problem.rows.len())?;
        Some((self.row[slot] as usize, self.problem.rows.r + slot))
    }

    /// What the price allows the multiplier of a side, where its row has no slot.
    fn cap(&self, side: ActiveBound) -> f64 {
        let slotless = side.row < self.slot.len() && self.slot[side.row] == 0.0;
        let slack = if slotless { self.problem.slack(side.row) } else { None };
        slack.map_or(f64::INFINITY, |slack| slack.cap)
    }

    /// Gives a row a slot, with s on its floor, which is not active. Numbers that let a row be left
    /// which has a slot, or may not be, are not certain: no change is left then.
    fn leave(&mut self, row: usize) {
        let new = row < self.slot.len() && self.slot[row] == 0.0 && self.slots < self.most;
        let Some(slack) = new.then(|| self.problem.slack(row)).flatten() else {
            self.changes = u32::MAX - 1;
            return;
        };
        self.row[self.slots] = row as f64;
        self.slots += 1;
        self.slot[row] = self.slots as f64;
        self.work.t[self.problem.rows.r + self.slots - 1] = slack.floor;
    }

    /// The outward normal of a side.
    fn normal(&mut self, side: ActiveBound) {
        self.work.n.fill(0.0);
        if let Some((_, place)) = self.floor(side) {
            self.work.n[place] = 1.0;
            return;
        }
        let rows = &self.problem.rows;
        let n = &mut self.work.n[..rows.r];
        n.iter_mut().zip(rows.normal(side.row)).for_each(|(n, a)| *n = side.sign * a);
        if let Some(L) = self.problem.hessian_factor {
            solve_lower(L, n, rows.stride());
        }
        if let (Some(place), Some(slack)) = (self.place(side.row), self.problem.slack(side.row)) {
            self.work.n[place] = slack.kappa;
        }
    }

    /// How far (t, s) = 0 is from a side's bound, along its normal.
    fn gap(&self, side: ActiveBound) -> f64 {
        if let Some((row, _)) = self.floor(side) {
            return self.problem.slack(row).map_or(0.0, |slack| slack.floor);
        }
        let left = self.place(side.row).and_then(|_| self.problem.slack(side.row));
        self.problem.gap(side) + left.map_or(0.0, |slack| slack.kappa * slack.floor)
    }

    /// How many deviations a slot's row is left.
    fn left(&self, slot: usize) -> f64 {
        let slack = self.problem.slack(self.row[slot] as usize);
        let s = self.work.t[self.problem.rows.r + slot];
        slack.map_or(0.0, |slack| (s - slack.floor) * slack.deviations)
    }

    /// z and its window from t, the moved bounds from s.
    fn reconstruct(&mut self, z: &mut [f64], w: &mut [f64]) {
        let Erased { rows, unconstrained, hessian_factor, windows, .. } = self.problem;
        let step = &mut self.work.back[..rows.r];
        step.copy_from_slice(&self.work.t[..rows.r]);
        if let Some(L) = hessian_factor {
            solve_transposed(L, step, rows.stride());
        }
        for ((z, free), step) in z.iter_mut().zip(*unconstrained).zip(&*step) {
            *z = free + step;
        }
        windows.window(&z[..rows.r], w);
        self.move_bounds();
    }

    fn move_bounds(&mut self) {
        for slot in 0..self.slots {
            let row = self.row[slot] as usize;
            let by = self.left(slot) * self.problem.rows.unit[row];
            self.lo[row] = self.problem.lo[row] - by;
            self.hi[row] = self.problem.hi[row] + by;
        }
    }

    /// The side that is violated most: of a row, and where there is none, of a floor.
    fn worst(&self, w: &[f64], times: f64) -> Option<ActiveBound> {
        let rows = &self.problem.rows;
        rows.worst(w, self.lo, self.hi, times).or_else(|| {
            let slot = (0..self.slots).min_by(|a, b| self.left(*a).total_cmp(&self.left(*b)))?;
            let below = self.left(slot) < -tol::VIOLATED * times;
            below.then_some(ActiveBound { row: rows.len() + slot, sign: 1.0 })
        })
    }

    /// The same, with active sides moved back onto their bounds: they are violated by rounding.
    fn violated(&mut self, z: &mut [f64], w: &mut [f64]) -> Option<ActiveBound> {
        for _ in 0..tol::REFINEMENTS {
            let side = self.worst(w, 1.0)?;
            if !self.sides.contains(side) {
                return Some(side);
            }
            self.refine(z, w);
        }
        self.worst(w, 1.0)
    }

    /// What is missing of a window to a side's bound, along its normal.
    fn missing(&self, side: ActiveBound, w: &[f64]) -> f64 {
        if let Some((row, place)) = self.floor(side) {
            let floor = self.problem.slack(row).map_or(0.0, |slack| slack.floor);
            return floor - self.work.t[place];
        }
        let ActiveBound { row, sign } = side;
        let bound = if sign > 0.0 { self.lo[row] } else { self.hi[row] };
        sign * (bound - w[row]) * self.problem.rows.inverse[row]
    }

    /// The shortest step that puts z with its window, and s, onto the active bounds.
    fn refine(&mut self, z: &mut [f64], w: &mut [f64]) {
        let (r, stride) = (self.problem.rows.r, self.work.stride);
        for j in 0..self.sides.len() {
            self.work.d[j] = self.missing(self.sides.at(j), w);
        }
        let Work { q, upper, d, rest, t, .. } = &mut self.work;
        rest.fill(0.0);
        for j in 0..self.sides.len() {
            let column = &upper[j * stride..j * stride + j + 1];
            d[j] = (d[j] - dot(&column[..j], &d[..j])) / column[j];
            axpy(d[j], &q[j * stride..(j + 1) * stride], &mut rest[..stride]);
        }
        axpy(1.0, &rest[r..stride], &mut t[r..]);
        if let Some(L) = self.problem.hessian_factor {
            solve_transposed(L, &mut rest[..r], self.problem.rows.stride());
        }
        axpy(1.0, &rest[..r], &mut z[..r]);
        self.problem.windows.window(&z[..r], w);
        self.move_bounds();
    }

    /// Takes in a violated side. Some: the end.
    fn add(&mut self, side: ActiveBound, most: u32) -> Option<Outcome> {
        let row = side.row;
        if row < self.slot.len() && self.problem.is_zero(row) && self.cap(side).is_finite() {
            self.leave(row); // no z moves it
        }
        let mut own = 0.0;
        loop {
            self.changes += 1;
            if self.changes > most {
                return Some(Outcome::Uncertain);
            }
            self.normal(side);
            let (k, missing) = (self.sides.len(), self.gap(side));
            let norm = dot(self.work.n, self.work.n).root();
            let length = self.work.split(k);
            self.work.solve_upper(k);
            let dependent = k == self.size() || !(length.root() > tol::ALONG * norm);
            let full = if dependent {
                f64::INFINITY
            } else {
                ((missing - dot(self.work.n, self.work.t)) / length).max(0.0)
            };
            let (step, event) = self.event(full, (self.cap(side) - own).max(0.0));
            if let Event::Never = event {
                return Some(Outcome::Infeasible(self.changes));
            }
            if let Event::Reached = event {
                self.work.append(k, length);
                self.work.b[k] = missing;
                self.sides.push(side);
                self.work.point(k + 1);
                return None;
            }
            own += step;
            let Work { u, back, rest, t, stride, .. } = &mut self.work;
            for (u, v) in u[..k].iter_mut().zip(&**back) {
                *u = (*u - step * v).max(0.0);
            }
            if !dependent {
                axpy(step, &rest[..*stride], t);
            }
            match event {
                Event::Drop(j) => self.work.drop(j, &mut self.sides),
                Event::Leave(j) => self.replace(j),
                _ => self.leave(row),
            }
        }
    }

    /// How far the multipliers may be moved, and what happens there.
    fn event(&self, full: f64, own: f64) -> (f64, Event) {
        let (mut step, mut event) =
            if full.is_finite() { (full, Event::Reached) } else { (f64::INFINITY, Event::Never) };
        if own < step {
            (step, event) = (own, Event::LeaveOwn);
        }
        let Work { u, back, .. } = &self.work;
        for (j, side) in self.sides.iter().enumerate() {
            if back[j] > tol::MULTIPLIER && u[j] / back[j] < step {
                (step, event) = (u[j] / back[j], Event::Drop(j));
            }
            if back[j] < -tol::MULTIPLIER {
                let left = (self.cap(side) - u[j]).max(0.0) / -back[j];
                if left < step {
                    (step, event) = (left, Event::Leave(j));
                }
            }
        }
        (step, event)
    }

    /// Active side j is left: its normal and its bound are others, its multiplier stays.
    fn replace(&mut self, j: usize) {
        let (side, u) = (self.sides.at(j), self.work.u[j]);
        self.work.drop(j, &mut self.sides);
        self.leave(side.row);
        self.normal(side);
        let k = self.sides.len();
        let length = self.work.split(k);
        self.work.append(k, length);
        (self.work.b[k], self.work.u[k]) = (self.gap(side), u);
        self.sides.push(side);
    }

    /// Q and R of the sides in their order; false if they are dependent.
    fn refactor(&mut self) -> bool {
        for k in 0..self.sides.len() {
            self.normal(self.sides.at(k));
            let norm = dot(self.work.n, self.work.n);
            let length = self.work.split(k);
            if !(length.root() > tol::ALONG * norm.root()) {
                return false;
            }
            self.work.append(k, length);
        }
        true
    }

    /// Whether every bound holds as it is moved, every multiplier has its sign and is below what
    /// its price allows, and t is their sum.
    fn verified(&mut self, w: &[f64]) -> bool {
        let (r, mut sum) = (self.problem.rows.r, 0.0);
        let size = dot(&self.work.t[..r], &self.work.t[..r]).root().max(1.0);
        let mut sound = self.worst(w, tol::ACTIVE_SET / tol::VIOLATED).is_none();
        let units = &self.problem.rows;
        let rest = core::mem::take(&mut self.work.back);
        rest[..r].copy_from_slice(&self.work.t[..r]);
        for j in 0..self.sides.len() {
            let (side, u) = (self.sides.at(j), self.work.u[j]);
            let scale = u.abs().max(size);
            sound &= u >= -tol::WRONG_SIGN * scale && u <= self.cap(side) + tol::ACTIVE_SET * scale;
            let unit = match self.floor(side) {
                Some((row, _)) => self.problem.slack(row).map_or(1.0, |slack| slack.floor.max(1.0)),
                None => units.unit[side.row] * units.inverse[side.row],
            };
            sound &= self.missing(side, w).abs() <= tol::ACTIVE_SET * unit;
            self.normal(side);
            axpy(-u, &self.work.n[..r], &mut rest[..r]);
            sum += u.abs();
        }
        let left = dot(&rest[..r], &rest[..r]).root();
        self.work.back = rest;
        sound && left <= tol::ACTIVE_SET * size + tol::SUMS * sum
    }
}
