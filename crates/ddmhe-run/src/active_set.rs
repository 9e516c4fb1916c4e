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

pub mod factor;
pub mod priced;
pub mod problem;
pub mod proof;
pub mod rows;
pub mod slack;
mod solve;
pub mod working_set;

pub use factor::{solve_lower, solve_transposed, work_len};
pub use priced::priced_len;
pub use problem::{Erased, LeastDistance, Outcome, Trust, Windows};
pub use proof::Combination;
pub use rows::{Rows, RowsMut};
pub use slack::Slack;
pub use working_set::{ActiveBound, Kept, Sides, WorkingSet};
