"""Error measures: root mean squares, in a unit or relative to the spread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["nrmse", "pooled_nrmse", "rmse", "rmse_norm", "root_mean_square"]


def rmse(error: Array) -> Array:
    """Root mean square of each column of error (N, n), (n,); NaN entries are left out.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> ddmhe.report.rmse(np.array([[3.0], [-4.0], [np.nan]])) ** 2
    array([12.5])
    """
    known = np.isfinite(error)
    squares = np.sum(np.where(known, error, 0.0) ** 2, axis=0)
    counts = known.sum(axis=0)
    return np.asarray(
        np.sqrt(np.where(counts > 0, squares, np.nan) / np.maximum(counts, 1)), dtype=np.float64
    )


def rmse_norm(error: Array) -> float:
    """Root mean square of the rows' Euclidean norms of error (N, n); rows with NaN are left out.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> ddmhe.report.rmse_norm(np.array([[3.0, 4.0]]))
    5.0
    """
    rows = error[np.isfinite(error).all(axis=1)]
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1)))) if len(rows) else float("nan")


def nrmse(x_hat: Array, x: Array) -> Array:
    """rms(x_hat - x)/std(x) of each column (N, n), (n,), over the rows where x is known: 1 is a
    constant's score.

    NaN for a column that never changes or is never known. One number for all states is their
    `root_mean_square`.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = np.array([[0.0], [2.0]])
    >>> ddmhe.report.nrmse(x + 0.5, x)
    array([0.5])
    """
    error, spread = _squares(x_hat, x)
    return np.asarray(
        np.sqrt(np.where(spread > 0, error, np.nan) / np.where(spread > 0, spread, 1.0))
    )


def root_mean_square(values: Array) -> float:
    """Root mean square of the numbers that are known, NaN without any: the one NRMSE of several
    states.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> ddmhe.report.root_mean_square(np.array([3.0, -3.0, np.nan]))
    3.0
    """
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def pooled_nrmse(x_hat: Array, x: Array) -> float:
    """`nrmse` with errors and spreads pooled over all columns (N, n): for states of one unit; large
    ones count more.

    The spread is taken about each column's own mean.

    Examples
    --------
    >>> import numpy as np
    >>> import ddmhe
    >>> x = np.array([[0.0, 0.0], [2.0, 2.0]])
    >>> ddmhe.report.pooled_nrmse(x + 0.5, x)
    0.5
    """
    error, spread = _squares(x_hat, x)
    return float(np.sqrt(error.sum() / spread.sum())) if spread.sum() > 0 else float("nan")


def _squares(x_hat: Array, x: Array) -> tuple[Array, Array]:
    """Sums of squares over each column of the errors and of the deviations of x from its mean,
    where x is known."""
    known = np.isfinite(x)
    counts = known.sum(axis=0)
    mean = np.where(known, x, 0.0).sum(axis=0) / np.maximum(counts, 1)
    error, deviation = (
        np.sum(np.where(known, part, 0.0) ** 2, axis=0) for part in (x_hat - x, x - mean)
    )
    return error, deviation
