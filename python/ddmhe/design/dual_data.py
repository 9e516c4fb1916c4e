"""Dual data (45) of Algorithm 2: pseudo-inverses of recorded differences (46), and the rank."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import History, RankError
from ddmhe.design.arguments import recording_or_system
from ddmhe.design.model import AffineModel, identify
from ddmhe.design.tol import (
    EPS,
    FULL_ROW_RANK,
    MARGIN_ROUNDING,
)

Array = NDArray[np.float64]

__all__ = ["DualData", "source"]


@dataclass(frozen=True, eq=False)
class DualData:
    """X0dl (n, K), U0dl (p, K), X1dl (n, K) of (45), with K reduced to the row space that they
    span."""

    X0: Array
    U0: Array
    X1: Array
    singular_values: Array
    rank: int
    arbitrary: bool = False
    """Whether the rows are independent: then the programme is solved by A_L = 0, L = 0."""


def source(
    history: History | None, A: ArrayLike | None, C: ArrayLike | None
) -> tuple[DualData, AffineModel]:
    """Dual data and the model of a recording, or of a given (A, C): n + p experiments tell it."""
    given = recording_or_system(history, A, C)
    if isinstance(given, History):
        return _dual_data(given), identify(given)
    A_, C_ = given
    n, p = len(A_), len(C_)
    # n + p experiments on the dual system x⁺ = Aᵀx + Cᵀu, one from each unit vector of (x, u), tell
    # all of it.
    both = np.vstack([A_, C_])
    data = DualData(
        np.eye(n, n + p),
        np.eye(p, n + p, n),
        both.T,
        np.asarray(np.linalg.svd(both, compute_uv=False)),
        n + p,
    )
    model = AffineModel(
        A_,
        np.zeros(n),
        C_,
        np.zeros(p),
        1.0,
        np.zeros((n + p, n + p)),
        np.eye(n + 1),
        0,
        "least squares",
    )
    return data, model


def _dual_data(history: History) -> DualData:
    """(45) from the differences (46); samples are columns, no difference crosses a seam."""
    n, p = history.n, history.p
    parts = [(np.diff(x, axis=0), np.diff(y, axis=0)) for x, y in history.recordings if len(y) > 1]
    columns = sum(len(dy) for _, dy in parts)
    if columns < n + p:
        raise RankError(
            f"history: expected at least n + p + 1 = {n + p + 1} outputs, found {columns + 1}"
        )
    X0 = np.concatenate([dx[: len(dy)] for dx, dy in parts]).T
    X1 = np.concatenate([dx[1 : len(dy) + 1] for dx, dy in parts]).T
    Y0 = np.concatenate([dy for _, dy in parts]).T
    both = np.vstack([X1, Y0])
    # Channels are brought to one size before the rank is judged: units must not decide it.
    size = np.sqrt(np.mean(both**2, axis=1, keepdims=True))
    size = np.where(size > 0, size, 1.0)
    U, sigma, Vt = np.linalg.svd(both / size, full_matrices=False)
    rank = int(
        np.sum(sigma > max(_rounding(history, size, columns), max(both.shape) * EPS * sigma[0]))
    )
    # The pseudo-inverse of the unscaled data on the directions that are kept.
    inverse = np.linalg.pinv(size * (U[:, :rank] * sigma[:rank])) if rank else np.zeros((0, n + p))
    dual = (Vt[:rank].T @ inverse).T  # (n+p) x K, [X0dl; U0dl] = [X1ᵀ Y0ᵀ]†
    X1dl = np.linalg.pinv(X0.T)
    # X (K x n) enters through X0dl X, U0dl X, X1dl X only: its part outside of their row space is
    # idle.
    stack = np.vstack([dual, X1dl])
    scale = np.linalg.norm(stack, axis=1, keepdims=True)
    _, values, rows = np.linalg.svd(stack / np.where(scale > 0, scale, 1.0), full_matrices=False)
    basis = rows[values > FULL_ROW_RANK * values[0]].T
    reduced = stack @ basis
    return DualData(
        reduced[:n], reduced[n : n + p], reduced[n + p :], sigma, rank, basis.shape[1] == 2 * n + p
    )


def _rounding(history: History, size: Array, columns: int) -> float:
    """Singular values of [X1; Y0]/size below this may be rounding.

    A sample is off by eps times its channel's largest, a difference of two by twice that, and
    singular values move by no more than the Frobenius norm. The margin is for outputs that were
    computed in several operations."""
    largest = [
        np.concatenate([np.abs(r[k]) for r in history.recordings]).max(axis=0) for k in (0, 1)
    ]
    error = 2 * EPS * np.concatenate(largest) / size[:, 0]
    return MARGIN_ROUNDING * math.sqrt(columns * float(error @ error))
