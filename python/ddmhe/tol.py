"""Every tolerance of the models, the tuning and the command line with its reason; the estimator's
own are the core's (`tol.rs`)."""

__all__ = [
    "INTEGRATION_ABSOLUTE",
    "INTEGRATION_RELATIVE",
    "NO_ERROR",
    "POSITIVE",
    "STANDSTILL",
    "SYMMETRIC",
    "WHOLE_STEPS",
]

WHOLE_STEPS = 1e-9
"""A duration is a whole number of steps if it is off by no more than this share of itself: decimal
times like 0.1 are rounded, and their multiples differ in the last digits."""
SYMMETRIC = 1e-12
"""Mirrored entries of a symmetric matrix differ by no more than this share: products of rotations
leave some units in the last place."""
INTEGRATION_RELATIVE = 2.3e-14
"""Relative tolerance of an accurate motion: scipy's integrators take nothing smaller."""
INTEGRATION_ABSOLUTE = 1e-16
"""Absolute tolerance of an accurate motion: states of 1 and more are bound by the relative one."""
NO_ERROR = 1e-9
"""Errors below this share of a state's spread, or of its largest number, are rounding: no score and
no range goes below it, so that none is better for it."""
POSITIVE = 1e-300
"""Added to a size that may be 0 before its logarithm is taken."""
STANDSTILL = 1e-12
"""Step of a motion that does not move, in units of its size: keeps its inverse finite."""
