"""Reading a log: a CSV of samples in, a checked `Log` out.

Rows are numbered on the clock's grid before they are thinned, so that every k-th sample stays every
k-th whatever is lost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import MOST, check_kind, check_path, file_words, shown
from ddmhe.recordings.cells import check_columns, column, read_table, units_of_columns
from ddmhe.recordings.clock import first_row, nominal_step, samples_of, times
from ddmhe.recordings.delays import checked_delay, moved_back, whole_samples
from ddmhe.recordings.log import LARGEST, Gap, Log, LogError, Names
from ddmhe.recordings.oddities import unwrapped

Array = NDArray[np.float64]

__all__ = ["read_log"]


def read_log(
    path: str | Path,
    state: Sequence[str],
    output: Sequence[str],
    time: str | None = None,
    start: float | None = None,
    decimate: int = 1,
    *,
    input: Sequence[str] = (),
    missing: Sequence[float] = (),
    unwrap: Sequence[str] = (),
    delay: float | Mapping[str, float] = 0.0,
) -> Log:
    """Read a CSV log, keep samples 0, decimate, 2 decimate, … of its clock, and of these the ones
    from time `start` on.

    Parameters
    ----------
    path
        A CSV file with one header line, which a line of units may follow.
    state, output
        Names of the state columns (n) and output columns (p); one column may be both.
    time
        Name of the time column, in seconds; default the first column.
    start
        Time of the log's own clock, s; default the first row.
    decimate
        Keep every decimate-th sample, at least 1; one whose row is lost is a gap, the next ones
        stay in place.
    input
        Names of the columns of known inputs (m); `Log.split` wants a number at every sample of
        them.
    missing
        Numbers that stand for "not measured" in these columns, like -9999.
    unwrap
        Columns of angles within one turn (2 pi or 360) to be made continuous.
    delay
        By how much the output columns are late, s: one number for all, or numbers by their names.
        Whole samples of the file. Each output is moved back by its delay, to the row of the instant
        that it tells of; the last rows then have outputs that were not measured. A negative one
        moves an output ahead, and rows before the first such output are left out. A column that is
        also a state stays in place as a state.

    Raises
    ------
    LogError
        One sentence naming the file, and the column and line where there is one.
    """
    check_path("path", path)
    _check_options((state, output, input), unwrap, time, start, decimate)
    numbers = checked_missing(missing)
    late = checked_delay(delay, output)
    name = file_words(path)
    table = read_table(str(path))
    header = list(table.columns)
    first = header[0] if time is None else time
    names = Names(first, tuple(state), tuple(output), tuple(input))
    check_columns(name, header, names)
    _check_unwrap(unwrap, names)
    table, units = units_of_columns(name, table, names.time)
    t = times(name, table, names.time)
    nominal = decimate * float(np.median(np.diff(t))) if t.size > 1 else math.nan
    samples = samples_of(t) if t.size > 1 else np.zeros(t.size, dtype=np.int64)
    by = whole_samples(name, late, nominal / decimate, int(samples[-1])) if late else {}
    first_sample = max(0, -min(by.values(), default=0))
    kept = np.flatnonzero((samples % decimate == 0) & (samples >= first_sample))
    kept = kept[0 if start is None else first_row(name, t[kept], start) :]
    dt = nominal_step(name, t[kept], nominal, decimate)

    def values(c: str) -> Array:
        read = column(name, table, c, numbers)
        return unwrapped(read) if c in unwrap else read

    def columns(group: Sequence[str]) -> Array:
        return np.column_stack([values(c) for c in group])[kept]

    lines = table.index.to_numpy(dtype=np.int64)
    gaps = _gaps(t, samples, lines, int(kept[0]))
    numbered = (samples[kept] - samples[kept[0]]) // decimate
    x, y, y_lines = columns(names.state), columns(names.output), None
    if by:
        moved = [moved_back(samples, values(c), lines, by.get(c, 0)) for c in names.output]
        y, y_lines = (np.column_stack(part)[kept] for part in zip(*moved, strict=True))
    u = columns(names.input) if names.input else None
    return Log(
        str(path),
        names,
        t[kept],
        x,
        y,
        dt,
        lines[kept],
        numbered,
        gaps,
        int(decimate),
        units,
        u,
        y_lines,
        late,
    )


def _gaps(
    t: Array, samples: NDArray[np.int64], lines: NDArray[np.int64], first: int
) -> tuple[Gap, ...]:
    """Where rows are lost, from row `first` on."""
    before = np.flatnonzero(np.diff(samples) > 1)
    return tuple(
        Gap(float(t[k]), float(t[k + 1] - t[k]), int(lines[k])) for k in before[before >= first]
    )


def checked_missing(missing: Sequence[float]) -> tuple[float, ...]:
    """Numbers that stand for "not measured"; LogError for anything else."""
    numbers: Sequence[Any] = missing if isinstance(missing, list | tuple) else [missing]
    for number in numbers:
        real = isinstance(number, int | float | np.integer | np.floating) and not isinstance(
            number, bool
        )
        if not real or not -LARGEST <= number <= LARGEST:
            raise LogError(f"missing: expected finite numbers, found {shown(number)}")
    return tuple(float(number) for number in numbers)


def _check_options(
    columns: tuple[Any, Any, Any], unwrap: Any, time: Any, start: Any, decimate: Any
) -> None:
    """LogError naming the first option of `read_log` that is of a wrong kind."""
    options = ("state", "output", "input", "unwrap")
    for option, group in zip(options, (*columns, unwrap), strict=True):
        _check_texts(option, group)
    if time is not None:
        check_kind("time", time, str, "the name of a column")
    real = isinstance(start, int | float | np.integer | np.floating)
    if start is not None and not (real and (isinstance(start, float) or abs(start) <= LARGEST)):
        raise LogError(f"start: expected a time in seconds, found {shown(start)}")
    whole = isinstance(decimate, int | np.integer) and not isinstance(decimate, bool)
    if not whole or not 1 <= decimate <= MOST:
        raise LogError(f"decimate: expected a whole number of at least 1, found {shown(decimate)}")


def _check_texts(option: str, group: Sequence[str]) -> None:
    if not isinstance(group, list | tuple) or not all(isinstance(name, str) for name in group):
        raise LogError(f"{option}: expected a list of column names, found {shown(group)}")


def _check_unwrap(unwrap: Sequence[str], names: Names) -> None:
    known = "states, outputs or inputs" if names.input else "states or outputs"
    for name in unwrap:
        if name not in (*names.state, *names.output, *names.input):
            raise LogError(f"unwrap: expected a column of the {known}, found {shown(name)}")
