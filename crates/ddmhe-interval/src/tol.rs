//! Every tolerance of the crate, each with its reason.

use std::ops::Range;

/// A point counts as inside a zonotope when it is inside the one larger by this factor: the linear
/// programme behind the answer is solved to about 1e-11.
pub const MEMBER: f64 = 1e-9;

/// Clarabel's gap and feasibility tolerances: three digits below [`MEMBER`], which its answers
/// decide.
pub const PROGRAMME: f64 = 1e-12;

/// Singular values of a zonotope's generators below this, relative to the largest, are directions
/// in which the set is flat up to rounding. A wrong choice costs time, never the answer: each is
/// checked.
pub const FLAT: f64 = 1e-12;

/// Principal axes V are taken for a box when |I - V Vᵀ| is below this in every entry: the box is
/// enlarged by n times that share of the set. Rounding leaves about 1e-15; more is a decomposition
/// that failed.
pub const SKEW: f64 = 1e-12;

/// Sums of numbers within have squares that are normal floats; sets of another size are measured in
/// a unit of their own before their axes are computed.
pub const SQUARED: Range<f64> = 1e-100..1e100;

/// Generators are made longer by at most this relative amount to hold what rounding lost; beyond it
/// axis-parallel ones are added. A thousand maps then widen a set by less than 1e-6 of it.
pub const LONGER: f64 = 1e-9;

/// The proof that longer generators hold the lost box asks of the right inverse R of M that M R
/// misses the identity by less than this, so that 1/(1 - ‖Δ‖) is within a factor of two, …
pub const INVERSE: f64 = 1e-3;

/// … that its row sums are below this, so that the roundings in computing it are far below that
/// factor, …
pub const INVERSE_SIZE: f64 = 1e4;

/// … and that sums over this many generators round by less than it.
pub const GENERATORS: usize = 1_000_000;

/// Row sums outside of this range lose digits, or overflow, where generators are divided by them.
pub const ROW_SUMS: Range<f64> = 1e-280..1e300;

/// P of a gain counts as symmetric up to this relative difference: it may have been written to
/// text.
pub const SYMMETRIC: f64 = 1e-9;

/// Largest ‖I - P Z‖ of a computed inverse Z of P: P⁻¹ is then within a factor of two of Z, and
/// beyond it P counts as singular.
pub const INVERTED: f64 = 0.5;

/// Most states for which the largest eᵀPe over a box is found at its 2ⁿ⁻¹ vertices; beyond, their
/// number costs more than the bound Σ|P_ij| r_i r_j gives away.
pub const VERTICES: usize = 10;

/// Past transitions that a measurement is carried back through: each is contracted twice a step,
/// and what is composed over many of them says little of their first box.
pub const TRANSITIONS: usize = 4;

/// Largest argument of sin and cos whose quotient by π still has a parity in floats: 2^50 is
/// 1.1e15.
pub const PHASE: f64 = 1e15;

/// An interval wider than this holds a whole period, 2π, whatever its width was rounded to.
pub const PERIOD: f64 = 7.0;
