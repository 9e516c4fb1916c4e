"""Which part of a recording's one-step errors drives the system, and which is reading noise.

The residual covariance of the states is Γ = Q + N + A N Aᵀ: a disturbance Q, and noise N on the
recorded states, at k+1 and through A at k. One share θ splits Γ: Q = θΓ, N + A N Aᵀ = (1-θ)Γ,
and R = Γ_s - C N Cᵀ of the outputs' Γ_s. θ is the share under which the recording itself is most
likely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ddmhe._core import History
from ddmhe.baselines.linear_model import LinearModel
from ddmhe.baselines.tol import LEAST_NOISE, LEAST_SHARE

Array = NDArray[np.float64]
Part = tuple[Array, Array, Array]

__all__ = ["RecordedNoise", "log_likelihood", "recorded_noise"]

SHARES = tuple(10.0 ** np.arange(0.0, -6.1, -0.5))
"""θ that are tried."""


@dataclass(frozen=True, eq=False)
class RecordedNoise:
    """What a recording says of its noise; units of x² and y²."""

    share: float
    """θ."""
    Q: Array
    """Covariance (n, n) of the disturbance."""
    N: Array
    """Of the reading noise on the recorded states (n, n)."""
    R: Array
    """Of the outputs' noise (p, p), diagonal."""


def recorded_noise(history: History, model: LinearModel) -> RecordedNoise:
    """Q, N and R of the most likely share."""
    assert model.residual is not None
    n = len(model.A)
    x = np.concatenate([x for x, _ in history.recordings])
    y = np.concatenate([y for _, y in history.recordings])
    size = np.concatenate([x.std(axis=0), y.std(axis=0)])
    size = np.where(size > 0, size, 1.0)
    unit = LinearModel(
        A=model.A * size[:n] / size[:n, None],
        B=model.B / size[:n, None],
        e=model.e / size[:n],
        C=model.C * size[:n] / size[n:, None],
        D=model.D / size[n:, None],
        r=model.r / size[n:],
        residual=model.residual / np.outer(size, size),
    )
    parts = [
        (x / size[:n], y / size[n:], u)
        for (x, y), u in zip(history.recordings, history.inputs, strict=True)
    ]
    splits = [_split(unit, share) for share in SHARES]
    likely = [log_likelihood(unit, parts, *split) for split in splits]
    best = int(np.argmax(likely))
    Q, N, R = splits[best]
    of_x, of_y = np.outer(size[:n], size[:n]), np.outer(size[n:], size[n:])
    return RecordedNoise(float(SHARES[best]), Q * of_x, N * of_x, R * of_y)


def _split(unit: LinearModel, share: float) -> tuple[Array, Array, Array]:
    """Q, N and R of a share θ."""
    assert unit.residual is not None
    n, p = len(unit.A), len(unit.C)
    gamma, gamma_s = unit.residual[:n, :n], unit.residual[n:, n:]
    rest = ((1 - share) * gamma).ravel()
    both = np.eye(n * n) + np.kron(unit.A, unit.A)
    N = _positive(np.asarray(np.linalg.lstsq(both, rest, rcond=None)[0].reshape(n, n)))
    values, vectors = np.linalg.eigh(gamma_s + LEAST_NOISE * np.eye(p))
    root = vectors * np.sqrt(np.maximum(values, LEAST_NOISE))
    whitened = np.linalg.solve(root, np.linalg.solve(root, unit.C @ N @ unit.C.T).T)
    explained, along = np.linalg.eigh(0.5 * (whitened + whitened.T))
    left = root @ (along * np.maximum(1 - explained, LEAST_SHARE)) @ along.T @ root.T
    return share * gamma, N, np.diag(np.diag(left))


def _positive(S: NDArray[Any]) -> Array:
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T, dtype=np.float64)


def log_likelihood(unit: LinearModel, parts: list[Part], Q: Array, N: Array, R: Array) -> float:
    """Of recordings x (T+1, n), y (T, p), u (T, m), x read with noise N, less a constant.

    The first state is where the filter starts; the last one, which has no output, is left out."""
    n, p = len(unit.A), len(unit.C)
    floor = LEAST_NOISE * np.eye(n + p)
    H, S_0 = np.vstack([np.eye(n), unit.C]), scipy.linalg.block_diag(N, R) + floor
    total = 0.0
    for x, y, u in parts:
        state, P = x[0], N + floor[:n, :n]
        for k in range(len(y)):
            seen = slice(n if k == 0 else 0, None)
            rows = H[seen]
            readings = np.concatenate([x[k], y[k] - unit.D @ u[k] - unit.r])
            error = readings[seen] - rows @ state
            S = rows @ P @ rows.T + S_0[seen, seen]
            try:
                lower = np.linalg.cholesky(0.5 * (S + S.T))
            except np.linalg.LinAlgError:
                return -np.inf
            white = scipy.linalg.solve_triangular(lower, error, lower=True)
            total -= 0.5 * float(white @ white) + float(np.log(np.diag(lower)).sum())
            gain = scipy.linalg.cho_solve((lower, True), rows @ P).T
            rest = np.eye(n) - gain @ rows
            state = unit.A @ (state + gain @ error) + unit.B @ u[k] + unit.e
            P = unit.A @ (rest @ P @ rest.T + gain @ S_0[seen, seen] @ gain.T) @ unit.A.T + Q
    return total
