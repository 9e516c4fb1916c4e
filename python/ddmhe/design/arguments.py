"""What the designs take: a recording or a known system (A, C), checked; and weights."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, ShapeError, numbers
from ddmhe.checks import array, check_finite, check_history, check_number

Array = NDArray[np.float64]

__all__ = ["check_finite", "check_number", "input_matrices", "recording_or_system", "system"]


def recording_or_system(
    history: History | None, A: ArrayLike | None, C: ArrayLike | None
) -> History | tuple[Array, Array]:
    """The recording, or A (n, n) and C (p, n); DdmheError unless exactly one of the two was
    given."""
    if (history is None) == (A is None and C is None):
        raise DdmheError("history: expected either a recording or A and C, found both or neither")
    if history is not None:
        return check_history(history)
    if A is None or C is None:
        raise DdmheError("A, C: expected both, found only one")
    return system(A, C)


def system(A: ArrayLike, C: ArrayLike) -> tuple[Array, Array]:
    """A (n, n) and C (p, n), checked."""
    A_, C_ = numbers("A", A), numbers("C", C)
    if A_.ndim != 2 or A_.shape[0] != A_.shape[1] or not A_.size:
        raise ShapeError(f"A: expected a square matrix, found shape {A_.shape}")
    if C_.ndim != 2 or C_.shape[1] != len(A_) or not C_.size:
        raise ShapeError(f"C: expected a matrix with {len(A_)} columns, found shape {C_.shape}")
    check_finite("A", A_)
    check_finite("C", C_)
    return A_, C_


def input_matrices(
    B: ArrayLike | None, D: ArrayLike | None, n: int, p: int
) -> tuple[Array, Array] | None:
    """B (n, m) and D (p, m), checked; None where neither was given."""
    if B is None and D is None:
        return None
    if B is None or D is None:
        raise DdmheError("B, D: expected both with A and C, or neither, found otherwise")
    B_ = array("B", B, (n, -1))
    D_ = array("D", D, (p, B_.shape[1]))
    check_finite("B", B_)
    check_finite("D", D_)
    return B_, D_
