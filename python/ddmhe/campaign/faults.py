"""Faults of outputs: rows that are missing, spikes, a bias, a delay."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdmheError
from ddmhe.campaign.tables import Key, amount, amount_from_0, check_whole_from, positive, share

Array = NDArray[np.float64]

__all__ = ["FAULT", "faulty"]

FAULT = {
    "missing": Key(share, 0.0),  # of the rows
    "spikes": Key(share, 0.0),  # of the rows, on one output each
    "spike_size": Key(positive, 10.0),  # deviations of the recorded output
    "bias": Key(amount, 0.0),  # deviations of the recorded output
    "bias_from": Key(amount_from_0, 0.0),  # s after the recording
    "delay": Key(check_whole_from(0), 0),  # samples, no more than recorded
}
"""Keys of a fault in a spec."""


def faulty(
    Y: Array, recorded: Array, dt: float, fault: Mapping[str, Any], draw: np.random.Generator
) -> Array:
    """Outputs (N, p) that follow the recorded ones (T, p) with a fault: late, off, hit and
    missing, in this order."""
    N, p = Y.shape
    late = int(fault["delay"])
    if late > len(recorded):
        raise DdmheError(
            f"faults.delay: expected at most the {len(recorded)} samples recorded, found {late}"
        )
    found = np.vstack([recorded, Y])
    found = found[len(recorded) - late : len(found) - late].copy()
    deviation = recorded.std(axis=0)
    found[round(fault["bias_from"] / dt) :] += fault["bias"] * deviation
    hit, channel = draw.random(N) < fault["spikes"], np.array(draw.integers(p, size=N))
    sign = np.where(draw.random(N) < 0.5, -1.0, 1.0)
    rows = np.flatnonzero(hit)
    found[rows, channel[rows]] += (sign * fault["spike_size"])[rows] * deviation[channel[rows]]
    found[draw.random(N) < fault["missing"]] = np.nan
    return found
