"""Faults of outputs: rows that are missing, spikes, a bias, a delay."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.campaign.tables import Key, amount, check_whole_from, positive, share

Array = NDArray[np.float64]

__all__ = ["FAULT", "faulty"]

FAULT = {
    "missing": Key(share, 0.0),  # of the rows
    "spikes": Key(share, 0.0),  # of the rows, on one output each
    "spike_size": Key(positive, 10.0),  # deviations of the recorded output
    "bias": Key(amount, 0.0),  # deviations of the recorded output
    "bias_from": Key(amount, 0.0),  # s after the recording
    "delay": Key(check_whole_from(0), 0),  # samples
}
"""Keys of a fault in a spec."""


def faulty(
    Y: Array, recorded: Array, dt: float, fault: Mapping[str, Any], draw: np.random.Generator
) -> Array:
    """Outputs (N, p) that follow the recorded ones (T, p) with a fault: late, off, hit and
    missing, in this order."""
    N, p = Y.shape
    found = np.vstack([recorded, Y])
    late = min(int(fault["delay"]), len(recorded))
    found = found[len(recorded) - late : len(found) - late].copy()
    deviation = recorded.std(axis=0)
    found[round(max(fault["bias_from"], 0.0) / dt) :] += fault["bias"] * deviation
    hit, channel = draw.random(N) < fault["spikes"], np.array(draw.integers(p, size=N))
    sign = np.where(draw.random(N) < 0.5, -1.0, 1.0)
    rows = np.flatnonzero(hit)
    found[rows, channel[rows]] += (sign * fault["spike_size"])[rows] * deviation[channel[rows]]
    found[draw.random(N) < fault["missing"]] = np.nan
    return found
