"""What a window of the model-based estimator weighs: the prior, the outputs' noise, the
disturbance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ddmhe._core import DdmheError
from ddmhe.baselines.linear_model import LinearModel
from ddmhe.baselines.tol import SETTLED

Array = NDArray[np.float64]

__all__ = ["PaperWeights", "RecordedWeights", "root"]


@dataclass(frozen=True, eq=False)
class PaperWeights:
    """2ρ^m ‖x̂(0) - x̄‖² + Σ_j ρ^{j-1} μ ‖v̂(t-j)‖² (17), and unit ‖ŵ‖²_{Q⁻¹} beside it."""

    rho: float
    mu: float
    unit: float
    """Cost of one ‖ŵ‖²_{Q⁻¹} = 1: μ σ_v², what a fitted noise of its own deviation costs."""

    def prior_root(self, m: int, n: int, P: Array | None) -> Array:
        """L (n, n): x̂(0) = x̄ + L s costs ‖s‖²."""
        return np.asarray(np.eye(n) / np.sqrt(2 * self.rho**m))

    def whitening(self, seen: NDArray[np.bool_]) -> Array:
        """(k, k) by which the k fitted noises that were seen (m, p) cost a sum of squares."""
        m, p = seen.shape
        weight = np.repeat(self.mu * self.rho ** np.arange(m - 1, -1, -1.0), p)
        return np.diag(np.sqrt(weight[seen.ravel()]))

    def first(self) -> Array | None:
        """No covariance goes along."""
        return None

    def following(self, P: Array | None, seen: NDArray[np.bool_]) -> Array | None:
        """No covariance goes along."""
        return None


class RecordedWeights:
    """‖x̂(0) - x̄‖²_{P⁻¹} + Σ ‖v̂‖²_{R⁻¹} + Σ ‖ŵ‖²_{Q⁻¹} (ρ = 1): with P(t) of the Riccati equation
    a Kalman filter's window. P starts at the equation's fixed point."""

    unit = 1.0

    def __init__(self, model: LinearModel, Q: Array, R: Array) -> None:
        """Q (n, n) and R (p, p); DdmheError where R is singular or no P is stationary."""
        self.model, self.Q, self.R = model, Q, R
        try:
            np.linalg.cholesky(R)
        except np.linalg.LinAlgError:
            raise DdmheError(
                "weights: expected output noise with a positive definite covariance for "
                "'recorded', found a singular one"
            ) from None
        self.P = _stationary(model, Q, R)
        self._P_root = root(self.P)

    def prior_root(self, m: int, n: int, P: Array | None) -> Array:
        """L (n, n): x̂(0) = x̄ + L s costs ‖s‖²; P is None where it is stationary."""
        return self._P_root if P is None else root(P)

    def whitening(self, seen: NDArray[np.bool_]) -> Array:
        """(k, k) by which the k fitted noises that were seen (m, p) cost a sum of squares."""
        blocks = []
        for row in seen:
            lower = np.linalg.cholesky(self.R[np.ix_(row, row)])
            blocks.append(np.linalg.inv(lower))
        return np.asarray(scipy.linalg.block_diag(*blocks)).reshape(seen.sum(), seen.sum())

    def first(self) -> Array | None:
        """P at the start: the stationary one."""
        return None

    def following(self, P: Array | None, seen: NDArray[np.bool_]) -> Array | None:
        """P(t) from P(t-1) and which of y(t-1) (p,) were seen; None while it is stationary."""
        if P is None and seen.all():
            return None
        A, before = self.model.A, self.P if P is None else P
        C, R = self.model.C[seen], self.R[np.ix_(seen, seen)]
        gain = scipy.linalg.solve(C @ before @ C.T + R, C @ before, assume_a="pos").T
        rest = np.eye(len(A)) - gain @ C
        after = A @ (rest @ before @ rest.T + gain @ R @ gain.T) @ A.T + self.Q
        settled = np.abs(after - self.P).max() <= SETTLED * np.abs(self.P).max()
        return None if settled and seen.all() else np.asarray(0.5 * (after + after.T))


def root(S: Array) -> Array:
    """L with L Lᵀ = S, symmetric and positive semidefinite (what is negative or rounding is cut: no
    direction of a deviation that is none)."""
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    rounding = len(S) * np.finfo(float).eps * values[-1]
    return np.asarray(vectors * np.sqrt(np.where(values > rounding, values, 0.0)))


def _stationary(model: LinearModel, Q: Array, R: Array) -> Array:
    """P = A(P - PCᵀ(CPCᵀ + R)⁻¹CP)Aᵀ + Q."""
    scale = float(max(np.trace(Q), np.trace(R)))
    try:
        P = scipy.linalg.solve_discrete_are(model.A.T, model.C.T, Q / scale, R / scale)
    except (np.linalg.LinAlgError, ValueError):
        P = np.full_like(Q, np.nan)
    if not np.isfinite(P).all():
        raise DdmheError(
            "process_noise: expected one with a stationary error covariance for this model, found "
            "none: the outputs do not show, or the disturbance does not reach, every mode that "
            "does not decay"
        )
    return np.asarray(scale * 0.5 * (P + P.T))
