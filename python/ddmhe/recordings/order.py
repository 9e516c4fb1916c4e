"""Rows in the order of time: stamps that repeat, that are swapped, or that start anew."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import choice, shown
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.stamps import Stamps
from ddmhe.recordings.table import Table

Array = NDArray[np.float64]

__all__ = ["DUPLICATES", "Order", "ordered", "piece_of"]

DUPLICATES = ("error", "first", "last", "mean")
ANEW = 5
"""Rows that have to stay before an earlier stamp for a clock to have started anew; fewer are
swapped."""


class Order(NamedTuple):
    """Which rows are taken, in the order of time."""

    rows: NDArray[np.intp]
    """Rows (N,) that are kept."""
    groups: NDArray[np.intp] | None
    """Where the rows of one stamp begin in `every` (N,), if their mean is wanted."""
    every: NDArray[np.intp]
    """All rows in the order of time."""
    notes: tuple[str, ...] = ()

    def take(self, values: Array) -> Array:
        """The kept rows of a column, means of known values where rows share a stamp."""
        if self.groups is None:
            return values[self.rows]
        sorted_values = values[self.every]
        known = np.isfinite(sorted_values)
        total = np.add.reduceat(np.where(known, sorted_values, 0.0), self.groups)
        count = np.add.reduceat(known.astype(np.float64), self.groups)
        single = np.diff(np.append(self.groups, len(values))) == 1
        with np.errstate(invalid="ignore"):
            return np.where(single, sorted_values[self.groups], total / count)


def restarts(t: Array) -> NDArray[np.intp]:
    """Rows at which the clock t (N,) starts anew: it falls, and stays below for a while."""
    found = []
    for k in np.flatnonzero(np.diff(t) < 0) + 1:
        after = t[k : k + ANEW]
        if len(after) == ANEW and (after < t[k - 1]).all() and (np.diff(after) >= 0).all():
            found.append(k)
    return np.array(found, dtype=np.intp)


def piece_of(table: Table, stamps: Stamps, number: int) -> tuple[Table, Stamps]:
    """The rows of one piece, from 1, of a log whose clock starts anew."""
    t = stamps.t
    edges = [0, *restarts(t).tolist(), len(t)]
    if not 1 <= number < len(edges):
        raise LogError(
            f"{table.path}#{number}: expected a piece from 1 to {len(edges) - 1}, as often as the "
            f"clock starts, found {number}"
        )
    rows = np.arange(edges[number - 1], edges[number])
    note = f"piece {number} of {len(edges) - 1}"
    return table.rows(rows).noted(note), stamps.rows(rows)


def ordered(table: Table, stamps: Stamps, name: str, duplicates: str, sort: bool) -> Order:
    """The rows in the order of time; LogError where their stamps repeat, fall or start anew and no
    option says what is meant."""
    choice("duplicates", duplicates, DUPLICATES)
    t = stamps.t
    every = np.arange(len(t), dtype=np.intp)
    notes = []
    falls = np.flatnonzero(np.diff(t) < 0) + 1
    if falls.size and sort:
        every = np.argsort(t, kind="stable").astype(np.intp)
        notes.append(f"sorted by time, {int(np.sum(every != np.arange(len(t))))} rows moved")
    elif falls.size:
        raise _falls(table, stamps, name, int(falls[0]))
    repeats = np.append(False, np.diff(t[every]) == 0)
    if not repeats.any():
        return Order(every, None, every, tuple(notes))
    if duplicates == "error":
        raise _repeats(table, stamps, name, every, int(np.argmax(repeats)))
    first = np.flatnonzero(~repeats)
    last = np.append(first[1:], len(t)) - 1
    rows = every[last if duplicates == "last" else first]
    notes.append(f"{int(repeats.sum())} repeated stamps, {duplicates} taken")
    return Order(rows, first if duplicates == "mean" else None, every, tuple(notes))


def _falls(table: Table, stamps: Stamps, name: str, row: int) -> LogError:
    t = stamps.t
    place = f"{table.path}, {table.place} {table.places[row]}, column {shown(name)}"
    seen = f"expected a time after the {t[row - 1]:.10g} s of the {table.place} before, found "
    anew = restarts(t)
    if row in anew:
        pieces = len(anew) + 1
        return LogError(
            f"{place}: {seen}{t[row]:.10g} s; the clock starts anew, so this holds {pieces} "
            f"recordings: {table.path}#1 to #{pieces} name them (--recording {table.path}#1 and "
            f"{table.path}#2 as the log, say), --sort takes all as one"
        )
    return LogError(f"{place}: {seen}{t[row]:.10g} s; --sort puts the rows in the order of time")


def _repeats(table: Table, stamps: Stamps, name: str, every: NDArray[np.intp], k: int) -> LogError:
    row = every[k]
    return LogError(
        f"{table.path}, {table.place} {table.places[row]}, column {shown(name)}: expected a time "
        "after "
        f"the {stamps.t[row]:.10g} s of the {table.place} before, found the same; --duplicates "
        "first, last or mean says which of the rows counts"
    )
