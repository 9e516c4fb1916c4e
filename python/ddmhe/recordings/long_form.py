"""Logs with one value a row, beside its name and its time, as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ddmhe.checks import shown
from ddmhe.recordings.cells import number
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.stamp_texts import is_stamp
from ddmhe.recordings.table import Cells, Table
from ddmhe.recordings.time_units import is_time_name

__all__ = ["with_wide_form"]

LOOKED_AT = 100
"""Cells that are looked at for times."""


def with_wide_form(table: Table, asked: Sequence[str], time: str | None) -> Table:
    """The table with a column for each of the names that are asked for, where these stand in the
    cells of one column and one other holds numbers; as it is for others."""
    if not asked or any(name in table.header for name in asked) or len(table) == 0:
        return table
    texts = {n: [str(cell).strip() for cell in c] for n, c in _columns(table).items()}
    changing = {name: cells for name, cells in texts.items() if len(set(cells)) > 1}
    wanted = [name for name in asked if name != time]
    naming = [name for name, cells in changing.items() if set(wanted) <= set(cells)]
    clocks = [n for n in changing if n == time or (time is None and is_time_name(n))]
    if time is None and not clocks:
        clocks = [n for n, cells in changing.items() if all(map(is_stamp, cells[:LOOKED_AT]))]
    values = [
        name
        for name, cells in changing.items()
        if name not in (*naming, *clocks) and all(number(c, ",") is not None or
                                                  number(c) is not None for c in cells)
    ]  # fmt: skip
    if len(naming) != 1 or len(clocks) != 1 or len(values) != 1:
        return table
    names, times, cells = changing[naming[0]], changing[clocks[0]], changing[values[0]]
    rows = {stamp: k for k, stamp in enumerate(dict.fromkeys(times))}
    first = {stamp: k for k, stamp in reversed(list(enumerate(times)))}
    columns = {name: [""] * len(rows) for name in wanted}
    for k, (name, stamp, cell) in enumerate(zip(names, times, cells, strict=True)):
        if name not in columns:
            continue
        if columns[name][rows[stamp]]:
            raise LogError(
                f"{table.path}, {table.place} {table.places[k]}: expected one value of "
                f"{shown(name)} at {shown(stamp)}, found another"
            )
        columns[name][rows[stamp]] = cell
    at = np.array([first[stamp] for stamp in rows], dtype=np.intp)
    return replace(
        table.noted(f"a value a row: names in {shown(naming[0])}, values in {shown(values[0])}"),
        header=[clocks[0], *columns],
        columns=[list(rows), *columns.values()],
        places=table.places[at],
        units={k: unit for k, unit in table.units.items() if k == clocks[0]},
        alone=False,
    )


def _columns(table: Table) -> dict[str, Cells]:
    every = zip(table.header, table.columns, strict=True)
    return {name: cells for name, cells in every if table.header.count(name) == 1}
