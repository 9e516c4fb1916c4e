"""What a page is made of: sections of sentences, tables and charts. Templates turn them into HTML
and escape all text, so names from files may stand in any of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["Chart", "Code", "Curve", "Items", "Page", "Section", "Table", "Text"]


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    words: str
    kind: str = "text"


@dataclass(frozen=True)
class Items:
    """A list of sentences."""

    sentences: Sequence[str]
    kind: str = "items"


@dataclass(frozen=True)
class Code:
    """Words to be typed, or numbers to be kept, as they are; `label` says what they are."""

    words: str
    label: str
    kind: str = "code"


@dataclass(frozen=True)
class Table:
    """Rows of texts; the first cell of each is its heading."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    kind: str = "table"


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of a chart: its numbers over the chart's axis.

    `look` is how it is drawn: "estimate", "truth", "recorded", "band", "limit", "output" or "bar".
    A band reaches from `values` up to `upper`. `at` says where the numbers stand on an axis of
    time: "run" (N,) or "recording" (K,)."""

    label: str
    look: str
    values: Array
    upper: Array | None = None
    at: str = "run"


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves over one axis.

    Without `x` that is the time of the run, and the chart is linked to all others over time."""

    title: str
    """Also the label of the vertical axis, with its unit."""
    alt: str
    """What is to be seen in it, in a sentence."""
    curves: Sequence[Curve]
    x: Array | None = None
    x_label: str = ""
    log: bool = False
    doubts: bool = False
    """Whether the time in doubt is shaded."""
    view: tuple[float, float] | None = None
    """Beyond these values nothing is shown at first: a curve that leaves them hides no other."""
    marks: Sequence[tuple[float, str]] = ()
    """Places on the axis with what they are."""
    lanes: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)
    """Bars by the names of their rows, from and to."""
    kind: str = "chart"


@dataclass(frozen=True)
class Section:
    """A part of a page, listed in its contents."""

    id: str
    title: str
    blocks: Sequence[Any]


@dataclass(frozen=True, eq=False)
class Page:
    """All that is written into one file."""

    title: str
    summary: Sequence[str]
    sections: Sequence[Section]
    t: Array
    """Times of the run (N,)."""
    time_label: str
    recorded_t: Array = field(default_factory=lambda: np.zeros(0))
    """Times of the recording (K,)."""
    doubts: Mapping[str, Sequence[tuple[float, float]]] = field(default_factory=dict)
    """Spans of time that are shaded, by the reason."""
