"""Which column of a table is its clock: the one that is named, or says so itself, or else the first
one if that can be nothing else. A counter is none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ddmhe.checks import MOST_LISTED, listed, shown
from ddmhe.recordings.cells import number
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.stamp_texts import is_stamp
from ddmhe.recordings.table import Cells, Table
from ddmhe.recordings.time_units import epoch_unit, is_time_name, unit_in_name, unit_word
from ddmhe.recordings.units import unit_of

__all__ = ["time_column", "with_joined_time", "with_plain_durations"]

LOOKED_AT = 2000
"""Cells of a column that are looked at."""
HALF = 0.5
"""A column of which fewer steps go one way is no clock, whatever its name."""
RISING = 0.9
"""Share of steps upwards that a clock's column has at least."""
_SECONDS = re.compile(r"(?P<stem>.*?)(?P<word>secs?|seconds)\Z", re.IGNORECASE)
_NANOS = ("nanos", "nsec", "nsecs", "nanosec", "nanoseconds", "nanosecs")
_JOINED = "time"
_ISO = re.compile(r"\s*PT(?=\d)(?:(\d+)H)?(?:(\d+)M)?(?:(\d+(?:[.,]\d+)?)S)?\s*\Z")
_DURATION = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([a-zµμ]+)\s*\Z")


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
    single = [n for n in table.header if n not in own and table.header.count(n) == 1]
    for sure in (_tells, _since_epoch):
        found = [name for name in single if sure(table, name)]
        if len(found) == 1:
            return found[0], "time column"
    return _first(table, own, asked)


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

    def clear(name: str) -> bool:
        unit = table.unit(name)
        stated = unit_in_name(name) or (unit and unit_word(unit))
        return bool(stated or _tells(table, name) or _since_epoch(table, name))

    return [name for name in running if clear(name)][:1] or running


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
    return bool(max(np.mean(steps > 0), np.mean(steps < 0)) < HALF)


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


def with_plain_durations(table: Table) -> Table:
    """The table with times like "0.02 sec" as numbers, whose unit is said."""
    units, columns, told = dict(table.units), list(table.columns), []
    for k, (name, cells) in enumerate(zip(table.header, table.columns, strict=True)):
        if not isinstance(cells, np.ndarray) and cells and (is_time_name(name) or k == 0):
            iso = _iso_seconds(cells)
            if iso is not None:
                columns[k], units[name] = iso, "s"
                told.append(f"ISO durations in the cells of {shown(name)}")
                continue
        first = None if isinstance(cells, np.ndarray) or not cells else _DURATION.match(cells[0])
        if first is None or not (is_time_name(name) or k == 0) or unit_word(first[2]) is None:
            continue
        found = [_DURATION.match(cell) for cell in cells]
        if all(match is not None and match[2] == first[2] for match in found):
            columns[k] = [match[1] for match in found if match is not None]
            units[name] = first[2]
            told.append(f"{first[2]} in the cells of {shown(name)}")
    return replace(table, columns=columns, units=units).noted(*told) if told else table


def _iso_seconds(cells: Sequence[str]) -> list[str] | None:
    """Seconds of durations like PT1M3.02S; None where a cell is none."""
    if _ISO.match(cells[0]) is None:
        return None
    found = [_ISO.match(cell) for cell in cells]
    parts = [match.groups(default="0") for match in found if match is not None]
    if len(parts) < len(cells):
        return None
    whole = [3600 * int(h) + 60 * int(m) for h, m, _ in parts]
    return [
        f"{w + float(s.replace(',', '.')):.12g}" for w, (_, _, s) in zip(whole, parts, strict=True)
    ]


def with_joined_time(table: Table) -> Table:
    """The table with a column that joins two: a date and a time of the day, or seconds and
    nanoseconds; as it is without such a pair."""
    joined = _date_and_clock(table) or _seconds_and_nanos(table)
    if joined is None:
        return table
    names, cells = joined
    name = _JOINED
    while name in table.header:
        name += "_"
    kept = [k for k, known in enumerate(table.header) if known not in names]
    header = [name, *(table.header[k] for k in kept)]
    columns = [cells, *(table.columns[k] for k in kept)]
    units = {k: v for k, v in table.units.items() if k not in names}
    told = f"time of columns {' and '.join(map(shown, names))}"
    return replace(table, header=header, columns=columns, units=units).noted(told)


def _date_and_clock(table: Table) -> tuple[tuple[str, str], list[str]] | None:
    texts = {
        name: column
        for name, column in zip(table.header, table.columns, strict=True)
        if not isinstance(column, np.ndarray) and column and is_stamp(column[0])
    }
    dates = [name for name, cells in texts.items() if ":" not in cells[0]]
    clocks = [name for name, cells in texts.items() if is_stamp(f"2000-01-01 {cells[0]}")]
    if len(dates) != 1 or len(clocks) != 1:
        return None
    pair = zip(texts[dates[0]], texts[clocks[0]], strict=True)
    return (dates[0], clocks[0]), [f"{day.strip()} {clock.strip()}" for day, clock in pair]


def _seconds_and_nanos(table: Table) -> tuple[tuple[str, str], list[str]] | None:
    """As messages of ROS hold a stamp: whole seconds, and nanoseconds below one second."""
    for name in table.header:
        found = _SECONDS.match(name)
        if found is None or (found["stem"] and found["stem"][-1].isalnum()):
            continue
        every = [found["stem"] + word for word in _NANOS]
        beside = [name for name in every for _ in range(table.header.count(name))]
        if len(beside) != 1 or table.header.count(name) > 1:
            continue
        whole, part = table.column(name), table.column(beside[0])
        try:
            pairs = [(int(s), int(n)) for s, n in zip(whole, part, strict=True)]
        except (ValueError, OverflowError):
            continue
        of_floats = [c for c in (whole, part) if isinstance(c, np.ndarray) and c.dtype.kind == "f"]
        if any((column != np.rint(column)).any() for column in of_floats):
            continue
        if all(0 <= n < 10**9 and s >= 0 for s, n in pairs):
            return (name, beside[0]), [f"{s}.{n:09d}" for s, n in pairs]
    return None
