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
//! that fails) is [`Outcome::Uncertain`] and left to a [`Fallback`](crate::Fallback).
//!
//! Nothing here allocates: the numbers live in the caller's memory, [`work_len`] of them.

mod factor;
mod problem;
mod proof;
mod rows;
mod working_set;

pub use factor::{solve_lower, solve_transposed, work_len};
pub use problem::LeastDistance;
pub use proof::Combination;
pub use rows::{Rows, RowsMut};
pub use working_set::{ActiveBound, Sides, WorkingSet};

use crate::tol;

/// What the method is certain of, with the number of rows that were taken in or dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The minimiser.
    Optimal(u32),
    /// No z satisfies all bounds: a combination of rows proves it.
    Infeasible(u32),
    /// None of these could be shown.
    Uncertain,
}

/// What reconstructs windows.
pub trait Windows {
    /// c + A z (padded) from z.
    fn window(&self, z: &[f64], window: &mut [f64]);
}

/// What the method trusts.
#[derive(Debug, Clone, Copy)]
pub struct Trust {
    /// See [`tol::DEPENDENT`].
    pub dependent: (f64, f64),
    /// See [`tol::MULTIPLIERS`].
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

/// What is kept of a working set beside its sides.
#[derive(Debug, Clone, Copy, Default)]
pub struct Kept {
    /// Whether the last call's active bounds were better foretold by those before moved on with the
    /// window (a bound that was active at a certain time) than by the same rows again (one that is
    /// active at a certain age).
    pub moves: bool,
    /// Whether Q and R in memory are of these sides.
    pub factored: bool,
}
