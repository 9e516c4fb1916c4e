"""Rows of a log that is still being written: one line at a time, on the clock's grid."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import shown
from ddmhe.recordings.cells import number
from ddmhe.recordings.clock import samples_of
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.habits import cells_of
from ddmhe.recordings.log import Log
from ddmhe.recordings.options import Reading
from ddmhe.recordings.stamp_texts import epoch_texts, stamp_texts, written_like
from ddmhe.recordings.stamps import SECOND, Stamps
from ddmhe.recordings.table import Table

Array = NDArray[np.float64]

__all__ = ["Row", "RowFormat", "Stream"]

MOST_LOST = 10_000
"""Samples that may be lost at once: more is another clock."""


class Row(NamedTuple):
    """One sample."""

    t: float
    """Time, s, on the clock of the log."""
    written: Any
    """Its time as the log has it."""
    y: Array
    """Outputs (p,), NaN where not measured."""
    u: Array | None
    """Known inputs (m,)."""


@dataclass
class RowFormat:
    """How a line is read; plain values, so that it can be stored."""

    header: list[str]
    time: str | None
    """The clock's column; None for rows that are `dt` apart."""
    output: list[str]
    input: list[str]
    dt: float
    """Step of the rows, s."""
    sep: str | None
    """What parts the cells; None for JSON lines."""
    decimal: str
    grouped: bool
    missing: list[float]
    kind: str
    """Of times: "text", "whole" or "number"."""
    per_second: float
    since: int

    @classmethod
    def of(cls, log: Log, table: Table, stamps: Stamps, how: Reading) -> RowFormat:
        """The format in which the beginning of a log was read; LogError for one that lines alone
        cannot be read in."""
        time = None if how.dt is not None else log.names.time
        if time is not None and any(note.startswith("time of columns") for note in table.notes):
            raise LogError(f"{log.path}: expected one column of times with --follow, found two")
        if how.unwrap or how.sort or how.duplicates != "error" or how.delay:
            raise LogError("--follow: expected without --unwrap, --sort, --duplicates and --delay")
        text = stamps.ns is not None
        whole = not text and np.asarray(stamps.written).dtype.kind == "i"
        return cls(
            list(table.header), time, list(log.names.output), list(log.names.input),
            log.dt / log.decimate, table.sep, table.decimal, table.grouped, list(how.missing),
            "text" if text else "whole" if whole else "number", stamps.per_second, stamps.since,
        )  # fmt: skip

    def cells(self, line: str) -> dict[str, str]:
        """The cells of a line by their names; LogError for a line that has others."""
        if self.sep is None:
            return _of_json(line)
        try:
            (_, cells), *more = list(cells_of([line], self.sep))
        except (csv.Error, ValueError):
            raise LogError(f"expected a row of cells, found {shown(line)}") from None
        if more or (len(cells) > len(self.header) and any(cells[len(self.header) :])):
            raise LogError(f"expected {len(self.header)} cells, found {len(cells)}")
        return dict(zip(self.header, cells, strict=False))

    def numbers(self, cells: Mapping[str, str], names: Sequence[str]) -> Array:
        """The numbers of some columns, NaN where not measured."""
        values = np.empty(len(names))
        for k, name in enumerate(names):
            cell = cells.get(name, "")
            value = number(cell, self.decimal, self.grouped)
            if value is None or np.isinf(value):
                raise LogError(
                    f"column {shown(name)}: expected a finite number, found {shown(cell)}"
                )
            values[k] = np.nan if value in self.missing else value
        return values

    def stamp(self, cell: str) -> tuple[float, Any]:
        """A time, s, and as it is written."""
        try:
            if self.kind == "text":
                ns = stamp_texts([cell])
                ns = epoch_texts([cell]) if ns is None else ns
                if ns is not None:
                    return (int(ns[0]) - self.since) / SECOND, cell.strip()
            elif self.kind == "whole":
                return (int(cell) - self.since) / self.per_second, int(cell)
            else:
                value = number(cell, self.decimal)
                if value is not None and np.isfinite(value):
                    return (value - self.since) / self.per_second, value
        except ValueError:
            pass
        raise LogError(f"column {self.time!r}: expected a time, found {shown(cell)}")

    def later(self, written: Any, seconds: float) -> Any:
        """A time as it would be written, some seconds later."""
        if self.kind == "whole":
            return int(written) + round(seconds * self.per_second)
        if self.kind == "number":
            return float(f"{float(written) + seconds * self.per_second:.14g}")
        ns = stamp_texts([written])
        ns = epoch_texts([written]) if ns is None else ns
        assert ns is not None
        return written_like(written, int(ns[0]) + round(seconds * SECOND))


def _of_json(line: str) -> dict[str, str]:
    from ddmhe.recordings.json_lines import flat

    try:
        row = json.loads(line)
    except json.JSONDecodeError:
        row = None
    if not isinstance(row, Mapping):
        raise LogError(f"expected a JSON object, found {shown(line)}")
    return {key: "" if value is None else str(value) for key, value in flat(row)}


@dataclass
class Stream:
    """Lines of a log, one after the other, numbered on the grid of its steps."""

    format: RowFormat
    decimate: int
    t: float
    """Time of the last row, s."""
    number: int
    """Its sample number."""
    written: Any
    """Its time as the log has it."""
    u: list[float] | None
    """Its inputs."""

    @classmethod
    def after(cls, log: Log, table: Table, stamps: Stamps, how: Reading) -> Stream:
        """The stream behind the beginning of a log."""
        t = stamps.t
        last = stamps.written[-1]
        plain = last if isinstance(last, str) else np.asarray(last).item()
        format = RowFormat.of(log, table, stamps, how)
        u = None if log.u is None else log.u[-1].tolist()
        return cls(format, log.decimate, float(t[-1]), int(samples_of(t)[-1]), plain, u)

    def take(self, line: str) -> tuple[int, Row | None]:
        """How many samples were lost before a line, and the row of its own; None where that one is
        thinned out. LogError for a line that is none, which leaves all as it was."""
        cells = self.format.cells(line)
        name = self.format.time
        if name is None:
            t, written = self.t + self.format.dt, self.written + self.format.dt
            steps = 1
        else:
            t, written = self.format.stamp(cells.get(name, ""))
            steps = self._steps(t)
        y = self.format.numbers(cells, self.format.output)
        u = self.format.numbers(cells, self.format.input) if self.format.input else None
        if u is not None and np.isnan(u).any():
            raise LogError("expected a number for every input, found none")
        before = self.number // self.decimate
        self.number += steps
        self.t, self.written, self.u = t, written, None if u is None else u.tolist()
        passed = self.number // self.decimate - before
        if self.number % self.decimate:
            return passed, None
        return passed - 1, Row(t, written, y, u)

    def _steps(self, t: float) -> int:
        ahead = (t - self.t) / self.format.dt
        if not ahead > 0:
            raise LogError(f"expected a time after {self.t:.10g} s, found {t:.10g} s")
        if ahead > MOST_LOST:
            raise LogError(
                f"expected a time at most {MOST_LOST} samples after {self.t:.10g} s, found "
                f"{t:.10g} s"
            )
        return max(1, round(ahead))
