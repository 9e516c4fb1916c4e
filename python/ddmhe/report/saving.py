"""Files: estimates as CSV, figures in the format that their name says."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.files import write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

__all__ = ["save_figure", "write_estimates"]


def write_estimates(
    path: Path,
    time: str,
    t: Any,
    names: Sequence[str],
    x_hat: Array,
    beside: Mapping[str, Any] | None = None,
) -> None:
    """A CSV with the time column, one column per state and those of `beside`, full precision."""
    import pandas as pd  # takes longer to load than an estimator to build

    frame = pd.DataFrame(x_hat, columns=list(names)).assign(**dict(beside or {}))
    frame.insert(0, time, t)
    write(path, lambda beside: frame.to_csv(beside, index=False))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of `path` names the format."""
    with warnings.catch_warnings():
        # a letter of a column's name that the font lacks is drawn as a box
        warnings.filterwarnings("ignore", "Glyph .* missing")
        write(path, lambda beside: figure.savefig(beside, dpi=150))
