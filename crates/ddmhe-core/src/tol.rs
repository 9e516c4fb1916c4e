//! Every tolerance of the crate, each with its reason.

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

/// A row of the window counts as inside its bounds up to this distance in units of the channel's
/// own standard deviation; the closed-form minimiser is accurate to about 1e-12 there.
pub const FEASIBLE: f64 = 1e-11;

/// Clarabel's gap and feasibility tolerances. At its default 1e-8 about one constrained window in
/// five came out wrong by more than 1e-6; see [`ACTIVE_SET`] for the check that follows.
pub const SOLVER: f64 = 1e-12;

/// The solver's answer is replaced by the exact one on its active set when that satisfies the
/// optimality conditions to this accuracy (standard deviations; multipliers relative to the
/// largest).
pub const ACTIVE_SET: f64 = 1e-9;

/// Most changes to the solver's active set in that search; a good guess needs none or a few.
pub const ACTIVE_SET_CHANGES: usize = 100;

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

/// The dual active-set method takes in a row that is violated by more than this, in standard
/// deviations: below what the final check asks for, [`ACTIVE_SET`], and above rounding.
pub const VIOLATED: f64 = 1e-11;

/// The part of a row's normal that the active ones do not span, relative to it: below the first it
/// counts as dependent, between the two nothing is certain and the interior-point solver decides.
pub const DEPENDENT: (f64, f64) = (1e-10, 1e-6);

/// Smallest change of a multiplier that can drive it to 0.
pub const MULTIPLIER: f64 = 1e-12;

/// Normals are parallel, or a combination of them vanishes, up to rounding: this much beside the
/// sum of their multipliers. What is proved with such a combination is proved for rows that differ
/// by so much.
pub const PARALLEL: f64 = 1e-12;

/// That there is no window within the bounds is proved for windows up to this many times as far
/// away as these.
pub const REACH: f64 = 1e6;

/// How often z is moved back onto its active bounds where the distance to z* takes its digits.
pub const REFINEMENTS: usize = 3;

/// An active row whose multiplier u has the wrong sign is let pass if |u|, the most that t would
/// move without that row, is below this, relative to t.
pub const WRONG_SIGN: f64 = 1e-11;

/// Largest sum of multipliers, relative to t, at which the active-set method trusts its answer: of
/// nearly parallel active rows they are as large as the rows are close, and t, their sum, is
/// rounded in proportion.
pub const MULTIPLIERS: f64 = 1e5;

/// Smallest pivot of the Hessian without the missing outputs, relative to 1 with all of them, that
/// is trusted: what is left has lost six of sixteen digits to cancellation. Below it the problem is
/// factored anew.
pub const DOWNDATE: f64 = 1e-6;

/// An answer is called almost optimal if its bounds hold to the first, in standard deviations, and
/// it is within the second of the minimiser, relative to the distance from z*.
pub const ALMOST: (f64, f64) = (1e-6, 1e-4);

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

/// Furthest that an output, a state or a prior may be from the recording's mean, in pooled standard
/// deviations: a double that holds more has no digit left for one of them.
pub const MEASURABLE: f64 = 1.0 / f64::EPSILON;

/// Smallest and largest size of the recording's numbers and deviations in the user's units. Their
/// products with squares of
/// [`MEASURABLE`] neither overflow nor vanish.
pub const SIZES: (f64, f64) = (1e-60, 1e60);

/// Most that two weights of the cost may differ by: four of the sixteen digits are left of the root
/// of the smaller beside the other's.
pub const WEIGHTS: f64 = 1e24;

/// Largest lower and smallest upper bound that a recording of [`SIZES`] may be asked to meet.
pub const BOUND: f64 = 1e80;

/// Samples without an output in a row after which a new output is believed rather than those before
/// them that it contradicts.
pub const DOUBTS: usize = 3;

/// Outputs are taken to deviate from the recording's by at least this share of their spread at an
/// unknown start: without any deviation its prior has no weight, and an output of the first window
/// that hardly tells two states apart would decide.
pub const START_NOISE: f64 = 1e-4;
