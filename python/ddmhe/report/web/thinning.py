"""Fewer points of long curves, peaks kept: of each stretch the smallest and the largest value."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Spans = list[tuple[float, float]]

__all__ = ["Thinning", "spans_of"]


@dataclass(frozen=True)
class Thinning:
    """How N samples are shown in at most `points` points."""

    samples: int
    stretch: int
    """Samples that share two points; 1: every sample is shown."""

    @classmethod
    def to(cls, samples: int, points: int) -> Thinning:
        """Of N samples to at most `points`, two at least."""
        if samples <= points:
            return cls(samples, 1)
        return cls(samples, math.ceil(2 * samples / max(points, 2)))

    @property
    def words(self) -> str:
        """What is left out, in a sentence; empty where nothing is."""
        if self.stretch == 1:
            return ""
        return (
            f"Curves of {self.samples} samples are thinned: of every {self.stretch} samples the "
            "smallest and the largest value are drawn, so no peak is lost; numbers in the text and "
            "in tables are of all samples."
        )

    def times(self, t: Array) -> Array:
        """Where the points stand: at the beginning and in the middle of each stretch."""
        if self.stretch == 1:
            return t
        begin = np.arange(0, self.samples, self.stretch)
        middle = np.minimum(begin + self.stretch // 2, self.samples - 1)
        # the last stretch may be of one sample: its two points stay apart by nothing
        return np.asarray(t[np.stack([begin, middle], axis=1).ravel()])

    def values(self, values: Array) -> Array:
        """The smallest and the largest known value of each stretch, in the order in which they
        came; NaN for a stretch without any."""
        if self.stretch == 1:
            return values
        count = math.ceil(self.samples / self.stretch)
        padded = np.full(count * self.stretch, np.nan)
        padded[: self.samples] = values
        rows = padded.reshape(count, self.stretch)
        known = ~np.isnan(rows)
        least = np.argmin(np.where(known, rows, np.inf), axis=1)
        most = np.argmax(np.where(known, rows, -np.inf), axis=1)
        order = np.sort(np.stack([least, most], axis=1), axis=1)
        return np.take_along_axis(rows, order, axis=1).ravel()


def spans_of(holds: Flags, t: Array, begin: float, most: int = 500) -> Spans:
    """From and to of the times at which samples (N,) hold; t (N,), the first sample reaches back to
    `begin`. More than `most` spans are joined over the shortest pauses."""
    there = np.concatenate([[0], holds.astype(np.int8), [0]])
    first, behind = (np.flatnonzero(np.diff(there) == sign) for sign in (1, -1))
    if len(first) > most:
        pause = first[1:] - behind[:-1]
        kept = np.sort(np.argsort(pause, kind="stable")[len(pause) - most + 1 :])
        first, behind = np.append(first[:1], first[kept + 1]), np.append(behind[kept], behind[-1:])
    whole = np.concatenate([[begin], t])
    edges = np.append(0.5 * (whole[1:] + whole[:-1]), t[-1])
    return [(float(edges[a]), float(edges[b])) for a, b in zip(first, behind, strict=True)]
