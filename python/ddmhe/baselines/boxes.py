"""Boxes on the signals of a window."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import DdmheError, ShapeError, numbers
from ddmhe.checks import shown

Array = NDArray[np.float64]

__all__ = ["box"]


def box(name: str, given: Any, width: int) -> tuple[Array, Array] | None:
    """(lo, hi), each (width,), of a pair of scalars or of (width,) arrays; None for none.

    Sides may be infinite, outwards. DdmheError where lo > hi, ShapeError for other shapes."""
    if given is None:
        return None
    if isinstance(given, str) or not hasattr(given, "__len__"):
        raise ShapeError(f"{name}: expected a pair (lo, hi), found {shown(given)}")
    if len(given) != 2:
        raise ShapeError(f"{name}: expected a pair (lo, hi), found {len(given)} items")
    lo, hi = (_side(name, side, width) for side in given)
    wrong = ~((lo <= hi) & (lo < np.inf) & (hi > -np.inf))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise DdmheError(
            f"{name}: expected lo <= hi in every entry, found lo = {_text(lo[i])}, "
            f"hi = {_text(hi[i])} in entry {i}"
        )
    return lo, hi


def _side(name: str, side: Any, width: int) -> Array:
    found = numbers(name, side)
    if found.shape not in ((), (width,)):
        came = f"a 1-D array of {len(found)}" if found.ndim == 1 else f"shape {found.shape}"
        raise ShapeError(f"{name}: expected a scalar, {width} numbers on each side, found {came}")
    return np.array(np.broadcast_to(found, (width,)))


def _text(value: float) -> str:
    return "NaN" if np.isnan(value) else f"{value:g}"
