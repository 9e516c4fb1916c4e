"""Kalman filters: on a data model (Dd-ESKF), on an identified vector-ARX model, and with the true
model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, RankError, ShapeError
from ddmhe.baselines.arx import fit_arx
from ddmhe.baselines.base import Baseline, recordings
from ddmhe.baselines.linear_model import identified
from ddmhe.baselines.tol import (
    ARX_OUTPUT,
    COVARIANCE,
    KNOWN_START,
    NONZERO,
    ORACLE_NOISE,
    ORACLE_STATE,
    SLOPE_STEP,
)
from ddmhe.checks import (
    array,
    check_finite,
    check_flag,
    check_number,
    check_whole,
    choice,
    shown,
)
from ddmhe.design.model import samples

Array = NDArray[np.float64]

__all__ = ["ArxKalman", "ErrorStateKalman", "Oracle", "update"]


def update(x: Array, P: Array, innovation: Array, C: Array, R: Array) -> tuple[Array, Array]:
    """x and P after a measurement, in Joseph's form; entries of the innovation that are NaN were
    not measured."""
    seen = ~np.isnan(innovation)
    if not seen.any():
        return x, P
    C, R = C[seen], R[np.ix_(seen, seen)]
    gain = scipy.linalg.solve(C @ P @ C.T + R, C @ P, assume_a="pos", check_finite=False).T
    rest = np.eye(len(x)) - gain @ C
    return x + gain @ innovation[seen], rest @ P @ rest.T + gain @ R @ gain.T


class ErrorStateKalman(Baseline):
    """Dd-ESKF: an error-state Kalman filter on the least-squares model of the recording.

    The nominal state runs through the model, the filter estimates its error and feeds it back at
    every step, as Liu et al. 2026 compare with (Q = 1e5, R = 1e3 there, both times identity).
    Without Q and R it is tuned from the recording: the residual covariances of the model.

    Parameters
    ----------
    history : History
        The recording.
    Q, R : float
        Process and measurement noise covariance, times identity; units of the state and of the
        output squared.
    affine : bool
        Model with offsets e and r; without them it is the linear one, [A; C] = [X1; Y0] X0⁺ (with
        inputs [A B; C D] = [X1; Y0] [X0; U0]⁺).
    x_prior : (n,)
        Default: the last recorded state.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> log = ddmhe.baselines.ErrorStateKalman(record.history(200)).run(record.y[200:300])
    >>> bool(np.abs(log.x - record.x[201:301]).max() < 0.01)
    True
    """

    def __init__(
        self,
        history: History,
        Q: float | None = None,
        R: float | None = None,
        *,
        affine: bool = True,
        x_prior: ArrayLike | None = None,
    ) -> None:
        """Check, identify and start."""
        last = recordings(history)[-1][0][-1]
        super().__init__(history.n, history.p, last if x_prior is None else x_prior, history.m)
        self.dt = history.dt
        check_flag("affine", affine)
        for name, value in (("Q", Q), ("R", R)):
            if value is not None:
                check_number(name, value, "a positive number", lambda size: size > 0)
        model = identified(history, affine=affine)
        self.A, self.B, self.e = model.A, model.B, model.e
        self.C, self.D, self.r = model.C, model.D, model.r
        before, after = samples(history)
        before, u = before[:, : self.n], before[:, self.n :]
        x_next, y = after[:, : self.n], after[:, self.n :]
        if self.m:  # what the inputs did is no residual
            x_next, y = x_next - u @ self.B.T, y - u @ self.D.T
        self.Q = _covariance(
            Q, x_next - before @ self.A.T - self.e, np.vstack([before[:1], x_next])
        )
        self.R = _covariance(R, y - before @ self.C.T - self.r, y)
        self.reset()

    def _start(self, x_prior: Array) -> None:
        self._x, self._P = x_prior, np.zeros((self.n, self.n))

    def _step(self, y: Array, u: Array) -> Array:
        innovation = y - self.C @ self._x - self.r
        if self.m:
            innovation -= self.D @ u
        error, P = update(np.zeros(self.n), self._P + _tiny(self.Q), innovation, self.C, self.R)
        self._x = self.A @ (self._x + error) + self.e
        if self.m:
            self._x += self.B @ u
        self._P = self.A @ P @ self.A.T + self.Q
        return self._x.copy()


class ArxKalman(Baseline):
    """A Kalman filter on a vector-ARX model of states and outputs together: what system
    identification would do.

    z(k) = [x(k); y(k)] = c + A_1 z(k-1) + … + A_L z(k-L) + ε(k) by ridge regression; the filter
    runs on the last L values of z, of which the outputs are measured. Hidden states are covered by
    the lags. An unstable fit is made stable. With inputs, B_1 u(k-1) + … + B_L u(k-L) is added, and
    to the rows of y also B_0 u(k).

    Parameters
    ----------
    history : History
        The recording.
    order : int
        Number of lags L. Default: the best of 1, 2, 3, 5 and 8 by Schwarz's criterion (BIC).

    Examples
    --------
    >>> import ddmhe
    >>> record = ddmhe.models.detumbling().simulate(duration=40.0, dt=0.1, noise=0.01)
    >>> ddmhe.baselines.ArxKalman(record.history(200)).run(record.y[200:300]).x.shape
    (100, 3)
    """

    ORDERS = (1, 2, 3, 5, 8)

    def __init__(self, history: History, order: int | None = None) -> None:
        """Check, identify and start."""
        parts = [np.hstack([x[:-1], y]) for x, y in recordings(history)]
        super().__init__(history.n, history.p, history.recordings[-1][0][-1], history.m)
        self.dt = history.dt
        known = history.inputs
        m, total = history.n + history.p, sum(len(z) for z in parts)
        if order is not None:
            check_whole("order", order, expected="at least 1 lag")
        orders = self.ORDERS if order is None else (order,)
        given = order is not None
        fits = [
            fit_arx(parts, known, L, history.n) for L in orders if self._suffices(parts, L, given)
        ]
        if not fits:
            least = 2 * (m + self.m + 1) if order is None else order + 1
            raise RankError(
                f"history: expected more than {least} samples, also in the last recording, found "
                f"{total}"
            )
        best = min(fits, key=lambda fit: fit.bic)
        self.order, self._offset = best.order, best.offset
        self._B, self._D = best.B, best.D
        L = self.order
        self._A = np.zeros((m * L, m * L))
        self._A[:m] = best.lags
        self._A[m:, :-m] = np.eye(m * (L - 1))
        self._Q = np.zeros((m * L, m * L))
        self._Q[:m, :m] = best.noise
        self._C = np.zeros((self.p, m * L))
        self._C[:, self.n : m] = np.eye(self.p)
        self._R = ARX_OUTPUT * np.diag(np.vstack(parts)[:, history.n :].var(axis=0) + NONZERO)
        self._recent = parts[-1][::-1][:L].ravel()
        self._recent_inputs = known[-1][::-1][:L].ravel()
        self.reset()

    def _suffices(self, parts: list[Array], L: int, given: bool) -> bool:
        """Whether the recordings hold enough windows of L + 1 samples, and the last one a start."""
        m, windows = parts[0].shape[1] + self.m, sum(max(len(z) - L, 0) for z in parts)
        return len(parts[-1]) >= L and windows > (1 if given else (L + 1) * (m + 1) - L)

    def _start(self, x_prior: Array) -> None:
        self._past_inputs = self._recent_inputs
        self._s = self._predicted(self._recent)
        self._s[: self.n] = x_prior
        self._P = self._Q.copy()
        self._P[: self.n] = self._P[:, : self.n] = 0.0

    def _predicted(self, s: Array) -> Array:
        """z(k) and its lags from those of z(k-1), without B_0 u(k), which is not known yet."""
        forward = self._A @ s
        forward[: self.n + self.p] += self._offset
        if self.m:
            forward[: self.n + self.p] += self._B @ self._past_inputs
        return forward

    def _step(self, y: Array, u: Array) -> Array:
        if self.m:
            self._s[self.n : self.n + self.p] += self._D @ u
            self._past_inputs = np.concatenate([u, self._past_inputs[: -self.m]])
        self._s, self._P = update(self._s, self._P, y - self._C @ self._s, self._C, self._R)
        self._s, self._P = self._predicted(self._s), self._A @ self._P @ self._A.T + self._Q
        return self._s[: self.n].copy()


class Oracle(Baseline):
    """A Kalman filter that knows the true model and noise: the limit that no data-driven method can
    pass.

    Parameters
    ----------
    model : a system of `ddmhe.models`
        The truth; it moves by forward Euler with step dt, as it was simulated.
    dt : float
        Sampling interval, s.
    x_prior : (n,)
        State at the first output.
    noise : float
        Standard deviation of the outputs' noise.
    prior : float
        Standard deviation of x_prior's error.
    motion : float
        Standard deviation of the process noise per step.
    kind : "ekf" or "ukf"
        Linearised along the estimate, or by sigma points (Julier, Uhlmann 1997; kappa = 3 - n).

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> model = ddmhe.models.detumbling()
    >>> record = model.simulate(duration=20.0, dt=0.1, noise=0.01)
    >>> oracle = ddmhe.baselines.Oracle(model, 0.1, record.x[0], noise=0.01)
    >>> bool(np.abs(oracle.run(record.y[:100]).x - record.x[1:101]).max() < 1e-3)
    True
    """

    def __init__(
        self,
        model: Any,
        dt: float,
        x_prior: ArrayLike,
        noise: float,
        *,
        prior: float = 0.0,
        motion: float = 0.0,
        kind: Literal["ekf", "ukf"] = "ekf",
    ) -> None:
        """Check and start."""
        x = array("x_prior", x_prior, (-1,))
        check_finite("x_prior", x)
        if not callable(getattr(model, "output", None)) or not callable(
            getattr(model, "derivative", None)
        ):
            raise DdmheError(f"model: expected a system of ddmhe.models, found {shown(model)}")
        states = len(getattr(model, "initial_state", x))
        if len(x) != states:
            raise ShapeError(f"x_prior: expected {states} numbers, found {len(x)}")
        check_number("dt", dt, "a positive number of seconds", lambda seconds: seconds > 0)
        for name, size in (("noise", noise), ("prior", prior), ("motion", motion)):
            check_number(name, size, "a finite number of at least 0", lambda value: value >= 0)
        self._kind = choice("kind", kind, ("ekf", "ukf"))
        super().__init__(len(x), len(model.output(x)), x)
        self.dt = float(dt)
        self._model, self._dt = model, dt
        size = float(np.linalg.norm(x)) or 1.0
        self._P_0 = max(prior, ORACLE_STATE * size) ** 2 * np.eye(self.n)
        self._Q = max(motion, ORACLE_STATE * size) ** 2 * np.eye(self.n)
        self._R = max(noise, ORACLE_NOISE) ** 2 * np.eye(self.p)
        self.reset()

    def _output(self, x: Array) -> Array:
        return np.asarray(self._model.output(x))

    def _forward(self, x: Array) -> Array:
        return np.asarray(x + self._dt * self._model.derivative(x))

    def _start(self, x_prior: Array) -> None:
        self._x, self._P = x_prior, self._P_0

    def _step(self, y: Array, u: Array) -> Array:
        if self._kind == "ekf":
            C = _slope(self._output, self._x)
            x, P = update(self._x, self._P, y - self._output(self._x), C, self._R)
            A = _slope(self._forward, x)
            self._x, self._P = self._forward(x), A @ P @ A.T + self._Q
        else:
            x, P = self._unscented_update(y)
            points, weights = _sigma_points(x, P)
            moved = self._forward(points)
            self._x = weights @ moved
            self._P = (weights * (moved - self._x).T) @ (moved - self._x) + self._Q
        return self._x.copy()

    def _unscented_update(self, y: Array) -> tuple[Array, Array]:
        seen = ~np.isnan(y)
        if not seen.any():
            return self._x, self._P
        points, weights = _sigma_points(self._x, self._P)
        outputs = self._output(points)[:, seen]
        mean = weights @ outputs
        S = (weights * (outputs - mean).T) @ (outputs - mean) + self._R[np.ix_(seen, seen)]
        cross = (weights * (points - self._x).T) @ (outputs - mean)
        gain = scipy.linalg.solve(S, cross.T, assume_a="pos", check_finite=False).T
        return self._x + gain @ (y[seen] - mean), self._P - gain @ S @ gain.T


def _covariance(given: float | None, residuals: Array, signal: Array) -> Array:
    """`given` times identity, or the residuals' covariance, never below rounding."""
    if given is not None:
        return float(given) * np.eye(residuals.shape[1])
    floor = COVARIANCE * (np.mean(signal**2, axis=0) + NONZERO)
    return residuals.T @ residuals / len(residuals) + np.diag(floor)


def _tiny(Q: Array) -> Array:
    """A first covariance: the last recorded state is known up to the recording's own errors."""
    return np.asarray(KNOWN_START * Q)


def _slope(f: Callable[[Array], Array], x: Array) -> Array:
    """Derivative of f at x by central differences; f takes many states at once."""
    h = SLOPE_STEP * (float(np.linalg.norm(x)) or 1.0)
    steps = h * np.eye(len(x))
    return np.asarray((f(x + steps) - f(x - steps)).T / (2 * h))


def _sigma_points(x: Array, P: Array) -> tuple[Array, Array]:
    """2n+1 points (2n+1, n) and their weights with the mean x and the covariance P."""
    n = len(x)
    kappa = max(3.0 - n, 0.0)
    spread = np.linalg.cholesky((n + kappa) * 0.5 * (P + P.T)).T
    weights = np.full(2 * n + 1, 0.5 / (n + kappa))
    weights[0] = kappa / (n + kappa)
    return np.vstack([x, x + spread, x - spread]), weights
