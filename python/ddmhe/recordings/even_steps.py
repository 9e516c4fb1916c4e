"""A log that is still being written, on even steps: each is settled by the first rows after it.

The same numbers as `resampled` makes of the whole log: what it takes from rows that are still to
come is waited for, nothing else."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.recordings.resampled import ON_TIME, longest_bridge, steps_in

Array = NDArray[np.float64]

__all__ = ["EvenSteps", "Sample", "settled"]


class Sample(NamedTuple):
    """A step that no later row can change."""

    number: int
    """From 0, the first row of the log."""
    y: Array
    """Outputs (p,), NaN where nothing is known."""
    u: Array | None
    """Known inputs (m,)."""


def settled(t: Array, measured: Array, dt: float, held: bool) -> int:
    """How many steps of dt from t[0] on are settled by rows at t (N,), whose columns (N, c) of
    states and outputs are NaN where not measured; `held`: whether there are inputs as well."""
    t = t - t[0]
    grid = dt * np.arange(steps_in(t, dt))
    longest = longest_bridge(t, dt)
    sizes = [np.searchsorted(grid + ON_TIME * dt, t[-1])] if held else []
    for column in measured.T:
        at = t[np.isfinite(column)]
        waiting = at.size > 0 and t[-1] - at[-1] <= longest
        sizes.append(np.searchsorted(grid, at[-1] if waiting else t[-1], side="right"))
    return int(min(sizes))


@dataclass
class EvenSteps:
    """What is needed of earlier rows; plain values, so that it can be stored."""

    dt: float
    """The steps, s."""
    longest: float
    """Between values that are further apart, s, nothing is known."""
    next: int
    """Number of the first step that is not settled."""
    times: list[list[float]]
    """Of each output when it was measured, s from the first row on; from the last time before
    the next step on."""
    values: list[list[float]]
    """What was measured then."""
    since: list[float]
    """When inputs were set, s."""
    inputs: list[list[float]]
    """To what."""
    begin: float
    """Time of the first row, s."""
    latest: float = 0.0
    """Time of the last row, s from the first one on."""

    @classmethod
    def of(cls, t: Array, y: Array, u: Array | None, dt: float, first: int) -> EvenSteps:
        """Behind rows at t (N,) with outputs (N, p) and inputs (N, m), from step `first` on."""
        times: list[list[float]] = [[] for _ in y.T]
        values: list[list[float]] = [[] for _ in y.T]
        made = cls(dt, longest_bridge(t, dt), first, times, values, [], [], float(t[0]))
        for k in range(len(t)):
            made.add(float(t[k]), y[k], None if u is None else u[k])
        made._forget()
        return made

    def add(self, t: float, y: Array, u: Array | None) -> None:
        """A row at t, s."""
        t -= self.begin
        for k in np.flatnonzero(np.isfinite(y)).tolist():
            self.times[k].append(t)
            self.values[k].append(float(y[k]))
        if u is not None:
            self.since.append(t)
            self.inputs.append(u.tolist())
        self.latest = t

    def take(self, ended: bool = False) -> Iterator[Sample]:
        """The steps that are settled now; if the log has ended, all that it holds."""
        while True:
            g = self.dt * self.next
            late = self.next > int(self.latest / self.dt + ON_TIME) if ended else g > self.latest
            held = self.since and not ended and not self.latest > g + ON_TIME * self.dt
            if late or held:
                return
            y = [self._between(k, g, ended) for k in range(len(self.times))]
            if None in y:
                return
            u = None
            if self.since:
                row = bisect_right(self.since, g + ON_TIME * self.dt) - 1
                u = np.array(self.inputs[row])
            yield Sample(self.next, np.array(y, dtype=np.float64), u)
            self.next += 1
            self._forget()

    def _between(self, k: int, g: float, ended: bool) -> float | None:
        """An output at time g; None where a row to come may tell it."""
        at, values = self.times[k], self.values[k]
        after = bisect_left(at, g)
        if after == len(at):
            waiting = not ended and at and self.latest - at[-1] <= self.longest
            return None if waiting else np.nan
        if at[after] == g:
            return values[after]
        if after == 0 or at[after] - at[after - 1] > self.longest:
            return np.nan
        pair = slice(after - 1, after + 1)
        return float(np.interp(g, at[pair], values[pair]))

    def _forget(self) -> None:
        """Leaves out what no later step needs."""
        g = self.dt * self.next
        for at, values in zip(self.times, self.values, strict=True):
            old = bisect_left(at, g) - 1
            if old > 0:
                del at[:old], values[:old]
        old = bisect_right(self.since, g + ON_TIME * self.dt) - 1
        if old > 0:
            del self.since[:old], self.inputs[:old]
