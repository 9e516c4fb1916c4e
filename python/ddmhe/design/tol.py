"""Every tolerance of the designs with its reason. A certificate rests on none of them: eigenvalues
verify it against zero."""

__all__ = [
    "BEYOND_ZERO",
    "CONDITION",
    "DELAY_GAIN",
    "EPS",
    "EQUAL",
    "ETA_MOST",
    "ETA_STEP",
    "EXACT_CHANNEL",
    "EXPLAINED",
    "FILTERED",
    "FULL_ROW_RANK",
    "HIDDEN",
    "INFLATIONS",
    "INVERTIBLE",
    "IN_REGION",
    "KERNEL",
    "LEAST_WIDTH",
    "MARGIN",
    "MARGINS",
    "MARGIN_ROUNDING",
    "NONZERO",
    "ON_BOUNDARY",
    "PBH",
    "POSITIVE_R",
    "READ_OUT_ROUNDING",
    "ROUNDED_RANK",
    "SECOND_VALLEY",
    "SHARP",
    "SYMMETRIC",
    "TRAJECTORY",
    "UNEXPLAINED",
]

EPS = 2.220446049250313e-16
"""Distance of 1 from the next number."""
NONZERO = 1e-300
"""The least size that is divided by: what is smaller has no size."""

# --- models and their sets

PBH = 1e-9
"""A pair is unobservable when [λI - A; C] loses rank at this relative tolerance in balanced
coordinates."""
EXACT_CHANNEL = 1e-9
"""Noise of a channel, in units of its spread, is never less: one without visible noise counts as
exact to rounding, not as infinitely accurate."""
TRAJECTORY = 1e3 * EPS
"""A recording counts as exact when every sample misses the model by less than this share of the
numbers added up."""
HIDDEN = 1e-12
"""H of the consistent systems, in units of its trace, is positive definite above this: its
eigenvalues are rounded in units of the trace."""
UNEXPLAINED = 1e-12
"""No system explains the recording when Δ has an eigenvalue below minus this, in units of the sums
that Δ is the difference of."""
ON_BOUNDARY = 1e-9
"""A system belongs to the consistent ones up to this share of the set's width."""

# --- certificates

MARGINS = (1e-7, 1e-4, 1e-2)
"""The programme keeps Φ's (d, s) block this far below zero, relative to its size in balanced
coordinates: the first margin whose solution survives the eigenvalue check."""
INFLATIONS = (1e-6, 1e-4, 1e-2, 1.0)
"""Shares of its mean eigenvalue that Q is made larger by in turn, until rounding does not refute
the inequality."""
POSITIVE_R = 1e-9
"""R ≻ 0 is asked for as R ⪰ this, in balanced coordinates, where its size is 1."""
CONDITION = 1e-6
"""cond P may exceed its bound by this share: that of the solver's own tolerance."""
ETA_STEP = 1e-3
"""The smallest η is sought to this."""
ETA_MOST = 1.0 - 1e-4
"""The largest η that is tried for a bound on cond P."""
LEAST_WIDTH = 1e-3
"""The smallest share of a set's width that is told where all of it cannot be certified."""

# --- poles

MARGIN = 1e-6
"""≻ 0 is asked for as ⪰ MARGIN·I: the blocks are of size 1, since (51c) makes X0dl X ≻ I."""
MARGIN_ROUNDING = 4.0
"""Rounding counts this many times: an output made by several operations is off by more than its
last digit."""
FULL_ROW_RANK = 1e-12
"""Directions of the dual data below this share of the largest are rounding."""
SYMMETRIC = 1e-9
"""Mirrored entries of a weight differ by no more than this share."""
INVERTIBLE = 1e12
"""X0dl X with a larger condition number leaves a gain without digits."""
IN_REGION = 1e-7
"""An eigenvalue lies in a region when it leaves it by no more: the solver's own tolerance."""
KERNEL = 1e-9
"""Singular values of C below this share of the largest are zero, whatever the standard errors."""

# --- lags of outputs

DELAY_GAIN = 1.5
"""A lag leaves less unexplained than no lag by this factor: flat curves of noise differ by up to
4, but then not in all parts of the recording."""
EXPLAINED = 0.6
"""No more of an output's variance is left unexplained at its lag."""
BEYOND_ZERO = 0.8
"""On the other side of 0 no less is left than this share of what is left at 0: a phase has a second
valley there, a lag has none, and noise wiggles."""
SECOND_VALLEY = 20.0
"""Or, where the motion swings, no less than this factor of what is left at the lag: the second
valley of a phase was up to 4 times as high as the first."""
FILTERED = 0.6
"""An output of which states of three samples leave less than this share of what those of one leave
is filtered rather than late."""
EQUAL = 1.1
"""A lag that leaves no more than this factor of the least is as good: of these it is the nearest to
0. Where x(k) says all of y(k+1), the next lag is as good as the true one."""
SHARP = 1.8
"""Beside a lag more is left by this factor. Measured outputs that follow the states by a phase had
up to 1.7, lags 1.9 and more."""
READ_OUT_ROUNDING = 1e-12
"""A smaller share of an output's variance is rounding."""
ROUNDED_RANK = 1e-12
"""Directions of the regressors below this share of the largest are rounding."""
