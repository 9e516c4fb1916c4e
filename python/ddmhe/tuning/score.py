"""Scores of the candidates, and what they are ranked by."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import SPECTRAL_RADIUS
from ddmhe.tol import NO_ERROR
from ddmhe.tuning.candidates import LAMBDA, Candidate
from ddmhe.tuning.folds import QUARTERS

Array = NDArray[np.float64]

__all__ = ["Score", "log_error", "ranking", "rating"]

QUARTERS_WEIGHT = 0.3
"""Weight of the quarters' score beside the rehearsals'."""
Score = tuple[list[float], float]
"""Mean squared relative errors of a fold's spans, spectral radius."""


def ranking(candidates: list[Candidate], results: Sequence[Score | None]) -> list[Candidate]:
    """The candidates with their scores, best first; empty if none can be used."""
    each = len(results) // len(candidates)
    for k, c in enumerate(candidates):
        found = [score for score in results[k * each : (k + 1) * each] if score is not None]
        c.radius = found[0][1]
        errors = [log_error(squares) for squares, _ in found[1:]]
        c.scores = np.array(errors[:QUARTERS])
        c.rehearsals = np.array(errors[QUARTERS:]) if errors[QUARTERS:] else None
    _rate(candidates)
    ranked = sorted(candidates, key=lambda c: c.rated)
    return ranked if math.isfinite(ranked[0].rated) else []


def log_error(squares: list[float]) -> float:
    """Mean over spans of log(rms/spread); differences below NO_ERROR are none."""
    return float(np.mean([0.5 * math.log(max(s, NO_ERROR**2)) for s in squares]))


def _rate(candidates: list[Candidate]) -> None:
    """Smoothed errors, and what candidates are ranked by; inf for unstable ones."""
    by_key = {
        (c.horizon, c.mu, c.weight, c.equilibrium): c for c in candidates if c.weight is not None
    }
    stable = [c for c in candidates if c.radius <= SPECTRAL_RADIUS] or [
        c for c in candidates if math.isfinite(c.radius)
    ]
    for c in stable:
        near = [c]
        if c.weight is not None:
            k = LAMBDA.index(c.weight)
            near = [
                by_key[c.horizon, c.mu, w, c.equilibrium] for w in LAMBDA[max(k - 1, 0) : k + 2]
            ]
        near = [other for other in near if math.isfinite(other.score)] or [c]
        c.smoothed = np.mean([_errors(other) for other in near], axis=0)
        c.rated = rating(c.smoothed)


def _errors(c: Candidate) -> Array:
    """log(rms/spread) of the quarters and the rehearsals."""
    return np.concatenate([part for part in (c.scores, c.rehearsals) if part is not None])


def rating(errors: Array, without: int = -1) -> float:
    """What is small for a good setting: the mean over the rehearsals, and with less weight over the
    quarters."""
    kept = np.arange(len(errors)) != without
    quarters, rehearsals = kept[:QUARTERS], kept[QUARTERS:]
    rated = float(np.mean(errors[:QUARTERS][quarters]))
    return (
        QUARTERS_WEIGHT * rated + float(np.mean(errors[QUARTERS:][rehearsals]))
        if rehearsals.any()
        else rated
    )
