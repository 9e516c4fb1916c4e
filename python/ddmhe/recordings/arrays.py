"""Tables from arrays by name: frames, mappings, `.npz`, `.npy` and MATLAB's files up to v7."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import reason, shown
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.table import Cells, Table

__all__ = [
    "DEEPEST",
    "array_table",
    "flattened",
    "frame_table",
    "is_frame",
    "mat_table",
    "npy_table",
    "npz_table",
]

DEEPEST = 8
"""Levels of groups that are looked into."""


def is_frame(value: Any) -> bool:
    """Whether it is of the kinds that `frame_table` takes."""
    if isinstance(value, Mapping):
        return True
    if isinstance(value, np.ndarray):
        return value.dtype.names is not None
    kind = type(value).__module__.partition(".")[0]
    parts = {"pandas": "columns", "polars": "get_columns", "pyarrow": "column_names"}
    return kind in parts and hasattr(value, parts[kind])


def frame_table(path: str, frame: Any, asked: Sequence[str]) -> Table:
    """A table of a frame of pandas or polars, a table of pyarrow, a structured array, or a mapping
    of names to arrays."""
    if isinstance(frame, Mapping):
        return array_table(path, flattened(frame), asked)
    if isinstance(frame, np.ndarray) and frame.dtype.names is not None:
        return array_table(path, flattened({n: frame[n] for n in frame.dtype.names}), asked)
    kind = type(frame).__module__.partition(".")[0]
    if kind == "pandas" and hasattr(frame, "columns"):
        return _of_pandas(path, frame)
    if kind == "polars" and hasattr(frame, "get_columns"):
        columns = {series.name: series.to_numpy() for series in frame.get_columns()}
        return _of_columns(path, columns)
    if kind == "pyarrow" and hasattr(frame, "column_names"):
        from ddmhe.recordings.columnar import arrow_table

        return arrow_table(path, frame)
    raise LogError(
        "src: expected a path, a frame (pandas, polars, pyarrow) or a mapping of names to arrays, "
        f"found {shown(frame)}"
    )


def _of_pandas(path: str, frame: Any) -> Table:
    """Columns of a pandas frame, and its index where that is more than a count."""
    columns: dict[str, Any] = {}
    index = frame.index
    if type(index).__name__ != "RangeIndex" and getattr(index, "nlevels", 1) == 1:
        columns[str(index.name) if index.name is not None else "index"] = index
    names = ["/".join(map(str, c)) if isinstance(c, tuple) else str(c) for c in frame.columns]
    for k, name in enumerate(names):
        columns[name if name not in columns else f"{name}_"] = frame.iloc[:, k]
    return _of_columns(path, {name: _series(column) for name, column in columns.items()})


def _series(column: Any) -> Any:
    """A column of pandas as an array; missing numbers are NaN, times without a zone are UTC."""
    kind = str(column.dtype)
    if kind.startswith("datetime64"):
        naive = column.dt if hasattr(column, "dt") else column
        column = naive.tz_convert(None) if "," in kind else column
    elif kind in ("Int64", "Int32", "Int16", "Int8", "Float64", "Float32", "boolean") or (
        kind.startswith(("UInt", "double[", "float[", "int"))
    ):
        if column.isna().any():
            return column.to_numpy(dtype=np.float64, na_value=np.nan)
        numpy_kind = np.int64 if "nt" in kind else np.float64
        return column.to_numpy(dtype=numpy_kind)
    return column.to_numpy()


def _of_columns(path: str, columns: Mapping[str, Any]) -> Table:
    size = len(next(iter(columns.values()))) if columns else 0
    if size == 0:
        raise LogError(f"{path}: expected rows of samples, found none")
    cells = [_cells(np.asarray(column)) for column in columns.values()]
    return Table(path, list(columns), cells, np.arange(1, size + 1), "row")


def _cells(column: NDArray[Any]) -> Cells:
    """An array as cells: objects and bytes as texts."""
    if column.dtype.kind == "S":
        return [bytes(cell).decode("utf-8", "replace") for cell in column]
    return [str(cell) for cell in column] if column.dtype.kind in "OU" else column


def flattened(tree: Mapping[Any, Any], above: str = "", deep: int = 0) -> dict[str, NDArray[Any]]:
    """Arrays of nested groups by their paths, parted by "."; columns of matrices by their number
    from 0, `name[0]`."""
    found: dict[str, NDArray[Any]] = {}
    for key, value in tree.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping):
            if deep < DEEPEST:
                found |= flattened(value, f"{name}.", deep + 1)
            continue
        groups = _groups(value)
        if groups is not None:
            if deep < DEEPEST:
                found |= flattened(groups, name, deep + 1)
            continue
        array = np.asarray(value)
        if array.dtype.names is not None:
            found |= flattened({n: array[n] for n in array.dtype.names}, f"{name}.", deep + 1)
        elif array.ndim == 2 and 1 in array.shape:
            found[name] = array.ravel()
        elif array.ndim in (1, 2):
            found[name] = array
    return found


def _groups(value: Any) -> dict[str, Any] | None:
    """An array of structures: what is one number in each is a column, the rest stays a group for
    each of them, `[0].name`; None for what is no such array."""
    listed = isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object)
    entries = list(np.ravel(np.asarray(value, dtype=object))) if listed and len(value) else []
    if not entries or not all(isinstance(entry, Mapping) for entry in entries):
        return None
    keys = [key for key in entries[0] if all(key in entry for entry in entries)]
    single = [k for k in keys if all(np.size(entry[k]) == 1 for entry in entries)]
    if single and len(single) == len(keys):
        return {f".{k}": np.array([np.ravel(entry[k])[0] for entry in entries]) for k in keys}
    return {f"[{number}]": entry for number, entry in enumerate(entries)}


def _trajectory(arrays: Mapping[str, Any]) -> dict[str, NDArray[Any]] | None:
    """Results of OpenModelica and Dymola, "Atrajectory": texts in `name`, and in `dataInfo` which
    row of which matrix each variable is, with its sign; None for other files."""
    if not {"name", "dataInfo", "data_2"} <= set(arrays):
        return None
    info = np.atleast_2d(np.asarray(arrays["dataInfo"], dtype=np.int64))
    names = [str(name) for name in np.atleast_1d(arrays["name"])]
    if "binNormal" in map(str.strip, map(str, np.atleast_1d(arrays.get("Aclass", "")))):
        info = info.T
        arrays = {k: v.T if k.startswith("data_") else v for k, v in arrays.items()}
    else:  # letters of one name below each other
        letters = [row.ljust(info.shape[1]) for row in names]
        names = ["".join(column) for column in zip(*letters, strict=True)]
    found = {}
    for name, (matrix, row, *_) in zip(names, info.T.tolist(), strict=False):
        values = np.asarray(arrays.get(f"data_{matrix or 2}", np.empty((0, 0))), dtype=float)
        if 0 < abs(row) <= len(values) and matrix != 1:
            found[name.strip()] = np.sign(row) * values[abs(row) - 1]
    return found or None


def array_table(
    path: str,
    arrays: Mapping[str, NDArray[Any]],
    asked: Sequence[str],
    units: Mapping[str, str] | None = None,
) -> Table:
    """A table of the arrays that are as long as those asked for."""
    lengths = Counter(len(a) for a in arrays.values() if a.ndim == 1 and len(a) > 1)
    columns = _columns(arrays, lengths.most_common(1)[0][0] if lengths else None)
    everything = Table(path, list(columns), list(columns.values()), np.arange(0))
    known = [(name, k) for name in asked if (k := everything.index(name)) is not None]
    if not columns:
        raise LogError(f"{path}: expected arrays of samples, found none")
    if known:
        size = len(everything.columns[known[0][1]])
        for name, k in known:
            if len(everything.columns[k]) != size:
                raise LogError(
                    f"{path}: expected columns of one length, found {size} rows of "
                    f"{shown(known[0][0])} and {len(everything.columns[k])} of {shown(name)}"
                )
    else:
        size = Counter(map(len, columns.values())).most_common(1)[0][0]
    chosen = {name: _cells(column) for name, column in columns.items() if len(column) == size}
    places = np.arange(1, size + 1)
    return Table(path, list(chosen), list(chosen.values()), places, "row", dict(units or {}))


def _columns(arrays: Mapping[str, NDArray[Any]], size: int | None) -> dict[str, NDArray[Any]]:
    """Vectors as they are, matrices column by column; samples run along the axis of that size, or
    the longer one."""
    found: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        if array.ndim == 1:
            found[name] = array
            continue
        across = array.shape[1] == size if size in array.shape else array.shape[1] > array.shape[0]
        rows = array.T if across else array
        found |= {f"{name}[{k}]": np.ascontiguousarray(rows[:, k]) for k in range(rows.shape[1])}
    return found


def npz_table(path: str, source: IO[bytes], asked: Sequence[str]) -> Table:
    """The table of a `.npz` file: one array a column."""
    try:
        with np.load(source, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as e:  # a damaged file makes it stumble over anything
        raise LogError(f"{path}: expected arrays of numbers, found others ({reason(e)})") from e
    return array_table(path, flattened(arrays), asked)


def npy_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of a `.npy` file: a structured array."""
    try:
        array = np.load(source, allow_pickle=False)
    except Exception as e:  # as above
        raise LogError(f"{path}: expected an array of numbers, found others ({reason(e)})") from e
    if array.dtype.names is None:
        raise LogError(
            f"{path}: expected columns with names, found a bare array of shape {array.shape}; "
            "np.savez(path, time_s=…, name=…) names them"
        )
    return frame_table(path, array, asked)


def mat_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of a MAT file of versions 4 to 7: variables, or fields of a structure."""
    from scipy.io import loadmat

    try:
        place: Any = source
        stored = loadmat(place, simplify_cells=True, appendmat=False)
    except Exception as e:  # the reader raises whatever a damaged file makes it stumble over
        raise LogError(f"{path}: expected a whole MAT file, found another ({reason(e)})") from e
    arrays = {k: v for k, v in stored.items() if not k.startswith("__")}
    trajectory = _trajectory(arrays)
    if trajectory is not None:
        return array_table(path, trajectory, asked)
    structures = [v for v in arrays.values() if isinstance(v, Mapping) or _groups(v) is not None]
    if arrays and not structures and all(np.asarray(v).dtype.kind == "O" for v in arrays.values()):
        raise LogError(
            f"{path}: expected variables with numbers, found objects of MATLAB; of a table T, "
            "S = table2struct(T, 'ToScalar', true); save(file, '-struct', 'S') makes some"
        )
    return array_table(path, flattened(arrays), asked)
