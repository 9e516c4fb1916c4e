"""Dual data (45) of Algorithm 2: pseudo-inverses of recorded differences (46), and the rank.

The algorithm is for x(k+1) = A x(k) + e, y(k) = C x(k) + r. With known inputs the differences obey

    X1 = A X0 + B ΔU,  Y0 = C X0 + D ΔU,

and as printed ΔU would pass for motion of A. So ΔU is taken off: with an orthonormal basis N (K,
K-m) of the kernel of ΔU,

    X1 N = A X0 N,  Y0 N = C X0 N,

the equations without inputs, exact on exact data, with neither B nor D nor a fit of them. X0 N has
rank n where [X0; ΔU] has rank n + m, and N leaves white noise white. The motion that u excited
stays in X0 N; the free motion x - x_f of an identified response has often died out. (45) depends on
X N through X N Nᵀ = X - (X ΔU†) ΔU alone, since (X N Nᵀ)† = N (X N)†."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import History, RankError
from ddmhe.design.arguments import recording_or_system
from ddmhe.design.model import AffineModel, given_model, identify, slopes
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
    return data, given_model(A_, C_)


def _dual_data(history: History) -> DualData:
    """(45) from the differences (46), free of the inputs; samples are columns."""
    n, p, m = history.n, history.p, history.m
    columns = sum(len(y) - 1 for _, y in history.recordings)
    if columns < n + p + m:  # inputs take m dimensions of them
        inputs = " + m" if m else ""
        raise RankError(
            f"history: expected at least n + p{inputs} + 1 = {n + p + m + 1} outputs, "
            f"found {columns + 1}"
        )
    X0, both, of_inputs = _differences(history)
    # Channels are brought to one size before the rank is judged: units must not decide it.
    size = np.sqrt(np.mean(both**2, axis=1, keepdims=True))
    size = np.where(size > 0, size, 1.0)
    U, sigma, Vt = np.linalg.svd(both / size, full_matrices=False)
    floor = _rounding(history, of_inputs, size, both.shape[1])
    rank = int(np.sum(sigma > max(floor, max(both.shape) * EPS * sigma[0])))
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


def _differences(history: History) -> tuple[Array, Array, Array]:
    """X0 (n, K), [X1; Y0] (n+p, K) of (46), none across a seam, with what the differences of the
    inputs explain taken off, and the slopes of [X1; Y0] on these (n+p, m)."""
    parts = [(np.diff(x, axis=0), np.diff(y, axis=0)) for x, y in history.recordings if len(y) > 1]
    X0 = np.concatenate([dx[: len(dy)] for dx, dy in parts]).T
    X1 = np.concatenate([dx[1 : len(dy) + 1] for dx, dy in parts]).T
    Y0 = np.concatenate([dy for _, dy in parts]).T
    both = np.vstack([X1, Y0])
    if not history.m:
        return X0, both, np.zeros((len(both), 0))
    dU = np.concatenate([np.diff(u, axis=0) for u in history.inputs if len(u) > 1])
    of_x, of_both = slopes(dU, X0.T), slopes(dU, both.T)
    return X0 - (dU @ of_x).T, both - (dU @ of_both).T, of_both.T


def _rounding(history: History, of_inputs: Array, size: Array, columns: int) -> float:
    """Singular values of [X1; Y0]/size below this may be rounding.

    A sample is off by eps times its channel's largest, a difference of two by twice that, and
    singular values move by no more than the Frobenius norm; what the differences of the inputs
    explain is off by theirs. The margin is for outputs that were computed in several operations."""
    signals = [*zip(*history.recordings, strict=True), *([history.inputs] if history.m else [])]
    largest = [np.abs(np.concatenate(signal)).max(axis=0) for signal in signals]
    own = np.concatenate(largest[:2])
    carried = (of_inputs * largest[2]) if history.m else of_inputs
    error = (2 * EPS * np.column_stack([own, carried]) / size).ravel()
    return MARGIN_ROUNDING * math.sqrt(columns * float(error @ error))
