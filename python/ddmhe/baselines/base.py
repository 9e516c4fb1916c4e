"""The interface that baselines share with `DdMhe`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, NotFiniteError, ShapeError

Array = NDArray[np.float64]

__all__ = ["Baseline", "Estimate", "Log", "single_recording"]


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate after one step."""

    x: Array
    """State (n,)."""


@dataclass(frozen=True, eq=False)
class Log:
    """The estimates of many steps."""

    x: Array
    """States (N, n)."""


class Baseline:
    """An estimator that is fed outputs one by one."""

    def __init__(self, n: int, p: int, x_prior: ArrayLike) -> None:
        """Start at x_prior (n,) with outputs (p,)."""
        self.n, self.p = n, p
        self._default_prior = self._checked_prior(x_prior)

    def step(self, y_t: ArrayLike) -> Estimate:
        """Consume y(t-1) (p,), NaN where not measured; x̂(t)."""
        y = np.asarray(y_t, dtype=np.float64)
        if y.shape != (self.p,):
            raise ShapeError(f"y_t: expected shape ({self.p},), found {y.shape}")
        if np.isinf(y).any():
            raise NotFiniteError("y_t: expected finite numbers or NaN, found infinity")
        return Estimate(self._step(y))

    def run(self, Y: ArrayLike) -> Log:
        """Consume outputs (N, p), one step each."""
        Y_ = np.asarray(Y, dtype=np.float64)
        if Y_.ndim != 2 or Y_.shape[1] != self.p:
            raise ShapeError(f"Y: expected shape (N, {self.p}), found {Y_.shape}")
        return Log(np.array([self.step(y).x for y in Y_]).reshape(len(Y_), self.n))

    def reset(self, x_prior: ArrayLike | None = None) -> None:
        """Start again from x_prior (n,), or from the last recorded state."""
        self._start(self._default_prior if x_prior is None else self._checked_prior(x_prior))

    def _checked_prior(self, x_prior: ArrayLike) -> Array:
        x = np.array(x_prior, dtype=np.float64)
        if x.shape != (self.n,):
            raise ShapeError(f"x_prior: expected shape ({self.n},), found {x.shape}")
        if not np.isfinite(x).all():
            raise NotFiniteError("x_prior: expected finite numbers, found NaN or infinity")
        return x

    def _start(self, x_prior: Array) -> None:
        raise NotImplementedError

    def _step(self, y: Array) -> Array:
        raise NotImplementedError


def single_recording(history: History) -> tuple[Array, Array]:
    """The states (T+1, n) and outputs (T, p) of a history that is one recording."""
    if not isinstance(history, History):
        raise DdmheError(f"history: expected a History, found {type(history).__name__}")
    if len(history.recordings) != 1:
        raise DdmheError(f"history: expected one recording, found {len(history.recordings)}")
    x, y = history.recordings[0]
    return np.asarray(x), np.asarray(y)
