"""Tables from Parquet and Feather, by pyarrow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from ddmhe.checks import reason
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.libraries import library
from ddmhe.recordings.table import Cells, Table

__all__ = ["arrow_table", "feather_table", "parquet_table"]


def parquet_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of a Parquet file."""
    parquet = library("pyarrow.parquet", path, "a Parquet file")
    return _read(path, lambda: parquet.read_table(source), "Parquet")


def feather_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of a Feather or Arrow file."""
    feather = library("pyarrow.feather", path, "a Feather file")
    place = str(source) if isinstance(source, Path) else source
    return _read(path, lambda: feather.read_table(place), "Feather")


def _read(path: str, load: Any, kind: str) -> Table:
    try:
        return arrow_table(path, load())
    except LogError:
        raise
    except Exception as e:  # pyarrow has a class of error for every layer
        raise LogError(f"{path}: expected a whole {kind} file, found another ({reason(e)})") from e


def arrow_table(path: str, table: Any) -> Table:
    """A table of pyarrow: fields of structures by their paths, units from the metadata of fields
    ("unit" or "units")."""
    while any(str(field.type).startswith("struct") for field in table.schema):
        table = table.flatten()
    if table.num_rows == 0:
        raise LogError(f"{path}: expected rows of samples, found none")
    columns = [_cells(column) for column in table.columns]
    units = {}
    for field in table.schema:
        stated = field.metadata or {}
        unit = stated.get(b"unit") or stated.get(b"units")
        if unit:
            units[field.name] = unit.decode("utf-8", "replace")
    places = np.arange(1, table.num_rows + 1)
    return Table(path, list(table.column_names), columns, places, "row", units)


def _cells(column: Any) -> Cells:
    kind = str(column.type)
    if kind.startswith(("timestamp", "duration", "date")):
        ns = column.to_numpy()
        return np.asarray(ns)
    if kind.startswith(("int", "uint", "float", "double", "halffloat", "bool")):
        return np.asarray(column.to_numpy())
    return ["" if cell is None else str(cell) for cell in column.to_pylist()]
