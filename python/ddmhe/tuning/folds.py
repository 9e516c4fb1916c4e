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
    "known",
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
    inputs: Array | None
    """Known inputs (N, m) of the part; None for a system without."""
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
    equilibrium: tuple[ArrayLike, ...] | None = None
    """A known rest (x_e, y_e), with u_e for a system with inputs."""

    @cached_property
    def x(self) -> Array:
        """States (T+1, n) of the longest recording."""
        return self.history.recordings[self.longest][0]

    @cached_property
    def y(self) -> Array:
        """Outputs (T, p) of the longest recording."""
        return self.history.recordings[self.longest][1]

    @cached_property
    def u(self) -> Array:
        """Known inputs (T, m) of the longest recording; m = 0 for a system without."""
        return self.history.inputs[self.longest]

    @cached_property
    def others(self) -> list[History]:
        """The other recordings."""
        h = self.history
        signals = zip(h.recordings, h.inputs, strict=True)
        return [like(h, x, y, u) for i, ((x, y), u) in enumerate(signals) if i != self.longest]

    def until(self, k: int) -> History:
        """The longest recording up to its output k."""
        return like(self.history, self.x[: k + 1], self.y[:k], self.u[:k])

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


def like(history: History, x: Array, y: Array, u: Array) -> History:
    """Another recording of the same channels; u (T, m) with m = 0 for a system without inputs."""
    x_units, y_units, u_units = history.x_units, history.y_units, history.u_units
    if not history.m:
        return History(x, y, history.dt, x_units=x_units, y_units=y_units)
    return History(x, y, history.dt, u, x_units=x_units, y_units=y_units, u_units=u_units)


def known(u: Array) -> Array | None:
    """Inputs (N, m) as a run takes them: None where m = 0."""
    return u if u.shape[1] else None


def whole(recorded: Recorded) -> Fold:
    """All recordings, and nothing that follows them: what an estimator's map is judged by."""
    h = recorded.history
    y, u, x = (np.zeros((0, size)) for size in (h.p, h.m, h.n))
    return Fold(h, h.recordings[-1][0][-1], y, known(u), x, [], recorded.spread)


def quarters(recorded: Recorded) -> list[Fold]:
    """Each quarter of the longest recording held out once; what was recorded right before it comes
    last."""
    history, x, y, u = recorded.history, recorded.x, recorded.y, recorded.u
    noisy = recorded.noisy(0)
    T = len(y)
    folds = []
    for q in range(QUARTERS):
        a, z = q * T // QUARTERS, (q + 1) * T // QUARTERS
        around = [(i, j) for i, j in ((z, T), (0, a)) if j - i >= 2]
        rest = [like(history, x[i : j + 1], y[i:j], u[i:j]) for i, j in around]
        learnt = History.concat(recorded.others + rest)
        held = noisy[a:z], known(u[a:z]), x[a + 1 : z + 1]
        folds.append(Fold(learnt, x[a], *held, [z - a], recorded.spread))
    return folds


def ends_of(recorded: Recorded) -> list[Fold]:
    """What follows first parts of the longest recording, learnt from them and from the other
    recordings."""
    x, T = recorded.x, len(recorded.y)
    noisy = recorded.noisy(1)
    folds = []
    for share in ORIGINS:
        k = int(share * T)
        learnt = History.concat([*recorded.others, recorded.until(k)])
        held = noisy[k:], known(recorded.u[k:]), x[k + 1 :]
        folds.append(Fold(learnt, x[k], *held, [T - k], recorded.spread))
    return folds
