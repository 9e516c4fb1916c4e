"""The colours of every figure and page: told apart by people who see no red, no green or no blue.

The first six are Okabe and Ito's, without their yellow, which is too light for a line on white
(Color Universal Design, 2008)."""

from __future__ import annotations

__all__ = ["COLORS", "HISTORY", "color_of"]

COLORS = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#882255",
    "#000000",
    "#5a2d0c",
    "#b5b5b5",
)
"""Blue, vermilion, green, purple, orange, sky, wine, black, brown, grey."""
HISTORY = "#8a8f96"
"""What was recorded before, grey."""


def color_of(i: int) -> str:
    """Colour of the i-th curve; the first belongs to our own estimator."""
    return COLORS[i % len(COLORS)]
