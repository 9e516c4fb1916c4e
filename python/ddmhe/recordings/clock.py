"""The clock of a log: regular steps, and which sample of them each row is, where stamps jitter,
come late or rows are lost.

A stamp that comes late is followed by shorter steps, a lost row is not. With s the nominal step and
L(i) = (t(i) - t(0))/s - i the lateness of row i, lost rows lift the lower envelope of L for good,
late stamps only L."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.stamp_texts import stamp_texts
from ddmhe.recordings.stamps import SINCE, Stamps

Array = NDArray[np.float64]

__all__ = ["first_row", "jitter", "nominal_step", "samples_of", "start_of"]

JITTER, JITTERY_SHARE = 0.25, 0.2
"""Steps off the nominal one by more than JITTER are bad; a log with more than this share of them is
not regular."""
GAP = 1.5
"""A step longer than this many nominal steps is nearer to two of them: at least one sample may be
missing."""
LOOK = 5
"""Rows before and after a long step in which its envelope is taken; after it, one more for every
step that it lasts."""
LEAST_JITTER = 0.02
"""Steps that vary by less than this share are not spoken of."""
MOST_LOST = 2**40
"""Lost rows beyond this many are not counted."""
LONGEST_LOOK = 100
"""Beyond this many rows a nominal step that is off by 0.5 % would count as half a sample."""


def samples_of(t: Array) -> NDArray[np.int64]:
    """Sample number of each row (N,), from 0, strictly increasing; 0, 1, 2, … where no row is lost.

    t : strictly increasing times (N,), N >= 2
    """
    steps = np.diff(t)
    regular = steps[steps <= GAP * np.median(steps)]
    step = float(regular.mean())  # stamps of whole milliseconds have a coarse median
    with np.errstate(over="ignore"):  # of steps next to nothing beside long ones
        late = (t - t[0]) / step - np.arange(t.size)
        lasting = np.minimum(steps / step, LONGEST_LOOK).astype(int)
    lost = np.zeros(t.size, dtype=np.int64)
    first = 0  # rows before the last loss tell nothing of the envelope now
    for i in np.flatnonzero(steps > GAP * step):
        ahead = LOOK + lasting[i]
        before = late[max(first, i + 1 - LOOK) : i + 1].min()
        with np.errstate(invalid="ignore"):
            rows = np.nan_to_num(late[i + 1 : i + 1 + ahead].min() - before)
        lost[i + 1] = round(float(np.clip(rows, 0, MOST_LOST)))
        first = int(i) + 1 if lost[i + 1] else first
    return np.asarray(np.arange(t.size) + np.cumsum(lost), dtype=np.int64)


def jitter(t: Array, step: float) -> list[str]:
    """What is said of steps that vary; nothing of small ones, nor of lost rows."""
    if t.size < 3 or not step > 0:
        return []
    steps = np.diff(t)
    off = float(np.max(np.abs(steps[steps <= GAP * step] / step - 1), initial=0.0))
    return [f"steps vary by up to {100 * off:.0f} %"] if off > LEAST_JITTER else []


def start_of(path: str, stamps: Stamps, start: float | str) -> tuple[float, list[str]]:
    """A start on the clock t of the stamps, s, and what is said of it: dates and times since 1970
    are counted from the first row."""
    if isinstance(start, str):
        try:
            return start_of(path, stamps, float(start))
        except ValueError:
            found = stamp_texts([start])
        if found is None or stamps.ns is None:
            raise LogError(
                f"start: expected a time like the log's, s or a date, found {shown(start)}"
            ) from None
        return (int(found[0]) - stamps.since) / 1e9, []
    if not stamps.since:
        return float(start), []
    if start >= SINCE:
        since = stamps.since / 1e9 if stamps.ns is not None else stamps.since / stamps.per_second
        return float(start) - since, []
    return float(start), [f"start {start:g} s after the first row"]


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
            f"nominal {dt:.4g} s by more than {JITTER:.0%}; --resample SECONDS puts the log on "
            "even steps, --dt SECONDS does if only the stamps are uneven"
        )
    return dt
