//! Every tolerance of the crate, each with its reason; those of a step are [`ddmhe_run::tol`].

pub use ddmhe_run::tol::*;

/// Singular values below `RANK_EPS · max(rows, columns) · σ₁` are rounding: the usual rank decision
/// of LAPACK, NumPy and MATLAB.
pub const RANK_EPS: f64 = f64::EPSILON;

/// Singular values below `DATA_ROUNDING` times the norm of the recording's own rounding are
/// rounding. 1 would do for numbers that were rounded once; recursions far from zero, whose
/// rounding a window carries along, came to 2.5 at depth 320.
pub const DATA_ROUNDING: f64 = 8.0;

/// A recording counts as a trajectory of an affine system when each sample misses it by less than
/// this share of the numbers that were added up: some hundred roundings.
pub const TRAJECTORY: f64 = 1e3 * f64::EPSILON;

/// The least-norm choice among equally good α (Exact spaces whose data hold more directions than
/// the cost sees) enters as a penalty of this size relative to the cost's own curvature: small
/// enough to leave the cost's minimiser alone to about 1e-8, large enough to survive rounding.
pub const LEAST_NORM: f64 = 1e-4;

/// A channel whose recorded values lie closer together than this, relative to the largest number
/// beside them, did not move; a row of the basis that is smaller than this, relative to the
/// largest, is rounding of the decomposition.
pub const UNMOVED: f64 = 64.0 * f64::EPSILON;

/// Clarabel's gap and feasibility tolerances. At its default 1e-8 about one constrained window in
/// five came out wrong by more than 1e-6; see [`ACTIVE_SET`] for the check that follows.
pub const SOLVER: f64 = 1e-12;

/// Spectral radius of the map prior → estimate above which the estimator is reported as unstable:
/// above 1.02 the median 3-DOF error grew twentyfold within 100 s, at 1.005 it did not.
pub const SPECTRAL_RADIUS: f64 = 1.005;

/// How often the default rule may raise its weight tenfold to get below [`SPECTRAL_RADIUS`]: from
/// its floor to 1.
pub const GUARD: usize = 8;

/// A matrix of a certificate counts as symmetric up to this relative difference: it may have been
/// written to text.
pub const SYMMETRIC: f64 = 1e-9;

pub use ddmhe_interval::tol::MEMBER;

/// Singular values of active normals below this, relative to the largest, count as 0: the first
/// keeps whatever can be computed, the second leaves out what is close to rounding where bounds
/// touch each other.
pub const CUTS: [f64; 2] = [1e-12, 1e-8];

/// The same where a point is moved back onto its bounds.
pub const SETTLE: f64 = 1e-10;

/// Beside a row's unit, this much of the size of z counts: a row that is summed from numbers of
/// that size is known to 1e-15 of it.
pub const SUMMED: f64 = 1e-6;

/// Beside a row's unit, this much of the distance to z* counts while active rows are searched: a
/// row is known to 1e-13 of that.
pub const RELATIVE: f64 = 1e-4;

/// δ of the proximal point method in `surplus`: the smaller, the fewer steps it takes and the fewer
/// digits are left of what the cost sees.
pub const PROXIMAL: f64 = 1e-3;

/// Its most steps, and the change of its point, relative to it, at which it ends.
pub const PROXIMAL_STEPS: usize = 200;
/// See [`PROXIMAL_STEPS`].
pub const PROXIMAL_CHANGE: f64 = 1e-11;

/// Multipliers below this, relative to the largest, are an interior point's way of saying 0.
pub const SUPPORT: f64 = 1e-7;

/// Smallest and largest size of the recording's numbers and deviations in the user's units. Their
/// products with squares of
/// [`MEASURABLE`] neither overflow nor vanish.
pub const SIZES: (f64, f64) = (1e-60, 1e60);

/// Most that two weights of the cost may differ by: four of the sixteen digits are left of the root
/// of the smaller beside the other's.
pub const WEIGHTS: f64 = 1e24;

/// Largest lower and smallest upper bound that a recording of [`SIZES`] may be asked to meet.
pub const BOUND: f64 = 1e80;

/// Outputs are taken to deviate from the recording's by at least this share of their spread at an
/// unknown start: without any deviation its prior has no weight, and an output of the first window
/// that hardly tells two states apart would decide.
pub const START_NOISE: f64 = 1e-4;
