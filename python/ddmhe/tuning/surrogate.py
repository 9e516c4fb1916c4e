"""A quadratic stand-in for the recorded system: motions on which settings can be rehearsed beyond
the recording.

    z(k+1) = z(k) + Θᵀ[u(k); 1; z(k); z(k) ⊗ z(k)],   y(k) = Cᵀ[u(k); 1; z(k)]

with z the state, and u the known inputs if there are any, relative to a known rest (then without
the ones: the rest stays one) or to the recording's mean. Beyond the recording the inputs go on with
the recorded ones, back and forth: there they are of the recorded kind, without a jump. Rigid bodies
turn like this (Euler's equations are quadratic), and any smooth motion does to second order. The
parameters minimise the simulation error of the whole recording, in units of its noise, with a weak
prior; others that fit as well are found by fitting disturbed data. It serves to choose settings,
never to estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ddmhe._core import History, noise_levels
from ddmhe.tol import STANDSTILL

Array = NDArray[np.float64]

__all__ = ["Surrogate", "continued"]

FLOOR = 1e-5
"""Noise below this share of the states' size counts as this much: a surrogate is no exact model."""
PRIOR = 1.0
"""Standard deviation of every parameter of the motion, in units of the recorded rms step."""
SMOOTHING = 1e-3
"""Share of the steps' variance that the first fit, a ridge regression, takes for noise."""
REACH = 3.0
"""A drawn motion that leaves this many times the recorded range is given up."""


class Overflow(ArithmeticError):
    """A motion whose derivatives are no numbers."""


def continued(u: Array, steps: int) -> Array:
    """Inputs (steps, m) that begin with the recorded u (T, m) and go on with u(T-1), u(T-2), …,
    u(0), u(0), u(1), …"""
    T = len(u)
    k = np.arange(steps) % (2 * T)
    return np.asarray(u[np.minimum(k, 2 * T - 1 - k)])


class Surrogate:
    """The quadratic model of one recording x (T+1, n), y (T, p), u (T, m)."""

    def __init__(
        self,
        x: Array,
        y: Array,
        rest: tuple[Array, ...] | None = None,
        u: Array | None = None,
    ) -> None:
        """Fit; `rest` is (x_e, y_e), or (x_e, y_e, u_e) with inputs."""
        u = np.zeros((len(y), 0)) if u is None else u
        self._rest = rest is not None
        self._n, self._p = x.shape[1], y.shape[1]
        self._x_0: Array = x.mean(axis=0) if rest is None else rest[0]
        self._y_0: Array = y.mean(axis=0) if rest is None else rest[1]
        self._size_x = float(np.sqrt(np.mean((x - self._x_0) ** 2)))
        self._size_y = float(np.sqrt(np.mean((y - self._y_0) ** 2))) or 1.0
        self._pairs = np.triu_indices(self._n)
        self.noise_x, self.noise_y = (
            float(np.sqrt(np.mean(noise**2))) for noise in noise_levels(History(x, y))
        )
        """Standard deviations of the recording's noise, pooled over channels."""
        u = u - (u.mean(axis=0) if rest is None or not u.shape[1] else rest[2])
        size_u = np.sqrt(np.mean(u**2, axis=0))
        self._u = u / np.where(size_u > 0, size_u, 1.0)
        self._z, self._y = (x - self._x_0) / self._size_x, (y - self._y_0) / self._size_y
        self._reach = REACH * float(np.linalg.norm(self._z, axis=1).max())
        self._fit()

    def draw(self, rng: np.random.Generator) -> Array:
        """Parameters that fit as well: those of the best fit to data and prior disturbed by their
        noise.

        To first order a draw from the posterior. Unlike one from the Gauss-Newton covariance it
        passes through the data where the motion is not linear in the parameters, and depends on
        them continuously: another rounding makes no other draw."""
        scale = np.sqrt(max(self.misfit, 1.0))
        return self._minimise(
            self.best, scale * rng.standard_normal(len(self._residuals(self.best)))
        )

    def motion(self, parameters: Array, steps: int) -> tuple[Array, Array]:
        """States (N+1, n) and outputs (N, p) from the recording's start, without noise.

        N = steps unless the motion goes astray.
        """
        z, theta, C = self._split(parameters)
        states, inputs = [z], continued(self._u, steps)
        for u in inputs:
            z = z + self._features(z, u) @ theta
            if not np.linalg.norm(z) < self._reach:
                break
            states.append(z)
        path = np.array(states)
        y = self._outputs(path[:-1], inputs[: len(path) - 1]) @ C
        return path * self._size_x + self._x_0, y * self._size_y + self._y_0

    def _features(self, z: Array, u: Array) -> Array:
        """(u, [1], z, products of z) along the last axis."""
        return np.concatenate(
            [self._outputs(z, u), z[..., self._pairs[0]] * z[..., self._pairs[1]]], axis=-1
        )

    def _outputs(self, z: Array, u: Array) -> Array:
        """(u, [1], z) along the last axis."""
        parts = [z] if self._rest else [np.ones((*z.shape[:-1], 1)), z]
        if u.shape[-1]:  # an empty part would change the order in memory, and so the rounding
            parts = [u, *parts]
        return np.concatenate(parts, axis=-1)

    def _split(self, parameters: Array) -> tuple[Array, Array, Array]:
        """z(0) (n,), Θ (m, n), C (q, p)."""
        n, m = self._n, self._count
        return (
            parameters[:n],
            parameters[n : n + m * n].reshape(m, n),
            parameters[n + m * n :].reshape(-1, self._p),
        )

    def _fit(self) -> None:
        self._count = self._features(self._z[:1], self._u[:1]).shape[1]
        self._weight_x = max(self.noise_x / self._size_x, FLOOR)
        self._weight_y = max(self.noise_y / self._size_y, FLOOR)
        self.best = self._minimise(self._start(), 0.0)
        """Parameters of the best fit."""
        self.misfit = float(np.mean(self._residuals(self.best) ** 2))
        """Mean squared residual in units of the noise: near 1 for a recording that the model
        explains."""

    def _minimise(self, start: Array, disturbance: Array | float) -> Array:
        """The parameters of least squares; `start` where the sensitivities of the motion overflow,
        so that no step can be computed: the misfit then says that nothing was explained."""

        def residuals(parameters: Array) -> Array:
            return np.asarray(self._residuals(parameters) + disturbance)

        try:
            with np.errstate(over="ignore", invalid="ignore"):
                solution = least_squares(
                    residuals, start, self._jacobian, x_scale="jac", max_nfev=40
                )
        except Overflow:
            return start
        return np.asarray(solution.x, dtype=np.float64)

    def _start(self) -> Array:
        """Ridge regression of (smoothed) steps on states."""
        z, u = self._z, self._u
        width = 5 if self._weight_x > 10 * FLOOR and len(z) > 10 else 1
        kernel = np.full(width, 1 / width)
        smooth = np.apply_along_axis(np.convolve, 0, z, kernel, "valid")
        driving = np.zeros((len(smooth) - 1, u.shape[1]))
        for i, channel in enumerate(u.T):
            driving[:, i] = np.convolve(channel, kernel, "valid")
        steps = np.diff(smooth, axis=0)
        rms = float(np.sqrt(np.mean(steps**2)))
        self._prior = PRIOR * rms + STANDSTILL
        F = self._features(smooth[:-1], driving)
        ridge = (self._weight_x**2 + SMOOTHING * rms**2) / self._prior**2
        theta = np.linalg.solve(F.T @ F + ridge * np.eye(self._count), F.T @ steps)
        C = np.linalg.lstsq(self._outputs(z[:-1], u), self._y, rcond=None)[0]
        return np.concatenate([z[0], theta.ravel(), C.ravel()])

    def _path(self, z: Array, theta: Array) -> Array:
        """States of the motion over the recording (T+1, n); a trial step of the optimiser must stay
        finite."""
        path = [z]
        for u in self._u:
            z = np.clip(z + self._features(z, u) @ theta, -10 * self._reach, 10 * self._reach)
            path.append(z)
        return np.array(path)

    def _residuals(self, parameters: Array) -> Array:
        """Simulation errors of x and y in units of the noise, and the prior."""
        z, theta, C = self._split(parameters)
        path = self._path(z, theta)
        errors_x = (path - self._z) / self._weight_x
        errors_y = (self._outputs(path[:-1], self._u) @ C - self._y) / self._weight_y
        return np.concatenate([errors_x.ravel(), errors_y.ravel(), theta.ravel() / self._prior])

    def _jacobian(self, parameters: Array) -> Array:
        """Derivatives of the residuals: the sensitivity S = ∂z/∂parameters runs along with the
        motion."""
        n, m, p = self._n, self._count, self._p
        z, theta, C = self._split(parameters)
        path = self._path(z, theta)
        i, j = self._pairs
        slopes = np.zeros((len(path), m, n))  # ∂features/∂z
        slopes[:, m - len(i) - n + np.arange(n), np.arange(n)] = 1.0
        rows = m - len(i) + np.arange(len(i))
        slopes[:, rows, i] += path[:, j]
        slopes[:, rows, j] += path[:, i]
        step = np.eye(n) + np.swapaxes(slopes, 1, 2) @ theta
        features = self._features(path[:-1], self._u)
        S = np.zeros((len(path), n, len(parameters)))
        S[0, :, :n] = np.eye(n)
        for k in range(len(path) - 1):
            S[k + 1] = step[k].T @ S[k]
            for c in range(n):
                S[k + 1, c, n + c : n + m * n : n] += features[k]
        slope_y = np.einsum("qp,tqv->tpv", C[-n:], S[:-1])
        outputs = self._outputs(path[:-1], self._u)
        for c in range(p):
            slope_y[:, c, n + m * n + c :: p] += outputs
        prior = np.zeros((m * n, len(parameters)))
        prior[:, n : n + m * n] = np.eye(m * n) / self._prior
        parts = (
            S.reshape(-1, len(parameters)) / self._weight_x,
            slope_y.reshape(-1, len(parameters)) / self._weight_y,
        )
        jacobian = np.concatenate([*parts, prior])
        if not np.isfinite(jacobian).all():
            raise Overflow
        return jacobian
