"""Rates of a body long after they were recorded, by estimators that know more and less."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ddmhe.report.palette import COLORS, HISTORY
from ddmhe.report.style import BAND, ESTIMATE, TRUTH

Array = NDArray[np.float64]

__all__ = ["Curve", "beyond_figure"]

WIDTH = 2.0
"""Standard deviations of a band."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One estimator's way."""

    x: Array
    """Estimates (N, 3), deg/s."""
    std: Array | None
    """Standard deviations of their errors, drawn as a band; None: the errors alone are shown."""


def beyond_figure(
    truth: tuple[Array, Array],
    curves: Mapping[str, Curve],
    names: Sequence[str],
    *,
    recorded: int,
    novel: float | None,
) -> Figure:
    """A panel for each rate over the time of `truth` (times in s, rates (K, 3) in deg/s), and one
    for the lengths of the errors, log.

    `recorded`: how many of the samples were; estimates are those of all later ones. `novel`: when
    the first curve's estimator found the motion unlike the recording, s."""
    t, x_true = truth
    later, end = t[recorded:], t[recorded - 1]
    figure = Figure(figsize=(11.0, 8.5), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    for i, (axis, name) in enumerate(zip(panels, names, strict=False)):
        axis.plot(t, x_true[:, i], color="0.25", label="" if i else "true", **TRUTH)
        room = 0.3 * float(np.ptp(x_true[:, i]))
        axis.set_ylim(x_true[:, i].min() - room, x_true[:, i].max() + room)
        axis.set_ylabel(f"{name} (deg/s)")
    for (label, curve), color in zip(curves.items(), COLORS, strict=False):
        error = np.linalg.norm(curve.x - x_true[recorded:], axis=1)
        if curve.std is not None:
            for i, axis in enumerate(panels[:3]):
                low, high = (curve.x[:, i] + sign * WIDTH * curve.std[:, i] for sign in (-1, 1))
                axis.fill_between(later, low, high, color=color, **BAND)
                axis.plot(later, curve.x[:, i], color=color, **ESTIMATE)
        panels[3].semilogy(later, error, color=color, label=label, **ESTIMATE)
    panels[3].set(xlabel="time (s)", ylabel="error (deg/s)", xlim=(t[0], t[-1]))
    for axis in panels:
        axis.axvspan(t[0], end, color=HISTORY, alpha=0.25, linewidth=0)
        axis.spines[["top", "right"]].set_visible(False)
        if novel is not None:
            axis.axvline(novel, color="0.3", linestyle=":")
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    left = next(iter(curves))
    words = f"grey: recorded; bands: ± {WIDTH:g} standard deviations"
    if novel is not None:
        words += f"; dotted: {left} find that the motion has left the recording"
    figure.supxlabel(words, fontsize="medium", color="0.3")
    return figure
