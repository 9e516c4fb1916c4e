//! The loop of the method.

use crate::active_set::factor::{Work, solve_lower, solve_transposed};
use crate::active_set::problem::{Erased, LeastDistance, Outcome, Windows};
use crate::active_set::working_set::{ActiveBound, Sides, WorkingSet};
use crate::panels::{Root, axpy, dot};
use crate::status::Status;
use crate::tol;

impl Erased<'_> {
    /// [`solve`](LeastDistance::solve), once in the program.
    #[cold]
    #[inline(never)]
    pub fn solve_erased(
        &self,
        kept: &mut WorkingSet<'_>,
        memory: &mut [f64],
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        self.solve(kept, memory, z, w)
    }

    /// From no active bounds: what it found and the multipliers of the bounds that it held active
    /// last, which are left in `kept`. z and w are the last point and its window, whatever was
    /// found.
    #[cold]
    pub fn anew<'m>(
        &self,
        kept: &mut WorkingSet<'_>,
        memory: &'m mut [f64],
        z: &mut [f64],
        w: &mut [f64],
    ) -> (Outcome, &'m [f64]) {
        kept.clear();
        let mut work = Work::new(memory, self.rows.r);
        let outcome = self.attempt(kept, &mut work, z, w);
        (outcome, &work.u[..kept.sides.len()])
    }
}

impl<W: Windows + ?Sized> LeastDistance<'_, W> {
    /// Into z and its window w (both padded), starting from the kept active bounds and leaving the
    /// new ones there. z and w say nothing unless the outcome is [`Outcome::Optimal`].
    #[inline(always)]
    pub fn solve(
        &self,
        kept: &mut WorkingSet<'_>,
        memory: &mut [f64],
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        let mut work = Work::new(memory, self.rows.r);
        let mut warm = !kept.sides.is_empty();
        loop {
            let outcome = self.attempt(kept, &mut work, z, w);
            if let Outcome::Optimal(_) = outcome {
                return outcome;
            }
            kept.clear();
            if !warm || outcome != Outcome::Uncertain {
                return outcome;
            }
            warm = false;
        }
    }

    #[inline(always)]
    fn attempt(
        &self,
        kept: &mut WorkingSet<'_>,
        work: &mut Work<'_>,
        z: &mut [f64],
        w: &mut [f64],
    ) -> Outcome {
        let mut changes = 0;
        let mut rotated = false; // whether the factor is another than that of the list
        let bounded = |side: ActiveBound| self.bound(side).is_finite();
        if !kept.sides.iter().all(bounded) {
            kept.sides.filter_map(|side| bounded(side).then_some(side));
            kept.kept.factored = false;
        }
        if !kept.kept.factored && !self.refactor(&kept.sides, work) {
            return Outcome::Uncertain;
        }
        self.missing(&kept.sides, work);
        while drop_negative(&mut kept.sides, work) {
            (changes, rotated) = (changes + 1, true);
        }
        let most = tol::ACTIVE_SET_CHANGES as u32 + 4 * self.rows.r as u32;
        loop {
            self.reconstruct(work, z, w);
            let Some(side) = self.violated(&kept.sides, work, z, w) else { break };
            if kept.sides.contains(side) {
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
        kept.kept.factored = true;
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
        sides: &mut Sides<'_>,
        work: &mut Work<'_>,
        (changes, most): (&mut u32, u32),
        rotated: &mut bool,
    ) -> Option<Outcome> {
        if self.is_zero(side.row) {
            let proved = self.proof(side, &Sides::new(&mut [], &mut 0), 0.0, work);
            // 0ᵀz cannot be above 0
            return Some(if proved { Outcome::Infeasible(*changes) } else { Outcome::Uncertain });
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
        let norm = dot(work.n, work.n).root();
        loop {
            *changes += 1;
            if *changes > most {
                return Some(Outcome::Uncertain);
            }
            let k = sides.len();
            let length = work.split(k);
            work.solve_upper(k);
            let (partial, blocking) = blocking(work, k);
            let ratio = length.root() / norm;
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

    /// Whether a row does not move at all.
    pub(super) fn is_zero(&self, row: usize) -> bool {
        self.rows.normal(row).iter().all(|a| *a == 0.0)
    }

    /// Q and R of the sides in their order; false if they are dependent.
    #[inline(always)]
    fn refactor(&self, sides: &Sides<'_>, work: &mut Work<'_>) -> bool {
        for (k, side) in sides.iter().enumerate() {
            self.normal(side, work);
            let norm = dot(work.n, work.n);
            let length = work.split(k);
            if k >= self.rows.r || length.root() < self.trust.dependent.0 * norm.root() {
                return false;
            }
            work.append(k, length);
        }
        true
    }

    /// The outward unit normal of a side, in the coordinates of t.
    #[inline(always)]
    pub(super) fn normal(&self, side: ActiveBound, work: &mut Work<'_>) {
        for (n, a) in work.n.iter_mut().zip(self.rows.normal(side.row)) {
            *n = side.sign * a;
        }
        if let Some(L) = self.hessian_factor {
            solve_lower(L, &mut work.n[..self.rows.r], work.stride);
        }
    }

    /// How far z* is from a side's bound, along its unit normal.
    #[inline(always)]
    pub(super) fn gap(&self, ActiveBound { row, sign }: ActiveBound) -> f64 {
        let along = dot(self.rows.normal(row), &self.unconstrained[..self.rows.stride()]);
        sign * ((self.bound(ActiveBound { row, sign }) - self.rows.offset[row])
            * self.rows.inverse[row]
            - along)
    }

    #[inline(always)]
    fn missing(&self, sides: &Sides<'_>, work: &mut Work<'_>) {
        for (side, b) in sides.iter().zip(&mut *work.b) {
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
        for ((z, free), t) in z[..r].iter_mut().zip(self.unconstrained).zip(&*work.back) {
            *z = free + t;
        }
        self.windows.window(&z[..r], w);
    }

    /// The side that is violated most. One that is active already is so by rounding, of z* far away
    /// from its bounds: z is then moved back onto all active bounds.
    #[inline(always)]
    fn violated(
        &self,
        sides: &Sides<'_>,
        work: &mut Work<'_>,
        z: &mut [f64],
        w: &mut [f64],
    ) -> Option<ActiveBound> {
        if self.trust.far && !sides.is_empty() {
            self.refine(sides, work, z, w);
        }
        let mut side = self.rows.worst(w, self.lo, self.hi, 1.0)?;
        for _ in 0..tol::REFINEMENTS {
            if !sides.contains(side) {
                break;
            }
            self.refine(sides, work, z, w);
            side = self.rows.worst(w, self.lo, self.hi, 1.0)?;
        }
        Some(side)
    }

    /// The shortest step that puts the window w of z onto the active bounds.
    #[cold]
    fn refine(&self, sides: &Sides<'_>, work: &mut Work<'_>, z: &mut [f64], w: &mut [f64]) {
        let (r, s) = (self.rows.r, work.stride);
        work.rest.fill(0.0);
        for (j, side) in sides.iter().enumerate() {
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
    fn verified(&self, sides: &Sides<'_>, work: &Work<'_>, w: &[f64]) -> bool {
        let size = dot(work.t, work.t).root().max(1.0);
        let u = &work.u[..sides.len()];
        let signs = u.iter().all(|&u| u >= -tol::WRONG_SIGN * size);
        // t = N u only up to rounding of that sum, and by so much t may miss the minimiser
        let accurate = u.iter().map(|u| u.abs()).sum::<f64>() <= self.trust.multipliers * size;
        let mut at_bounds = true; // by a loop, as in `panels`
        for side in sides.iter() {
            at_bounds &= self.at_bound(side, w);
        }
        signs && accurate && at_bounds && self.inside(w)
    }
}

/// The point on the active bounds; whether one of them, that with the smallest multiplier, was
/// dropped because that is negative.
#[inline(always)]
fn drop_negative(sides: &mut Sides<'_>, work: &mut Work<'_>) -> bool {
    let k = sides.len();
    work.point(k);
    match (0..k).min_by(|&a, &b| work.u[a].total_cmp(&work.u[b])) {
        Some(j) if work.u[j] < 0.0 => work.drop(j, sides),
        _ => return false,
    }
    true
}

/// How far until the multiplier of one of k active bounds is 0, and of which; else infinite.
#[inline(always)]
fn blocking(work: &Work<'_>, k: usize) -> (f64, usize) {
    let (mut partial, mut blocking) = (f64::INFINITY, usize::MAX);
    for j in 0..k {
        if work.back[j] > tol::MULTIPLIER && work.u[j] / work.back[j] < partial {
            (partial, blocking) = (work.u[j] / work.back[j], j);
        }
    }
    (partial, blocking)
}
