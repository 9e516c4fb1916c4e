"""Which column of a table is its clock: the one that is named, or says so itself, or else the first
one if that can be nothing else. A counter is none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ddmhe.checks import MOST_LISTED, listed, shown
from ddmhe.recordings.cells import number
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.stamp_texts import is_stamp
from ddmhe.recordings.table import Cells, Table
from ddmhe.recordings.time_units import epoch_unit, is_time_name, unit_in_name, unit_word
from ddmhe.recordings.units import unit_of

__all__ = ["time_column"]

LOOKED_AT = 2000
"""Cells of a column that are looked at."""
ONE_WAY, SHARED = 0.75, 0.1
"""A column of which fewer steps go one way, or of which fewer move at all, is no clock, whatever
its name."""
RISING = 0.9
"""Share of steps upwards that a clock's column has at least."""


def time_column(table: Table, asked: Names, time: str | None) -> tuple[str, str]:
    """The name of the clock's column, and how it is known; LogError where none is."""
    if time is not None:
        name = table.header[table.find("time", time)]
        _not_asked(table, asked, name)
        return time, ""
    every = (*asked.state, *asked.output, *asked.input)
    own = {table.header[k] for k in map(table.index, every) if k is not None}
    named = [name for name in table.header if is_time_name(name) and name not in own]
    for name in named:
        table.find("time", name)  # once in the header
    named = [name for name in named if not _stays(table, name)]
    if len(named) > 1:
        named = _clearest(table, named)
    if len(named) > 1:
        raise LogError(
            f"{table.path}: columns {', '.join(map(shown, named[:MOST_LISTED]))} may each be the "
            "clock; --time says which"
        )
    if named:
        return named[0], "time column"
    stated = [n for n in table.header if n not in own and _states_time(table, n)]
    if len(stated) == 1:
        return stated[0], "time column (by its unit)"
    single = [n for n in table.header if n not in own and table.header.count(n) == 1]
    for sure in (_tells, _since_epoch):
        found = [name for name in single if sure(table, name)]
        if len(found) == 1:
            return found[0], "time column"
    return _first(table, own, asked)


def _states_time(table: Table, name: str) -> bool:
    """Whether a column has a unit of time, and rises as a clock does."""
    unit = (table.unit(name) or unit_of(name)) if table.header.count(name) == 1 else ""
    return unit_word(unit) in ("s", "ms", "us", "ns", "min") and _runs(table, name)


def _first(table: Table, own: set[str], asked: Names) -> tuple[str, str]:
    """The first column, if it runs as a clock does."""
    name = table.header[0]
    taken = [column for column in table.header if column in own and is_time_name(column)]
    if taken:
        _not_asked(table, asked, taken[0])
    unit = table.units.get(name) or unit_of(name)
    if table.header.count(name) > 1:
        table.find("time", name)  # says so
    other = name in own or (unit and unit_word(unit) is None)
    values = None if other else _numbers(table.columns[0], table.decimal)
    if values is None or values.size < 2 or not np.all(np.isfinite(values)):
        raise LogError(
            f"{table.path}: no column is known as the time (columns: {listed(table.header)}); "
            "--time NAME says which one is, --dt SECONDS stands for one"
        )
    steps = np.diff(values)
    if np.all(values == np.rint(values)) or not np.mean(steps > 0) > RISING:
        raise LogError(
            f"{table.path}: no column is known as the time; the first, {shown(name)}, holds "
            f"{', '.join(f'{v:.10g}' for v in values[:3])}, … and may count rows: --dt SECONDS "
            "states their step, or --time NAME and --time-unit say which column is the clock"
        )
    return name, "time column (the first, by its values)"


def _not_asked(table: Table, asked: Names, name: str) -> None:
    """LogError if the clock's column is a state, output or input."""
    groups = {"state": asked.state, "output": asked.output, "input": asked.input}
    for option, group in groups.items():
        for given in group:
            found = table.index(given)
            if found is not None and table.header[found] == name:
                raise LogError(
                    f"{option}: expected columns other than the time column, found "
                    f"{shown(given)}; for a log without times --dt SECONDS states the step"
                )


def _clearest(table: Table, named: Sequence[str]) -> list[str]:
    """Of columns named like clocks the one that runs as a clock, and says its unit."""
    running = [name for name in named if _runs(table, name)] or list(named)
    running = [name for name in running if not _counts(table, name)] or running

    def clear(name: str) -> bool:
        unit = table.unit(name)
        stated = unit_in_name(name) or (unit and unit_word(unit))
        return bool(stated or _tells(table, name) or _since_epoch(table, name))

    return [name for name in running if clear(name)][:1] or running


def _counts(table: Table, name: str) -> bool:
    """Whether a column counts rows one by one, without a unit."""
    values = _numbers(table.column(name), table.decimal)
    stated = table.unit(name) or unit_in_name(name)
    return values is not None and not stated and bool(np.all(np.diff(values) == 1))


def _numbers(cells: Cells, decimal: str) -> np.ndarray | None:
    """The first cells as numbers; None if one is none."""
    if isinstance(cells, np.ndarray):
        return np.asarray(cells[:LOOKED_AT], float) if cells.dtype.kind in "fiu" else None
    values = [number(cell, decimal) for cell in cells[:LOOKED_AT]]
    return None if None in values else np.array(values, dtype=np.float64)


def _stays(table: Table, name: str) -> bool:
    """Whether a column of numbers neither rises nor falls as a clock does."""
    values = _numbers(table.column(name), table.decimal)
    if values is None or values.size < 3:
        return False
    steps = np.diff(values)
    moving = steps[steps != 0]  # rows may share a stamp
    if moving.size < SHARED * steps.size:
        return True
    return bool(max(np.mean(moving > 0), np.mean(moving < 0)) < ONE_WAY)


def _runs(table: Table, name: str) -> bool:
    if _tells(table, name):
        return True
    values = _numbers(table.column(name), table.decimal)
    return values is not None and values.size > 1 and bool(np.mean(np.diff(values) > 0) > RISING)


def _tells(table: Table, name: str) -> bool:
    """Whether a column tells dates or times of the day."""
    cells = table.column(name)
    if isinstance(cells, np.ndarray):
        return cells.dtype.kind in "mM"
    return bool(cells) and all(is_stamp(cell) for cell in cells[:3])


def _since_epoch(table: Table, name: str) -> bool:
    values = _numbers(table.column(name), table.decimal)
    if values is None or values.size < 2 or not np.isfinite(values).all():
        return False
    return epoch_unit(values) is not None and bool(np.mean(np.diff(values) > 0) > RISING)
