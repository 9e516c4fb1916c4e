"""One window of the model-based estimator: its motion as rows, its gains, its bounded minimum.

The window starts at x̂(0) = x̄ + L s and is driven by ŵ(j) = L_w d(b), one d for each block b of
instants. With z = [s; d], and x⁰, v⁰ its states and noise for z = 0,

    x̂ = x⁰ + S z,   v̂ = v⁰ - O z,   ŵ = W z,   cost ‖z‖² + ‖V v̂‖²."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ddmhe.baselines.least_distance import least_distance
from ddmhe.baselines.linear_model import LinearModel

Array = NDArray[np.float64]

__all__ = ["WindowFit", "WindowGains", "WindowMotion"]


class WindowMotion:
    """How x̄, the inputs, the offsets and the disturbance move a window of m outputs."""

    def __init__(self, model: LinearModel, m: int, noise_root: Array | None, block: int) -> None:
        """noise_root: L_Q (n, n) of the disturbance of one instant, or None for none."""
        n, q = model.B.shape
        self.m, self.n, self.p, self.q = m, n, len(model.r), q
        self.W = _disturbance(m, n, noise_root, block)  # (m n, n blocks)
        # columns: x̄ (n), constant (1), inputs (m q), disturbance
        columns = n + 1 + m * q + self.W.shape[1]
        x, y = np.zeros((m + 1, n, columns)), np.zeros((m, self.p, columns))
        x[0, :, :n] = np.eye(n)
        for k in range(m):
            now = slice(n + 1 + k * q, n + 1 + (k + 1) * q)
            y[k] = model.C @ x[k]
            y[k, :, n] += model.r
            y[k, :, now] += model.D
            x[k + 1] = model.A @ x[k]
            x[k + 1, :, n] += model.e
            x[k + 1, :, now] += model.B
            x[k + 1, :, n + 1 + m * q :] += self.W[k * n : (k + 1) * n]
        self.x, self.y = x.reshape(-1, columns), y.reshape(-1, columns)
        self.known = n + 1 + m * q

    def free(self, x_bar: Array, inputs: Array) -> tuple[Array, Array]:
        """States ((m+1) n,) and outputs (m p,) from x̄ (n,) with inputs (m, q), undisturbed."""
        given = np.concatenate([x_bar, [1.0], inputs.ravel()])
        return self.x[:, : self.known] @ given, self.y[:, : self.known] @ given


def _disturbance(m: int, n: int, noise_root: Array | None, block: int) -> Array:
    """ŵ (m n, n blocks) of d: over b instants constant with covariance Q/b, so that their sum has
    the covariance b Q of b single ones; the last block may be shorter."""
    if noise_root is None:
        return np.zeros((m * n, 0))
    lengths = [min(block, m - k) for k in range(0, m, block)]
    columns = [np.tile(noise_root / np.sqrt(b), (b, 1)) for b in lengths]
    return np.asarray(scipy.linalg.block_diag(*columns))


@dataclass(frozen=True, eq=False)
class WindowFit:
    """The minimiser of one window."""

    x: Array
    """((m+1) n,)"""
    v: Array
    """(m p,), NaN where not measured"""
    w: Array
    """(m n,)"""
    cost: float
    active: int
    status: str


class WindowGains:
    """The minimiser as a matrix, for a prior root L, outputs that were seen and their weights."""

    def __init__(
        self, motion: WindowMotion, L: Array, whitening: Array, seen: NDArray[np.bool_]
    ) -> None:
        """L (n, n); seen (m, p); whitening (k, k) for the k outputs seen."""
        self.motion, self.seen, self.whitening = motion, seen.ravel(), whitening
        n, known = motion.n, motion.known
        self.S = np.hstack([motion.x[:, :n] @ L, motion.x[:, known:]])
        self.O = np.hstack([motion.y[:, :n] @ L, motion.y[:, known:]])
        r = self.S.shape[1]
        self.W = np.hstack([np.zeros((len(motion.W), n)), motion.W])
        F = whitening @ self.O[self.seen]
        Q, self.R = np.linalg.qr(np.vstack([np.eye(r), F]))
        # (r, k): z = K v⁰
        self.K = scipy.linalg.solve_triangular(self.R, Q[r:].T @ whitening)
        self.S_K, self.O_K, self.W_K = self.S @ self.K, self.O @ self.K, self.W @ self.K
        self._boxed: Array | None = None

    def minimise(self, x: Array, y: Array, Y: Array, box: tuple[Array, Array] | None) -> WindowFit:
        """x, y: the free motion; Y (m p,) measured, NaN where not.

        box: lo and hi of [x̂; v̂; ŵ], a row each; None without any."""
        v = Y - y
        v_seen = v[self.seen]
        x_hat, w = x + self.S_K @ v_seen, self.W_K @ v_seen
        v_hat = v - self.O_K @ v_seen
        shift: Array | None = None
        active, status = 0, "optimal"
        if box is not None:
            at = np.concatenate([x_hat, v_hat, w])
            lo, hi = box
            if ((at < lo) | (at > hi)).any():  # False where v̂ is NaN
                found = least_distance(*self._rows(at, lo, hi))
                active, status = found.active, found.status
                shift = scipy.linalg.solve_triangular(self.R, found.t)
                x_hat, v_hat = x_hat + self.S @ shift, v_hat - self.O @ shift
                w = w + self.W @ shift
        z = self.K @ v_seen if shift is None else self.K @ v_seen + shift
        fitted = self.whitening @ v_hat[self.seen]
        return WindowFit(x_hat, v_hat, w, float(z @ z + fitted @ fitted), active, status)

    def _rows(self, at: Array, lo: Array, hi: Array) -> tuple[Array, Array, Array]:
        """The rows N of [x̂; v̂; ŵ] by t = R (z - z*), and what is left to their limits."""
        if self._boxed is None:
            moved = np.vstack([self.S, -self.O, self.W])
            self._boxed = np.asarray(scipy.linalg.solve_triangular(self.R.T, moved.T, lower=True).T)
        used = ~np.isnan(at) & (np.isfinite(lo) | np.isfinite(hi))
        return self._boxed[used], (lo - at)[used], (hi - at)[used]
