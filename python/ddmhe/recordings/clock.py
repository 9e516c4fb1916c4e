"""The clock of a log: regular steps, and which sample of them each row is, where stamps jitter,
come late or rows are lost.

A stamp that comes late is followed by shorter steps, a lost row is not. With s the nominal step and
L(i) = (t(i) - t(0))/s - i the lateness of row i, lost rows lift the lower envelope of L for good,
late stamps only L."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.cells import column
from ddmhe.recordings.log import LogError

Array = NDArray[np.float64]

__all__ = ["first_row", "nominal_step", "samples_of", "times"]

JITTER, JITTERY_SHARE = 0.25, 0.2
"""Steps off the nominal one by more than JITTER are bad; a log with more than this share of them is
not regular."""
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


def times(path: str, table: pd.DataFrame, name: str) -> Array:
    """The column of times (N,), s; LogError unless every row has one and they strictly increase."""
    t = column(path, table, name)
    if np.isnan(t).any():
        line = table.index[int(np.argmax(np.isnan(t)))]
        raise LogError(
            f"{path}, line {line}, column {shown(name)}: expected a time in seconds, found none"
        )
    back = np.diff(t) <= 0
    if back.any():
        row = int(np.argmax(back)) + 1
        raise LogError(
            f"{path}, line {table.index[row]}, column {shown(name)}: expected a time after the "
            f"{t[row - 1]:.10g} s of the line before, found {t[row]:.10g} s"
        )
    return t


def first_row(path: str, t: Array, start: float) -> int:
    """Index of the first of the times t (N,) at or after `start`, s; LogError if there is none."""
    if not start <= t[-1]:  # written so that NaN is refused too
        raise LogError(
            f"start: expected at most {t[-1]:.10g} s, the last time of {path}, found {start} s"
        )
    return int(np.argmax(t >= start))


def nominal_step(path: str, t: Array, nominal: float, decimate: int) -> float:
    """The nominal step, the median of the undecimated log times `decimate`: coarse time stamps do
    not shift it.

    LogError if the steps do not keep to it.
    """
    if t.size < 3:
        raise LogError(
            f"{path}: expected at least 3 samples from the start on, every {decimate} rows, found "
            f"{t.size}"
            if decimate > 1
            else f"{path}: expected at least 3 samples from the start on, found {t.size}"
        )
    steps, dt = np.diff(t), nominal
    bad = np.abs(steps - dt) > JITTER * dt
    if bad.mean() > JITTERY_SHARE:
        raise LogError(
            f"{path}: expected regular sampling, found {bad.mean():.0%} of the steps off the "
            f"nominal {dt:.4g} s by more than {JITTER:.0%}"
        )
    return dt
