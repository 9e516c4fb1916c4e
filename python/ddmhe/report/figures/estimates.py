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

from ddmhe.reasons import Reason
from ddmhe.report.palette import COLORS, HISTORY, color_of
from ddmhe.report.style import BAND, BAR, DOUBTS, ESTIMATE, TRUTH, legend_above, shade
from ddmhe.report.trust import BARS, Trust

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
    trust: Trust | None = None,
    bars: Mapping[str, Array] | None = None,
) -> Figure:
    """Estimates over time above, with bands of three standard deviations, their errors below on a
    log axis (only where the truth is known), with three standard deviations dashed. What is in
    doubt is shaded.

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
    trust
        The evidence on the estimates, in the state's unit; None: no bands, nothing shaded.
    bars
        Of curves of the lower panel, by label, what they should stay below (N,); default three
        standard deviations per state.
    """
    # the states have the first colours
    colors: list[Any] = [color_of(len(names) + k) for k in range(len(COLORS))]
    if errors is None and x_true is not None:
        errors = {name: np.abs(x_hat[:, i] - x_true[:, i]) for i, name in enumerate(names)}
        colors = [color_of(i) for i in range(len(names))]
        if trust is not None:
            bars = {name: BARS * trust.std[:, i] for i, name in enumerate(names)}
    figure = Figure(figsize=(9.0, 6.5 if errors else 4.2), layout="constrained")
    if errors:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        _draw_errors(below, t, (errors, bars or {}), quantity, colors)
    else:
        above = figure.subplots()
    _draw_states(above, t, x_hat, x_true, history, names)
    if trust is not None:
        _draw_bands(above, t, x_hat, trust.std)
    doubts: set[Reason] = set()
    for axes in figure.axes:
        shade(axes, history[0])
        if trust is not None:
            doubts = _shade_doubts(axes, np.append(history[0][-1], t), trust.reasons)
    above.set_ylabel(quantity)
    figure.axes[-1].set_xlabel("time (s)")
    figure.axes[-1].set_xlim(history[0][0], t[-1])
    _legend(figure, names, truth=x_true is not None, bands=trust is not None, doubts=doubts)
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
        axes.plot(history[0], history[1][:, i], color=HISTORY, **TRUTH)
        if x_true is not None:
            axes.plot(t, x_true[:, i], color=color_of(i), **TRUTH)
        axes.plot(t, x_hat[:, i], color=color_of(i), **ESTIMATE)
    known = [history[1]] if x_true is None else [history[1], x_true]
    _limit(axes, np.concatenate(known), x_hat)
    axes.grid(alpha=0.3)


def _draw_bands(axes: Axes, t: Array, x_hat: Array, std: Array) -> None:
    """Bands, on axes whose limits are set: these stay as they are."""
    for i in range(x_hat.shape[1]):
        room = BARS * std[:, i]
        axes.fill_between(t, x_hat[:, i] - room, x_hat[:, i] + room, color=color_of(i), **BAND)


def _shade_doubts(axes: Axes, t: Array, reasons: NDArray[np.uint8]) -> set[Reason]:
    """Shade the time of estimates that are in doubt, by reason; those that there are. t (N+1,), s,
    begins with the end of the recording."""
    edges = np.append(0.5 * (t[1:] + t[:-1]), t[-1])
    found = set()
    for reason, color in DOUBTS.items():
        there = np.concatenate([[0], (reasons & reason != 0).astype(int), [0]])
        begin, end = (np.flatnonzero(np.diff(there) == sign) for sign in (1, -1))
        if begin.size:
            found.add(reason)
            spans = list(zip(edges[begin], edges[end] - edges[begin], strict=True))
            across = axes.get_xaxis_transform()
            axes.broken_barh(spans, (0, 1), transform=across, color=color, linewidth=0, zorder=0.5)
    return found


def _draw_errors(
    axes: Axes,
    t: Array,
    drawn: tuple[Mapping[str, Array], Mapping[str, Array]],
    quantity: str,
    colors: Sequence[Any],
) -> None:
    errors, bars = drawn
    handles = []
    for i, (label, error) in enumerate(errors.items()):
        color = colors[i % len(colors)]
        visible = np.where(error > 0, error, np.nan)
        handles += axes.plot(t, visible, color=color, label=label, **ESTIMATE)
        if label in bars:
            above = np.where(bars[label] > 0, bars[label], np.nan)
            axes.plot(t, above, color=color, **BAR)
    axes.set_yscale("log")
    axes.set_ylabel(f"error of {quantity}")
    axes.grid(alpha=0.3)
    if bars:
        handles.append(Line2D([], [], color="0.2", label=f"{BARS:g} sd", **BAR))
    legend_above(axes, handles=handles, ncols=min(4, len(handles)))


def _limit(axes: Axes, known: Array, x_hat: Array) -> None:
    """Keep a diverging estimate from hiding the truth: at most three times the known range is
    shown."""
    lo, hi = np.nanmin(known), np.nanmax(known)
    room = max(hi - lo, FLAT * max(abs(lo), abs(hi), 1.0))
    bottom, top = min(lo, np.nanmin(x_hat)), max(hi, np.nanmax(x_hat))
    axes.set_ylim(max(bottom, lo - room) - 0.05 * room, min(top, hi + room) + 0.05 * room)


def _legend(
    figure: Figure, names: Sequence[str], *, truth: bool, bands: bool, doubts: set[Reason]
) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=color_of(i), label=name) for i, name in enumerate(names)
    ]
    thick = "true" if truth else "recorded"
    handles += [
        Line2D([], [], color="0.2", label=thick, **TRUTH),
        Line2D([], [], color="0.2", label="estimated", **ESTIMATE),
        Patch(color="0.9", label="history"),
    ]
    if bands:
        handles.append(Patch(color="0.2", label=f"± {BARS:g} sd", **BAND))
    handles += [
        Patch(color=color, label=f"doubt: {str(reason.name).lower()}")
        for reason, color in DOUBTS.items()
        if reason in doubts
    ]
    figure.legend(
        handles=handles, loc="outside upper center", ncols=min(len(handles), 6), fontsize="small"
    )


def outputs_figure(t: Array, y: Array, names: Sequence[str], quantity: str) -> Figure:
    """Measured outputs (N, p) over time."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(names):
        axes.plot(t, y[:, i], color=color_of(i), label=name, linewidth=0.9)
    axes.set(xlabel="time (s)", ylabel=quantity)
    axes.grid(alpha=0.3)
    legend_above(axes)
    return figure
