"""Estimates as a file: a row for every step, with all that is known of it, and what the file is
made of. The ending decides the format.

Parquet, `.npz` and MAT files hold their metadata themselves. A CSV can not without losing readers:
they stand beside it in `NAME.csv-metadata.json`, as the W3C's "CSV on the Web" has it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import Log as Estimates
from ddmhe.checks import check_path, file_words, shown
from ddmhe.files import FileError, write, write_text
from ddmhe.frames import told
from ddmhe.recordings.libraries import library
from ddmhe.recordings.reading import Recorded
from ddmhe.report.trust import reason_words

__all__ = ["ENDINGS", "EstimatesFile", "check_ending", "described_in", "write_estimates_file"]

ENDINGS = (".csv", ".parquet", ".npz", ".mat")
LONGEST_NAME = 63
"""Characters that a name has at most in MATLAB."""


@dataclass(frozen=True, eq=False)
class EstimatesFile:
    """What is written of N estimates."""

    columns: Mapping[str, NDArray[Any] | list[str]]
    """Columns (N,) by their names."""
    units: Mapping[str, str]
    """Units of the columns that have one."""
    metadata: Mapping[str, Any]
    """Version, log, settings: values of JSON."""

    @classmethod
    def of(
        cls, recorded: Recorded, estimates: Estimates, metadata: Mapping[str, Any]
    ) -> EstimatesFile:
        """Of a run over a log: time as the log has it, states, standard deviations, status,
        whether trusted, reasons, error bounds, innovations, true states where the log has them, and
        whether the row is filled in."""
        names = recorded.names
        columns: dict[str, Any] = {names.time: recorded.stamps}
        units: dict[str, str] = {}

        def put(name: str, values: Any, unit: str = "") -> None:
            while name in columns:
                name += "_"
            columns[name] = values
            if unit:
                units[name] = unit

        def each(ending: str, channels: tuple[str, ...], values: Any) -> None:
            for k, channel in enumerate(channels):
                put(channel + ending, values[:, k], recorded.log.unit(channel))

        if names.time in recorded.units:
            units[names.time] = recorded.units[names.time]
        each("", names.state, estimates.x)
        evidence = estimates.evidence
        if estimates.std is not None:
            each("_std", names.state, estimates.std)
        if evidence is not None:
            put("trusted", np.asarray(estimates.trusted).astype(np.int64))
            put("reasons", reason_words(np.asarray(estimates.reasons)))
        put("status", [str(status) for status in estimates.status])
        bound = told(estimates, "bound")
        if bound is not None:
            put("bound", bound)
        if evidence is not None:
            each("_innovation", names.output, evidence.innovation)
            each("_innovation_std", names.output, evidence.innovation_std)
        if recorded.x_true is not None:
            each("_true", names.state, recorded.x_true)
        filled = recorded.log.lines[len(recorded.log.lines) - len(recorded.t) :] == 0
        put("filled", filled.astype(np.int64))
        return cls(columns, units, metadata)


def check_ending(path: Path) -> None:
    """FileError for an ending that no format has, or that needs a library which is not there."""
    if path.suffix.lower() not in ENDINGS:
        raise FileError(
            f"{file_words(path)}: expected a file ending in {', '.join(ENDINGS)}, found "
            f"{shown(path.suffix)}"
        )
    if path.suffix.lower() == ".parquet":
        library("pyarrow.parquet", str(path), "a Parquet file")


def described_in(path: Path) -> Path:
    """Where what a CSV file holds is described."""
    return path.with_name(path.name + "-metadata.json")


def write_estimates_file(path: Path, file: EstimatesFile) -> list[Path]:
    """Write estimates in the format that the ending names; the paths that were written."""
    check_path("path", path)
    check_ending(path)
    ending = path.suffix.lower()
    if ending == ".csv":
        write(path, lambda beside: _frame(file).to_csv(beside, index=False))
        described = described_in(path)
        write_text(described, json.dumps(_csv_metadata(path, file), indent=1) + "\n")
        return [path, described]
    writer = {".parquet": _parquet, ".npz": _npz, ".mat": _mat}[ending]
    write(path, lambda beside: writer(beside, file))
    return [path]


def _frame(file: EstimatesFile) -> Any:
    import pandas as pd  # takes longer to load than an estimator to build

    return pd.DataFrame(dict(file.columns))


def _described(file: EstimatesFile) -> dict[str, Any]:
    return dict(file.metadata) | {"units": dict(file.units)}


def _csv_metadata(path: Path, file: EstimatesFile) -> dict[str, Any]:
    """Metadata in the vocabulary of CSV on the Web; ours under one key."""
    columns = [
        {"titles": name} | ({"schema:unitText": file.units[name]} if name in file.units else {})
        for name in file.columns
    ]
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": path.name,
        "tableSchema": {"columns": columns},
        "schema:additionalProperty": _described(file),
    }


def _parquet(path: Path, file: EstimatesFile) -> None:
    pa = library("pyarrow", str(path), "a Parquet file")
    parquet = library("pyarrow.parquet", str(path), "a Parquet file")
    arrays = [pa.array(values) for values in file.columns.values()]
    fields = []
    for name, array in zip(file.columns, arrays, strict=True):
        unit = file.units.get(name)
        fields.append(pa.field(name, array.type, metadata={"unit": unit} if unit else None))
    schema = pa.schema(fields, metadata={"ddmhe": json.dumps(_described(file))})
    parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), path)


def _npz(path: Path, file: EstimatesFile) -> None:
    arrays: dict[str, Any] = {name: np.asarray(values) for name, values in file.columns.items()}
    name = "metadata"
    while name in arrays:
        name += "_"
    arrays[name] = np.array(json.dumps(_described(file)))
    with open(path, "wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, **arrays)


def _mat(path: Path, file: EstimatesFile) -> None:
    """Each column as a variable, under a name that MATLAB allows; `columns` holds the names as they
    are, and of what variables."""
    from scipy.io import savemat

    variables: dict[str, Any] = {}
    for name, values in file.columns.items():
        word = re.sub(r"\W", "_", name, flags=re.ASCII)
        word = (word if re.match("[A-Za-z]", word) else f"x{word}")[:LONGEST_NAME]
        while word in variables or word in ("columns", "metadata"):
            word = f"{word[: LONGEST_NAME - 1]}_"
        array = np.asarray(values)
        if array.dtype.kind == "M":
            array = np.datetime_as_string(array)
        variables[word] = array.astype(object) if array.dtype.kind == "U" else array
    pairs = [list(pair) for pair in zip(variables, file.columns, strict=True)]
    described = {"columns": np.array(pairs, object), "metadata": json.dumps(_described(file))}
    savemat(path, variables | described, do_compression=True, long_field_names=True,
            oned_as="column")  # fmt: skip
