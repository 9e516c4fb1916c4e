"""What `tune` is told beside the recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import DdmheError, History, ShapeError, noise_levels, numbers
from ddmhe.checks import shown

Array = NDArray[np.float64]

__all__ = ["extra_noise"]


def extra_noise(history: History, output_noise: ArrayLike | None) -> Array:
    """Standard deviation (p,) to add to recorded outputs so that they are as noisy as the online
    ones."""
    if output_noise is None:
        return np.zeros(history.p)
    stated = numbers("output_noise", output_noise)
    if stated.shape not in ((), (history.p,)):
        raise ShapeError(
            f"output_noise: expected a number or {history.p} numbers, found shape {stated.shape}"
        )
    if not (np.isfinite(stated).all() and (stated >= 0).all()):
        raise DdmheError(
            f"output_noise: expected finite numbers of at least 0, found {shown(output_noise)}"
        )
    recorded = noise_levels(history)[1]
    return np.asarray(np.sqrt(np.maximum(stated**2 - recorded**2, 0.0)))
