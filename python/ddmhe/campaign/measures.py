"""What a row keeps of a run: errors over spans, whether the bars hold, and how it went."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.campaign.data import Data

Array = NDArray[np.float64]

__all__ = ["measured"]

NEARLY = 1e-9
"""Share of a span by which times may be off, multiples of dt as they are."""


def measured(
    log: Any, data: Data, states: tuple[str, ...], spans: Mapping[str, float], bins: int
) -> dict[str, Any]:
    """Columns of one run. Errors are NaN where the truth is not known or the run is shorter than a
    span, infinite where an estimate is not finite."""
    x = np.asarray(log.x, dtype=np.float64)
    N = len(x)
    error = _errors(x, data.x[:N])
    square = np.sum(error**2, axis=1)
    nees = _nees(error, _known(log, "covariance"))
    row: dict[str, Any] = {"samples": N, "finite": float(np.mean(np.isfinite(x))) if N else 1.0}
    for name, seconds in spans.items():
        inside = data.t[:N] <= seconds * (1 + NEARLY)
        if np.isfinite(seconds) and (not N or data.t[-1] < seconds * (1 - NEARLY)):
            inside[:] = False
        row[f"rmse_{name}"] = _root_mean(square[inside])
        for i, state in enumerate(states):
            row[f"rmse_{state}_{name}"] = _root_mean(error[inside, i] ** 2)
        row[f"nees_{name}"] = _mean(nees[inside])
    std, trusted = _known(log, "std"), _known(log, "trusted")
    row |= _within(error, std)
    row |= _of_bounds(log, data.x[:N])
    row["trusted"] = None if trusted is None or not N else float(np.mean(trusted))
    row["unnoticed"] = None if std is None or not N else _unnoticed(error, std, trusted)
    row["status"] = _counts(log, N)
    means = _binned(np.stack([square, nees]), bins)
    row["error_over_time"], row["nees_over_time"] = np.sqrt(means[0]).tolist(), means[1].tolist()
    return row


def _errors(x: Array, truth: Array) -> Array:
    with np.errstate(invalid="ignore", over="ignore"):
        error = x - truth
    return np.where(np.isfinite(truth) & ~np.isfinite(x), np.inf, error)


def _known(log: Any, name: str) -> Any:
    """What a log tells beyond estimates; baselines tell nothing."""
    return getattr(log, name, None)


def _nees(error: Array, covariance: Array | None) -> Array:
    """e' P⁻¹ e / n (N,): 1 in the mean where the covariance is right; NaN where there is none."""
    found = np.full(len(error), np.nan)
    if covariance is None:
        return found
    usable = np.array(np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)))
    usable &= np.linalg.det(np.where(usable[:, None, None], covariance, 0.0)) > 0
    e = error[usable]
    solved = np.linalg.solve(covariance[usable], e[:, :, None])[:, :, 0]
    found[usable] = np.sum(e * solved, axis=1) / error.shape[1]
    return found


def _mean(values: Array) -> float:
    """Mean of what is known; NaN without any."""
    known = values[~np.isnan(values)]
    return float(np.mean(known)) if known.size else float("nan")


def _root_mean(squares: Array) -> float:
    return float(np.sqrt(_mean(squares)))


def _within(error: Array, std: Array | None) -> dict[str, float | None]:
    """How often the known ones are within one, two and three deviations."""
    names = [f"within_{k}sd" for k in (1, 2, 3)]
    if std is None:
        return dict.fromkeys(names)
    size = np.abs(error)
    known = np.count_nonzero(~np.isnan(size))
    inside = [np.count_nonzero(size <= k * std) for k in (1, 2, 3)]
    return {
        name: n / known if known else float("nan") for name, n in zip(names, inside, strict=True)
    }


def _unnoticed(error: Array, std: Array, trusted: NDArray[np.bool_]) -> float:
    """How often an estimate is trusted and the error of a state beyond three deviations."""
    return float(np.mean(trusted & (np.abs(error) > 3 * std).any(axis=1)))


def _of_bounds(log: Any, truth: Array) -> dict[str, Any]:
    """Of an interval observer: how often the truth is inside, and the mean width (n)."""
    lower, upper = _known(log, "lower"), _known(log, "upper")
    if lower is None or upper is None or not len(lower):
        return {"inside": None, "width": None}
    known = np.isfinite(truth).all(axis=1)
    held = ((truth >= lower) & (truth <= upper)).all(axis=1)
    inside = float(np.mean(held[known])) if known.any() else float("nan")
    return {"inside": inside, "width": np.mean(upper - lower, axis=0).tolist()}


def _counts(log: Any, N: int) -> str:
    """How many steps ended how, as JSON."""
    status = _known(log, "status")
    if getattr(log, "violation", None) is not None:
        return json.dumps({"held": N, "violation": 1})
    if status is None:
        return "{}"
    words = np.asarray(status)
    if N and (words == words[0]).all():  # nearly always, and much faster
        return json.dumps({str(words[0]): N})
    names, counts = np.unique(words.astype(str), return_counts=True)
    return json.dumps(dict(zip(names.tolist(), counts.tolist(), strict=True)))


def _binned(values: Array, bins: int) -> Array:
    """Means of rows (k, N) over equal pieces of the run (k, bins), of what is known; NaN where
    nothing is."""
    k, N = values.shape
    edges = np.linspace(0, N, bins + 1).round().astype(int)
    known = ~np.isnan(values)
    parts = np.zeros((2 * k, N + 1))  # with a column for pieces that begin at the end
    parts[:k, :N][known] = values[known]
    parts[k:, :N] = known
    sums = np.add.reduceat(parts, edges[:-1], axis=1)
    sums[:, edges[1:] == edges[:-1]] = 0.0  # of no samples reduceat takes the next one
    with np.errstate(invalid="ignore"):
        return np.asarray(sums[:k] / sums[k:])
