"""What a recorded column says of itself: numbers that stand for "not measured", and angles that
jump by a turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import wrapped_angle

Array = NDArray[np.float64]

__all__ = ["far_out", "unwrapped"]

FAR = 50.0
"""Deviations of the other values beyond which one is no measurement of the same thing."""
APART = 3.0
"""What is far out stands on its own: the space between it and the others is more than this many
times their range."""
ALONE = 3
"""Rows in a row that different values far out may take; more of them are a motion. Of one value
there may be more."""
LEAST = 30
"""Fewest values that tell what is far out."""


def far_out(values: Array) -> NDArray[np.intp]:
    """Rows of values (N,), NaN where unknown, that sit more than FAR deviations out on their
    own."""
    rest = np.flatnonzero(np.isfinite(values))
    found = rest[:0]
    while rest.size >= LEAST:
        more = np.concatenate(
            [_above(values, rest), _above(-values, rest)]
        )  # numbers on one side can hide the other's
        if not more.size:
            break
        rest, found = np.setdiff1d(rest, more), np.union1d(found, more)
    if not found.size:
        return found
    runs = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1)
    short = np.concatenate([np.full(len(run), len(run) <= ALONE) for run in runs])
    _, which, counts = np.unique(values[found], return_inverse=True, return_counts=True)
    return np.asarray(found[short | (counts[which] > 1)], dtype=np.intp)


def _above(values: Array, known: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows above the bulk; at most half of all are, and the bulk is judged without its lowest
    quarter."""
    order = known[np.argsort(values[known], kind="stable")]
    v = values[order] - np.median(values[known])
    quarter, half = len(v) // 4, len(v) // 2
    count = np.arange(1, len(v) - quarter + 1)
    with np.errstate(over="ignore", invalid="ignore"):
        mean = np.cumsum(v[quarter:]) / count
        spread = np.sqrt(np.maximum(np.cumsum(v[quarter:] ** 2) / count - mean**2, 0.0))
        # of v[quarter : k] for the candidate v[k], k = half …
        mean, spread = mean[half - quarter - 1 : -1], spread[half - quarter - 1 : -1]
        below = v[half - 1 : -1]
        candidate = v[half:]
        far = (
            (candidate - mean > FAR * spread)
            & (candidate - below > APART * (below - v[quarter]))
            & (spread > 0)
        )
    return order[half + int(np.argmax(far)) :] if far.any() else np.empty(0, dtype=np.intp)


def unwrapped(values: Array) -> Array:
    """An angle (N,) without its jumps by a turn of 2 pi or 360; as it is where it has none."""
    wrapped = wrapped_angle(values)
    if wrapped is None:
        return values
    full, _ = wrapped
    known = np.isfinite(values)
    result = values.copy()
    result[known] = np.unwrap(values[known], period=full)
    return result
