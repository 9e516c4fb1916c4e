"""The errors of the chosen settings on ends of the recording, and where later ones are expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdMhe, DdmheError, History, noise_levels
from ddmhe.tol import NO_ERROR, POSITIVE
from ddmhe.tuning.folds import Fold

Array = NDArray[np.float64]

__all__ = ["Promise", "promise_of", "ratio_to"]

RANGE = {
    "lo": 0.7,
    "lo scatter": 0.5,
    "lo horizon": 2.0,
    "hi": 0.6,
    "hi scatter": 2.0,
    "hi horizon": 1.0,
    "rehearsed": 0.8,
}
"""Range of later errors in logs about the held-out one: constants, per standard deviation of the
held-out ends about their trend, per horizon/T (long windows leave few of them when an end is left
out: the held-out error is too large, or too small where the long window fails later), and about the
largest error of the rehearsals but one. Chosen so that nine in ten errors of what they were shaped
on lie inside."""
CLEAN = 0.2
"""Smallest share of the held-out error that is left when the noise of the recorded states is taken
off: it is none of the estimates'."""


@dataclass(frozen=True)
class Promise:
    """What settings do on the ends of the recording that they have not seen, and where later errors
    are expected."""

    parts: Array
    """Error of each end and state (K, n)."""
    held_out: Array
    """Root mean square over the ends (n,)."""
    lo: Array
    """Where the range of later errors begins (n,)."""
    hi: Array
    """Where that range ends (n,)."""


def promise_of(
    history: History, ends: list[Fold], rehearsals: list[Fold], given: dict[str, Any], horizon: int
) -> Promise:
    """Held-out errors with their range (see RANGE); NaN, 0 and infinity where no end can be held
    out."""
    n = history.n
    parts = np.array([_rms(fold, given)[0] for fold in ends])
    parts = parts[~np.isnan(parts).any(axis=1)]
    if len(parts) < 2:
        return Promise(parts, np.full(n, math.nan), np.zeros(n), np.full(n, math.inf))
    T = max(len(y) for _, y in history.recordings)
    size = np.max([np.abs(x).max(axis=0) for x, _ in history.recordings], axis=0)
    share = min(horizon / T, 1.0)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        held_out = np.sqrt(np.mean(parts**2, axis=0))
        scatter = _scatter(np.log(np.maximum(parts, NO_ERROR * size + POSITIVE)))
        lo = _clean(parts, noise_levels(history)[0]) * np.exp(
            -RANGE["lo"] - RANGE["lo scatter"] * scatter - RANGE["lo horizon"] * share
        )
        hi = held_out * np.exp(
            RANGE["hi"] + RANGE["hi scatter"] * scatter + RANGE["hi horizon"] * share
        )
        if rehearsals:
            worst = np.nan_to_num(
                [_rms(fold, given).max(axis=0) for fold in rehearsals], posinf=math.inf
            )
            hi = np.maximum(hi, math.exp(RANGE["rehearsed"]) * np.sort(worst, axis=0)[-2:][0])
    lo = np.where(np.isfinite(held_out), lo, 0.0)
    return Promise(parts, held_out, lo, np.maximum(hi, NO_ERROR * size))


def _clean(parts: Array, noise: Array) -> Array:
    """Typical error (n,) of the ends (K, n) without the noise of the recorded states (n,)."""
    typical = np.exp(np.mean(np.log(parts), axis=0))
    return np.asarray(np.sqrt(np.maximum(typical**2 - noise**2, (CLEAN * typical) ** 2)))


def _scatter(logs: Array) -> Array:
    """Standard deviation of each column (K, n) about its line: longer recordings are expected to do
    better."""
    K = len(logs)
    trend = np.vander(np.arange(K), 2 if K > 2 else 1)
    residuals = logs - trend @ (np.linalg.pinv(trend) @ logs)
    found = np.sqrt(np.sum(residuals**2, axis=0) / (K - trend.shape[1]))
    return np.where(np.isfinite(found), found, 0.0)


def _rms(fold: Fold, given: dict[str, Any]) -> Array:
    """Error of each state over each span of a fold (spans, n), in its unit; NaN where the fold is
    too short."""
    try:
        estimates = DdMhe(fold.history, **given, start="recording").run(fold.outputs, fold.inputs).x
    except DdmheError:
        return np.full((len(fold.spans), fold.history.n), math.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (estimates - fold.truth) ** 2
        found = np.sqrt([squares[:span].mean(axis=0) for span in fold.spans])
    return np.where(np.isfinite(found), found, math.inf)


def ratio_to(chosen: Promise, default: Promise) -> Array:
    """Error over the default rule's, state by state; NaN where the ends disagree on which is
    better."""
    if chosen.parts.shape != default.parts.shape or len(chosen.parts) < 2:
        return np.full(len(chosen.held_out), math.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        smaller, larger = chosen.parts < default.parts, chosen.parts > default.parts
        agreed = smaller.all(axis=0) | larger.all(axis=0)
        return np.where(agreed, chosen.held_out / default.held_out, math.nan)
