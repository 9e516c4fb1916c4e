"""Figures: functions that take arrays and return a matplotlib Figure; nothing is shown, nothing is
saved here.

Matplotlib is slow to import, so this package is imported where a figure is made."""

from ddmhe.report.figures.beyond import Curve, beyond_figure
from ddmhe.report.figures.estimates import estimate_figure, outputs_figure
from ddmhe.report.figures.intervals import intervals_figure, widths_figure
from ddmhe.report.figures.poles import pole_figure
from ddmhe.report.figures.scores import tuning_figure
from ddmhe.report.figures.sweeps import heat_figure, sweep_figure

__all__ = [
    "Curve",
    "beyond_figure",
    "estimate_figure",
    "heat_figure",
    "intervals_figure",
    "outputs_figure",
    "pole_figure",
    "sweep_figure",
    "tuning_figure",
    "widths_figure",
]
