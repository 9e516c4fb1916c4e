"""A log on even steps, where that is asked for: straight lines between measured values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ddmhe.recordings.cells import column
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.oddities import unwrapped
from ddmhe.recordings.options import Reading
from ddmhe.recordings.order import Order
from ddmhe.recordings.stamps import Stamps
from ddmhe.recordings.table import Table

Array = NDArray[np.float64]

__all__ = ["ON_TIME", "SEEN", "longest_bridge", "resampled", "steps_in"]

BRIDGED = 2.5
"""Between values that are further apart than so many steps, old or new ones, nothing is known."""
MOST = 50_000_000
"""Samples that fit into memory."""
SEEN = 50
"""Steps at the beginning of a log that tell how long its own are: a log that is still being written
has no others."""
ON_TIME = 1e-9
"""Share of a step within which a sample is at its time."""


def longest_bridge(t: Array, dt: float) -> float:
    """How far apart, s, two values may be for a line between them, in a log with rows at t (N,)
    and new steps dt."""
    return BRIDGED * max(float(np.median(np.diff(t[: SEEN + 1]))), dt)


def steps_in(t: Array, dt: float) -> int:
    """How many even steps rows at t (N,) hold, the one at the first row among them."""
    return int((t[-1] - t[0]) / dt + ON_TIME) + 1


def resampled(
    table: Table,
    stamps: Stamps,
    order: Order,
    names: Names,
    how: Reading,
    size: int | None = None,
) -> tuple[Table, Stamps, Order]:
    """The columns that are asked for at even steps of `how.resample` seconds from the first row
    on, with their clock; the first `size` of them, if that is said. States and outputs lie on
    straight lines between measured values, which filters nothing; inputs are held, since they act
    until they change."""
    dt, t = float(how.resample or 0.0), stamps.t - stamps.t[0]
    held = t[-1] / dt
    if not 2 <= held <= MOST:
        raise LogError(
            f"resample: expected a step of which {table.path} has 2 to {MOST}, its {t[-1]:.6g} s "
            f"hold {held:.3g} of {dt:g} s"
        )
    every = np.arange(steps_in(t, dt))[:size]
    grid: Array = np.asarray(dt * every, dtype=np.float64)
    longest = longest_bridge(t, dt)

    def values(name: str) -> Array:
        found = order.take(column(table, name, how.missing))
        return unwrapped(found) if name in how.unwrap else found

    columns = {name: _held(t, values(name), grid, dt) for name in dict.fromkeys(names.input)} | {
        name: _between(t, values(name), grid, longest)
        for name in dict.fromkeys((*names.state, *names.output))
    }
    rows = np.searchsorted(t, grid + ON_TIME * dt, side="right") - 1
    note = f"resampled to {dt:g} s, on straight lines between measured values"
    made = replace(
        table.noted(note + (", inputs held" if names.input else "")),
        header=list(columns),
        columns=list(columns.values()),
        places=table.places[order.rows][rows],
        units={table.header[k]: unit for k, unit in _units(table, list(columns))},
    )
    return made, stamps.after(dt, every), Order(every, None, every, order.notes)


def _units(table: Table, names: Sequence[str]) -> list[tuple[int, str]]:
    found = [(table.index(name), table.unit(name)) for name in names]
    return [(k, unit) for k, unit in found if k is not None and unit]


def _between(t: Array, values: Array, grid: Array, longest: float) -> Array:
    """Values on straight lines; NaN outside of the measured ones, and where they are too far
    apart."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == 0:
        return np.full(len(grid), np.nan)
    at = t[known]
    after = np.clip(np.searchsorted(at, grid), 0, known.size - 1)
    before = np.clip(after - 1, 0, known.size - 1)
    near = (at[after] - at[before] <= longest) | (at[after] == grid)
    inside = (grid >= at[0]) & (grid <= at[-1])
    found = np.interp(grid, at, values[known])
    return np.where(near & inside, found, np.nan)


def _held(t: Array, values: Array, grid: Array, dt: float) -> Array:
    """The latest value; NaN where that was not measured."""
    return np.asarray(values[np.searchsorted(t, grid + ON_TIME * dt, side="right") - 1])
