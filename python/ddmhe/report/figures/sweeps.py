"""Errors over one setting, and over two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ddmhe.report.palette import color_of
from ddmhe.report.style import legend_above

Array = NDArray[np.float64]

__all__ = ["heat_figure", "sweep_figure"]


def sweep_figure(
    values: Array,
    curves: Mapping[str, Array],
    parameter: str,
    quantity: str,
    *,
    chosen: float | None = None,
    colors: Mapping[str, str] | None = None,
) -> Figure:
    """Errors over a parameter on log axes: curves (K, 3) with the ends of the 90 % band about the
    median."""
    figure = Figure(figsize=(8, 4.8), layout="constrained")
    axes = figure.subplots()
    for k, (name, curve) in enumerate(curves.items()):
        color = color_of(k) if colors is None else colors[name]
        axes.plot(values, curve[:, 1], "o-", color=color, label=name)
        axes.fill_between(values, curve[:, 0], curve[:, 2], color=color, alpha=0.15, linewidth=0)
    medians = np.concatenate([curve[:, 1] for curve in curves.values()])
    axes.set_ylim(
        0.1 * medians.min(), 30 * medians[np.isfinite(medians)].max()
    )  # a band may end at infinity
    if chosen is not None:
        axes.axvline(chosen, color="0.5", linestyle=":", label="the paper's value")
    axes.set(xscale="log", yscale="log", xlabel=parameter, ylabel=quantity)
    axes.grid(alpha=0.3)
    legend_above(axes)
    return figure


def heat_figure(
    panels: Sequence[tuple[str, Array]],
    rows: tuple[str, Sequence[str]],
    columns: tuple[str, Sequence[str]],
    unit: str,
) -> Figure:
    """Errors over two settings, a panel per (title, values (R, C)); logarithmic colours, numbers in
    the cells.

    `rows` and `columns` are (label with unit, names of the values); infinite errors are left white.
    """
    figure = Figure(figsize=(1.5 + 4.6 * len(panels), 4.4), layout="constrained")
    for k, (axes, (title, values)) in enumerate(
        zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True)
    ):
        finite = values[np.isfinite(values)]
        norm = LogNorm(finite.min(), min(finite.max(), 100 * finite.min()))
        image = axes.imshow(
            np.where(np.isfinite(values), values, np.nan), norm=norm, cmap="viridis", aspect="auto"
        )
        for (i, j), value in np.ndenumerate(values):
            text = f"{value:.2g}" if np.isfinite(value) and value < 1e4 else "large"
            dark = np.isfinite(value) and norm(value) < 0.6
            axes.text(
                j, i, text, ha="center", va="center", fontsize=7, color="white" if dark else "black"
            )
        axes.set_xticks(range(len(columns[1])), columns[1], fontsize=8)
        axes.set_yticks(range(len(rows[1])), rows[1], fontsize=8)
        axes.set(title=title, xlabel=columns[0])
        figure.colorbar(image, ax=axes, label=unit)
        if k == 0:
            axes.set_ylabel(rows[0])
    return figure
