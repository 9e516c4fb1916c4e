"""Log files: a CSV of samples in, a checked `Log` out, and its split into a history and the outputs
that follow.

A CSV has one header line and one row per sample. An empty cell, NaN, NA, n/a, null or none means
"not measured", and so do the numbers that `missing` names: allowed in outputs and states after the
history, an error inside it. A log samples regularly: its stamps may jitter or come late, but where
the clock says that rows are lost there is a gap. Rows are numbered on the clock's grid before they
are thinned, so that every k-th sample stays every k-th whatever is lost. Gaps are errors unless
`Log.fill_gaps` turned them into rows not measured: the estimator then runs through them without
data, and inside the history at most 10 such rows in a row are interpolated."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ddmhe._core import DdmheError, History
from ddmhe.checks import check_kind, check_path, shown
from ddmhe.grid import samples_of
from ddmhe.oddities import unwrapped
from ddmhe.units import unit_of

Array = NDArray[np.float64]

__all__ = ["Gap", "Log", "LogError", "Names", "Split", "read_log"]

JITTER, JITTERY_SHARE = 0.25, 0.2
"""Steps off the nominal one by more than JITTER are bad; a log with more than this share of them is
not regular."""
MOST_INTERPOLATED = 10
"""A longer stretch of filled rows inside the history is an invention, not a recording. Seven in a
row left the errors
on the measured pendulum logs as they were; cutting the recording there doubled them."""
MOST_FILLED = 2
"""Filling may at most double a log: beyond that it is several logs."""
LARGEST = float(np.finfo(np.float64).max)
_NOT_MEASURED = frozenset({"", "nan", "na", "n/a", "#n/a", "<na>", "null", "none"})
_SECONDS = frozenset({"s", "sec", "secs", "second", "seconds"})


class LogError(DdmheError):
    """A log file cannot be used as asked."""


@dataclass(frozen=True)
class Names:
    """Column names of a log."""

    time: str
    state: tuple[str, ...]
    output: tuple[str, ...]


class Gap(NamedTuple):
    """Rows that a log lacks."""

    t: float
    """Time of the row before, s."""
    length: float
    """Time to the row after, s."""
    line: int
    """Line of the row before in the file, from 1."""


class Split(NamedTuple):
    """A log as the estimator needs it; N estimates follow the history of T samples."""

    history: History
    Y: Array
    """Outputs (N, p) for DdMhe.run: log rows T to T+N-1."""
    t: Array
    """Times (N,) of the estimates, s: log rows T+1 to T+N."""
    x_true: Array | None
    """States (N, n) at t as logged, NaN where not; None if none was logged."""


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of one log, N rows."""

    path: str
    names: Names
    t: Array
    """Time (N,), s, the log's own clock."""
    x: Array
    """States (N, n), NaN where not measured."""
    y: Array
    """Outputs (N, p), NaN where not measured."""
    dt: float
    """Nominal step, s: the median step of the log as sampled, times the decimation."""
    lines: NDArray[np.int64]
    """Line of each row in the file (N,), from 1; 0 for a row that `fill_gaps` added."""
    samples: NDArray[np.int64]
    """Number of each row on the grid of steps dt (N,), from 0; a number that is left out is a
    sample that is lost."""
    gaps: tuple[Gap, ...]
    """Where the file lacks rows, also ones that the decimation would have left out; none after
    `fill_gaps`."""
    decimate: int = 1
    """dt is this many steps of the file."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of columns, from a line below the header; a column that is not among them may state its
    own in its name."""

    def unit(self, column: str) -> str:
        """The unit of a column, "" where neither a line of units nor its name states one."""
        return self.units.get(column) or unit_of(column)

    def fill_gaps(self) -> Log:
        """The log on a gapless grid: in each gap the samples that are missing, all of them NaN (not
        measured).

        Raises LogError where more samples are missing than there are.
        """
        rows = self.samples
        size = int(rows[-1]) + 1
        if size > MOST_FILLED * rows.size:
            raise LogError(
                f"{self.path}: expected gaps that can be filled, found {size - rows.size} samples missing"
            )

        def spread(values: Array) -> Array:
            wide = np.full((size, values.shape[1]), np.nan)
            wide[rows] = values
            return wide

        lines = np.zeros(size, dtype=np.int64)
        lines[rows] = self.lines
        t = np.interp(np.arange(size), rows, self.t)
        filled = np.arange(size, dtype=np.int64)
        return replace(
            self, t=t, x=spread(self.x), y=spread(self.y), lines=lines, samples=filled, gaps=()
        )

    def history_samples(self, history: float) -> int:
        """T = round(history/dt).

        Raises LogError if `history` (s) is not a positive number, shorter than 2 samples or longer
        than the log."""
        real = isinstance(history, int | float | np.integer | np.floating) and not isinstance(
            history, bool
        )
        if not real or not 0 < history <= LARGEST:
            raise LogError(
                f"history: expected a positive number of seconds, found {shown(history)}"
            )
        samples, last = round(history / self.dt), len(self.t) - 1
        if samples < 2:
            raise LogError(
                f"history: expected at least 2 samples ({2 * self.dt:.4g} s), found {history} s"
            )
        if samples >= last:
            raise LogError(
                f"history: expected less than {last * self.dt:.4g} s, the {last + 1} samples that {self.path} holds "
                f"from {self.t[0]:.10g} s on, found {history} s"
            )
        return samples

    def split(self, history: float) -> Split:
        """Cut the log after `history` seconds: states of rows 0 to T and outputs of rows 0 to T-1
        are the history.

        Raises LogError for a history that does not fit, for samples missing inside it, and for
        gaps."""
        T = self.history_samples(history)
        if self.gaps:
            gap = self.gaps[0]
            where = "inside the history" if gap.t < self.t[T] else "after the history"
            raise LogError(
                f"{self.path}: gap {where} at {gap.t:.10g} s (line {gap.line}): expected steps of about "
                f"{self.dt / self.decimate:.4g} s, found {gap.length:.4g} s; use another start or history, or fill the "
                f"gaps (--gaps fill)"
            )
        self._check_measured(self.x[: T + 1], self.names.state)
        self._check_measured(self.y[:T], self.names.output)
        x_units, y_units = (
            [self.unit(name) for name in names] for names in (self.names.state, self.names.output)
        )
        recorded = History(
            self._bridged(self.x, T + 1),
            self._bridged(self.y, T),
            dt=self.dt,
            x_units=x_units,
            y_units=y_units,
        )
        x_true = self.x[T + 1 :]
        return Split(
            recorded, self.y[T:-1], self.t[T + 1 :], None if np.isnan(x_true).all() else x_true
        )

    def _bridged(self, values: Array, size: int) -> Array:
        """Rows 0 to size-1 with the filled ones interpolated between their neighbours in the log.

        Seams between recordings would invent nothing, but they cost every window that crosses one;
        on measured pendulum logs with gaps of one or two rows interpolation was clearly better."""
        real = np.flatnonzero(self.lines)
        runs = np.diff(real[: np.searchsorted(real, size) + 1]) - 1
        if runs.max() > MOST_INTERPOLATED:
            row = int(real[int(np.argmax(runs > MOST_INTERPOLATED))])
            raise LogError(
                f"{self.path}: gap inside the history at {self.t[row]:.10g} s (line {self.lines[row]}): "
                f"expected at most {MOST_INTERPOLATED} missing samples, found {runs.max()}"
            )
        at, rows = np.arange(size), np.arange(len(values))
        known = np.isfinite(values)
        return np.column_stack(
            [np.interp(at, rows[k], column[k]) for k, column in zip(known.T, values.T, strict=True)]
        )

    def _check_measured(self, values: Array, names: Sequence[str]) -> None:
        lacking = np.argwhere(np.isnan(values) & (self.lines[: len(values), None] > 0))
        if lacking.size:
            row, column = lacking[0]
            raise LogError(
                f"{self.path}, line {self.lines[row]}, column {names[column]!r}: expected a number inside the "
                f"history, found an empty cell, NaN or a number that stands for not measured"
            )


def read_log(
    path: str | Path,
    state: Sequence[str],
    output: Sequence[str],
    time: str | None = None,
    start: float | None = None,
    decimate: int = 1,
    *,
    missing: Sequence[float] = (),
    unwrap: Sequence[str] = (),
) -> Log:
    """Read a CSV log, keep samples 0, decimate, 2 decimate, … of its clock, and of these the ones
    from time `start` on.

    Parameters
    ----------
    path : path of a CSV file with one header line, which a line of units may follow state, output :
    names of the state columns (n) and output columns (p); one column may be both time : name of the
    time column, in seconds; default the first column start : time of the log's own clock, s;
    default the first row decimate : keep every decimate-th sample, at least 1; one whose row is
    lost is a gap, the next ones stay in place missing : numbers that stand for "not measured" in
    state and output columns, like -9999 unwrap : columns of angles within one turn (2 pi or 360) to
    be made continuous

    Raises
    ------
    LogError
        One sentence naming the file, and the column and line where there is one.
    """
    check_path("path", path)
    name = str(path)
    for option, group in (("state", state), ("output", output), ("unwrap", unwrap)):
        _check_texts(option, group)
    if time is not None:
        check_kind("time", time, str, "the name of a column")
    if start is not None and not isinstance(start, int | float | np.integer | np.floating):
        raise LogError(f"start: expected a time in seconds, found {shown(start)}")
    _check_decimate(decimate)
    numbers = checked_missing(missing)
    table = _read_table(name)
    names = _checked_names(name, list(table.columns), state, output, time)
    _check_unwrap(unwrap, names)
    table, units = _units(name, table, names.time)
    t = _time(name, table, names.time)
    nominal = decimate * float(np.median(np.diff(t))) if t.size > 1 else math.nan
    samples = samples_of(t) if t.size > 1 else np.zeros(t.size, dtype=np.int64)
    kept = np.flatnonzero(samples % decimate == 0)
    kept = kept[0 if start is None else _first_row(name, t[kept], start) :]
    dt = _step(name, t[kept], nominal, decimate)

    def columns(group: Sequence[str]) -> Array:
        values = [_column(name, table, column, numbers) for column in group]
        return np.column_stack(
            [unwrapped(v) if c in unwrap else v for c, v in zip(group, values, strict=True)]
        )[kept]  # fmt: skip

    lines = table.index.to_numpy(dtype=np.int64)
    before = np.flatnonzero(np.diff(samples) > 1)
    before = before[before >= kept[0]]
    gaps = tuple(Gap(float(t[k]), float(t[k + 1] - t[k]), int(lines[k])) for k in before)
    numbered = (samples[kept] - samples[kept[0]]) // decimate
    x, y = columns(names.state), columns(names.output)
    return Log(name, names, t[kept], x, y, dt, lines[kept], numbered, gaps, int(decimate), units)


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


def _check_decimate(decimate: int) -> None:
    if isinstance(decimate, bool) or not isinstance(decimate, int | np.integer) or decimate < 1:
        raise LogError(f"decimate: expected a whole number of at least 1, found {shown(decimate)}")


def _check_texts(option: str, group: Sequence[str]) -> None:
    if not isinstance(group, list | tuple) or not all(isinstance(column, str) for column in group):
        raise LogError(f"{option}: expected a list of column names, found {shown(group)}")


def _check_unwrap(unwrap: Sequence[str], names: Names) -> None:
    for column in unwrap:
        if column not in (*names.state, *names.output):
            raise LogError(f"unwrap: expected a column of the states or outputs, found {column!r}")


def _read_table(path: str) -> pd.DataFrame:
    """The file as text cells, its header as columns, its line numbers as index; empty lines
    dropped."""
    try:
        cells = pd.read_csv(
            path, header=None, dtype=str, na_filter=False, skip_blank_lines=False, index_col=False,
            skipinitialspace=True, encoding="utf-8-sig", quoting=csv.QUOTE_MINIMAL,
        )  # fmt: skip
    except FileNotFoundError:
        raise LogError(f"{path}: expected a log file, found no such file") from None
    except OSError as e:
        raise LogError(
            f"{path}: expected a readable log file, found that it is not ({e.strerror})"
        ) from e
    except pd.errors.EmptyDataError:
        raise LogError(f"{path}: expected a header line and samples, found an empty file") from None
    except UnicodeDecodeError as e:
        raise LogError(f"{path}: expected a text file in UTF-8, found bytes that are not") from e
    except pd.errors.ParserError as e:
        raise LogError(
            f"{path}: expected a CSV table, found one that cannot be read ({_one_line(e)})"
        ) from e
    cells = cells.fillna("")
    cells.index += 1
    header = [str(c).strip() for c in cells.iloc[0]]
    table = cells.iloc[1:].set_axis(header, axis="columns")
    table = table[(table != "").any(axis="columns")]
    if table.empty:
        raise LogError(f"{path}: expected samples after the header line, found none")
    return table


def _checked_names(
    path: str, header: list[str], state: Sequence[str], output: Sequence[str], time: str | None
) -> Names:
    time = header[0] if time is None else time
    for option, group in (("time", [time]), ("state", state), ("output", output)):
        if not group:
            raise LogError(f"{option}: expected at least one column name, found none")
        for column in group:
            if column not in header:
                raise LogError(
                    f"{option}: expected a column of {path}, found {column!r}{_nearest(column, header)}"
                )
            if header.count(column) > 1:
                raise LogError(
                    f"{path}: expected one column named {column!r}, found {header.count(column)}"
                )
            if list(group).count(column) > 1:
                raise LogError(
                    f"{option}: expected different columns, found {column!r} more than once"
                )
            if option != "time" and column == time:
                raise LogError(
                    f"{option}: expected columns other than the time column, found {column!r}"
                )
    return Names(time, tuple(state), tuple(output))


def _nearest(column: str, header: list[str]) -> str:
    close = difflib.get_close_matches(column, header, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"{hint} (columns: {', '.join(header)})"


def _units(path: str, table: pd.DataFrame, time: str) -> tuple[pd.DataFrame, dict[str, str]]:
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
            f"{path}, line {table.index[0]}, column {time!r}: expected a time in seconds, found the unit {of_time!r}"
        )
    return table.iloc[1:], units


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _column(path: str, table: pd.DataFrame, column: str, missing: Sequence[float] = ()) -> Array:
    """One column as numbers, NaN where the cell says that nothing was measured."""
    cells = table[column].str.strip()
    values = np.array(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)
    wrong = np.isinf(values)
    unread = np.flatnonzero(np.isnan(values))
    wrong[unread] = [c.lower() not in _NOT_MEASURED for c in cells.iloc[unread]]
    if wrong.any():
        row = int(np.argmax(wrong))
        raise LogError(
            f"{path}, line {table.index[row]}, column {column!r}: expected a finite number, found {cells.iloc[row]!r}"
        )
    return np.where(np.isin(values, missing), np.nan, values)


def _time(path: str, table: pd.DataFrame, column: str) -> Array:
    t = _column(path, table, column)
    if np.isnan(t).any():
        line = table.index[int(np.argmax(np.isnan(t)))]
        raise LogError(
            f"{path}, line {line}, column {column!r}: expected a time in seconds, found none"
        )
    back = np.diff(t) <= 0
    if back.any():
        row = int(np.argmax(back)) + 1
        raise LogError(
            f"{path}, line {table.index[row]}, column {column!r}: expected a time after the {t[row - 1]:.10g} s of the "
            f"line before, found {t[row]:.10g} s"
        )
    return t


def _first_row(path: str, t: Array, start: float) -> int:
    if not start <= t[-1]:  # written so that NaN is refused too
        raise LogError(
            f"start: expected at most {t[-1]:.10g} s, the last time of {path}, found {start} s"
        )
    return int(np.argmax(t >= start))


def _step(path: str, t: Array, nominal: float, decimate: int) -> float:
    """The nominal step, the median of the undecimated log times `decimate`: coarse time stamps do
    not shift it.

    LogError if the steps do not keep to it.
    """
    if t.size < 3:
        raise LogError(
            f"{path}: expected at least 3 samples from the start on, every {decimate} rows, found {t.size}"
            if decimate > 1
            else f"{path}: expected at least 3 samples from the start on, found {t.size}"
        )
    steps, dt = np.diff(t), nominal
    bad = np.abs(steps - dt) > JITTER * dt
    if bad.mean() > JITTERY_SHARE:
        raise LogError(
            f"{path}: expected regular sampling, found {bad.mean():.0%} of the steps off the nominal {dt:.4g} s by "
            f"more than {JITTER:.0%}"
        )
    return dt


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
