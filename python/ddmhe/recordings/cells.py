"""Cells to numbers.

An empty cell, NaN, NA, n/a, null, none and their like mean "not measured", and so do the numbers
and words that `missing` names. Numbers are read to the nearest float64."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.table import Cells, Table

Array = NDArray[np.float64]

__all__ = ["check_columns", "column", "is_number", "number", "says_nothing"]

_NOT_MEASURED = frozenset(
    """nan +nan -nan nan(ind) -nan(ind) #nan 1.#qnan 1.#ind -1.#ind na n/a n.a. n.a #n/a #na
    <na> \\n null nil none nat missing - -- --- . ? #value! #num! #div/0!""".split()  # noqa: SIM905
) | {""}


_DRAWN = set("-.:*")
"""Characters of cells that a display leaves without a number, like --.-- and ****."""
LONGEST_WORD = 20
"""Characters of a word that may say "not measured"."""
MARKS = "'\N{RIGHT SINGLE QUOTATION MARK}\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{THIN SPACE}"
"""Marks between groups of three digits that can be nothing else."""
_NUMBER = re.compile(
    rf"[+-]?(\d{{1,3}}([{MARKS}]\d{{3}})+([.,]\d*)?|\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?\Z"
)
_GROUPED = re.compile(rf"[+-]?\d{{1,3}}([{MARKS}]\d{{3}})+(?!\d)")


def is_number(cell: str) -> bool:
    """Whether a cell is a number in any habit."""
    return _NUMBER.match(cell) is not None


def says_nothing(cell: str) -> bool:
    """Whether a cell says "not measured"."""
    text = cell.strip()
    return text.lower() in _NOT_MEASURED or set(text) <= _DRAWN


def check_columns(table: Table, asked: Names) -> None:
    """LogError unless the header has each column that is asked for, once."""
    groups = {"state": asked.state, "output": asked.output, "input": asked.input}
    for option, group in groups.items():
        if not group and option != "input":
            raise LogError(f"{option}: expected at least one column name, found none")
        for name in group:
            table.find(option, name)
            if list(group).count(name) > 1:
                raise LogError(
                    f"{option}: expected different columns, found {shown(name)} more than once"
                )


def column(table: Table, name: str, missing: Sequence[float | str] = ()) -> Array:
    """One column as numbers (N,), NaN where the cell says that nothing was measured, as the numbers
    and words of `missing` do, too."""
    cells = table.column(name)
    words = {one.lower() for one in missing if isinstance(one, str)}
    if words and not (isinstance(cells, np.ndarray) and cells.dtype.kind in "fiub"):
        cells = ["" if str(cell).strip().lower() in words else str(cell) for cell in cells]
    values = _of_array(table, name, cells) if isinstance(cells, np.ndarray) else None
    if values is None:
        values = _of_texts(table, name, cells)
    wrong = np.isinf(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise _wrong(table, name, row, cells[row])
    numbers = [one for one in missing if not isinstance(one, str)]
    return np.where(np.isin(values, numbers), np.nan, values) if numbers else values


def words_for_nothing(table: Table, name: str, missing: Sequence[float | str]) -> dict[str, int]:
    """How often which words, other than nothing and NaN, say "not measured" in a column."""
    cells = table.column(name)
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "fiub":
        return {}
    unknown = np.flatnonzero(np.isnan(column(table, name, missing))).tolist()
    texts = (str(cells[k]).strip() for k in unknown)
    return dict(Counter(text for text in texts if text.lower() not in ("", "nan", "none")))


def _of_array(table: Table, name: str, cells: NDArray[Any]) -> Array | None:
    """Numbers of an array; None where they are objects or texts."""
    if cells.dtype.kind in "fiub":
        return np.asarray(cells, dtype=np.float64)
    if cells.dtype.kind in "OUS":
        return None
    raise LogError(
        f"{table.path}, column {shown(name)}: expected numbers, found values of type {cells.dtype}"
    )


def _of_texts(table: Table, name: str, cells: Cells) -> Array:
    texts: Sequence[str] = cells if not isinstance(cells, np.ndarray) else [*map(str, cells)]
    if table.decimal == "." and not table.grouped and "_" not in "".join(texts):
        try:
            return np.fromiter(map(float, texts), np.float64, len(texts))
        except ValueError:
            pass  # some cells hold words
    values = np.empty(len(texts))
    for row, text in enumerate(texts):
        found = number(text, table.decimal, table.grouped)
        if found is None:
            raise _wrong(table, name, row, cells[row])
        values[row] = found
    return values


def number(text: str, decimal: str = ".", grouped: bool = False) -> float | None:
    """A cell as a number, NaN where it says that nothing was measured; None where it is none."""
    text = text.strip()
    if says_nothing(text):
        return np.nan
    other = "," if decimal == "." else "."
    if grouped and other in text:
        if not re.fullmatch(rf"[+-]?\d{{1,3}}(\{other}\d{{3}})+(\{decimal}\d*)?", text):
            return None
        text = text.replace(other, "")
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    text = text.replace("\N{MINUS SIGN}", "-")
    groups = _GROUPED.match(text)
    if groups is not None:
        text = re.sub(f"[{MARKS}]", "", groups[0]) + text[groups.end() :]
    fortran = re.fullmatch(r"([+-]?[\d.]+)[dD]([+-]?\d+)", text)
    try:
        return None if "_" in text else float(f"{fortran[1]}e{fortran[2]}" if fortran else text)
    except ValueError:
        return None


def _is_word(text: str) -> bool:
    plain = re.fullmatch(r"[^\s\d,;=-][^\s,;=]*", text) is not None and text.isprintable()
    return plain and len(text) <= LONGEST_WORD and not np.isinf(number(text) or 0.0)


def _wrong(table: Table, name: str, row: int, cell: Any) -> LogError:
    hint = "; an empty cell says not measured"
    if isinstance(cell, str) and _is_word(cell.strip()):
        hint += f", with --missing {cell.strip()} this word does"
    if isinstance(cell, str) and re.fullmatch(r"[+-]?\d+,\d+", cell):
        hint = "; --decimal , reads a decimal comma"
    return LogError(
        f"{table.path}, {table.place} {table.places[row]}, column {shown(name)}: expected a finite "
        f"number, found {shown(str(cell))}{hint}"
    )
