"""The penalised problem of soft bounds written down over the windows of a recording, for Clarabel.

Used only by tests. Nothing here shares code or formulation with the package: violations are
variables of their own, and no active set is looked for."""

import warnings
from dataclasses import dataclass

import cvxpy as cp
import numpy as np

from reference import hankel

SHARP = {"tol_gap_abs": 1e-13, "tol_gap_rel": 1e-13, "tol_feas": 1e-13, "max_iter": 200}


@dataclass(frozen=True)
class Window:
    """One window's data: outputs (M, p), NaN where not measured; the prior (n,)."""

    y: np.ndarray
    prior: np.ndarray


@dataclass(frozen=True)
class Problem:
    """Cost (17) with weights of the squares of a state and of an output, all in the user's units; a
    weight on the squares of alpha; bounds and prices, None: hard."""

    x: np.ndarray  # (T+1, n)
    y: np.ndarray  # (T, p)
    rho: float
    of_x: np.ndarray  # (n,)
    of_y: np.ndarray  # (p,)
    unit: float  # of the cost, in which prices are
    prices: tuple  # of x, of v
    ridge: float = 0.0
    deviations: tuple | None = None  # of x and y, where they are not these recordings'

    def basis(self, M):
        """Mean window, directions (rows, k), states first, and sigma; alpha = 1/N + V b / sigma."""
        stack = np.vstack([hankel(self.x, M + 1), hankel(self.y, M)])
        mean = stack.mean(1)
        size = np.concatenate([np.tile(self.x.std(0), M + 1), np.tile(self.y.std(0), M)])
        U, sigma, _ = np.linalg.svd((stack - mean[:, None]) / size[:, None], full_matrices=False)
        k = (sigma > 1e-10 * sigma[0]).sum()
        return mean, size[:, None] * U[:, :k], sigma[:k]

    def minimiser(self, window, x_bounds=None, v_bounds=None):
        """States (M+1, n) and cost of the minimiser, without the weight on alpha; bounds broadcast
        to (M+1, n) and (M, p)."""
        (M, p), n = window.y.shape, self.x.shape[1]
        mean, B, sigma = self.basis(M)
        b = cp.Variable(B.shape[1])
        x = mean[: (M + 1) * n] + B[: (M + 1) * n] @ b
        known = np.flatnonzero(np.isfinite(window.y.ravel()))
        v = window.y.ravel()[known] - mean[(M + 1) * n :][known] - B[(M + 1) * n :][known] @ b
        age = np.repeat(self.rho ** np.arange(M - 1, -1, -1.0), p) * np.tile(self.of_y, M)
        seen = cp.multiply(np.sqrt(2 * self.rho**M * self.of_x), x[:n] - window.prior)
        cost = cp.sum_squares(seen)
        if len(known):
            cost += cp.sum_squares(cp.multiply(np.sqrt(age[known]), v))
        limits = []
        own = self.deviations or (self.x.std(0), self.y.std(0))
        sides = (
            (x, x_bounds, own[0], self.prices[0], np.arange((M + 1) * n)),
            (v, v_bounds, own[1], self.prices[1], known),
        )
        for rows, bounds, deviation, price, kept in sides:
            if bounds is None or not len(kept):
                continue
            size = (M + 1 if rows is x else M, len(deviation))
            lo, hi, unit = (
                np.broadcast_to(value, size).ravel()[kept] for value in (*bounds, deviation)
            )
            e = np.zeros(len(kept))
            if price is not None:
                e = cp.Variable(len(kept), nonneg=True)
                cost += self.unit * price * (cp.sum(e) + cp.sum_squares(e))
            below, above = np.isfinite(lo), np.isfinite(hi)
            limits += [(rows + cp.multiply(unit, e))[below] >= lo[below]]
            limits += [(rows - cp.multiply(unit, e))[above] <= hi[above]]
        problem = cp.Problem(cp.Minimize(cost + self.ridge * cp.sum_squares(b / sigma)), limits)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that it stops short of so sharp an end
            problem.solve(solver=cp.CLARABEL, **SHARP)
        assert problem.status in ("optimal", "optimal_inaccurate")
        states = (mean[: (M + 1) * n] + B[: (M + 1) * n] @ b.value).reshape(M + 1, n)
        return states, float(cost.value)
