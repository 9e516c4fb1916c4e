"""The extended Kalman filter that runs a lifted model, inside a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddmhe.lifted.kalman import updated
from ddmhe.lifted.model import LiftedModel
from ddmhe.lifted.tol import NIS_MOST, NOVEL, SCORE_RATE, SPREAD_MOST

Array = NDArray[np.float64]

__all__ = ["Innovation", "LiftedFilter"]


@dataclass(frozen=True, eq=False)
class Innovation:
    """What the newest outputs differ by from what was expected of them; NaN where not measured."""

    value: Array  # p
    std: Array  # p


class LiftedFilter:
    """x̂(t) and its covariance from outputs up to y(t-1)."""

    def __init__(self, model: LiftedModel, x_bounds: tuple[Array, Array] | None) -> None:
        """At the end of the recording; x_bounds: smallest and largest states (n,)."""
        self.model = model
        least, most = model.cut_off
        if x_bounds is not None:
            least, most = np.maximum(least, x_bounds[0]), np.minimum(most, x_bounds[1])
        self._least, self._most = least, np.maximum(most, least)
        self.x, self.P = model.x_end.copy(), model.P_end.copy()
        self.score = 1.0
        """Moving mean of the normalised innovations squared; 1 while the model holds."""

    def begin(self, x: Array, P: Array) -> None:
        """Start from a state (n,) with this covariance (n, n) of its error."""
        self.x, self.P, self.score = x.copy(), P.copy(), 1.0

    def step(self, y: Array, u: Array) -> Innovation:
        """Take in y(t-1) (p,), NaN where not measured, and u(t-1) (m,), and predict x̂(t)."""
        model = self.model
        value, std = np.full(len(y), np.nan), np.full(len(y), np.nan)
        measured = np.flatnonzero(np.isfinite(y))
        if measured.size:
            expected, C = model.output(self.x, u)
            H, v = C[measured], (y - expected)[measured]
            R = model.R[np.ix_(measured, measured)]
            S = H @ self.P @ H.T + R
            self._judge(float(v @ np.linalg.solve(S, v)) / measured.size)
            value[measured], std[measured] = v, np.sqrt(np.diag(S))
            x, self.P = updated(self.x, self.P, H, v, R)
            self.x = self._inside(x)
        x, A = model.next(self.x, u)
        self.P = A @ self.P @ A.T + model.Q
        self.x = self._inside(x)
        most = SPREAD_MOST * len(x)
        total = float(np.trace(self.P / np.outer(model.spread, model.spread)))
        if total > most:
            self.P *= most / total
        return Innovation(value, std)

    def _judge(self, nis: float) -> None:
        """The score with one more innovation; a covariance that is too small for it grows."""
        self.score += SCORE_RATE * (min(nis, NIS_MOST) - self.score)
        if self.score > NOVEL:
            self.P = self.P * min(1 + 0.1 * (self.score - NOVEL), 2.0)

    def _inside(self, x: Array) -> Array:
        """The state moved into the box along its covariance, the bound that is broken most first;
        what that leaves outside, straight."""
        for _ in range(len(x)):
            over = np.maximum(self._least - x, x - self._most) / np.sqrt(np.diag(self.P))
            worst = int(np.argmax(over))
            if not over[worst] > 0:
                return x
            bound = np.clip(x[worst], self._least[worst], self._most[worst])
            x = x + self.P[:, worst] / self.P[worst, worst] * (bound - x[worst])
        return np.asarray(np.clip(x, self._least, self._most))
