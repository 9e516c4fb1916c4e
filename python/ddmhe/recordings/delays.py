"""Outputs that are late: a known delay taken off their columns, in whole samples of the file.

Row k of a log says what a sensor gave at k; with a delay of d samples that is what was so at k - d.
Moved back, the columns of row k all speak of one instant, and the last d rows have no output."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.errors import LogError

Array = NDArray[np.float64]

__all__ = ["checked_delay", "moved_back", "whole_samples"]

OFF = 0.1
"""A delay may be off by so much of a sample: numbers are typed with a few digits, and the steps of
a clock have a rounded median."""


def checked_delay(delay: Any, outputs: Sequence[str]) -> dict[str, float]:
    """Seconds by the names of the outputs that have a delay; LogError for anything but a finite
    number, or finite numbers by names of outputs."""
    named = delay if isinstance(delay, Mapping) else dict.fromkeys(outputs, delay)
    for name, seconds in named.items():
        if name not in outputs:
            raise LogError(f"delay: expected the name of an output column, found {shown(name)}")
        real = isinstance(seconds, int | float | np.integer | np.floating) and not isinstance(
            seconds, bool
        )
        if not real or not math.isfinite(seconds):
            raise LogError(
                "delay: expected finite seconds, or such by names of outputs, found "
                f"{shown(seconds)}"
            )
    return {name: float(seconds) for name, seconds in named.items() if seconds != 0}


def whole_samples(path: str, delay: Mapping[str, float], step: float, rows: int) -> dict[str, int]:
    """Samples of the file, `step` seconds each, by name; LogError for parts of a sample, or more
    than the log has.

    rows : samples from the first row to the last
    """
    found = {}
    for name, seconds in delay.items():
        samples = seconds / step if step > 0 else math.nan
        if not abs(samples - np.round(samples)) <= OFF:
            raise LogError(
                f"delay: expected whole samples of {path}, {step:.6g} s each, found {seconds:g} s "
                f"for output {shown(name)}, {samples:.4g} of them"
            )
        if abs(samples) >= rows:
            raise LogError(
                f"delay: expected less than the {rows * step:.6g} s of {path}, found {seconds:g} s "
                f"for output {shown(name)}"
            )
        found[name] = int(np.round(samples))
    return found


def moved_back(
    samples: NDArray[np.int64], values: Array, lines: NDArray[np.int64], by: int
) -> tuple[Array, NDArray[np.int64]]:
    """One column (N,) whose row of sample s has the value of sample s + by, and the lines (N,) that
    the values stand in; NaN and 0 where that sample has no row.

    samples : increasing sample numbers of the rows (N,)
    """
    source = np.minimum(np.searchsorted(samples, samples + by), len(samples) - 1)
    there = samples[source] == samples + by
    return np.where(there, values[source], np.nan), np.where(there, lines[source], 0)
