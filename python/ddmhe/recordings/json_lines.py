"""Tables from JSON: one object a line, or one value that holds a table."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ddmhe.checks import reason, shown
from ddmhe.recordings.arrays import frame_table
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.json_trees import table_in, table_of_objects
from ddmhe.recordings.table import Table
from ddmhe.recordings.text import decode

SPLIT = {"columns", "index", "data"}
"""Keys of a frame as pandas writes it."""

__all__ = ["json_table"]


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
        plain = not any(isinstance(cell, list | Mapping) for v in whole.values() for cell in v)
        if plain:
            arrays = {k: np.array(v, dtype=object) for k, v in whole.items()}
            return frame_table(path, arrays, asked)
    return table_in(path, whole, asked)


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
