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

__all__ = ["resampled"]

BRIDGED = 2.5
"""Between values that are further apart than so many steps, old or new ones, nothing is known."""
MOST = 50_000_000
"""Samples that fit into memory."""
ON_TIME = 1e-9
"""Share of a step within which a sample is at its time."""


def resampled(
    table: Table, stamps: Stamps, order: Order, names: Names, how: Reading
) -> tuple[Table, Stamps, Order]:
    """The columns that are asked for at even steps of `how.resample` seconds from the first row
    on, with their clock. States and outputs lie on straight lines between measured values, which
    filters nothing; inputs are held, since they act until they change."""
    dt, t = float(how.resample or 0.0), stamps.t - stamps.t[0]
    size = t[-1] / dt
    if not 2 <= size <= MOST:
        raise LogError(
            f"resample: expected a step of which {table.path} has 2 to {MOST}, its {t[-1]:.6g} s "
            f"hold {size:.3g} of {dt:g} s"
        )
    grid: Array = np.asarray(dt * np.arange(int(size + ON_TIME) + 1), dtype=np.float64)
    longest = BRIDGED * max(float(np.median(np.diff(t))), dt)

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
    every = np.arange(len(grid))
    return made, stamps.after(grid), Order(every, None, every, order.notes)


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
