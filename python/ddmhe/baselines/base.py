"""The interface that baselines share with `DdMhe`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import History, NotFiniteError, numbers
from ddmhe.baselines.known_inputs import inputs_now, inputs_of_run
from ddmhe.checks import array, channels, check_finite, check_history
from ddmhe.steps import StepLog

Array = NDArray[np.float64]

__all__ = ["Baseline", "Estimate", "Log", "recordings"]


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate after one step."""

    x: Array
    """State (n,)."""


@dataclass(frozen=True, eq=False, repr=False)
class Log(StepLog):
    """The estimates of many steps."""


class Baseline:
    """An estimator that is fed outputs one by one, each with the inputs of its instant.

    Made for a recording with inputs, it takes u(k) (m,) beside y(k): u(k) acts on x(k+1), and y(k)
    may depend on u(k). Without inputs m is 0 and u stays away.

    One whose estimate has left all bounds has diverged: its estimate is NaN from then on, until the
    next reset."""

    dt = 1.0
    """Sampling interval, s; 1 where none is known."""
    t = 0
    """Number of outputs taken in since the start."""
    _diverged = False

    def __init__(self, n: int, p: int, x_prior: ArrayLike, m: int = 0) -> None:
        """Start at x_prior (n,) with outputs (p,) and inputs (m,)."""
        self.n, self.p, self.m = n, p, m
        self._default_prior = self._checked_prior(x_prior)

    def step(self, y_t: ArrayLike, u: ArrayLike | None = None) -> Estimate:
        """Consume y(t-1) (p,), NaN where not measured, and u(t-1) (m,); x̂(t)."""
        y = _outputs("y_t", np.atleast_1d(numbers("y_t", y_t, missing=True)), (self.p,))
        estimate = self._estimate(y, inputs_now(u, self.m))
        self.t += 1
        return estimate

    def run(self, Y: ArrayLike, U: ArrayLike | None = None) -> Log:
        """Consume outputs (N, p) and inputs (N, m), one step each. A KeyboardInterrupt has the Log
        so far as `finished`."""
        estimates: list[Estimate] = []
        before = self.t
        try:
            outputs = _outputs("Y", channels(Y, self.p), (-1, self.p))
            for y, u in zip(outputs, inputs_of_run(U, len(outputs), self.m), strict=True):
                estimates.append(self._estimate(y, u))
                self.t += 1
        except KeyboardInterrupt as e:
            e.finished = self._log(estimates, before)  # type: ignore[attr-defined]
            raise
        return self._log(estimates, before)

    def reset(self, x_prior: ArrayLike | None = None) -> None:
        """Start again from x_prior (n,), or from the last recorded state."""
        self._diverged, self.t = False, 0
        self._start(self._default_prior if x_prior is None else self._checked_prior(x_prior))

    def _estimate(self, y: Array, u: Array) -> Estimate:
        return Estimate(self._next(y, u))

    def _log(self, estimates: list[Any], before: int) -> Log:
        x = np.reshape([e.x for e in estimates], (-1, self.n))
        return Log(x, before=before, dt=self.dt)

    def _next(self, y: Array, u: Array) -> Array:
        if not self._diverged:
            try:
                with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                    x = self._step(y, u)
            except np.linalg.LinAlgError:  # numbers too large to solve with
                x = np.full(self.n, np.nan)
            self._diverged = not bool(np.isfinite(x).all())
        return np.full(self.n, np.nan) if self._diverged else x

    def _checked_prior(self, x_prior: ArrayLike) -> Array:
        x = array("x_prior", x_prior, (self.n,))
        check_finite("x_prior", x)
        return x

    def _start(self, x_prior: Array) -> None:
        raise NotImplementedError

    def _step(self, y: Array, u: Array) -> Array:
        raise NotImplementedError


def recordings(history: History) -> list[tuple[Array, Array]]:
    """States (T_i+1, n) and outputs (T_i, p) of each recording; DdmheError if this is no
    History."""
    return check_history(history).recordings


def _outputs(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Outputs, NaN where not measured."""
    y = array(name, value, shape, missing=True)
    if np.isinf(y).any():
        raise NotFiniteError(f"{name}: expected finite numbers or NaN, found infinity")
    return y
