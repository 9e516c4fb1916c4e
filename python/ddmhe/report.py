"""What a run leaves behind: error measures, tables for the terminal, CSV files and figure files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.table import Table

from ddmhe._core import DdMhe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

__all__ = ["nrmse", "outcome", "rmse", "rmse_norm", "save_figure", "settings", "table", "write_estimates"]


def rmse(error: Array) -> Array:
    """Root mean square of each column of error (N, n), (n,); NaN entries are left out."""
    known = np.isfinite(error)
    squares = np.sum(np.where(known, error, 0.0) ** 2, axis=0)
    counts = known.sum(axis=0)
    return np.asarray(np.sqrt(np.where(counts > 0, squares, np.nan) / np.maximum(counts, 1)), dtype=np.float64)


def rmse_norm(error: Array) -> float:
    """Root mean square of the rows' Euclidean norms of error (N, n); rows with NaN are left out."""
    rows = error[np.isfinite(error).all(axis=1)]
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1)))) if len(rows) else float("nan")


def nrmse(x_hat: Array, x: Array) -> float:
    """rms(x_hat - x)/std(x), both pooled over all rows and columns (N, n) where x is known: 1 is a constant's score.

    The spread is taken about each column's own mean.
    """
    known = np.isfinite(x)
    counts = known.sum(axis=0)
    mean = np.where(known, x, 0.0).sum(axis=0) / np.maximum(counts, 1)
    spread = np.sum(((x - mean) ** 2)[known])
    error = np.sum(((x_hat - x) ** 2)[known])
    return float(np.sqrt(error / spread)) if spread > 0 else float("nan")


def settings(est: DdMhe) -> dict[str, str]:
    """The settings in force, as label and text."""
    space = f"{est.rank} directions" + (f", ridge {est.ridge:.3g}" if est.ridge > 0 else "")
    return {
        "horizon M": str(est.horizon),
        "rho": f"{est.rho:.4g}",
        "mu": f"{est.mu:.4g}",
        "trajectory space": space,
        "spectral radius": f"{est.spectral_radius:.4f}",
    }


def outcome(status: Iterable[str], iterations: Iterable[int]) -> dict[str, str]:
    """How the steps ended, as label and text: count per status, share that needed no solver."""
    counts = Counter(str(s) for s in status)
    free = [i == 0 for i in iterations]
    return {
        "steps": ", ".join(f"{count} {word}" for word, count in counts.most_common()),
        "without solver": f"{np.mean(free):.1%}",
    }


def table(title: str, columns: Mapping[str, Mapping[str, str]]) -> Table:
    """A table with one row per label and one column per mapping; an empty name makes a column without heading."""
    names = list(columns)
    result = Table("", *names, title=title, title_justify="left", show_header=any(names))
    labels = list(dict.fromkeys(label for column in columns.values() for label in column))
    for label in labels:
        result.add_row(label, *(columns[name].get(label, "") for name in names))
    return result


def write_estimates(path: Path, time: str, t: Array, names: Sequence[str], x_hat: Array) -> None:
    """A CSV with the time column and one column per state, full precision."""
    frame = pd.DataFrame(x_hat, columns=list(names))
    frame.insert(0, time, t)
    frame.to_csv(path, index=False)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of `path` names the format."""
    figure.savefig(path, dpi=150)
