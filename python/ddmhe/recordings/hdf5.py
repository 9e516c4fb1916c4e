"""Tables from HDF5, and from MATLAB's files of version 7.3, by h5py."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import reason
from ddmhe.recordings.arrays import array_table, flattened
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.libraries import library
from ddmhe.recordings.table import Table

__all__ = ["hdf5_table"]


def hdf5_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of an HDF5 file: datasets by their paths, fields of compound ones, columns of
    matrices as `name[0]`; units from the attributes "unit" or "units"."""
    h5py = library("h5py", path, "an HDF5 file")
    try:
        with h5py.File(source, "r") as file:
            arrays, units = _datasets(h5py, file)
    except LogError:
        raise
    except Exception as e:  # h5py has a class of error for every layer
        raise LogError(f"{path}: expected a whole HDF5 file, found another ({reason(e)})") from e
    return array_table(path, flattened(arrays), asked, units)


def _datasets(h5py: Any, file: Any) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    found: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        if name.startswith("#") or not isinstance(item, h5py.Dataset) or item.ndim not in (1, 2):
            return  # "#refs#": cells of MATLAB
        matlab = item.attrs.get("MATLAB_class")
        if matlab in (b"char", b"cell") or item.dtype.kind == "O":
            return
        array = np.asarray(item[()])
        # MATLAB stores by columns, HDF5 by rows
        found[name] = array.T if matlab is not None and array.ndim == 2 else array
        unit = item.attrs.get("unit", item.attrs.get("units"))
        if isinstance(unit, str | bytes) and unit:
            units[name] = unit if isinstance(unit, str) else unit.decode("utf-8", "replace")

    file.visititems(visit)
    return found, units
