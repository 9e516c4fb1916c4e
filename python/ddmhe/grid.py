"""The nominal grid of a log's clock: which sample each row is, where stamps jitter, come late or
rows are lost.

A stamp that comes late is followed by shorter steps, a lost row is not. With s the nominal step and
L(i) = (t(i) - t(0))/s - i the lateness of row i, lost rows lift the lower envelope of L for good,
late stamps only L."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["GAP", "samples_of"]

GAP = 1.5
"""A step longer than this many nominal steps is nearer to two of them: at least one sample may be
missing."""
LOOK = 5
"""Rows before and after a long step in which its envelope is taken; after it, one more for every
step that it lasts."""
LONGEST_LOOK = 100
"""Beyond this many rows a nominal step that is off by 0.5 % would count as half a sample."""


def samples_of(t: Array) -> NDArray[np.int64]:
    """Sample number of each row (N,), from 0, strictly increasing; 0, 1, 2, … where no row is lost.

    t : strictly increasing times (N,), N >= 2
    """
    steps = np.diff(t)
    regular = steps[steps <= GAP * np.median(steps)]
    step = float(regular.mean())  # stamps of whole milliseconds have a coarse median
    late = (t - t[0]) / step - np.arange(t.size)
    lost = np.zeros(t.size, dtype=np.int64)
    first = 0  # rows before the last loss tell nothing of the envelope now
    for i in np.flatnonzero(steps > GAP * step):
        ahead = LOOK + min(int(steps[i] / step), LONGEST_LOOK)
        before = late[max(first, i + 1 - LOOK) : i + 1].min()
        lost[i + 1] = max(round(float(late[i + 1 : i + 1 + ahead].min() - before)), 0)
        first = int(i) + 1 if lost[i + 1] else first
    return np.asarray(np.arange(t.size) + np.cumsum(lost), dtype=np.int64)
