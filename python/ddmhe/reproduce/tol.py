"""Every tolerance of the experiments with its reason; the verdicts' criteria stand beside their
claims."""

__all__ = [
    "BLOWN_UP",
    "DRAWN",
    "LEMMA_1",
    "LINEAR_STEP",
    "NO_COST",
    "NO_MISFIT",
    "RADIUS",
    "RECORDED_STATE",
    "SAME_TIME",
]

SAME_TIME = 1e-9
"""s; times that differ by less are one: sums of sampling intervals are rounded."""
BLOWN_UP = 1e150
"""Errors above this have no square: the estimator has failed."""
RECORDED_STATE = 1e-6
"""rad/s; a filter that knows the true model takes the recorded state to be as good as this at
best."""
RADIUS = 1e-4
"""The radius of Algorithm 2 is sought to this."""
LINEAR_STEP = 1e-3
"""Step of central differences, in units of the point: they are exact for a quadratic f."""
LEMMA_1 = 1e-8
"""Relative misfit of noise-free data that counts as none: that of random systems' condition times
rounding."""
NO_COST = 1e-9
"""A cost that counts as zero, of numbers of size 1."""
NO_MISFIT = 1e-3
"""A distance that a search over points does not close is no rounding."""
DRAWN = 1e-12
"""The least height of a figure's axis, in units of what it shows."""
