"""Known inputs as `DdMhe` takes them: the same checks, the same words."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import NotFiniteError, ShapeError, numbers
from ddmhe.checks import channels

Array = NDArray[np.float64]

__all__ = ["inputs_now", "inputs_of_run"]


def inputs_now(u: ArrayLike | None, m: int) -> Array:
    """The inputs u(t-1) (m,), all of them finite; an empty array for an estimator without inputs.

    ShapeError for inputs that lack, are not asked for or are of another length, NotFiniteError for
    NaN, infinity and missing entries."""
    if u is None:
        if m:
            raise ShapeError(f"u: expected {m} numbers, the inputs at the instant of y, found none")
        return np.empty(0)
    if m == 0:
        raise ShapeError("u: expected none, for a recording without inputs")
    found = numbers("u", u)
    if found.ndim == 0 and m == 1:
        found = found[None]
    if found.shape != (m,):
        raise ShapeError(f"u: expected {m} numbers, found {_described(found)}")
    _check_finite("u", found[None])
    return found


def inputs_of_run(U: ArrayLike | None, samples: int, m: int) -> Array:
    """The inputs (N, m) of as many steps as there are samples of Y; errors as `inputs_now`."""
    if U is None:
        if m:
            raise ShapeError(
                f"U: expected {samples} samples of {m} inputs, as many as of Y, found none"
            )
        return np.empty((samples, 0))
    found = numbers("U", channels(U, m))
    if found.ndim != 2:
        raise ShapeError(f"U: expected a 2-D array (N, m), found {_described(found)}")
    if found.shape != (samples, m):
        expected = f"shape ({samples}, {m}), one row for each of Y"
        if m == 0:
            expected = "none, for a recording without inputs"
        raise ShapeError(f"U: expected {expected}, found {found.shape}")
    _check_finite("U", found)
    return found


def _check_finite(name: str, found: Array) -> None:
    known = np.isfinite(found)
    if not known.all():
        row, column = np.argwhere(~known)[0]
        value = found[row, column]
        raise NotFiniteError(
            f"{name}: expected finite numbers, found {'NaN' if np.isnan(value) else value} at row "
            f"{row}, column {column}"
        )


def _described(found: Array) -> str:
    if found.ndim == 0:
        return "a single number"
    if found.ndim == 1:
        return f"a 1-D array of {len(found)}"
    return f"an array of shape {found.shape}"
