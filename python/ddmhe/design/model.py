"""An affine model from a recording: the bridge from data to designs that need (A, C), and to
python-control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ddmhe._core import History, RankError, noise_levels
from ddmhe.checks import array, check_finite, check_history, check_whole, choice
from ddmhe.design.tol import EXACT_CHANNEL, PBH

if TYPE_CHECKING:
    from collections.abc import Callable

Array = NDArray[np.float64]
Method = Literal["least squares", "total least squares"]

__all__ = ["AffineModel", "identify", "is_observable", "samples"]

MOST_STEPS = 10_000_000
"""Simulated steps that fit into memory."""


@dataclass(frozen=True, eq=False)
class AffineModel:
    """x(k+1) = A x(k) + e + w(k), y(k) = C x(k) + r + v(k), with what the recording says of its
    accuracy."""

    A: Array
    """(n, n)"""
    e: Array
    """(n,)"""
    C: Array
    """(p, n)"""
    r: Array
    """(p,)"""
    dt: float
    """Sampling interval, s."""
    residual: Array
    """Covariance ((n+p), (n+p)) of [x(k+1) - A x(k) - e; y(k) - C x(k) - r], with the degrees of
    freedom taken off."""
    gram: Array
    """Σ_k [x(k); 1][x(k); 1]ᵀ (n+1, n+1)."""
    samples: int
    """Number of samples k behind it."""
    method: Method = "least squares"

    @property
    def covariance(self) -> Array:
        """Covariance of the least-squares estimate of [A e; C r], row after row: residual ⊗ gram⁻¹.

        Shape ((n+p)(n+1), (n+p)(n+1)). It holds for noise that enters as w and v; errors of the
        recorded states also bias the estimate towards zero, which no covariance shows."""
        return np.kron(self.residual, np.linalg.pinv(self.gram, hermitian=True))

    @property
    def standard_errors(self) -> tuple[Array, Array]:
        """Standard errors of the entries of A (n, n) and of C (p, n)."""
        n, p = len(self.e), len(self.r)
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).reshape(n + p, n + 1)[:, :n]
        return deviation[:n], deviation[n:]

    @property
    def observable(self) -> bool:
        """Whether (A, C) is observable; see `is_observable`."""
        return is_observable(self.A, self.C)

    def simulate(self, x_0: Array, steps: int) -> tuple[Array, Array]:
        """States (steps+1, n) and outputs (steps, p) from x_0 (n,), without noise."""
        check_whole("steps", steps, 0, MOST_STEPS)
        x = np.empty((steps + 1, len(self.e)))
        x[0] = array("x_0", x_0, (len(self.e),))
        check_finite("x_0", x[0])
        for k in range(steps):
            x[k + 1] = self.A @ x[k] + self.e
        return x, x[:-1] @ self.C.T + self.r

    def to_control(self) -> Any:
        """The model as a discrete `control.StateSpace` (python-control, `pip install control`).

        A StateSpace has no offsets: here they are the effect of one input that is constantly 1, so
        B = e and D = r."""
        try:
            import control
        except ImportError:
            raise ImportError(
                "to_control: expected the package control, found none (pip install control)"
            ) from None
        return control.ss(self.A, self.e[:, None], self.C, self.r[:, None], self.dt)


def identify(history: History, method: Method = "least squares") -> AffineModel:
    """Fit x(k+1) = A x(k) + e, y(k) = C x(k) + r to a recording.

    Parameters
    ----------
    history : History
        One or several recordings; no sample pair crosses a seam.
    method : "least squares" or "total least squares"
        Least squares takes the recorded x(k) as exact, right for noise that drives the system or
        sits on y. Total least squares also allows errors of x(k): each channel is scaled by its
        noise (from fifth differences) first.

    Raises
    ------
    RankError
        Fewer than n + 1 samples, or states that do not span n directions about their mean: A would
        not be unique.
    DdmheError
        An unknown method.
    """
    check_history(history)
    choice("method", method, _METHODS)
    n = history.n
    regressor, target = samples(history)
    mean_x, mean_z = regressor.mean(0), target.mean(0)
    X, Z = regressor - mean_x, target - mean_z
    needed = n + 1 if method == "least squares" else 2 * n + history.p + 1
    if len(X) < needed:
        raise RankError(f"history: expected at least {needed} outputs for {method}, found {len(X)}")
    _check_span(X, np.abs(regressor).max(axis=0))
    theta = _METHODS[method](X, Z, history)  # (n, n+p): Z ≈ X theta
    offset = mean_z - mean_x @ theta
    freedom = len(X) - n - 1
    residual = Z - X @ theta
    covariance = (
        residual.T @ residual / freedom if freedom > 0 else np.zeros((Z.shape[1], Z.shape[1]))
    )
    extended = np.column_stack([regressor, np.ones(len(regressor))])
    return AffineModel(
        A=theta[:, :n].T.copy(),
        e=offset[:n],
        C=theta[:, n:].T.copy(),
        r=offset[n:],
        dt=history.dt,
        residual=covariance,
        gram=extended.T @ extended,
        samples=len(X),
        method=method,
    )


def samples(history: History) -> tuple[Array, Array]:
    """Regressors x(k) (K, n) and targets [x(k+1), y(k)] (K, n+p) of all recordings."""
    parts = [(x[:-1], np.hstack([x[1:], y])) for x, y in history.recordings]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def is_observable(A: Array, C: Array) -> bool:
    """Popov-Belevitch-Hautus test: [λI - A; C] has rank n at every eigenvalue λ of A.

    A is balanced by a diagonal scaling of the states and the rows of C are brought to one size, so
    that units do not decide."""
    return len(unobservable_modes(A, C)) == 0


def unobservable_modes(A: Array, C: Array) -> NDArray[np.complex128]:
    """Eigenvalues of A at which [λI - A; C] loses rank (relative tolerance PBH)."""
    n = len(A)
    balanced, (units, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    A, C = np.asarray(balanced), C * units
    rows: Array = np.asarray(np.linalg.norm(C, axis=1, keepdims=True))
    scale = max(float(np.linalg.norm(A, 2)), 1.0)
    C = np.asarray(C / np.where(rows > 0, rows, 1.0) * scale, dtype=np.float64)
    values = np.linalg.eigvals(A)
    lost = [
        np.linalg.svd(np.vstack([z * np.eye(n) - A, C]), compute_uv=False)[-1] <= PBH * scale
        for z in values
    ]
    return np.asarray(values[np.array(lost, dtype=bool)], dtype=np.complex128)


def _check_span(X: Array, magnitude: Array) -> None:
    """RankError unless the centred states (K, n) span n directions above rounding."""
    scale = np.where(magnitude > 0, magnitude, 1.0)
    sigma = np.linalg.svd(X / scale, compute_uv=False)
    floor = np.finfo(float).eps * len(X) ** 0.5 * max(float(sigma[0]), 1.0)
    rank = int(np.sum(sigma > floor)) if len(sigma) else 0
    if rank < X.shape[1]:
        raise RankError(
            f"history: expected states that span n = {X.shape[1]} directions about their mean, "
            f"found {rank}: some combination of the states never changes"
        )


def _least_squares(X: Array, Z: Array, history: History) -> Array:
    scale = np.linalg.norm(X, axis=0)
    solution = np.linalg.lstsq(X / scale, Z, rcond=None)[0]
    return np.asarray(solution / scale[:, None])


def _total_least_squares(X: Array, Z: Array, history: History) -> Array:
    """From the null space of the scaled, centred [X Z]; centring has taken care of the exact ones
    column."""
    n = X.shape[1]
    noise_x, noise_y = noise_levels(history)
    noise = np.concatenate([noise_x, noise_x, noise_y])
    both = np.hstack([X, Z])
    spread = both.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    scale = np.maximum(noise, EXACT_CHANNEL * spread)
    V = np.linalg.svd(both / scale, full_matrices=True)[2].T
    V12, V22 = V[:n, n:], V[n:, n:]
    theta = -np.linalg.lstsq(V22.T, V12.T, rcond=None)[0].T
    return np.asarray(scale[:n, None] ** -1 * theta * scale[None, n:])


_METHODS: dict[str, Callable[[Array, Array, History], Array]] = {
    "least squares": _least_squares,
    "total least squares": _total_least_squares,
}
