"""A vector-ARX model of states and outputs together, by ridge regression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ddmhe.baselines.tol import ARX_COVARIANCE, ARX_RIDGE, NONZERO

Array = NDArray[np.float64]

__all__ = ["ArxModel", "fit_arx"]

STABLE = 0.999
"""Spectral radius that an identified model is given if its own is above one."""


@dataclass(frozen=True, eq=False)
class ArxModel:
    """z(k) = offset + lags [z(k-1); …; z(k-L)] + B [u(k-1); …; u(k-L)] + [0; D u(k)] + ε(k), where
    z = [x; y]."""

    bic: float
    """Schwarz's criterion: the smaller the better."""
    order: int
    """L"""
    offset: Array
    """(q,), q = n + p"""
    lags: Array
    """(q, q L)"""
    noise: Array
    """Covariance of ε (q, q)."""
    B: Array
    """(q, m L); m = 0 without inputs"""
    D: Array
    """(p, m)"""


def fit_arx(parts: list[Array], inputs: list[Array], L: int, n: int) -> ArxModel:
    """The ARX model with L lags.

    parts, inputs : z (T_i, q) and u (T_i, m) of each recording; no window crosses from one to the
    next. The first n of z are states: they do not depend on u(k).
    """
    z, u = np.vstack(parts), np.vstack(inputs)
    q, m = z.shape[1], u.shape[1]
    mean, scale = z.mean(axis=0), z.std(axis=0) + NONZERO
    mean_u = u.mean(axis=0)
    scale_u = np.where(u.std(axis=0) > 0, u.std(axis=0), 1.0)
    scaled = [(part - mean) / scale for part in parts if len(part) > L]
    past = np.vstack([_lagged(s, L) for s in scaled])
    now = np.vstack([s[L:] for s in scaled])
    if m:
        forced = [(part - mean_u) / scale_u for part in inputs if len(part) > L]
        past = np.hstack([past, np.vstack([_lagged(s, L) for s in forced])])
    theta = _ridge(past, now)
    direct = np.zeros((m, q - n))
    if m:
        both = np.hstack([past, np.vstack([s[L:] for s in forced])])
        theta_y = _ridge(both, now[:, n:])
        theta[:, n:], direct = theta_y[:-m], theta_y[-m:]
    shrink = _contraction(theta[: q * L], L) ** np.arange(1, L + 1)
    theta *= np.concatenate([np.repeat(shrink, q), np.repeat(shrink, m)])[:, None]
    residual = now - past @ theta
    if m:
        residual[:, n:] -= both[:, -m:] @ direct
    free = max(len(past) - past.shape[1] - 1, 1)
    covariance = residual.T @ residual / free + ARX_COVARIANCE * np.eye(q)
    bic = (
        len(past)
        * np.linalg.slogdet(residual.T @ residual / len(past) + ARX_COVARIANCE * np.eye(q))[1]
    )
    bic += q * (past.shape[1] + 1) * np.log(len(past))
    lags = (scale[:, None] * theta[: q * L].T) / np.tile(scale, L)
    offset = mean - lags @ np.tile(mean, L)
    B = (scale[:, None] * theta[q * L :].T) / np.tile(scale_u, L)
    D = (scale[n:, None] * direct.T) / scale_u
    if m:
        offset -= B @ np.tile(mean_u, L)
        offset[n:] -= D @ mean_u
    return ArxModel(float(bic), L, offset, lags, covariance * np.outer(scale, scale), B, D)


def _lagged(s: Array, L: int) -> Array:
    """Rows [s(k-1), …, s(k-L)] for k = L, L+1, …"""
    return np.hstack([s[L - i - 1 : len(s) - i - 1] for i in range(L)])


def _ridge(past: Array, now: Array) -> Array:
    width = past.shape[1]
    return np.asarray(
        np.linalg.solve(past.T @ past + ARX_RIDGE * len(past) * np.eye(width), past.T @ now)
    )


def _contraction(theta: Array, L: int) -> float:
    """1 for a stable model; else the factor a sample that brings its poles into the circle of
    radius STABLE.

    Lag i times c^i multiplies every pole by c. Without it a state that no output shows, or a gap,
    lets errors explode."""
    m = theta.shape[1]
    companion = np.eye(m * L, k=-m)
    companion[:m] = theta.T
    radius = float(np.abs(np.linalg.eigvals(companion)).max())
    return STABLE / radius if radius > 1 else 1.0
