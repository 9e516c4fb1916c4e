"""A quadratic stand-in for the recorded system: motions on which settings can be rehearsed beyond the recording.

    z(k+1) = z(k) + Θᵀ[1; z(k); z(k) ⊗ z(k)],   y(k) = Cᵀ[1; z(k)]

with z the state relative to a known rest (then without the ones: the rest stays one) or to the recording's mean.
Rigid bodies turn like this (Euler's equations are quadratic), and any smooth motion does to second order. The
parameters minimise the simulation error of the whole recording, in units of its noise, with a weak prior; other
parameters that fit as well are drawn from the Gauss-Newton covariance. It serves to choose settings, never to
estimate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ddmhe._core import History
from ddmhe.design.model import noise_levels

Array = NDArray[np.float64]

__all__ = ["Surrogate"]

FLOOR = 1e-5
"""Noise below this share of the states' size counts as this much: a surrogate is no exact model."""
PRIOR = 3.0
"""Standard deviation of every parameter of the motion, in units of the recorded rms step."""
REACH = 3.0
"""A drawn motion that leaves this many times the recorded range is given up."""
ROUNDING = 1e-15
"""Curvature below this share of the largest is not resolved."""


class Surrogate:
    """The quadratic model of one recording x (T+1, n), y (T, p)."""

    def __init__(self, x: Array, y: Array, rest: tuple[Array, Array] | None = None) -> None:
        """Fit; `rest` is (x_e, y_e)."""
        self._rest = rest is not None
        self._n, self._p = x.shape[1], y.shape[1]
        self._x_0: Array = x.mean(axis=0) if rest is None else rest[0]
        self._y_0: Array = y.mean(axis=0) if rest is None else rest[1]
        self._size_x = float(np.sqrt(np.mean((x - self._x_0) ** 2)))
        self._size_y = float(np.sqrt(np.mean((y - self._y_0) ** 2))) or 1.0
        self._pairs = np.triu_indices(self._n)
        self.noise_x, self.noise_y = (float(np.sqrt(np.mean(noise**2))) for noise in noise_levels(History(x, y)))
        """Standard deviations of the recording's noise, pooled over channels."""
        self._z, self._u = (x - self._x_0) / self._size_x, (y - self._y_0) / self._size_y
        self._reach = REACH * float(np.linalg.norm(self._z, axis=1).max())
        self._fit()

    def motion(self, rng: np.random.Generator | None, steps: int) -> tuple[Array, Array]:
        """States (N+1, n) and outputs (N, p) from the recording's start, without noise.

        N = steps unless the motion goes astray. With `rng` for parameters drawn from those that fit, without for the
        best ones.
        """
        parameters = self._best
        if rng is not None:
            parameters = parameters + self._spread @ rng.standard_normal(len(parameters))
        z, theta, C = self._split(parameters[None])
        states = [z[0]]
        for _ in range(steps):
            z = self._next(z, theta)
            if not np.linalg.norm(z) < self._reach:
                break
            states.append(z[0])
        path = np.array(states)
        return path * self._size_x + self._x_0, self._outputs(path[:-1]) @ C[0] * self._size_y + self._y_0

    def _features(self, z: Array) -> Array:
        """([1], z, products of z) along the last axis."""
        return np.concatenate([self._outputs(z), z[..., self._pairs[0]] * z[..., self._pairs[1]]], axis=-1)

    def _next(self, z: Array, theta: Array) -> Array:
        """z(k+1) (B, n) from z(k) with Θ (B, m, n)."""
        return np.asarray(z + np.einsum("bm,bmn->bn", self._features(z), theta))

    def _outputs(self, z: Array) -> Array:
        """([1], z) along the last axis."""
        return z if self._rest else np.concatenate([np.ones((*z.shape[:-1], 1)), z], axis=-1)

    def _split(self, parameters: Array) -> tuple[Array, Array, Array]:
        """z(0) (B, n), Θ (B, m, n), C (B, q, p) of B parameter vectors."""
        n, m = self._n, self._count
        theta = parameters[:, n : n + m * n].reshape(-1, m, n)
        return parameters[:, :n], theta, parameters[:, n + m * n :].reshape(len(parameters), -1, self._p)

    def _fit(self) -> None:
        self._count = self._features(self._z[:1]).shape[1]
        self._weight_x = max(self.noise_x / self._size_x, FLOOR)
        self._weight_y = max(self.noise_y / self._size_y, FLOOR)
        start = self._start()

        def residuals(parameters: Array) -> Array:
            return np.asarray(self._residuals(parameters[None])[0])

        with np.errstate(over="ignore", invalid="ignore"):
            solution = least_squares(residuals, start, self._jacobian, x_scale="jac", max_nfev=40)
        self._best = np.asarray(solution.x, dtype=np.float64)
        self.misfit = float(2 * solution.cost / len(solution.fun))
        """Mean squared residual in units of the noise: near 1 for a recording that the model explains."""
        slope = self._jacobian(self._best)
        curvature, directions = np.linalg.eigh(slope.T @ slope)
        floor = max(float(curvature[-1]), 1e-300) * ROUNDING
        self._spread = directions / np.sqrt(np.maximum(curvature, floor)) * np.sqrt(max(self.misfit, 1.0))

    def _start(self) -> Array:
        """Ridge regression of (smoothed) steps on states."""
        z, u = self._z, self._u
        width = 5 if self._weight_x > 10 * FLOOR and len(z) > 10 else 1
        smooth = np.apply_along_axis(np.convolve, 0, z, np.full(width, 1 / width), "valid")
        steps = np.diff(smooth, axis=0)
        rms = float(np.sqrt(np.mean(steps**2)))
        self._prior = PRIOR * rms + 1e-12
        F = self._features(smooth[:-1])
        ridge = (self._weight_x**2 + 1e-3 * rms**2) / self._prior**2
        theta = np.linalg.solve(F.T @ F + ridge * np.eye(self._count), F.T @ steps)
        C = np.linalg.lstsq(self._outputs(z[:-1]), u, rcond=None)[0]
        return np.concatenate([z[0], theta.ravel(), C.ravel()])

    def _residuals(self, parameters: Array) -> Array:
        """Of B parameter vectors at once: simulation errors of x and y in units of the noise, and the prior."""
        z, theta, C = self._split(parameters)
        path = np.empty((len(parameters), len(self._z), self._n))
        path[:, 0] = z
        for k in range(1, len(self._z)):
            # a trial step of the optimiser must stay finite
            z = np.clip(self._next(z, theta), -10 * self._reach, 10 * self._reach)
            path[:, k] = z
        u = np.einsum("btq,bqp->btp", self._outputs(path[:, :-1]), C)
        parts = ((path - self._z) / self._weight_x, (u - self._u) / self._weight_y, theta / self._prior)
        return np.concatenate([part.reshape(len(parameters), -1) for part in parts], axis=1)

    def _jacobian(self, parameters: Array) -> Array:
        """Central differences, all parameters in one simulation."""
        size = np.full(len(parameters), 1e-2)
        size[self._n : self._n + self._count * self._n] *= self._prior
        h = 1e-6 * np.maximum(np.abs(parameters), size)
        both = self._residuals(np.concatenate([parameters + np.diag(h), parameters - np.diag(h)]))
        return np.asarray(((both[: len(h)] - both[len(h) :]) / (2 * h[:, None])).T)
