"""Figures: functions that take arrays and return a matplotlib Figure; nothing is shown, nothing is
saved here.

Matplotlib is slow to import, so this module is imported where a figure is made, by `report` and the
command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

    from ddmhe.design import AffineModel, PolePlacement
    from ddmhe.design.regions import Region

Array = NDArray[np.float64]

__all__ = [
    "estimate_figure",
    "heat_figure",
    "intervals_figure",
    "outputs_figure",
    "pole_figure",
    "sweep_figure",
    "tuning_figure",
    "widths_figure",
]

TRUTH: dict[str, Any] = {"linewidth": 3.5, "alpha": 0.35}
ESTIMATE: dict[str, Any] = {"linewidth": 1.2}


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
    t : (N,) times of the estimates, s x_hat, x_true : (N, n) estimated and true states in one unit,
    NaN where unknown history : times (K,), s, and states (K, n) of the recording, drawn shaded
    names : n names of the states quantity : label of the state axis, with its unit in brackets
    errors : curves of the lower panel by label, (N,) each, in the state's unit; default |x_hat -
    x_true| per state"""
    colors: list[Any] = ["black", "tab:red", "tab:purple", "tab:brown"]
    if errors is None and x_true is not None:
        errors = {name: np.abs(x_hat[:, i] - x_true[:, i]) for i, name in enumerate(names)}
        colors = [_color(i) for i in range(len(names))]
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


def pole_figure(model: AffineModel, placement: PolePlacement) -> Figure:
    """Poles in the complex plane: of the identified A, of A_L as printed and of A + L C in the
    model."""
    figure = Figure(figsize=(6.5, 6.5), layout="constrained")
    axes = figure.subplots()
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    axes.plot(circle.real, circle.imag, color="0.4", linewidth=1, label="unit circle")
    _draw_region(axes, placement.region)
    kinds: list[tuple[Any, str, str, str]] = [
        (np.linalg.eigvals(model.A), "x", "tab:blue", "identified A"),
        (placement.poles, "o", "tab:orange", "A_L as printed, from data"),
    ]
    if placement.gain is not None:
        kinds.append(
            (placement.poles_identified, "s", "tab:green", "A + L C in the identified model")
        )
    for values, marker, color, label in kinds:
        style: dict[str, Any] = (
            {"color": color} if marker == "x" else {"facecolors": "none", "edgecolors": color}
        )
        axes.scatter(values.real, values.imag, 60, marker=marker, label=label, zorder=3, **style)
    extent = max([1.2, *(1.1 * abs(z) for values, *_ in kinds for z in values)])
    axes.set(
        xlim=(-extent, extent), ylim=(-extent, extent), xlabel="real part", ylabel="imaginary part"
    )
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", fontsize="small")
    return figure


def _draw_region(axes: Axes, region: Region) -> None:
    """The region where f(z) = L + z M + z̄ Mᵀ is negative definite, shaded."""
    L, M = region.matrices()
    grid = np.linspace(-1.2, 1.2, 161)
    z = grid[None, :] + 1j * grid[:, None]
    f = L + z[..., None, None] * M + z.conj()[..., None, None] * M.T
    inside = np.linalg.eigvalsh(f)[..., -1]
    axes.contourf(grid, grid, inside, levels=[-1e9, 0.0], colors=["tab:orange"], alpha=0.15)
    axes.fill([], [], color="tab:orange", alpha=0.15, label=str(region))


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
    horizons = sorted(set(table["horizon"]))
    styles = dict(zip(sorted(set(table["mu"])), ["-", "--", ":", "-."] * 4, strict=False))
    for axes, option in zip(panels, options, strict=True):
        part = table[table["equilibrium"] == option]
        ridge = part[part["lambda/mu"].notna()]
        for (M, mu), curve in ridge.groupby(["horizon", "mu"]):
            curve = curve.sort_values("lambda/mu")
            color = _color(horizons.index(M))
            axes.plot(
                curve["lambda/mu"],
                curve["error"],
                styles[mu],
                color=color,
                label=f"M = {M}, mu = {mu:.3g}",
            )
        (default,) = part[part["space"] == "auto"]["error"]
        axes.axhline(default, color="0.5", linewidth=1, label="default rule")
        ranks = part[part["space"].str.startswith("Truncated")]
        for M, cut in ranks.groupby("horizon"):
            axes.scatter(
                np.full(len(cut), EDGE),
                cut["error"],
                18,
                color=_color(horizons.index(M)),
                marker="_",
            )
        refused = ridge[~np.isfinite(ridge["rated"])]
        if len(refused):
            axes.scatter(
                refused["lambda/mu"],
                refused["error"],
                24,
                marker="x",
                color="0.3",
                label="unstable: refused",
            )
        if chosen["equilibrium"] == option:
            x_chosen = chosen["lambda/mu"] if np.isfinite(chosen["lambda/mu"]) else EDGE
            axes.scatter(
                x_chosen, chosen["error"], 140, marker="*", color="black", label="chosen", zorder=4
            )
        axes.set(xscale="log", yscale="log")
        axes.set_xlabel("regularisation weight / mu (left edge: cuts at a rank, default rule)")
        if len(options) > 1:
            axes.set_title("with the known rest" if option else "recording alone")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="x-small")
    panels[0].set_ylabel("held-out error / spread of the states")
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
        axes.plot(history[0], history[1][:, i], color=_color(i), **TRUTH)
        if x_true is not None:
            axes.plot(t, x_true[:, i], color=_color(i), **TRUTH)
        axes.plot(t, x_hat[:, i], color=_color(i), **ESTIMATE)
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
    room = max(hi - lo, 1e-12 * max(abs(lo), abs(hi), 1.0))
    bottom, top = min(lo, np.nanmin(x_hat)), max(hi, np.nanmax(x_hat))
    axes.set_ylim(max(bottom, lo - room) - 0.05 * room, min(top, hi + room) + 0.05 * room)


def shade(axes: Axes, t: Array) -> None:
    axes.axvspan(t[0], t[-1], color="0.9", zorder=0)


def _legend(axes: Axes, names: Sequence[str], truth: bool) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=_color(i), label=name) for i, name in enumerate(names)
    ]
    thick = "true" if truth else "recorded"
    handles += [
        Line2D([], [], color="0.2", label=thick, **TRUTH),
        Line2D([], [], color="0.2", label="estimated", **ESTIMATE),
        Patch(color="0.9", label="history"),
    ]
    axes.legend(handles=handles, loc="upper right", ncols=min(len(handles), 6), fontsize="small")


def _color(i: int) -> tuple[float, float, float, float]:
    rgba: tuple[float, float, float, float] = colormaps["tab10"](i % 10)
    return rgba


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
        color = _color(k) if colors is None else colors[name]
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
    axes.legend()
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
                color = _color(k) if colors is None else colors[name]
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
    figure.axes[0].legend(fontsize="small", ncols=3, loc="upper right")
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
            color = _color(k) if colors is None else colors[name]
            axes.plot(
                t, width[:, i], color=color, label=name, linestyle=["-", "--"][k % 2], linewidth=1.4
            )
        axes.set(yscale="log", ylabel=f"full width of the bounds of {names[i]}")
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize="x-small", ncols=3, loc="upper right")
    figure.axes[-1].set_xlabel("time (s)")
    return figure


def outputs_figure(t: Array, y: Array, names: Sequence[str], quantity: str) -> Figure:
    """Measured outputs (N, p) over time."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    for i, name in enumerate(names):
        axes.plot(t, y[:, i], color=_color(i), label=name, linewidth=0.9)
    axes.set(xlabel="time (s)", ylabel=quantity)
    axes.grid(alpha=0.3)
    axes.legend()
    return figure
