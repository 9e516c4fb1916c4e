"""The text cells of a CSV file, and the columns of numbers that they hold.

A CSV has one header line, perhaps a line of units below it, and one row per sample. An empty cell,
NaN, NA, n/a, null or none means "not measured", and so do the numbers that `missing` names."""

from __future__ import annotations

import csv
import difflib
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ddmhe.checks import file_words, listed, reason, shown
from ddmhe.recordings.log import LogError, Names

Array = NDArray[np.float64]

__all__ = ["check_columns", "column", "read_table", "units_of_columns"]

_NOT_MEASURED = frozenset({"", "nan", "na", "n/a", "#n/a", "<na>", "null", "none"})
_SECONDS = frozenset({"s", "sec", "secs", "second", "seconds"})


def read_table(path: str) -> pd.DataFrame:
    """The file as text cells, its header as columns, its line numbers as index; empty lines
    dropped."""
    named = file_words(path)
    try:
        cells = pd.read_csv(
            path, header=None, dtype=str, na_filter=False, skip_blank_lines=False, index_col=False,
            skipinitialspace=True, encoding="utf-8-sig", quoting=csv.QUOTE_MINIMAL,
        )  # fmt: skip
    except FileNotFoundError:
        raise LogError(f"{named}: expected a log file, found no such file") from None
    except OSError as e:
        raise LogError(
            f"{named}: expected a readable log file, found that it is not "
            f"({e.strerror or reason(e)})"
        ) from e
    except pd.errors.EmptyDataError:
        raise LogError(
            f"{named}: expected a header line and samples, found an empty file"
        ) from None
    except UnicodeDecodeError as e:
        raise LogError(f"{named}: expected a text file in UTF-8, found bytes that are not") from e
    except Exception as e:  # of pandas, or of whatever unpacks a packed file
        raise LogError(
            f"{named}: expected a CSV table, found one that cannot be read ({reason(e)})"
        ) from e
    cells = cells.fillna("")
    cells.index += 1
    header = [str(c).strip() for c in cells.iloc[0]]
    table = cells.iloc[1:].set_axis(header, axis="columns")
    table = table[(table != "").any(axis="columns")]
    if table.empty:
        raise LogError(f"{named}: expected samples after the header line, found none")
    return table


def check_columns(path: str, header: list[str], asked: Names) -> None:
    """LogError unless the header has each column that is asked for, once."""
    groups = {"time": (asked.time,), "state": asked.state, "output": asked.output}
    for option, group in (groups | {"input": asked.input}).items():
        if not group and option != "input":
            raise LogError(f"{option}: expected at least one column name, found none")
        for column in group:
            if column not in header:
                raise LogError(
                    f"{option}: expected a column of {path}, found "
                    f"{shown(column)}{_nearest(column, header)}"
                )
            if header.count(column) > 1:
                raise LogError(
                    f"{path}: expected one column named {shown(column)}, "
                    f"found {header.count(column)}"
                )
            if list(group).count(column) > 1:
                raise LogError(
                    f"{option}: expected different columns, found {shown(column)} more than once"
                )
            if option != "time" and column == asked.time:
                raise LogError(
                    f"{option}: expected columns other than the time column, found {shown(column)}"
                )


def _nearest(column: str, header: list[str]) -> str:
    close = difflib.get_close_matches(column, header, n=1)
    hint = f"; did you mean {shown(close[0])}?" if close else ""
    return f"{hint} (columns: {listed(header)})"


def units_of_columns(
    path: str, table: pd.DataFrame, time: str
) -> tuple[pd.DataFrame, dict[str, str]]:
    """The samples, and the units of the columns if the first line states them: a word for the time,
    and no number."""
    first = [cell.strip() for cell in table.iloc[0]]
    of_time = table[time].iloc[0].strip()
    words = [cell for cell in first if cell and cell.lower() not in _NOT_MEASURED]
    if of_time not in words or any(_is_number(word) for word in words) or len(table) < 2:
        return table, {}
    units = {
        name: cell.strip("[]() ")
        for name, cell in zip(table.columns, first, strict=True)
        if cell in words
    }
    if units[time].lower() not in _SECONDS:
        raise LogError(
            f"{path}, line {table.index[0]}, column {shown(time)}: expected a time in "
            f"seconds, found the unit {shown(of_time)}"
        )
    return table.iloc[1:], units


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def column(path: str, table: pd.DataFrame, name: str, missing: Sequence[float] = ()) -> Array:
    """One column as numbers, NaN where the cell says that nothing was measured."""
    cells = table[name].str.strip()
    values = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    wrong = np.isinf(values)
    unread = np.flatnonzero(np.isnan(values))
    wrong[unread] = [c.lower() not in _NOT_MEASURED for c in cells.iloc[unread]]
    if wrong.any():
        row = int(np.argmax(wrong))
        raise LogError(
            f"{path}, line {table.index[row]}, column {shown(name)}: expected a finite "
            f"number, found {shown(cells.iloc[row])}"
        )
    return np.where(np.isin(values, missing), np.nan, values)
