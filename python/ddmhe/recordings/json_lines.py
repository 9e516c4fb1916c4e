"""Tables from JSON: one object a line, or a list of objects."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ddmhe.checks import reason, shown
from ddmhe.recordings.arrays import frame_table
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.table import Cells, Table
from ddmhe.recordings.text import decode

SPLIT = {"columns", "index", "data"}
"""Keys of a frame as pandas writes it."""

__all__ = ["flat", "json_table", "table_of_objects"]


def json_table(path: str, data: bytes, asked: Sequence[str], encoding: str | None) -> Table:
    """The table of objects, nested ones by their paths; one object of lists is a mapping."""
    text, _ = decode(path, data, encoding)
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError):  # a number may have too many digits
        return table_of_objects(path, list(_lines(path, text)))
    if isinstance(whole, Mapping) and {"columns", "data"} <= set(whole) <= SPLIT:
        return _split(path, whole)
    if isinstance(whole, Mapping) and all(isinstance(v, list) for v in whole.values()):
        return frame_table(path, {k: np.array(v, dtype=object) for k, v in whole.items()}, asked)
    rows = whole if isinstance(whole, list) else [whole]
    if not all(isinstance(row, Mapping) for row in rows):
        raise LogError(f"{path}: expected JSON objects with columns' names as keys, found others")
    return table_of_objects(path, list(enumerate(rows, 1)), "row")


def _split(path: str, whole: Mapping[str, Any]) -> Table:
    """A frame as pandas writes it with orient="split": names, rows, and an index that is left out
    where it counts."""
    names, rows, index = whole["columns"], whole["data"], whole.get("index")
    fits = isinstance(names, list) and isinstance(rows, list) and len(rows) > 0
    if not fits or not all(isinstance(row, list) and len(row) == len(names) for row in rows):
        raise LogError(
            f"{path}: expected rows of as many values as there are columns, found others"
        )
    if isinstance(index, list) and len(index) == len(rows) and index != list(range(len(rows))):
        names, rows = ["index", *names], [[k, *row] for k, row in zip(index, rows, strict=True)]
    objects = [dict(zip(map(str, names), row, strict=True)) for row in rows]
    return table_of_objects(path, list(enumerate(objects, 1)), "row")


def _lines(path: str, text: str) -> Iterator[tuple[int, Any]]:
    for line, words in enumerate(text.split("\n"), 1):
        if not words.strip():
            continue
        try:
            row = json.loads(words)
        except (ValueError, RecursionError) as e:
            raise LogError(
                f"{path}, line {line}: expected a JSON object, found none ({reason(e)})"
            ) from None
        if not isinstance(row, Mapping):
            raise LogError(f"{path}, line {line}: expected a JSON object, found {shown(words)}")
        yield line, row


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
