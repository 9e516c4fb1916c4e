"""Poles in the complex plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ddmhe.report.palette import color_of
from ddmhe.report.style import legend_above

if TYPE_CHECKING:
    from ddmhe.design import AffineModel, PolePlacement
    from ddmhe.design.regions import Region

__all__ = ["pole_figure"]


def pole_figure(model: AffineModel, placement: PolePlacement) -> Figure:
    """Poles in the complex plane: of the identified A, of A_L as printed and of A + L C in the
    model."""
    figure = Figure(figsize=(6.5, 6.5), layout="constrained")
    axes = figure.subplots()
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    axes.plot(circle.real, circle.imag, color="0.4", linewidth=1, label="unit circle")
    _draw_region(axes, placement.region)
    kinds: list[tuple[Any, str, str, str]] = [
        (np.linalg.eigvals(model.A), "x", color_of(0), "identified A"),
        (placement.poles, "o", color_of(1), "A_L as printed, from data"),
    ]
    if placement.gain is not None:
        kinds.append(
            (placement.poles_identified, "s", color_of(2), "A + L C in the identified model")
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
    legend_above(axes, ncols=2)
    return figure


def _draw_region(axes: Axes, region: Region) -> None:
    """The region where f(z) = L + z M + z̄ Mᵀ is negative definite, shaded."""
    L, M = region.matrices()
    grid = np.linspace(-1.2, 1.2, 161)
    z = grid[None, :] + 1j * grid[:, None]
    f = L + z[..., None, None] * M + z.conj()[..., None, None] * M.T
    inside = np.linalg.eigvalsh(f)[..., -1]
    axes.contourf(grid, grid, inside, levels=[-1e9, 0.0], colors=[color_of(1)], alpha=0.15)
    axes.fill([], [], color=color_of(1), alpha=0.15, label=str(region))
