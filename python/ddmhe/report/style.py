"""How curves look: the same colours and widths in every figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ddmhe.checks import word
from ddmhe.reasons import Reason

Array = NDArray[np.float64]

__all__ = [
    "BAND",
    "BAR",
    "DOUBTS",
    "ESTIMATE",
    "TRUTH",
    "caption",
    "labels",
    "legend_above",
    "shade",
]


TRUTH: dict[str, Any] = {"linewidth": 3.5, "alpha": 0.35}
"""True or recorded states: broad, below the estimates."""
ESTIMATE: dict[str, Any] = {"linewidth": 1.2}
"""Estimates."""
BAND: dict[str, Any] = {"alpha": 0.2, "linewidth": 0.0}
"""What estimates may be off by, around them."""
BAR: dict[str, Any] = {"linewidth": 0.9, "linestyle": "--"}
"""What an error should stay below."""
DOUBTS = {
    Reason.NOVEL: (0.90, 0.62, 0.0, 0.24),
    Reason.UNCERTAIN: (0.80, 0.27, 0.51, 0.16),
    Reason.STUCK: (0.43, 0.31, 0.78, 0.2),
}
"""Where an estimate is not to be trusted: light, so that reasons that come together show, too."""


def caption(name: str) -> str:
    """A name from a file as a figure shows it: letter by letter, none of it typeset as a
    formula."""
    return word(name).replace("$", r"\$")


def labels(names: Sequence[str], units: Sequence[str]) -> tuple[list[str], str]:
    """Labels of states, with their units behind them; and what a common axis is of, with the unit
    if all share one, which then stands nowhere else."""
    shared = units[0] if len(set(units)) == 1 else ""
    if shared:
        return [caption(name) for name in names], f"state ({caption(shared)})"
    with_units = [
        f"{caption(name)} ({caption(unit)})" if unit else caption(name)
        for name, unit in zip(names, units, strict=True)
    ]
    return with_units, "state"


def shade(axes: Axes, t: Array) -> None:
    """Shade the time of the recording t (K,), s."""
    axes.axvspan(t[0], t[-1], color="0.9", zorder=0)


def legend_above(axes: Axes, **style: Any) -> None:
    """The legend above the axes, where it covers no data."""
    looks: dict[str, Any] = {"fontsize": "small", "ncols": 3, "frameon": False} | style
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.3, **looks)
