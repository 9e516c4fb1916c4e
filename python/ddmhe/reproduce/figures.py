"""Figures of Monte Carlo trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ddmhe.report.palette import HISTORY, color_of
from ddmhe.report.style import ESTIMATE, TRUTH, legend_above, shade
from ddmhe.reproduce.montecarlo import Trial, Trials
from ddmhe.reproduce.tol import DRAWN

__all__ = ["parameter_figure", "trials_figure"]


def trials_figure(
    trials: Trials,
    *,
    names: Sequence[str],
    quantity: str,
    colors: Mapping[str, str],
    scale: float = 1.0,
    event: tuple[float, float] | None = None,
    band: float | None = None,
) -> Figure:
    """History, true and estimated states of the first seed, a panel per state; below, the errors of
    all seeds.

    Parameters
    ----------
    trials : Trials
        An experiment of `ddmhe.reproduce`.
    names : n names of the states quantity : label with its unit in brackets, of states times
    `scale` colors : which estimators to draw, and their colours event : when noise or disturbance
    is large, s band : half width of the box around the first seed's centre, in the states' unit:
    drawn about the centre, with a
        mark wherever one of its bounds was active, unless none ever was
    """
    n = len(names)
    figure = Figure(figsize=(9.5, 2.2 * n + 3.8), layout="constrained")
    panels = np.atleast_1d(figure.subplots(n + 1, 1, sharex=True, height_ratios=[2] * n + [3]))
    first = trials.all[0]
    for i, (axes, name) in enumerate(zip(panels[:n], names, strict=True)):
        _draw_first(axes, first, i, scale, colors, band)
        axes.set_ylabel(f"{name}\n{quantity}" if n == 1 else f"{name} ({quantity.split('(')[-1]}")
    below = panels[n]
    floor, top = np.inf, 0.0
    for name, color in colors.items():
        lo, median, hi = scale * trials.band(name)
        below.plot(trials.t, median, color=color, **ESTIMATE)
        below.fill_between(trials.t, lo, np.minimum(hi, 1e12), color=color, alpha=0.15, linewidth=0)
        floor = min(floor, float(np.min(np.where(median > 0, median, np.inf)[5:])))
        top = max(top, float(np.max(np.where(np.isfinite(median), median, 0.0))))
    spread = scale * float(np.abs(first.x).max())
    below.set_yscale("log")
    below.set_ylim(max(floor / 2, 1e-9 * spread), min(3 * top, 100 * spread))
    below.set_ylabel(
        f"|error|: median and 90 %\nof {len(trials.all)} seeds ({quantity.split('(')[-1]}"
    )
    below.set_xlabel("time (s)")
    below.grid(alpha=0.3)
    for axes in panels:
        if event is not None:
            axes.axvspan(*event, color=color_of(1), alpha=0.1, zorder=0)
        if first.history is not None:
            shade(axes, first.history[0])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize="x-small")
    return figure


def _draw_first(
    axes: Axes,
    first: Trial,
    i: int,
    scale: float,
    colors: Mapping[str, str],
    band: float | None = None,
) -> None:
    """State i of one trial: history, truth, box and estimates."""
    truth = scale * first.x[:, i]
    shown = truth
    if first.history is not None:
        recorded = scale * first.history[1][:, i]
        axes.plot(first.history[0], recorded, color=HISTORY, **TRUTH)
        shown = np.concatenate([recorded, truth])
    axes.plot(first.t, truth, color="0.2", label="true; shaded: history", **TRUTH)
    if band is not None and first.center is not None and first.active is not None:
        middle, half = scale * first.center[:, i], scale * band
        acts = first.active > 0
        label = f"box of {next(iter(colors))}: active at {acts.sum()} of {len(acts)} samples"
        if acts.any():
            axes.fill_between(
                first.t,
                middle - half,
                middle + half,
                color="0.7",
                alpha=0.35,
                linewidth=0,
                label=label,
            )
            for side in (middle - half, middle + half):
                axes.plot(first.t[acts], side[acts], ".", color="0.3", markersize=3)
        else:  # a box that never acts is mostly wider than the panel
            axes.plot([], [], " ", label=label)
    for name, color in colors.items():
        axes.plot(first.t, scale * first.x_hat[name][:, i], color=color, label=name, **ESTIMATE)
    room = max(float(np.ptp(shown)), DRAWN)
    axes.set_ylim(shown.min() - 0.25 * room, shown.max() + 0.25 * room)
    axes.grid(alpha=0.3)


def parameter_figure(
    sweep: Mapping[str, Trials], *, quantity: str, colors: Mapping[str, str]
) -> Figure:
    """History, true and estimated state of the first seed for several settings, a panel per
    estimator.

    Parameters
    ----------
    sweep : Trials of one state by the setting's label
    quantity : label of the state with its unit in brackets
    colors : the estimators and their colours; a setting is a shade of it, light for the first
    """
    figure = Figure(figsize=(9.5, 3.2 * len(colors)), layout="constrained")
    for axes, (name, color) in zip(
        figure.subplots(len(colors), 1, sharex=True, squeeze=False)[:, 0],
        colors.items(),
        strict=True,
    ):
        _draw_first(axes, next(iter(sweep.values())).all[0], 0, 1.0, {})
        for k, (label, trials) in enumerate(sweep.items()):
            alpha = 0.3 + 0.7 * k / max(len(sweep) - 1, 1)
            first = trials.all[0]
            axes.plot(
                first.t, first.x_hat[name][:, 0], color=color, alpha=alpha, label=label, **ESTIMATE
            )
        history = next(iter(sweep.values())).all[0].history
        if history is not None:
            shade(axes, history[0])
        axes.set_ylabel(f"{name}\n{quantity}")
        legend_above(axes, fontsize="x-small")
    figure.axes[-1].set_xlabel("time (s)")
    return figure
