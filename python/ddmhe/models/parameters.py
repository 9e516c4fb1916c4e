"""The fields of a model, which is frozen: checked when it is made, and read-only."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, ShapeError, numbers
from ddmhe.checks import check_finite

Array = NDArray[np.float64]

__all__ = ["finite_numbers", "scalar", "set_field", "shaped"]


def finite_numbers(name: str, value: ArrayLike) -> Array:
    """Real numbers as a float64 array of any shape, a copy; NotFiniteError naming the field."""
    found = numbers(name, value)
    check_finite(name, found)
    return found


def shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Finite numbers of that shape; ShapeError naming the field."""
    array = finite_numbers(name, value)
    if array.shape != shape:
        raise ShapeError(f"{name}: expected shape {shape}, found {array.shape}")
    return array


def scalar(model: object, name: str, above: float = -math.inf, at_least: float = -math.inf) -> None:
    """Make the field a float of the model; DdmheError naming it unless it is within the limits."""
    value = float(shaped(name, getattr(model, name), ()))
    if value <= above or value < at_least:
        limit = f"above {above:g}" if value <= above else f"of at least {at_least:g}"
        raise DdmheError(f"{name}: expected a number {limit}, found {value:g}")
    set_field(model, name, value)


def set_field(model: object, name: str, value: Array | float) -> None:
    """Set a field of a frozen model, an array read-only."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    object.__setattr__(model, name, value)
