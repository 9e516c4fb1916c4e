"""Reading a log: a file, a frame or standard input in, a checked `Log` out.

Rows are numbered on the clock's grid before they are thinned, so that every k-th sample stays every
k-th whatever is lost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import check_path, shown, word
from ddmhe.recordings.cells import check_columns, column, words_for_nothing
from ddmhe.recordings.clock import first_row, jitter, nominal_step, samples_of, start_of
from ddmhe.recordings.delays import checked_delay, moved_back, whole_samples
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.joined_time import with_joined_time
from ddmhe.recordings.log import Gap, Log
from ddmhe.recordings.long_form import with_wide_form
from ddmhe.recordings.oddities import unwrapped
from ddmhe.recordings.options import Reading, check_texts
from ddmhe.recordings.order import Order, ordered, piece_of
from ddmhe.recordings.plain_cells import with_plain_clock, with_plain_durations
from ddmhe.recordings.resampled import resampled
from ddmhe.recordings.sources import piece_in, table_of
from ddmhe.recordings.stamps import Stamps, counted, read_stamps
from ddmhe.recordings.table import Table
from ddmhe.recordings.time_column import time_column

Array = NDArray[np.float64]

__all__ = ["Clocked", "clocked", "log_of", "log_of_clocked", "read_log"]


def read_log(
    path: str | Path,
    state: Sequence[str],
    output: Sequence[str],
    time: str | None = None,
    start: float | str | None = None,
    decimate: int = 1,
    *,
    input: Sequence[str] = (),
    missing: Sequence[float | str] = (),
    unwrap: Sequence[str] = (),
    delay: float | Mapping[str, float] = 0.0,
    **how: Any,
) -> Log:
    """Read a log, keep samples 0, decimate, 2 decimate, … of its clock, and of these the ones
    from time `start` on.

    Parameters
    ----------
    path
        A file of samples under a header, in any format that docs/logs.md lists; "-" is standard
        input.
    state, output
        Names of the state columns (n) and output columns (p); one column may be both.
    time
        Name of the time column; default the one that says so, else the first.
    start
        Time of the log's own clock, s, or a date as the log has them; default the first row. Times
        since 1970 may be counted from the first row.
    decimate
        Keep every decimate-th sample, at least 1; one whose row is lost is a gap, the next ones
        stay in place.
    input
        Names of the columns of known inputs (m); `Log.split` wants a number at every sample of
        them.
    missing
        Numbers and words that stand for "not measured" in these columns, like -9999.
    unwrap
        Columns of angles within one turn (2 pi or 360) to be made continuous.
    delay
        By how much the output columns are late, s: one number for all, or numbers by their names.
        Whole samples of the file. Each output is moved back by its delay, to the row of the instant
        that it tells of; the last rows then have outputs that were not measured. A negative one
        moves an output ahead, and rows before the first such output are left out. A column that is
        also a state stays in place as a state.
    how
        The other options of `read`: time_unit, dt, sep, decimal, comment, encoding, duplicates,
        sort, resample.

    Raises
    ------
    LogError
        One sentence naming the file, and the column and line where there is one.
    """
    check_path("path", path)
    options = Reading(time, start, decimate, missing, unwrap, delay=delay, **how)
    return log_of(path, (state, output, input), options)


class Clocked(NamedTuple):
    """A table whose rows have their times and are in order."""

    table: Table
    names: Names
    stamps: Stamps
    """Of the rows that are kept."""
    order: Order

    def values(self, group: Sequence[str], how: Reading) -> Array:
        """Columns (N, c) as numbers, NaN where not measured."""
        columns = [self.order.take(column(self.table, c, how.missing)) for c in group]
        return np.column_stack(columns) if columns else np.empty((len(self.order.rows), 0))


def log_of(src: Any, columns: tuple[Any, Any, Any], how: Reading) -> Log:
    """The log of a source: states, outputs and inputs by their names."""
    return log_of_clocked(clocked(src, columns, how), how)


def clocked(src: Any, columns: tuple[Any, Any, Any], how: Reading) -> Clocked:
    """The table of a source, with the times of its rows."""
    for option, group in zip(("state", "output", "input"), columns, strict=True):
        check_texts(option, group)
    state, output, known = (tuple(group) for group in columns)
    asked = (*output, *state, *known)  # outputs first: their stamps count where topics differ
    src, piece = piece_in(src)
    table = table_of(src, asked if how.time is None else (*asked, how.time), how)
    table = with_wide_form(table, asked, how.time)
    names = Names("", *(table.joined(group) for group in (state, output, known)))
    check_columns(table, names)  # before a clock that is not found is spoken of
    _check_unwrap(how.unwrap, names)
    table = table.noted(*_resolved(table, names))
    table, stamps, name = _clocked(table, names, how)
    if piece is not None:
        table, stamps = piece_of(table, stamps, piece)
    order = ordered(table, stamps, name, how.duplicates, how.sort)
    return Clocked(table, replace(names, time=name), stamps.rows(order.rows), order)


def log_of_clocked(found: Clocked, how: Reading, size: int | None = None) -> Log:
    """The log, on even steps if that is asked for, of which `size` are taken."""
    table, names, stamps, order = found
    if how.resample is not None and len(table) > 1:
        table, stamps, order = resampled(table, stamps, order, names, how, size)
        how = replace(how, unwrap=(), missing=())
    return _sampled(table, names, stamps, order, how)


def _resolved(table: Table, names: Names) -> list[str]:
    """What is said of names that are the end of a path."""
    every = dict.fromkeys((*names.state, *names.output, *names.input))
    pairs = [(name, table.header[k]) for name in every if (k := table.index(name)) is not None]
    ends = [f"{word(name)} is {word(path)}" for name, path in pairs if name != path]
    return [f"columns: {', '.join(ends)}"] if ends else []


def _clocked(table: Table, asked: Names, how: Reading) -> tuple[Table, Stamps, str]:
    """The table with what its clock says; the clock's times and name."""
    if how.dt is not None:
        name = "time_s"
        while name in (*asked.state, *asked.output, *asked.input):
            name += "_"
        return table.noted(f"rows {how.dt:g} s apart"), counted(len(table), float(how.dt)), name
    table = with_plain_durations(table)
    if how.time is None:
        every = (*asked.state, *asked.output, *asked.input)
        table = with_joined_time(
            table, [table.header[k] for k in map(table.index, every) if k is not None]
        )
    if how.time_unit is None:
        table = with_plain_clock(table, how.time)
    name, known = time_column(table, asked, how.time)
    stamps, unit = read_stamps(table, name, how.time_unit)
    words = " ".join(part for part in (known, repr(name), unit) if part)
    return table.noted(*([words] if known or unit else [])), stamps, name


def _sampled(table: Table, names: Names, stamps: Stamps, order: Order, how: Reading) -> Log:
    """The samples that are kept, in order, numbered on the clock's grid."""
    path, t, decimate = table.path, stamps.t, int(how.decimate)
    step = stamps.median_step() if t.size > 1 else math.nan
    samples = samples_of(t) if t.size > 1 else np.zeros(t.size, dtype=np.int64)
    if how.resample is not None and t.size > 1:  # exact, whatever the times are rounded to
        step, samples = float(how.resample), np.arange(t.size, dtype=np.int64)
    late = checked_delay(how.delay, names.output)
    by = whole_samples(path, late, step, int(samples[-1])) if late else {}
    first_sample = max(0, -min(by.values(), default=0))
    kept = np.flatnonzero((samples % decimate == 0) & (samples >= first_sample))
    notes = [*table.notes, *order.notes, *jitter(t, step)]
    if how.start is not None:
        start, note = start_of(path, stamps, how.start)
        notes += note
        kept = kept[first_row(path, t[kept], start) :]
    dt = nominal_step(path, t[kept], decimate * step, decimate)

    def values(c: str) -> Array:
        found = order.take(column(table, c, how.missing))
        return unwrapped(found) if c in how.unwrap else found

    def columns(group: Sequence[str]) -> Array:
        return np.column_stack([values(c) for c in group])[kept]

    lines = table.places[order.rows]
    numbered = (samples[kept] - samples[kept[0]]) // decimate
    x, y, y_lines = columns(names.state), columns(names.output), None
    if by:
        moved = [moved_back(samples, values(c), lines, by.get(c, 0)) for c in names.output]
        y, y_lines = (np.column_stack(part)[kept] for part in zip(*moved, strict=True))
    u = columns(names.input) if names.input else None
    every = dict.fromkeys((*names.state, *names.output, *names.input))
    units = {c: unit for c in (*every, names.time) if (unit := table.unit(c))}
    return Log(
        path, names, t[kept], x, y, dt, lines[kept], numbered,
        _gaps(t, samples, lines, int(kept[0])), decimate, units, u, y_lines, late,
        stamps.rows(kept), (*notes, *_of_words(table, list(every), how.missing)), table.place,
        table.digest,
    )  # fmt: skip


def _of_words(table: Table, names: Sequence[str], missing: Sequence[float | str]) -> list[str]:
    """What is said of words that mean "not measured"."""
    words: dict[str, int] = {}
    for name in names:
        for text, count in words_for_nothing(table, name, missing).items():
            words[text] = words.get(text, 0) + count
    told = ", ".join(f"{shown(text)} ({count})" for text, count in words.items())
    return [f"taken as not measured: {told}"] if words else []


def _gaps(
    t: Array, samples: NDArray[np.int64], lines: NDArray[np.int64], first: int
) -> tuple[Gap, ...]:
    """Where rows are lost, from row `first` on."""
    before = np.flatnonzero(np.diff(samples) > 1)
    return tuple(
        Gap(float(t[k]), float(t[k + 1] - t[k]), int(lines[k])) for k in before[before >= first]
    )


def _check_unwrap(unwrap: Sequence[str], names: Names) -> None:
    known = "states, outputs or inputs" if names.input else "states or outputs"
    for name in unwrap:
        if name not in (*names.state, *names.output, *names.input):
            raise LogError(f"unwrap: expected a column of the {known}, found {shown(name)}")
