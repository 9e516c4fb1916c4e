"""Estimates and outputs over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ddmhe.report.style import ESTIMATE, TRUTH, color_of, shade

Array = NDArray[np.float64]

__all__ = ["estimate_figure", "outputs_figure"]

FLAT = 1e-12
"""A curve that varies by less than this share of its size is drawn as one that does not vary."""


def estimate_figure(
    t: Array,
    x_hat: Array,
    x_true: Array | None,
    *,
    history: tuple[Array, Array],
    names: Sequence[str],
    quantity: str,
    errors: Mapping[str, Array] | None = None,
) -> Figure:
    """Estimates over time above, their errors below on a log axis (only where the truth is known).

    Parameters
    ----------
    t
        Times of the estimates (N,), s.
    x_hat, x_true
        Estimated and true states (N, n) in one unit, NaN where unknown.
    history
        Times (K,), s, and states (K, n) of the recording, drawn shaded.
    names
        Names of the states (n).
    quantity
        Label of the state axis, with its unit in brackets.
    errors
        Curves of the lower panel by label, (N,) each, in the state's unit; default
        |x_hat - x_true| per state.
    """
    colors: list[Any] = ["black", "tab:red", "tab:purple", "tab:brown"]
    if errors is None and x_true is not None:
        errors = {name: np.abs(x_hat[:, i] - x_true[:, i]) for i, name in enumerate(names)}
        colors = [color_of(i) for i in range(len(names))]
    figure = Figure(figsize=(9.0, 6.5 if errors else 4.2), layout="constrained")
    if errors:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        _draw_errors(below, t, errors, quantity, colors)
        shade(below, history[0])
    else:
        above = figure.subplots()
    _draw_states(above, t, x_hat, x_true, history, names)
    shade(above, history[0])
    above.set_ylabel(quantity)
    figure.axes[-1].set_xlabel("time (s)")
    figure.axes[-1].set_xlim(history[0][0], t[-1])
    _legend(above, names, truth=x_true is not None)
    return figure


def _draw_states(
    axes: Axes,
    t: Array,
    x_hat: Array,
    x_true: Array | None,
    history: tuple[Array, Array],
    names: Sequence[str],
) -> None:
    for i in range(len(names)):
        axes.plot(history[0], history[1][:, i], color=color_of(i), **TRUTH)
        if x_true is not None:
            axes.plot(t, x_true[:, i], color=color_of(i), **TRUTH)
        axes.plot(t, x_hat[:, i], color=color_of(i), **ESTIMATE)
    known = [history[1]] if x_true is None else [history[1], x_true]
    _limit(axes, np.concatenate(known), x_hat)
    axes.grid(alpha=0.3)


def _draw_errors(
    axes: Axes, t: Array, errors: Mapping[str, Array], quantity: str, colors: Sequence[Any]
) -> None:
    for i, (label, error) in enumerate(errors.items()):
        visible = np.where(error > 0, error, np.nan)
        axes.plot(t, visible, color=colors[i % len(colors)], label=label, **ESTIMATE)
    axes.set_yscale("log")
    axes.set_ylabel(f"error of {quantity}")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", ncols=min(3, len(errors)), fontsize="small")


def _limit(axes: Axes, known: Array, x_hat: Array) -> None:
    """Keep a diverging estimate from hiding the truth: at most three times the known range is
    shown."""
    lo, hi = np.nanmin(known), np.nanmax(known)
    room = max(hi - lo, FLAT * max(abs(lo), abs(hi), 1.0))
    bottom, top = min(lo, np.nanmin(x_hat)), max(hi, np.nanmax(x_hat))
    axes.set_ylim(max(bottom, lo - room) - 0.05 * room, min(top, hi + room) + 0.05 * room)


def _legend(axes: Axes, names: Sequence[str], truth: bool) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=color_of(i), label=name) for i, name in enumerate(names)
    ]
    thick = "true" if truth else "recorded"
    handles += [
        Line2D([], [], color="0.2", label=thick, **TRUTH),
        Line2D([], [], color="0.2", label="estimated", **ESTIMATE),
        Patch(color="0.9", label="history"),
    ]
    axes.legend(handles=handles, loc="upper right", ncols=min(len(handles), 6), fontsize="small")


def outputs_figure(t: Array, y: Array, names: Sequence[str], quantity: str) -> Figure:
    """Measured outputs (N, p) over time."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(names):
        axes.plot(t, y[:, i], color=color_of(i), label=name, linewidth=0.9)
    axes.set(xlabel="time (s)", ylabel=quantity)
    axes.grid(alpha=0.3)
    axes.legend()
    return figure
