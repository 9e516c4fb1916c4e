"""Rows of a log that is still being written: one line at a time, on the clock's grid or on even
steps."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import one_line, shown
from ddmhe.recordings.cells import number
from ddmhe.recordings.clock import samples_of
from ddmhe.recordings.csv_log import Clocked
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.even_steps import EvenSteps, Sample
from ddmhe.recordings.habits import cells_of
from ddmhe.recordings.log import Log
from ddmhe.recordings.options import Reading
from ddmhe.recordings.stamp_texts import DAY, epoch_texts, is_of_day, stamp_texts, written_like
from ddmhe.recordings.stamps import SECOND, Stamps, in_seconds

Array = NDArray[np.float64]

__all__ = ["Row", "RowFormat", "Stream"]

MOST_LOST = 10_000
"""Samples that may be lost at once: more is another clock."""


class Row(NamedTuple):
    """One sample."""

    after: Any
    """The time of the next one, as the log has times."""
    y: Array
    """Outputs (p,), NaN where not measured."""
    u: Array | None
    """Known inputs (m,)."""
    measured: bool
    """Whether there was a line of it; on even steps, whether anything is known."""


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
    missing: list[float | str]
    kind: str
    """Of times: "text", "whole" or "number"."""
    per_second: float
    since: int
    first: Any
    """The time of the first row, as the log has it."""

    @classmethod
    def of(cls, log: Log, found: Clocked, how: Reading) -> RowFormat:
        """The format in which the beginning of a log was read; LogError for one that lines alone
        cannot be read in."""
        table, stamps = found.table, found.stamps
        time = None if how.dt is not None else log.names.time
        if not table.alone:
            raise LogError(
                f"{log.path}: expected lines that can be read one by one with --follow, found "
                f"others ({one_line('; '.join(table.notes))})"
            )
        if how.unwrap or how.sort or how.duplicates != "error" or how.delay:
            raise LogError("--follow: expected without --unwrap, --sort, --duplicates and --delay")
        text = stamps.ns is not None
        whole = not text and np.asarray(stamps.written).dtype.kind == "i"
        dt = log.dt / log.decimate if how.dt is None else float(how.dt)
        return cls(
            list(table.header), time, list(log.names.output), list(log.names.input),
            dt, table.sep, table.decimal, table.grouped, list(how.missing),
            "text" if text else "whole" if whole else "number", stamps.per_second, stamps.since,
            _plain(stamps.written[0]),
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
        words = [one.lower() for one in self.missing if isinstance(one, str)]
        for k, name in enumerate(names):
            cell = cells.get(name, "")
            cell = "" if cell.strip().lower() in words else cell
            value = number(cell, self.decimal, self.grouped)
            if value is None or np.isinf(value):
                raise LogError(
                    f"column {shown(name)}: expected a finite number, found {shown(cell)}"
                )
            values[k] = np.nan if value in self.missing else value
        return values

    def stamp(self, cell: str, before: float) -> tuple[float, Any]:
        """A time, s, and as it is written; of the day, it goes on from the one before, s."""
        try:
            if self.kind == "text":
                pair = [self.first, cell]  # a date is read like the first one
                ns = stamp_texts(pair)
                ns = epoch_texts(pair) if ns is None else ns
                if ns is not None:
                    t = (int(ns[1]) - self.since) / SECOND
                    days = round((before - t) * SECOND / DAY) if is_of_day(cell) else 0
                    return (int(ns[1]) + days * DAY - self.since) / SECOND, cell.strip()
            elif self.kind == "whole":
                return in_seconds(int(cell) - self.since, self.per_second), int(cell)
            else:
                value = number(cell, self.decimal, self.grouped)
                if value is not None and np.isfinite(value):
                    return in_seconds(value - self.since, self.per_second), value
        except ValueError:
            pass
        raise LogError(f"column {shown(self.time)}: expected a time, found {shown(cell)}")

    def step(self, dt: float, number: int) -> Any:
        """The time of an even step, as `Stamps.after` has it."""
        if self.kind == "text":
            stamps = Stamps([str(self.first)], 1.0, np.array([self.since]), self.since)
        else:
            stamps = Stamps(np.array([self.first]), self.per_second, None, self.since)
        return _plain(stamps.after(dt, np.array([number])).written[0])

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
    from ddmhe.recordings.json_trees import flat

    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        row = None
    if not isinstance(row, Mapping):
        raise LogError(f"expected a JSON object, found {shown(line)}")
    return {key: "" if value is None else str(value) for key, value in flat(row)}


def _plain(written: Any) -> Any:
    return written if isinstance(written, str) else np.asarray(written).item()


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
    even: EvenSteps | None = None
    """What is known of the next steps of a log that is put on even ones."""

    @classmethod
    def after(cls, log: Log, found: Clocked, how: Reading, first: int) -> Stream:
        """The stream behind the beginning of a log; on even steps, from number `first` on."""
        t = found.stamps.t
        format = RowFormat.of(log, found, how)
        even = None
        if how.resample is not None:
            names, dt = found.names, float(how.resample)
            u = found.values(names.input, how) if names.input else None
            even = EvenSteps.of(t, found.values(names.output, how), u, dt, first)
        last = None if log.u is None else log.u[-1].tolist()
        written = _plain(found.stamps.written[-1])
        number = int(samples_of(t)[-1])
        return cls(format, log.decimate, float(t[-1]), number, written, last, even)

    def plain(self) -> dict[str, Any]:
        """All of it as plain values."""
        return asdict(self)

    @classmethod
    def restored(cls, plain: Mapping[str, Any]) -> Stream:
        """The stream of such values; TypeError or KeyError for others."""
        values = {field.name: plain[field.name] for field in fields(cls)}
        even = values["even"]
        values["even"] = None if even is None else EvenSteps(**even)
        return cls(**values | {"format": RowFormat(**values["format"])})

    def take(self, line: str) -> tuple[int, list[Row]]:
        """How many samples were lost before a line, and what is known now: rows for these, and of
        its own unless that is thinned out. LogError for a line that is none, which leaves all as it
        was."""
        format, before = self.format, (self.written, self.u)
        cells = format.cells(line)
        if format.time is None:
            t, written = (self.number + 1) * format.dt, (self.number + 1) * format.dt
            steps = 1
        else:
            t, written = format.stamp(cells.get(format.time, ""), self.t)
            steps = self._steps(t)
        y = format.numbers(cells, format.output)
        u = format.numbers(cells, format.input) if format.input else None
        if u is not None and np.isnan(u).any():
            raise LogError("expected a number for every input, found none")
        passed = (self.number + steps) // self.decimate - self.number // self.decimate
        self.number += steps
        self.t, self.written, self.u = t, written, None if u is None else u.tolist()
        if self.even is not None:
            self.even.add(t, y, u)
            return 0, self._rows(self.even.take())
        kept = self.number % self.decimate == 0
        dt = format.dt * self.decimate
        held = None if before[1] is None else np.array(before[1])
        nothing = np.full(len(y), np.nan)
        lost = passed - kept
        rows = [
            Row(format.later(before[0], (k + 2) * dt), nothing, held, False) for k in range(lost)
        ]
        return lost, [*rows, Row(format.later(written, dt), y, u, True)] if kept else rows

    def next_time(self, log: Log, row: int) -> Any:
        """The time of the sample after a row of the log, as that has times."""
        if self.even is not None:
            before = self.even.next - 1 - int(log.samples[-1] - log.samples[row]) * self.decimate
            before -= (self.even.next - 1) % self.decimate
            return self.format.step(self.even.dt, before + self.decimate)
        assert log.stamps is not None
        return self.format.later(_plain(log.stamps.rows(slice(row, row + 1)).written[0]), log.dt)

    def rest(self) -> list[Row]:
        """What is left when the log has ended."""
        return [] if self.even is None else self._rows(self.even.take(ended=True))

    def _rows(self, samples: Iterable[Sample]) -> list[Row]:
        assert self.even is not None
        dt, by = self.even.dt, self.decimate
        return [
            Row(self.format.step(dt, k + by), y, u, bool(np.isfinite(y).any()))
            for k, y, u in samples
            if k % by == 0
        ]

    def _steps(self, t: float) -> int:
        step = self.format.dt if self.even is None else self.even.dt
        ahead = (t - self.t) / step
        if not ahead > 0:
            raise LogError(f"expected a time after {self.t:.10g} s, found {t:.10g} s")
        if ahead > MOST_LOST:
            raise LogError(
                f"expected a time at most {MOST_LOST} samples after {self.t:.10g} s, found "
                f"{t:.10g} s"
            )
        return max(1, round(ahead))
