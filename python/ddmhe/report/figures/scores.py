"""Held-out errors of the settings that a tuning tried."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ddmhe.report.palette import color_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["tuning_figure"]

EDGE = 3e-8
"""Where settings without a regularisation weight stand on the axis of weights."""


def tuning_figure(table: pd.DataFrame) -> Figure:
    """Held-out error over the regularisation weight, a curve for each horizon and μ; choice and
    default marked."""
    options = sorted(set(table["equilibrium"]))
    figure = Figure(figsize=(5.5 * len(options) + 1.5, 5), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(options), sharey=True))
    table = table.assign(error=np.exp(table["score"]))
    chosen = table.iloc[0]
    for axes, option in zip(panels, options, strict=True):
        _draw_scores(axes, table, table[table["equilibrium"] == option])
        if chosen["equilibrium"] == option:
            x_chosen = chosen["lambda/mu"] if np.isfinite(chosen["lambda/mu"]) else EDGE
            axes.scatter(
                x_chosen, chosen["error"], 140, marker="*", color="black", label="chosen", zorder=4
            )
        axes.set(xscale="log", yscale="log")
        axes.set_xlabel("regularisation weight / mu (left edge: cuts at a rank, rules)")
        if len(options) > 1:
            axes.set_title("with the known rest" if option else "recording alone")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    panels[0].set_ylabel("held-out error / spread of the states")
    return figure


def _draw_scores(axes: Axes, table: pd.DataFrame, part: pd.DataFrame) -> None:
    """The `part` of a tuning's table that one panel shows, in the colours and lines of the whole
    table."""
    horizons = sorted(set(table["horizon"]))
    styles = dict(zip(sorted(set(table["mu"].dropna())), ["-", "--", ":", "-."] * 4, strict=False))
    ridge = part[part["lambda/mu"].notna()]
    for (M, mu), curve in ridge.groupby(["horizon", "mu"]):
        curve = curve.sort_values("lambda/mu")
        weights, errors = curve["lambda/mu"], curve["error"]
        label = f"M = {M}, mu = {mu:.3g}"
        axes.plot(weights, errors, styles[mu], color=color_of(horizons.index(M)), label=label)
    (default,) = part[part["default"]]["error"]
    axes.axhline(default, color="0.5", linewidth=1, label="default rule")
    beside = part[(part["space"] == "auto") & ~part["default"]]
    for marker, (_, row) in zip("^v<>d", beside.iterrows(), strict=False):
        label = f"{row['weights']} weights, disturbance {row['disturbance']}"
        axes.scatter(EDGE, row["error"], 24, marker=marker, color="0.4", label=label)
    ranks = part[part["space"].str.startswith("Truncated")]
    for M, cut in ranks.groupby("horizon"):
        at = np.full(len(cut), EDGE)
        axes.scatter(at, cut["error"], 18, color=color_of(horizons.index(M)), marker="_")
    refused = ridge[~np.isfinite(ridge["rated"])]
    if len(refused):
        at, errors = refused["lambda/mu"], refused["error"]
        axes.scatter(at, errors, 24, marker="x", color="0.3", label="unstable: refused")
