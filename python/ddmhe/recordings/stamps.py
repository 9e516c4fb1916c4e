"""The times of a log's rows: which column holds them, in which unit, digit for digit.

Whole numbers and texts stay what they are: differences are taken of whole nanoseconds, and what is
written back is what was read. What is not clear is asked about, never guessed in silence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.cells import column
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.stamp_texts import (
    Unclear,
    epoch_texts,
    first_unread,
    is_stamp,
    stamp_texts,
    written_like,
)
from ddmhe.recordings.table import Cells, Table
from ddmhe.recordings.time_units import (
    PER_SECOND,
    checked_unit,
    epoch_unit,
    unit_in_name,
    unit_word,
)

Array = NDArray[np.float64]

__all__ = ["Stamps", "counted", "in_seconds", "read_stamps"]

SECOND = 10**9
LONG = 2.0
"""Steps longer than this without a unit are as likely milliseconds."""
SINCE = 0.8e9
"""Times from here on, s, are since 1970 and counted from the first row."""


@dataclass(frozen=True, eq=False)
class Stamps:
    """Times of N rows."""

    written: NDArray[Any] | list[str]
    """As the file has them (N,): numbers of its unit, or texts."""
    per_second: float = 1.0
    """Numbers of `written` that make a second."""
    ns: NDArray[np.int64] | None = None
    """Texts as nanoseconds (N,)."""
    since: int = 0
    """What t is counted from, in whole numbers of `written` or, of texts, in nanoseconds."""

    @property
    def t(self) -> Array:
        """Times (N,), s."""
        if self.ns is not None:
            return np.asarray((self.ns - self.since) / SECOND, dtype=np.float64)
        numbers = np.asarray(self.written) - self.since if self.since else np.asarray(self.written)
        return np.asarray(in_seconds(numbers, self.per_second), dtype=np.float64)

    @property
    def unit(self) -> str:
        """The unit of `written`, "" of texts."""
        if self.ns is not None:
            return ""
        return next(unit for unit, rate in PER_SECOND.items() if rate == self.per_second)

    def median_step(self) -> float:
        """The median step, s, of N >= 2 rows; exact where the stamps are whole numbers."""
        if self.ns is not None:
            return float(np.median(np.diff(self.ns))) / SECOND
        if np.asarray(self.written).dtype.kind == "i":
            return float(np.median(np.diff(np.asarray(self.written)))) / self.per_second
        return float(np.median(np.diff(self.t)))

    def rows(self, chosen: Any) -> Stamps:
        """Of some rows: a mask, a slice or an index."""
        ns = None if self.ns is None else self.ns[chosen]
        if isinstance(self.written, np.ndarray):
            return replace(self, written=self.written[chosen], ns=ns)
        at = np.arange(len(self.written))[chosen]
        return replace(self, written=[self.written[k] for k in at], ns=ns)

    def spread(self, rows: NDArray[np.int64], size: int) -> Stamps:
        """On a grid of `size` samples of which these are known: the others in between."""
        every = np.arange(size)
        if self.ns is None:
            values = np.asarray(self.written)
            whole = values.dtype.kind == "i"
            base = values[0] if whole else 0
            between = np.interp(every, rows, (values - base).astype(np.float64))
            filled = np.rint(between).astype(np.int64) + base if whole else between
            filled[rows] = values
            return replace(self, written=filled)
        ns = np.rint(np.interp(every, rows, self.ns - self.ns[0])).astype(np.int64) + self.ns[0]
        ns[rows] = self.ns
        if isinstance(self.written, np.ndarray):
            kind = self.written.dtype.kind
            return replace(self, written=ns.astype(f"{kind}8[ns]"), ns=ns)
        written = [written_like(self.written[0], int(one)) for one in ns]
        for row, text in zip(rows, self.written, strict=True):
            written[row] = text
        return replace(self, written=written, ns=ns)

    def after(self, dt: float, steps: NDArray[np.int64]) -> Stamps:
        """Times so many steps of dt s after the first row, written as that is: whole numbers where
        the times and the steps are."""
        seconds = dt * steps
        if self.ns is None:
            first, later = np.asarray(self.written)[0], seconds * self.per_second
            step = dt * self.per_second
            whole = np.asarray(self.written).dtype.kind == "i" and abs(step - round(step)) < 1e-9
            written = np.rint(later).astype(np.int64) + first if whole else first + later
            return replace(self, written=written)
        ns = self.ns[0] + np.rint(seconds * SECOND).astype(np.int64)
        if isinstance(self.written, np.ndarray):
            kind = self.written.dtype.kind
            return replace(self, written=ns.astype(f"{kind}8[ns]"), ns=ns)
        return replace(self, written=[written_like(self.written[0], int(k)) for k in ns], ns=ns)


def in_seconds(numbers: Any, per_second: float) -> Any:
    """Numbers of a unit, or one, in seconds; hours and days by what one of them lasts, a whole
    number."""
    return numbers * (1.0 / per_second) if per_second < 1.0 else numbers / per_second


def counted(size: int, dt: float) -> Stamps:
    """Times of rows that have none, from 0 s on, `dt` s apart."""
    return Stamps(np.arange(size) * dt)


def read_stamps(table: Table, name: str, unit: str | None) -> tuple[Stamps, str]:
    """The times in a column, and what was inferred of them; `unit` where it is stated.

    LogError where a row has no time or the unit is not clear."""
    cells = table.column(name)
    told = _told(table, name, cells)
    if told is not None:
        return told, "with dates or times of the day"
    whole_numbers = _whole(table, cells)
    values: NDArray[Any] = column(table, name) if whole_numbers is None else whole_numbers
    if np.isnan(values).any():
        place = table.places[int(np.argmax(np.isnan(values)))]
        raise LogError(
            f"{table.path}, {table.place} {place}, column {shown(name)}: expected a time in "
            "seconds, found none"
        )
    found, how = _unit(table, name, values, unit)
    per_second = PER_SECOND[found]
    exact = _exact_epoch(cells) if found == "s" and values.dtype.kind == "f" else None
    if exact is not None:
        return Stamps(list(cells), 1.0, exact, int(exact[0])), how
    late = float(values[0]) / per_second >= SINCE
    whole = values.dtype.kind == "i"
    return Stamps(values, per_second, None, int(values[0]) if late and whole else 0), how


def _told(table: Table, name: str, cells: Cells) -> Stamps | None:
    """Times that are told in words or are of a type for times; None for numbers."""
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "mM":
        ns = cells.astype(f"{cells.dtype.kind}8[ns]").astype(np.int64)
        lacking = np.isnat(cells)
        if lacking.any():
            raise _no_time(table, name, int(np.argmax(lacking)), "none")
        return Stamps(cells, 1.0, ns, int(ns[0]))
    if isinstance(cells, np.ndarray) and cells.dtype.kind != "O" and cells.dtype.kind != "U":
        return None
    if not is_stamp(str(cells[0])):
        return None
    texts = [str(cell) for cell in cells]
    try:
        ns_of_texts = stamp_texts(texts)
    except Unclear:
        raise LogError(
            f"{table.path}, column {shown(name)}: {shown(texts[0])} may begin with the day or "
            "the month; write dates like 2024-05-01, or give --dt SECONDS"
        ) from None
    if ns_of_texts is None:
        row = first_unread(texts)
        raise _no_time(table, name, row, repr(texts[row]))
    return Stamps(texts, 1.0, ns_of_texts, int(ns_of_texts[0]))


def _no_time(table: Table, name: str, row: int, found: str) -> LogError:
    return LogError(
        f"{table.path}, {table.place} {table.places[row]}, column {shown(name)}: expected a time "
        f"like that of the rows before, found {found}"
    )


def _whole(table: Table, cells: Cells) -> NDArray[np.int64] | None:
    """Cells that are whole numbers, all of them."""
    if isinstance(cells, np.ndarray):
        if cells.dtype.kind == "u" and cells.size and cells.max() > np.iinfo(np.int64).max:
            return None
        return cells.astype(np.int64) if cells.dtype.kind in "iu" else None
    texts = [cell.strip() for cell in cells]
    if not all(text.isascii() and text.lstrip("+-").isdigit() for text in texts):
        return None
    try:
        return np.array([int(text) for text in texts], dtype=np.int64)
    except (OverflowError, ValueError):
        return None


def _exact_epoch(cells: Cells) -> NDArray[np.int64] | None:
    return None if isinstance(cells, np.ndarray) else epoch_texts(cells)


def _unit(table: Table, name: str, values: NDArray[Any], stated: str | None) -> tuple[str, str]:
    """The unit of a column of times, and how it is known; LogError where that is not clear."""
    if stated is not None:
        return checked_unit("time_unit", stated), ""
    of_file, of_name = table.unit(name), unit_in_name(name)
    if of_file:
        unit = unit_word(of_file)
        if unit is None:
            raise _unclear(table, name, values, f"has the unit {shown(of_file)}")
        return unit, f"in {unit}"
    by_values = epoch_unit(values)
    if of_name is not None:
        if by_values not in (None, of_name, "days"):
            raise _unclear(
                table, name, values, f"says {of_name} and looks like {by_values} since 1970"
            )
        return of_name, f"in {of_name}"
    if by_values is not None:
        since = "as serial days" if by_values == "days" else f"in {by_values} since 1970"
        return by_values, since
    steps = np.abs(np.diff(values))
    if values.size > 1 and np.all(values == np.rint(values)):
        counts = np.median(steps) == 1
        words = "whole numbers, as a counter does" if counts else "whole numbers without a unit"
        raise _unclear(table, name, values, f"holds {words}")
    if values.size > 1 and np.median(steps) > LONG:
        raise _unclear(table, name, values, "has long steps and no unit")
    return "s", "taken as seconds"


def _unclear(table: Table, name: str, values: NDArray[Any], what: str) -> LogError:
    first = ", ".join(
        f"{value:.10g}" if value.dtype.kind == "f" else str(value) for value in values[:3]
    )
    return LogError(
        f"{table.path}: column {shown(name)} {what} ({first}, …); if it is the time, --time-unit "
        "says "
        "in what (s, ms, us, ns, min, h or days), if it is not, give --time NAME or --dt SECONDS"
    )
