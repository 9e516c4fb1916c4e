"""Cells that hold more than a number: units behind it, durations, several numbers in brackets,
digits of a time of the day. Where all cells of a column are alike, they are made plain, and it is
said."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ddmhe.checks import shown
from ddmhe.recordings.cells import number, says_nothing
from ddmhe.recordings.table import Cells, Table
from ddmhe.recordings.time_units import is_time_name, unit_in_name, unit_word
from ddmhe.recordings.units import is_unit

__all__ = ["with_plain_clock", "with_plain_durations", "with_plain_units", "with_plain_vectors"]

_ISO = re.compile(r"\s*PT(?=\d)(?:(\d+)H)?(?:(\d+)M)?(?:(\d+(?:[.,]\d+)?)S)?\s*\Z")
_DURATION = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([a-zµμ]+)\s*\Z")
_WITH_UNIT = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*([^\s\d.,+-].*?)\s*\Z")
_VECTOR = re.compile(r"\s*[\[({]([^\[\](){}]*)[\])}]\s*\Z")
_CLOCK = re.compile(r"\s*(\d\d)([0-5]\d)([0-5]\d)(?:\.(\d{1,9}))?\s*\Z")
ON_TIME = 1.5
"""Steps over a minute's end that are at most so many usual ones go on as before."""


def with_plain_units(table: Table, names: Sequence[str]) -> Table:
    """The columns of these names whose cells are numbers with one unit behind them, as numbers;
    empty cells stay."""
    units, columns, told = dict(table.units), list(table.columns), []
    for name in names:
        k = table.index(name)
        cells = None if k is None else table.columns[k]
        if k is None or cells is None or isinstance(cells, np.ndarray):
            continue
        first = next((cell for cell in cells if not says_nothing(cell)), "")
        if _WITH_UNIT.match(first) is None:
            continue
        found = [None if says_nothing(cell) else _WITH_UNIT.match(cell) for cell in cells]
        every = {match[2] for match in found if match is not None}
        full = sum(match is not None for match in found)
        if len(every) != 1 or full < sum(not says_nothing(cell) for cell in cells):
            continue
        unit = every.pop()
        if not is_unit(unit):
            continue
        pairs = zip(cells, found, strict=True)
        columns[k] = [cell if match is None else match[1] for cell, match in pairs]
        units[table.header[k]] = unit
        told.append(f"{unit} in the cells of {shown(name)}")
    if not told:
        return table
    return replace(table, columns=columns, units=units, alone=False).noted(*told)


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
    if not told:
        return table
    return replace(table, columns=columns, units=units, alone=False).noted(*told)


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


def with_plain_vectors(table: Table, asked: Sequence[str]) -> Table:
    """The table with columns whose cells are lists of equally many numbers, like "[0.8, 0.2]", as
    one column an entry, `name[0]`, `name[1]`, …, where such a column is asked for."""
    wanted = {match[1] for name in asked if (match := re.match(r"(.+)\[\d+\]\Z", name))}
    header: list[str] = []
    columns: list[Cells] = []
    told = []
    for name, cells in zip(table.header, table.columns, strict=True):
        parts = None if name not in wanted or isinstance(cells, np.ndarray) else _entries(cells)
        if parts is None:
            header.append(name)
            columns.append(cells)
            continue
        header += [f"{name}[{k}]" for k in range(len(parts))]
        columns += parts
        told.append(f"{len(parts)} numbers in each cell of {shown(name)}")
    if not told:
        return table
    return replace(table, header=header, columns=columns, alone=False).noted(*told)


def _entries(cells: Sequence[str]) -> list[list[str]] | None:
    """Entries by their number; None where a cell is no list of as many numbers as the others."""
    found = [_VECTOR.match(cell) for cell in cells]
    rows = [re.split(r"[,;\s]+", match[1].strip()) for match in found if match is not None]
    size = len(rows[0]) if rows else 0
    if len(rows) < len(cells) or not all(len(row) == size for row in rows):
        return None
    if any(number(cell) is None for row in rows for cell in row):
        return None
    return [list(column) for column in zip(*rows, strict=True)]


def with_plain_clock(table: Table, time: str | None) -> Table:
    """The table with times of the day like 115958.02, as receivers of satellites write them, as
    11:59:58.02: where a column of times goes on from …59 to …00 without a break, as no number of
    seconds does. Within one minute both readings have the same steps."""
    for k, (name, cells) in enumerate(zip(table.header, table.columns, strict=True)):
        asked = name == time or (time is None and is_time_name(name))
        if isinstance(cells, np.ndarray) or not asked or unit_in_name(name) or table.unit(name):
            continue
        found = [_CLOCK.match(cell) for cell in cells]
        parts = [match.groups() for match in found if match is not None]
        if len(parts) < len(cells) or len(parts) < 3 or not _goes_on(parts):
            continue
        columns = list(table.columns)
        columns[k] = [f"{h}:{m}:{s}" + (f".{f}" if f else "") for h, m, s, f in parts]
        told = f"hours, minutes and seconds in the digits of {shown(name)}"
        return replace(table, columns=columns, alone=False).noted(told)
    return table


def _goes_on(parts: Sequence[Sequence[str | None]]) -> bool:
    """Whether a minute's end is passed, and no longer a step than others are."""
    minutes = np.array([60 * int(h or 0) + int(m or 0) for h, m, _, _ in parts])
    t = 60 * minutes + np.array([float(f"{s}.{f or 0}") for _, _, s, f in parts])
    steps, passing = np.diff(t), np.diff(minutes) == 1
    return bool((steps[passing] <= ON_TIME * np.median(steps)).any()) and np.median(steps) < 10
