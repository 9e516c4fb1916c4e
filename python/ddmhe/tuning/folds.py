"""Parts of the recording that are held out: its quarters and its ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddmhe._core import History
from ddmhe.recordings.units import shared

Array = NDArray[np.float64]

__all__ = [
    "ORIGINS",
    "QUARTERS",
    "Fold",
    "Recorded",
    "ends_of",
    "like",
    "quarters",
    "spreads",
    "whole",
]

QUARTERS = 4
"""Parts of the recording that are held out in turn."""
ORIGINS = (0.6, 0.7, 0.8, 0.9)
"""Ends of the first parts of the recording that are learnt from, as shares of T, to judge what
follows them."""


class Fold(NamedTuple):
    """A part of a recording held out, and what there is to learn from."""

    history: History
    """Recording to learn from."""
    prior: Array
    """State (n,) at which the part begins."""
    outputs: Array
    """Outputs (N, p) of the part."""
    truth: Array
    """States (N, n) that they are to show."""
    spans: list[int]
    """Numbers of estimates per error, each at most N."""
    spread: Array
    """What errors of the states (n,) are relative to."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What settings are chosen from: the recording that is cut up, and what is said beside it."""

    history: History
    """All recordings."""
    longest: int
    """Which of them is cut up."""
    extra: Array
    """Standard deviation (p,) to add to recorded outputs so that they are as noisy as the online
    ones."""
    output_noise: ArrayLike | None = None
    """That of the online outputs, as stated."""
    equilibrium: tuple[ArrayLike, ArrayLike] | None = None
    """A known rest (x_e, y_e)."""

    @cached_property
    def x(self) -> Array:
        """States (T+1, n) of the longest recording."""
        return self.history.recordings[self.longest][0]

    @cached_property
    def y(self) -> Array:
        """Outputs (T, p) of the longest recording."""
        return self.history.recordings[self.longest][1]

    @cached_property
    def others(self) -> list[History]:
        """The other recordings."""
        pairs = enumerate(self.history.recordings)
        return [like(self.history, x, y) for i, (x, y) in pairs if i != self.longest]

    @cached_property
    def spread(self) -> Array:
        """What errors of the states (n,) are relative to."""
        return spreads(self.x, self.history.x_units)

    def noisy(self, seed: int) -> Array:
        """The outputs (T, p), as noisy as the online ones."""
        rng = np.random.default_rng(seed)
        return np.asarray(self.y + self.extra * rng.standard_normal(self.y.shape))


def spreads(values: Array, units: list[str]) -> Array:
    """Standard deviation of each column, those of one unit pooled; 1 for one that never moved."""
    spread = np.sqrt(shared(np.var(values, axis=0), units))
    return np.where(spread > 0, spread, 1.0)


def like(history: History, x: Array, y: Array) -> History:
    """Another recording of the same channels."""
    return History(x, y, history.dt, x_units=history.x_units, y_units=history.y_units)


def whole(recorded: Recorded) -> Fold:
    """All recordings, and nothing that follows them: what an estimator's map is judged by."""
    h = recorded.history
    none = (np.zeros((0, h.p)), np.zeros((0, h.n)))
    return Fold(h, h.recordings[-1][0][-1], *none, [], recorded.spread)


def quarters(recorded: Recorded) -> list[Fold]:
    """Each quarter of the longest recording held out once; what was recorded right before it comes
    last."""
    history, x, y = recorded.history, recorded.x, recorded.y
    noisy = recorded.noisy(0)
    T = len(y)
    folds = []
    for q in range(QUARTERS):
        a, z = q * T // QUARTERS, (q + 1) * T // QUARTERS
        rest = [like(history, x[i : j + 1], y[i:j]) for i, j in ((z, T), (0, a)) if j - i >= 2]
        learnt = History.concat(recorded.others + rest)
        truth = x[a + 1 : z + 1]
        folds.append(Fold(learnt, x[a], noisy[a:z], truth, [z - a], recorded.spread))
    return folds


def ends_of(recorded: Recorded) -> list[Fold]:
    """What follows first parts of the longest recording, learnt from them and from the other
    recordings."""
    history, x, y = recorded.history, recorded.x, recorded.y
    noisy = recorded.noisy(1)
    folds = []
    for share in ORIGINS:
        k = int(share * len(y))
        learnt = History.concat([*recorded.others, like(history, x[: k + 1], y[:k])])
        folds.append(Fold(learnt, x[k], noisy[k:], x[k + 1 :], [len(y) - k], recorded.spread))
    return folds
