//! Every tolerance of the crate, each with its reason.

/// A row of the window counts as inside its bounds up to this distance in units of the channel's
/// own standard deviation; the closed-form minimiser is accurate to about 1e-12 there.
pub const FEASIBLE: f64 = 1e-11;

/// An answer is optimal when it satisfies the optimality conditions to this accuracy (standard
/// deviations; multipliers relative to the largest).
pub const ACTIVE_SET: f64 = 1e-9;

/// Most changes of the active set, beside four for each direction; a good guess needs none or a
/// few.
pub const ACTIVE_SET_CHANGES: usize = 100;

/// The dual active-set method takes in a row that is violated by more than this, in standard
/// deviations: below what the final check asks for, [`ACTIVE_SET`], and above rounding.
pub const VIOLATED: f64 = 1e-11;

/// The part of a row's normal that the active ones do not span, relative to it: below the first it
/// counts as dependent, between the two nothing is certain, and another method decides.
pub const DEPENDENT: (f64, f64) = (1e-10, 1e-6);

/// The same where bounds may be left, without a range of doubt: a bound that is dear to leave adds
/// little to its row's normal, and that is known to every digit. The answer is checked.
pub const ALONG: f64 = 1e-11;

/// A sum of normals times multipliers is known to this share of the multipliers.
pub const SUMS: f64 = 1e-14;

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
/// to be factored anew.
pub const DOWNDATE: f64 = 1e-6;

/// An answer is called almost optimal if its bounds hold to the first, in standard deviations, and
/// it is within the second of the minimiser, relative to the distance from z*.
pub const ALMOST: (f64, f64) = (1e-6, 1e-4);

/// Furthest that an output, a state or a prior may be from the recording's mean, in pooled standard
/// deviations: a double that holds more has no digit left for one of them.
pub const MEASURABLE: f64 = 1.0 / f64::EPSILON;

/// Samples without an output in a row after which a new output is believed rather than those before
/// them that it contradicts.
pub const DOUBTS: usize = 3;

/// Outputs in a row that are rejected to one side before the state is taken to have jumped.
pub const RESTART: usize = 4;

/// Largest square of an innovation, in units of its variance, that counts for what innovations are
/// like now.
pub const GATE_MOST: f64 = 9.0;

/// Square of an innovation, in variances, that no run has which goes on from the recording's end.
pub const GOES_ON: f64 = 25.0;

/// Of the depths that a run grows through, each lacks one part in so many of the next: a half more
/// at most. See [`kept_depths`](crate::plan::kept_depths).
pub const DEPTHS: usize = 3;

/// Up to this depth none is left out: they take little memory, and a run is in most need of them.
pub const SHORT: usize = 20;

/// Difference of two estimates, in units of 1 + |x| scaled deviations, that is rounding: both are
/// one filter's.
pub const SAME_FILTER: f64 = 1e-13;

/// Difference of a covariance from the stationary one, in units of that one's largest entry, that
/// is rounding.
pub const SETTLED: f64 = 1e-14;
