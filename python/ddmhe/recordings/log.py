"""A log: samples on a regular clock, and its split into a recording and the outputs that follow.

A log samples regularly: its stamps may jitter or come late, but where the clock says that rows are
lost there is a gap. Gaps are errors unless `Log.fill_gaps` turned them into rows not measured: the
estimator then runs through them without data, and inside the history at most 10 such rows in a row,
or blank cells, are interpolated. Known inputs act at every sample: they are never filled in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import History
from ddmhe.checks import shown
from ddmhe.recordings.errors import LARGEST, LogError, Names
from ddmhe.recordings.stamps import Stamps
from ddmhe.recordings.units import unit_of

Array = NDArray[np.float64]

__all__ = ["LARGEST", "Gap", "Log", "LogError", "Names", "Split"]

MOST_INTERPOLATED = 10
"""A longer stretch of filled rows inside the history is an invention, not a recording. Seven in a
row left the errors on the measured pendulum logs as they were; cutting the recording there doubled
them."""
MOST_BLANK = 0.25
"""Share of a column's cells inside the history that may be blank: more is another sampling."""
MOST_FILLED = 2
"""Filling may at most double a log: beyond that it is several logs."""


class Gap(NamedTuple):
    """Rows that a log lacks."""

    t: float
    """Time of the row before, s."""
    length: float
    """Time to the row after, s."""
    line: int
    """Line of the row before in the file, from 1."""


@dataclass(frozen=True, eq=False)
class Split:
    """A log as the estimator needs it; N estimates follow the history of T samples.

    It unpacks as (history, Y, t, x_true)."""

    history: History
    Y: Array
    """Outputs (N, p) for DdMhe.run: log rows T to T+N-1."""
    t: Array
    """Times (N,) of the estimates, s: log rows T+1 to T+N."""
    x_true: Array | None
    """States (N, n) at t as logged, NaN where not; None if none was logged."""
    U: Array | None = None
    """Known inputs (N, m) at the rows of Y, for DdMhe.run; None for a log without."""

    def __iter__(self) -> Iterator[Any]:
        """The four parts of a log without inputs."""
        return iter((self.history, self.Y, self.t, self.x_true))


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
    u: Array | None = None
    """Known inputs (N, m), NaN where the file has no number; None for a log without."""
    y_lines: NDArray[np.int64] | None = None
    """Line of the file in which each output stands (N, p), 0 for none; None where that is the line
    of the row, as it is without a delay."""
    delay: Mapping[str, float] = field(default_factory=dict)
    """By how much outputs were late, s, by the names of those that were."""
    stamps: Stamps | None = None
    """The times as the file has them (N,), digit for digit."""
    notes: tuple[str, ...] = ()
    """What was inferred in reading, one phrase each."""
    place: str = "line"
    """What `lines` counts: "line", or "row" where there are none."""
    digest: str | None = None
    """SHA-256 of the file; None for frames."""
    filled: bool = False
    """Whether `fill_gaps` made it: then blank cells inside the history are bridged, too."""

    @property
    def output_lines(self) -> NDArray[np.int64]:
        """Line of the file in which each output stands (N, p), 0 for none."""
        if self.y_lines is not None:
            return self.y_lines
        return np.repeat(self.lines[:, None], self.y.shape[1], axis=1)

    def __len__(self) -> int:
        """Rows N."""
        return len(self.t)

    def __repr__(self) -> str:
        """Sizes and source, not the numbers."""
        sizes = f"N={len(self)}, n={self.x.shape[1]}, p={self.y.shape[1]}"
        inputs = "" if self.u is None else f", m={self.u.shape[1]}"
        gaps = f", {len(self.gaps)} gaps" if self.gaps else ""
        return f"Log({self.path!r}, {sizes}{inputs}, dt={self.dt:.6g} s{gaps})"

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
                f"{self.path}: expected gaps that can be filled, found {size - rows.size} samples "
                "missing"
            )

        def spread(values: Any, empty: float = np.nan) -> Any:
            wide = np.full((size, values.shape[1]), empty, dtype=values.dtype)
            wide[rows] = values
            return wide

        lines = np.zeros(size, dtype=np.int64)
        lines[rows] = self.lines
        t = np.interp(np.arange(size), rows, self.t)
        filled = np.arange(size, dtype=np.int64)
        x, y = spread(self.x), spread(self.y)
        u = None if self.u is None else spread(self.u)
        y_lines = None if self.y_lines is None else spread(self.y_lines, 0)
        stamps = None if self.stamps is None else self.stamps.spread(rows, size)
        return replace(
            self, t=t, x=x, y=y, lines=lines, samples=filled, gaps=(), u=u, stamps=stamps,
            filled=True, y_lines=y_lines,
        )  # fmt: skip

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
                f"history: expected less than {last * self.dt:.4g} s, the {last + 1} samples that "
                f"{self.path} holds from {self.t[0]:.10g} s on, found {history} s"
            )
        return samples

    def split(self, history: float) -> Split:
        """Cut the log after `history` seconds: states of rows 0 to T and outputs of rows 0 to T-1
        are the history, with the inputs at the same rows.

        Raises LogError for a history that does not fit, for samples missing inside it, for gaps,
        and for an input without a number at any row but the last."""
        T = self.history_samples(history)
        if self.gaps:
            gap = self.gaps[0]
            where = "inside the history" if gap.t < self.t[T] else "after the history"
            raise LogError(
                f"{self.path}: gap {where} at {gap.t:.10g} s ({self.place} {gap.line}): expected "
                f"steps of about {self.dt / self.decimate:.4g} s, found {gap.length:.4g} s; use "
                "another start or history, or fill the gaps (--gaps fill)"
            )
        return self._after(T, self._history(T))

    def recording(self, T: int) -> History:
        """The first T samples alone; errors as of `split`."""
        if self.gaps:
            raise LogError(
                f"{self.path}: gap at {self.gaps[0].t:.10g} s ({self.place} {self.gaps[0].line}); "
                "cut the recording there, or fill the gaps (--gaps fill)"
            )
        return self._history(T)

    def whole(self) -> Split:
        """All of the log behind a recording from elsewhere: outputs of rows 0 to N-2, states of
        rows 1 to N-1. The history is None."""
        self._check_known()
        return self._after(0, None)

    def _history(self, T: int) -> History:
        """The first T samples; errors for what is not measured in them."""
        if not self.filled:
            self._check_measured(self.x[: T + 1], self._x_lines, self.names.state)
            self._check_measured(self.y[:T], self.output_lines, self.names.output)
        self._check_known()
        return History(
            self._bridged(self.x, self._x_lines, T + 1, self.names.state),
            self._bridged(self.y, self.output_lines, T, self.names.output),
            dt=self.dt,
            x_units=[self.unit(name) for name in self.names.state],
            y_units=[self.unit(name) for name in self.names.output],
            u=None if self.u is None else self.u[:T],
            u_units=None if self.u is None else [self.unit(name) for name in self.names.input],
        )

    def _after(self, T: int, history: Any) -> Split:
        x_true = self.x[T + 1 :]
        return Split(
            history,
            self.y[T:-1],
            self.t[T + 1 :],
            None if np.isnan(x_true).all() else x_true,
            None if self.u is None else self.u[T:-1],
        )

    def _check_known(self) -> None:
        """LogError naming the first column and line of an input that has no number; the last row is
        not asked, for nothing follows that it acts on."""
        lacking = np.argwhere(np.isnan(self.u[:-1])) if self.u is not None else np.empty((0, 2))
        if not lacking.size:
            return
        row, column = map(int, lacking[0])
        name = self.names.input[column]
        if self.lines[row] > 0:
            raise LogError(
                f"{self.path}, {self.place} {self.lines[row]}, column {shown(name)}: expected a "
                "number "
                "at every sample of an input, found an empty cell, NaN or a number that stands for "
                "not measured"
            )
        before = int(np.flatnonzero(self.lines[:row])[-1])
        after = row + int(np.argmax(self.lines[row:] > 0))
        raise LogError(
            f"{self.path}: gap at {self.t[before]:.10g} s ({self.place} {self.lines[before]}), "
            f"column {shown(name)}: expected a number at every sample of an input, found "
            f"{after - before - 1} samples missing; write what the input was there into the file, "
            "or use another start or history"
        )

    @property
    def _x_lines(self) -> NDArray[np.int64]:
        return np.repeat(self.lines[:, None], self.x.shape[1], axis=1)

    def _bridged(
        self, values: Array, lines: NDArray[np.int64], size: int, names: Sequence[str]
    ) -> Array:
        """Rows 0 to size-1 with filled rows and blank cells interpolated between their neighbours
        in the log; `lines` is 0 where a value was filled in.

        Seams between recordings would invent nothing, but they cost every window that crosses one;
        on measured pendulum logs with gaps of one or two rows interpolation was clearly better."""
        columns = []
        for column, of_column, name in zip(values.T, lines.T, names, strict=True):
            self._check_runs(np.flatnonzero(of_column), size)
            columns.append(self._column_bridged(column, of_column, size, name))
        return np.column_stack(columns)

    def _check_runs(self, real: NDArray[np.intp], size: int) -> None:
        """LogError where more than MOST_INTERPOLATED of the rows 0 to size-1 are missing in a row;
        `real` are those that are not. Without a delay the rows around a history are in the log."""
        if not real.size or real[-1] < size - 1 or real[0] > 0:
            raise LogError(
                f"history: expected outputs for all of it, found that a delay of {self._delays} "
                f"leaves rows of {self.path} without"
            )
        runs = np.diff(real[: np.searchsorted(real, size) + 1]) - 1
        if runs.max(initial=0) > MOST_INTERPOLATED:
            row = int(real[int(np.argmax(runs > MOST_INTERPOLATED))])
            raise LogError(
                f"{self.path}: gap inside the history at {self.t[row]:.10g} s ({self.place} "
                f"{self.lines[row]}): expected at most {MOST_INTERPOLATED} missing samples, found "
                f"{runs.max()}; --start or --history choose other rows"
            )

    @property
    def _delays(self) -> str:
        return ", ".join(f"{seconds:g} s of {shown(name)}" for name, seconds in self.delay.items())

    def _column_bridged(
        self, values: Array, lines: NDArray[np.int64], size: int, name: str
    ) -> Array:
        """One column (N,) without its blank cells in rows 0 to size-1; LogError where there are too
        many of them."""
        known = np.isfinite(values)
        blank = ~known[:size] & (lines[:size] > 0)
        rows = np.flatnonzero(known)
        if not blank.any():
            return np.interp(np.arange(size), rows, values[rows])
        edges = np.concatenate([[-1], rows[: np.searchsorted(rows, size) + 1]])
        runs = np.diff(np.append(edges, size) if edges[-1] < size else edges) - 1
        begun = known[0] and rows[-1] >= size - 1
        share = float(blank.mean())
        if not begun or runs.max() > MOST_INTERPOLATED or share > MOST_BLANK:
            at = int(edges[int(np.argmax(runs > MOST_INTERPOLATED))]) + 1
            row = at if runs.max() > MOST_INTERPOLATED else int(np.argmax(blank))
            while lines[row] == 0:
                row += 1
            raise LogError(
                f"{self.path}, {self.place} {lines[row]}, column {shown(name)}: expected at most "
                f"{MOST_INTERPOLATED} cells in a row and {MOST_BLANK:.0%} of all not measured "
                f"inside the history, a number first and last, found up to {runs.max()} in a row, "
                f"{share:.0%} of all; --start, --history or --decimate choose other rows"
            )
        return np.interp(np.arange(size), rows, values[rows])

    def _check_measured(
        self, values: Array, lines: NDArray[np.int64], names: Sequence[str]
    ) -> None:
        lacking = np.argwhere(np.isnan(values) & (lines[: len(values)] > 0))
        if lacking.size:
            row, column = lacking[0]
            where = f"{self.place} {lines[row, column]}, column {shown(names[column])}"
            raise LogError(
                f"{self.path}, {where}: expected a number inside the history, found an empty "
                "cell, NaN or a number that stands for not measured"
            )
