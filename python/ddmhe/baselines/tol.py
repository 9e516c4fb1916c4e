"""Every tolerance of the baselines with its reason."""

__all__ = [
    "ARX_COVARIANCE",
    "ARX_OUTPUT",
    "ARX_RIDGE",
    "BOX",
    "COVARIANCE",
    "FREEDOM",
    "KNOWN_START",
    "LEAST_MU",
    "LEAST_NOISE",
    "LEAST_OUTPUT_NOISE",
    "LEAST_RATIO",
    "LEAST_SHARE",
    "MISSED",
    "NONZERO",
    "NO_POINT",
    "ORACLE_NOISE",
    "ORACLE_STATE",
    "ROUNDING",
    "SETTLED",
    "SLOPE_STEP",
]

NONZERO = 1e-300
"""Added to a size that may be 0 before it is divided by."""

# --- Kalman filters

COVARIANCE = 1e-20
"""Residuals' covariance is not below this share of the signals' mean square: rounding, squared."""
KNOWN_START = 1e-12
"""Covariance of the last recorded state, in units of the process noise: it is as good as known."""
ARX_OUTPUT = 1e-6
"""Measurement noise of the ARX filter, in units of the outputs' variance: its state holds the
outputs themselves."""
ARX_RIDGE = 1e-8
"""Ridge of the ARX regression, in units of a scaled channel's variance: lags that repeat each
other stay finite."""
ARX_COVARIANCE = 1e-16
"""Added to the ARX residuals' covariance in scaled channels: an exact fit has a logarithm."""
ORACLE_STATE = 1e-9
"""Standard deviations of prior and motion, in units of the start, are not below: the filter's
covariance stays regular."""
ORACLE_NOISE = 1e-12
"""Standard deviation of the outputs' noise is not below, for the same reason."""
SLOPE_STEP = 1e-6
"""Step of central differences, in units of the point: truncation (its square) and rounding (eps
over it) are both below 1e-9."""

# --- regression and intervals

FREEDOM = 1e-9
"""Degrees of freedom that a regression is left with at least."""
ROUNDING = 1e-12
"""Relative widening of every bound: the interval baseline computes with plain floats."""
LEAST_MU = 1e-9
"""μ of the interval observer's programme is at least this, with P below 1: γ/μ stays finite."""
LEAST_RATIO = 1e-12
"""The same where the solver leaves μ below its bound by its own tolerance."""

# --- model-based moving horizon estimation

BOX = 1e-12
"""A bound counts as met when it is missed by less, in units of a row of length one."""
MISSED = 1e-9
"""Bounds that hold a point are missed by less, in the same units, or no point is inside of all."""
NO_POINT = 1e-13
"""Least 1/(1 + ‖t‖²) of a point, t in units of the largest limit: below it is rounding, and there
is no point inside of all bounds."""
SETTLED = 1e-14
"""A covariance this near to the stationary one, relative to its largest entry, is the stationary
one."""
LEAST_NOISE = 1e-18
"""Added to covariances, in units of the recorded variances: rounding, squared."""
LEAST_OUTPUT_NOISE = 1e-4
"""Outputs deviate from a model by at least this share of their recorded deviation, where that says
what a disturbance costs, as in `DdMhe`."""
LEAST_SHARE = 0.05
"""Outputs keep at least this share of their residual as noise, whatever the noise of the states
explains: a share of few samples is uncertain by as much."""
