"""Least distance: the shortest t with lo <= N t <= hi (Lawson, Hanson 1974, chapter 23).

Its dual is a non-negative least-squares problem in the multipliers, which SciPy solves by active
sets: the answer is that of an active set, not of a tolerance. Few rows matter, so rows join as
they are violated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from ddmhe.baselines.tol import BOX, MISSED, NO_POINT

Array = NDArray[np.float64]

__all__ = ["LeastDistance", "least_distance"]

MOST_ROUNDS = 200
"""Times that violated rows join before the search is given up."""


@dataclass(frozen=True, eq=False)
class LeastDistance:
    """The shortest point of a box of rows."""

    t: Array
    """(r,)"""
    active: int
    """Number of rows at their limits that hold the point there."""
    status: str
    """"optimal", "infeasible" (no point) or "failed" (none was found)."""


def least_distance(N: Array, lo: Array, hi: Array) -> LeastDistance:
    """The shortest t (r,) with lo <= N t <= hi; N (k, r), sides (k,) may be infinite."""
    length = np.linalg.norm(N, axis=1)
    flat = length <= 0.0
    size = np.where(flat, 1.0, length)
    rows = np.vstack([N / size[:, None], -N / size[:, None]])  # rows t >= limits
    limits = np.concatenate([lo / size, -hi / size])
    t, lost = np.zeros(N.shape[1]), LeastDistance(np.zeros(N.shape[1]), 0, "infeasible")
    scale = max(1.0, float(np.abs(limits[np.isfinite(limits)]).max(initial=0.0)))
    # a row that t cannot move holds everywhere or nowhere
    if (limits[np.tile(flat, 2)] > BOX * scale).any():
        return lost
    chosen = np.zeros(len(limits), dtype=bool)
    multipliers: Array = np.zeros(0)
    for _ in range(MOST_ROUNDS):
        room = rows @ t - limits
        worse = (room < -BOX * (1.0 + np.abs(limits))) & ~chosen
        if not worse.any():
            return LeastDistance(t, int(np.sum(multipliers > 0)), "optimal")
        chosen |= worse
        found = _shortest(rows[chosen], limits[chosen])
        if found is None:
            return lost
        t, multipliers = found
        if (rows[chosen] @ t < limits[chosen] - MISSED * (1.0 + np.abs(limits[chosen]))).any():
            return lost  # a compromise of rows that exclude each other, by little
    return LeastDistance(t, 0, "failed")


def _shortest(rows: Array, limits: Array) -> tuple[Array, Array] | None:
    """The shortest t with rows t >= limits and its multipliers; None if there is no such t."""
    scale = float(np.abs(limits).max()) or 1.0
    dual = np.vstack([rows.T, limits / scale])
    target = np.zeros(len(dual))
    target[-1] = 1.0
    multipliers, _ = scipy.optimize.nnls(dual, target)
    rest = dual @ multipliers - target  # -rest[-1] = 1 / (1 + ‖t / scale‖²)
    if -rest[-1] < NO_POINT:
        return None
    t = -scale * rest[:-1] / rest[-1]
    # anew from the active rows: the division above has lost what a long t needs
    active = multipliers > 0
    if active.any():
        t = np.linalg.lstsq(rows[active], limits[active], rcond=None)[0]
    return np.asarray(t), np.asarray(multipliers)
