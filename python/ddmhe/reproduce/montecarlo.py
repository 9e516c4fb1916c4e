"""Many noise seeds of one experiment, in parallel processes, and their median and 90 % band."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Estimators = Mapping[str, Callable[[], Any]]

__all__ = ["Trial", "Trials", "estimates", "run_trials"]

BAND = (5.0, 50.0, 95.0)
"""Percentiles that are shown: the median and the ends of the 90 % band."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One noise seed."""

    t: Array
    """Times of the estimates (N,), s."""
    x: Array
    """True states (N, n)."""
    y: Array
    """Outputs that were estimated from (N, p)."""
    x_hat: dict[str, Array]
    """Estimates (N, n) of each estimator; NaN after one has failed."""


@dataclass(frozen=True, eq=False)
class Trials:
    """All seeds of an experiment."""

    all: list[Trial]

    @property
    def names(self) -> list[str]:
        """The estimators."""
        return list(self.all[0].x_hat)

    @property
    def t(self) -> Array:
        """Times (N,), s."""
        return self.all[0].t

    def errors(self, name: str) -> Array:
        """‖x̂ - x‖ (seeds, N); infinite where the estimator has failed."""
        with np.errstate(over="ignore"):
            found = np.array([np.linalg.norm(trial.x_hat[name] - trial.x, axis=1) for trial in self.all])
        return np.where(np.isnan(found), np.inf, found)

    def band(self, name: str) -> Array:
        """Median and ends of the 90 % band of ‖x̂ - x‖ over the seeds: (3, N)."""
        return np.percentile(self.errors(name), BAND, axis=0, method="nearest")

    def rms(self, name: str, start: float = 0.0, end: float = np.inf) -> Array:
        """Root mean square of ‖x̂ - x‖ for start < t - t_0 <= end: (seeds,)."""
        first = self.t[0] - (self.t[1] - self.t[0])
        part = (self.t - first > start + 1e-9) & (self.t - first <= end + 1e-9)
        with np.errstate(over="ignore"):
            return np.asarray(np.sqrt(np.mean(self.errors(name)[:, part] ** 2, axis=1)))


def estimates(estimators: Estimators, Y: Array, n: int) -> dict[str, Array]:
    """x̂ (N, n) of each estimator over outputs Y (N, p)."""
    found = {}
    for name, make in estimators.items():
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found[name] = np.asarray(make().run(Y).x)
        except (np.linalg.LinAlgError, ValueError):  # an estimate that has left all bounds
            found[name] = np.full((len(Y), n), np.nan)
    return found


def run_trials(trial: Callable[..., Trial], seeds: Sequence[int], advance: Callable[[], None], **given: Any) -> Trials:
    """`trial(seed, **given)` for every seed, on all cores; `advance` is called after each."""
    found = []
    with ProcessPoolExecutor(os.cpu_count() or 1, initializer=_one_thread) as pool:
        for future in [pool.submit(trial, seed, **given) for seed in seeds]:
            found.append(future.result())
            advance()
    return Trials(found)


def _one_thread() -> None:
    """The processes share the cores: no threads inside of them."""
    os.environ["RAYON_NUM_THREADS"] = "1"
