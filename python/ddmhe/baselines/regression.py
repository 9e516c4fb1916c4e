"""A finite impulse response: the state as a linear function of the last outputs, by ridge
regression."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import History, RankError
from ddmhe.baselines.base import Baseline, recordings
from ddmhe.baselines.tol import FREEDOM, NONZERO
from ddmhe.checks import check_number, check_whole

Array = NDArray[np.float64]

__all__ = ["RidgeFir"]


class RidgeFir(Baseline):
    """x̂(t) = c + W [y(t-L); …; y(t-1)], W by ridge regression on the recording.

    With inputs the window has u(t-L), …, u(t-1) as well, their channels scaled to the outputs'
    pooled deviation, so that their units do not move the ridge.

    Parameters
    ----------
    history : History
        The recording; its last outputs are the first window.
    length : int
        Number of outputs L in the window. Default: a fifth of the recording, at most 40.
    weight : float
        Ridge weight in units of the largest squared singular value. Default: by generalised
        cross-validation (Golub, Heath, Wahba 1979).

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> ddmhe.baselines.RidgeFir(record.history(200), length=20).run(record.y[200:300]).x.shape
    (100, 3)
    """

    WEIGHTS = tuple(10.0**k for k in range(-12, 1))

    def __init__(
        self, history: History, length: int | None = None, weight: float | None = None
    ) -> None:
        """Check, identify and start."""
        parts = recordings(history)
        super().__init__(history.n, history.p, parts[-1][0][-1], history.m)
        longest = max(len(y) for _, y in parts)
        if length is not None:
            check_whole("length", length, expected="at least 1 output")
        if weight is not None:
            check_number(
                "weight", weight, "a finite number of at least 0", lambda value: value >= 0
            )
        self.length = L = min(max(longest // 5, 1), 40) if length is None else int(length)
        if longest < L + 2:
            raise RankError(
                f"history: expected at least {L + 2} samples in a row for {L}, found {longest}"
            )
        signals = self._signals(history)  # no window crosses from one recording to the next
        windows = np.array([s[k : k + L].ravel() for s in signals for k in range(len(s) - L + 1)])
        targets = np.concatenate([x[L:] for x, _ in parts])
        self._mean_y, self._mean_x = windows.mean(axis=0), targets.mean(axis=0)
        U, s, Vt = np.linalg.svd(windows - self._mean_y, full_matrices=False)
        projected = U.T @ (targets - self._mean_x)
        outside = np.sum((targets - self._mean_x) ** 2) - np.sum(projected**2)

        def score(share: float) -> float:
            shrink = s**2 / (s**2 + share * s[0] ** 2 + NONZERO)
            residual = np.sum(((1 - shrink)[:, None] * projected) ** 2) + max(outside, 0.0)
            return float(residual / max(len(windows) - 1 - shrink.sum(), FREEDOM) ** 2)

        self.weight = min(self.WEIGHTS, key=score) if weight is None else weight
        gains = s / (s**2 + self.weight * s[0] ** 2 + NONZERO)
        self.W = (Vt.T * gains @ projected).T
        last = signals[-1][len(signals[-1]) - min(L - 1, len(signals[-1])) :]
        lacking = np.tile(
            self._mean_y[: self.p + self.m], (L - 1 - len(last), 1)
        )  # a last recording shorter than the window
        self._recent = np.vstack([lacking, last])
        self.reset()

    def _signals(self, history: History) -> list[Array]:
        """[y, u] (T_i, p+m) of each recording, u scaled."""
        outputs = [y for _, y in history.recordings]
        if not self.m:
            return outputs
        u = np.concatenate(history.inputs)
        own = np.where(u.std(axis=0) > 0, u.std(axis=0), 1.0)
        pooled = float(np.sqrt(np.concatenate(outputs).var(axis=0).mean())) or 1.0
        self._scale_u = pooled / own
        return [
            np.hstack([y, u * self._scale_u]) for y, u in zip(outputs, history.inputs, strict=True)
        ]

    def _start(self, x_prior: Array) -> None:
        self._window = self._recent.copy()

    def _step(self, y: Array, u: Array) -> Array:
        last = self._window[-1] if len(self._window) else self._mean_y[: self.p + self.m]
        # a lacking output keeps its last value
        filled = np.where(np.isnan(y), last[: self.p], y)
        if self.m:
            filled = np.concatenate([filled, u * self._scale_u])
        window = np.vstack([self._window, filled])
        self._window = window[1:]
        return np.asarray(self._mean_x + self.W @ (window.ravel() - self._mean_y))
