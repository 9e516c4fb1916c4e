"""The weights of a recording for outputs that are noisier online."""

from __future__ import annotations

import numpy as np

from ddmhe.baselines.linear_model import identified
from ddmhe.baselines.recorded_noise import recorded_noise
from ddmhe.tol import NO_ERROR
from ddmhe.tuning.folds import Recorded

__all__ = ["LOUDER", "stated_noise"]

LOUDER = 2.0
"""Stated noise of more than this many times the recorded one is not that of the recording: a filter
whose R is wrong by a factor of four still has nearly the gain that it should have."""


def stated_noise(recorded: Recorded) -> tuple[list[list[float]], float] | None:
    """Q / c (n, n) and c for weights of the recording whose outputs' noise is the stated one; None
    where that is not louder.

    A filter's gain is the same for (Q, c R) and for (Q / c, R), so that a smaller disturbance
    stands in for a larger R. c is the geometric mean over the channels of stated over recorded
    variance."""
    if recorded.output_noise is None:
        return None
    noise = recorded_noise(recorded.history, identified(recorded.history))
    size = np.max([np.abs(y).max(axis=0) for _, y in recorded.history.recordings], axis=0)
    R = np.diag(noise.R)
    told = (NO_ERROR * size) ** 2 < R
    stated = np.broadcast_to(np.square(recorded.output_noise), R.shape)[told]
    if not (stated > LOUDER**2 * R[told]).any():
        return None
    c = float(np.exp(np.mean(np.log(np.maximum(stated / R[told], 1.0)))))
    return (noise.Q / c).tolist(), c
