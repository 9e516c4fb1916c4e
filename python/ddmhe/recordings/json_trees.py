"""Tables inside one JSON value: arrays by name in nested objects, rows below or beside their names,
lists of objects, series of pairs. Which one is meant is told by the columns that are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.arrays import DEEPEST, array_table
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.table import Cells, Table

__all__ = ["flat", "table_in", "table_of_objects"]

ROWS = 2
"""Fewest rows of what is taken as a table."""


def table_in(path: str, tree: Any, asked: Sequence[str]) -> Table:
    """The table in a tree of objects and lists that has the columns asked for, or the largest."""
    found = list(_tables(path, tree, asked, 0))
    fitting = [table for table in found if all(table.index(name) is not None for name in asked)]
    if len(fitting) > 1:
        raise LogError(
            f"{path}: expected one table with the columns asked for, found {len(fitting)}; write "
            "the one that is meant as JSON lines"
        )
    if not found and isinstance(tree, Mapping):
        return table_of_objects(path, [(1, tree)], "row")
    if not found:
        raise LogError(f"{path}: expected JSON objects with columns' names as keys, found others")
    return fitting[0] if fitting else max(found, key=lambda table: len(table) * len(table.header))


def _tables(path: str, tree: Any, asked: Sequence[str], deep: int) -> Iterator[Table]:
    """Every table of a tree, those further out first."""
    if deep > DEEPEST or not isinstance(tree, Mapping | list):
        return
    if isinstance(tree, Mapping):
        arrays = dict(_arrays(tree))
        if arrays:
            table = array_table(path, arrays, asked)
            yield table
            if all(table.index(name) is not None for name in asked):
                return
        objects = _rows_by_keys(tree, asked) or _rows_beside_names(tree)
    else:
        objects = _rows_below_names(tree)
        if len(tree) >= ROWS and all(isinstance(row, Mapping) for row in tree):
            series = _series(path, tree, asked)
            yield (
                table_of_objects(path, list(enumerate(tree, 1)), "row")
                if series is None
                else (series)
            )
            return
    if objects:
        yield table_of_objects(path, list(enumerate(objects, 1)), "row")
        return
    for inner in tree.values() if isinstance(tree, Mapping) else tree:
        yield from _tables(path, inner, asked, deep + 1)


def _arrays(tree: Mapping[Any, Any], above: str = "", deep: int = 0) -> Iterator[Any]:
    """Lists of values, and of equally many numbers, by their paths."""
    for key, value in tree.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping) and deep < DEEPEST:
            yield from _arrays(value, f"{name}.", deep + 1)
        elif isinstance(value, list) and len(value) >= ROWS:
            if not any(isinstance(entry, Mapping | list) for entry in value):
                yield name, np.array(value, dtype=object)
            elif (matrix := _matrix(value)) is not None:
                yield name, matrix


def _matrix(rows: list[Any]) -> NDArray[np.float64] | None:
    """Rows of equally many numbers; None for others."""
    if not all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows):
        return None
    if not all(type(cell) in (int, float, type(None)) for row in rows for cell in row):
        return None
    return np.array([[np.nan if c is None else c for c in row] for row in rows], dtype=float)


def _rows_by_keys(tree: Mapping[Any, Any], asked: Sequence[str]) -> list[dict[str, Any]]:
    """{"t": {"0": 0, "1": 0.02}, "w1": …}, a column a key, or {"0": {"t": 0, "w1": 0.8}, …}, a row
    a key, which may be its time: as pandas writes frames."""
    entries = list(tree.values())
    if not entries or not all(isinstance(entry, Mapping) for entry in entries):
        return []
    keys = list(entries[0])
    alike = all(list(entry) == keys for entry in entries)
    if alike and len(keys) >= ROWS and set(asked) <= set(tree):
        return [{name: tree[name][key] for name in tree} for key in keys]
    if len(tree) < ROWS or not set(asked) <= set(keys):
        return []
    counted = list(tree) == [str(k) for k in range(len(tree))]
    return [({} if counted else {"index": key}) | dict(row) for key, row in tree.items()]


def _rows_beside_names(tree: Mapping[Any, Any]) -> list[dict[str, Any]]:
    """{"columns": ["t", "w1"], "data": [[0, 0.8], …]}, whatever the keys are."""
    lists = [value for value in tree.values() if isinstance(value, list) and value]
    names = [value for value in lists if all(isinstance(name, str) for name in value)]
    for header in names:
        for rows in lists:
            wide = all(isinstance(row, list) and len(row) == len(header) for row in rows)
            if wide and len(rows) >= ROWS and len(set(header)) == len(header):
                return [dict(zip(header, row, strict=True)) for row in rows]
    return []


def _rows_below_names(tree: list[Any]) -> list[dict[str, Any]]:
    """[["t", "w1"], [0, 0.8], …]."""
    if len(tree) <= ROWS or not isinstance(tree[0], list):
        return []
    return _rows_beside_names({"names": tree[0], "rows": tree[1:]})


def _series(path: str, tree: list[Any], asked: Sequence[str]) -> Table | None:
    """A list of objects, each with a name and pairs of a time and a value, all at the same times;
    None where they are no such series."""
    every = [list(_pairs(entry)) for entry in tree]
    if not all(len(found) == 1 for found in every):
        return None
    pairs = [found[0] for found in every]
    labels = [dict(_labels(entry)) for entry in tree]
    keys = [k for k in labels[0] if len({label.get(k) for label in labels}) == len(tree)]
    keys.sort(key=lambda k: -len({label[k] for label in labels if k in label} & set(asked)))
    if not keys:
        return None
    names = [str(label.get(keys[0])) for label in labels]
    clocks = [p for p in (0, 1) if all(_rises(one, p) for one in pairs)]
    if len(clocks) != 1:
        return None
    at = clocks[0]
    times = [[row[at] for row in one] for one in pairs]
    for name, own in zip(names, times, strict=True):
        if own != times[0]:
            raise LogError(
                f"{path}: expected series at the same times, found others in {shown(name)} than "
                f"in {shown(names[0])}; write one table of them, or ask for one step of both"
            )
    columns: list[Cells] = [[str(time) for time in times[0]]]
    columns += [_column([_plain(row[1 - at]) for row in one]) for one in pairs]
    return Table(path, ["time", *names], columns, np.arange(1, len(times[0]) + 1), "row")


def _pairs(tree: Any) -> Iterator[list[Any]]:
    for value in tree.values() if isinstance(tree, Mapping) else ():
        if isinstance(value, Mapping):
            yield from _pairs(value)
        elif isinstance(value, list) and len(value) >= ROWS and _all_pairs(value):
            yield value


def _all_pairs(rows: list[Any]) -> bool:
    return all(isinstance(row, list) and len(row) == 2 for row in rows)


def _labels(tree: Any) -> Iterator[tuple[str, str]]:
    return ((name, value) for name, value in flat(_without_lists(tree)) if isinstance(value, str))


def _without_lists(tree: Mapping[Any, Any]) -> dict[Any, Any]:
    return {
        key: _without_lists(value) if isinstance(value, Mapping) else value
        for key, value in tree.items()
        if not isinstance(value, list)
    }


def _rises(rows: list[Any], place: int) -> bool:
    values = [row[place] for row in rows]
    if any(not isinstance(v, int | float) or isinstance(v, bool) for v in values):
        return False
    return all(a < b for a, b in pairwise(values))


def _plain(value: Any) -> Any:
    """A number that is written as a text as a number."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def table_of_objects(path: str, rows: Sequence[tuple[int, Any]], place: str = "line") -> Table:
    """A table of nested objects; a key that one lacks is a cell that is not measured."""
    plain = [dict(flat(row)) for _, row in rows]
    header = list(dict.fromkeys(key for row in plain for key in row))
    columns = [_column([row.get(name) for row in plain]) for name in header]
    places = np.array([at for at, _ in rows], dtype=np.int64)
    return Table(path, header, columns, places, place)


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """What nested objects hold, by their paths."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flat(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple):
        for k, inner in enumerate(value):
            yield from flat(inner, f"{name}[{k}]")
    else:
        yield name, value


def _column(values: Sequence[Any]) -> Cells:
    """Whole numbers as such, numbers as floats, the rest as texts."""
    kinds = {type(value) for value in values}
    if kinds == {int} and max(map(abs, values)) < 2**63:
        return np.array(values, dtype=np.int64)
    if kinds <= {int, float, type(None), bool}:
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    return ["" if value is None else str(value) for value in values]
