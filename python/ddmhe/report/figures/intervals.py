"""Guaranteed intervals over time, and their widths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ddmhe.report.palette import color_of
from ddmhe.report.style import ESTIMATE, legend_above

Array = NDArray[np.float64]

__all__ = ["intervals_figure", "widths_figure"]


def intervals_figure(
    t: Array,
    x: Array,
    bounds: Mapping[str, tuple[Array, Array]],
    names: Sequence[str],
    *,
    colors: Mapping[str, str] | None = None,
) -> Figure:
    """True states (N, n), NaN where unknown, and (lower, upper) of each method, a panel per state.

    `names` are the states' labels with their units, `colors` those of the methods.
    """
    figure = Figure(figsize=(10, 3.4 * len(names)), layout="constrained")
    for i, axes in enumerate(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]):
        known = x[np.isfinite(x[:, i]), i]
        # bounds that have left the view, or all numbers, are not drawn
        widest = 2 * min(
            float(np.min(0.5 * upper[:, i] - 0.5 * lower[:, i])) for lower, upper in bounds.values()
        )
        spread = float(np.ptp(known)) if len(known) else 30 * widest
        for k, (name, (lower, upper)) in enumerate(bounds.items()):
            near = 0.5 * upper[:, i] - 0.5 * lower[:, i] < 50 * max(spread, widest)
            for side, label in ((lower, name), (upper, None)):
                color = color_of(k) if colors is None else colors[name]
                axes.plot(
                    t, np.where(near, side[:, i], np.nan), color=color, label=label, **ESTIMATE
                )
            if not len(known):
                known = (0.5 * lower[:, i] + 0.5 * upper[:, i])[near]
        if np.isfinite(x[:, i]).any():
            axes.plot(t, x[:, i], color="black", linestyle="--", linewidth=1, label="true")
        room = max(0.3 * spread, widest)
        axes.set_ylim(known.min() - room, known.max() + room)
        axes.set_ylabel(names[i])
        axes.grid(alpha=0.3)
    legend_above(figure.axes[0])
    figure.axes[-1].set_xlabel("time (s)")
    return figure


def widths_figure(
    t: Array,
    widths: Mapping[str, Array],
    names: Sequence[str],
    *,
    colors: Mapping[str, str] | None = None,
) -> Figure:
    """Full width (N, n) of each method's bounds over time on a log axis, a panel per state."""
    figure = Figure(figsize=(10, 3.4 * len(names)), layout="constrained")
    for i, axes in enumerate(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]):
        for k, (name, width) in enumerate(widths.items()):
            color = color_of(k) if colors is None else colors[name]
            axes.plot(
                t, width[:, i], color=color, label=name, linestyle=["-", "--"][k % 2], linewidth=1.4
            )
        axes.set(yscale="log", ylabel=f"full width of the bounds of {names[i]}")
        axes.grid(alpha=0.3)
    legend_above(figure.axes[0], fontsize="x-small")
    figure.axes[-1].set_xlabel("time (s)")
    return figure
