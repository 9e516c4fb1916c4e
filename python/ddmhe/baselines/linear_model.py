"""The linear model behind the filters: identified from a recording, with its inputs, or given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdmheError, History, RankError, ShapeError
from ddmhe.checks import array, check_finite, shown
from ddmhe.design.model import identify, samples, slopes

Array = NDArray[np.float64]

__all__ = ["LinearModel", "given", "identified"]


@dataclass(frozen=True, eq=False)
class LinearModel:
    """x(k+1) = A x(k) + B u(k) + e + w(k), y(k) = C x(k) + D u(k) + r + v(k)."""

    A: Array
    """(n, n)"""
    B: Array
    """(n, m); m = 0 without inputs"""
    e: Array
    """(n,)"""
    C: Array
    """(p, n)"""
    D: Array
    """(p, m)"""
    r: Array
    """(p,)"""
    residual: Array | None = None
    """Covariance (n+p, n+p) of [w; v], if known."""


def identified(history: History, *, affine: bool = True) -> LinearModel:
    """The least-squares model of a recording; without `affine` e and r are 0.

    An estimator has to run on whatever was recorded: unlike `design.identify` this takes inputs
    that never change, or move together, and gives them the smallest of their possible effects.
    RankError as `design.identify` without inputs, or for fewer samples than unknowns of a row."""
    n = history.n
    before, after = samples(history)
    if not affine:
        theta: Array = np.linalg.lstsq(before, after, rcond=None)[0].T.astype(np.float64)
        return _of_rows(theta, np.zeros(after.shape[1]), n, None)
    if not history.m:
        model = identify(history)
        none = np.zeros((n, 0)), np.zeros((history.p, 0))
        return LinearModel(model.A, none[0], model.e, model.C, none[1], model.r, model.residual)
    unknowns = before.shape[1] + 1
    if len(before) < unknowns:
        raise RankError(
            f"history: expected at least {unknowns} outputs for least squares, found {len(before)}"
        )
    mean, target = before.mean(axis=0), after.mean(axis=0)
    theta = slopes(before - mean, after - target).T
    errors = after - target - (before - mean) @ theta.T
    residual = errors.T @ errors / max(len(before) - unknowns, 1)
    return _of_rows(theta, target - theta @ mean, n, residual)


def _of_rows(theta: Array, offset: Array, n: int, residual: Array | None) -> LinearModel:
    """From [[A, B], [C, D]] and [e; r]."""
    return LinearModel(
        A=theta[:n, :n],
        B=theta[:n, n:],
        e=offset[:n],
        C=theta[n:, :n],
        D=theta[n:, n:],
        r=offset[n:],
        residual=residual,
    )


def given(model: Any) -> LinearModel:
    """A checked copy of any object with .A .e .C .r and, if it has them, .B .D .residual."""
    lacking = [name for name in "AeCr" if not hasattr(model, name)]
    if lacking:
        raise DdmheError(
            "model: expected a History or an object with .A, .e, .C and .r, found "
            f"{shown(model)}, without .{lacking[0]}"
        )
    A = array("model.A", model.A, (-1, -1))
    n = len(A)
    if A.shape != (n, n) or n == 0:
        raise ShapeError(f"model.A: expected a square matrix, found shape {A.shape}")
    C = array("model.C", model.C, (-1, n))
    p = len(C)
    B = np.zeros((n, 0)) if _none(model, "B") else array("model.B", model.B, (n, -1))
    m = B.shape[1]
    D = np.zeros((p, m)) if _none(model, "D") else array("model.D", model.D, (p, m))
    residual = None
    if not _none(model, "residual"):
        residual = array("model.residual", model.residual, (n + p, n + p))
        check_finite("model.residual", residual)
    e, r = array("model.e", model.e, (n,)), array("model.r", model.r, (p,))
    for name, matrix in zip("ABeCDr", (A, B, e, C, D, r), strict=True):
        check_finite(f"model.{name}", matrix)
    return LinearModel(A, B, e, C, D, r, residual)


def _none(model: Any, name: str) -> bool:
    return getattr(model, name, None) is None
