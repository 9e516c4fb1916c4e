"""One call from logs to what an estimator needs: the recording to learn from, the outputs that
follow, and what was inferred on the way."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddmhe._core import History
from ddmhe.checks import choice, shown
from ddmhe.recordings.csv_log import log_of
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.log import Log, Split
from ddmhe.recordings.options import Reading, is_real
from ddmhe.recordings.sources import name_of

Array = NDArray[np.float64]

__all__ = ["Recorded", "pick", "read", "recorded_of"]

GAPS = ("error", "fill")
SAME_STEP = 0.01
"""Recordings of one system have steps that differ by less than this share."""
_SPAN = re.compile(r"(?P<src>.+?):(?P<a>[-+.\deE]*)\.\.(?P<b>[-+.\deE]*)\Z", re.DOTALL)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Logs as an estimator needs them: a recording of T samples, and N outputs after it."""

    history: History
    Y: Array
    """Outputs (N, p) for DdMhe.run."""
    U: Array | None
    """Known inputs (N, m) at the same instants; None for a log without."""
    t: Array
    """Times (N,) of the estimates, s; of times since 1970 counted from the first row."""
    x_true: Array | None
    """States (N, n) at t as logged, NaN where not; None if none was logged."""
    names: Names
    """Names of the columns: .time, .state, .output, .input."""
    units: Mapping[str, str]
    """Units of the columns that state one."""
    notes: tuple[str, ...]
    """What was inferred in reading and filled in, one phrase each."""
    log: Log
    """The log, all samples of it."""
    stamps: Any
    """Times (N,) of the estimates as the log has them, digit for digit: numbers or texts."""
    recordings: tuple[Log, ...]
    """The other logs that were recorded."""
    goes_on: bool
    """Whether the outputs follow the recording's end without a break."""

    def __len__(self) -> int:
        """Outputs N."""
        return len(self.Y)

    def __repr__(self) -> str:
        """Sizes and source, not the numbers."""
        h = self.history
        inputs = f", m={h.m}" if h.m else ""
        return (
            f"Recorded({self.log.path!r}, T={h.T}, N={len(self)}, n={h.n}, p={h.p}{inputs}, "
            f"dt={h.dt:.6g} s)"
        )

    @property
    def split(self) -> Split:
        """The same, as `Log.split` gives it."""
        return Split(self.history, self.Y, self.t, self.x_true, self.U)


def read(
    src: Any,
    *,
    state: Sequence[str],
    output: Sequence[str],
    input: Sequence[str] = (),
    history: float | None = None,
    recording: Sequence[Any] = (),
    time: str | None = None,
    time_unit: str | None = None,
    dt: float | None = None,
    start: float | str | None = None,
    decimate: int = 1,
    sep: str | None = None,
    decimal: str | None = None,
    comment: str | None = None,
    encoding: str | None = None,
    missing: Sequence[float | str] = (),
    duplicates: str = "error",
    sort: bool = False,
    gaps: str = "fill",
    unwrap: Sequence[str] = (),
    delay: float | Mapping[str, float] = 0.0,
    resample: float | None = None,
) -> Recorded:
    """Read logs: the recording to learn from, and the outputs to estimate from.

    What a file does not say is inferred where it is clear, and stated in `notes`; where it is not,
    an error of one sentence names the option that settles it. docs/logs.md lists formats and
    habits.

    Parameters
    ----------
    src
        A path ("-" is standard input, "log.csv#2" the second piece of a log whose clock starts
        anew), a frame (pandas, polars, pyarrow), a mapping of names to arrays, or a list of these:
        all but the last are recordings.
    state, output, input
        Names of the columns of states (n), outputs (p) and known inputs (m).
    history
        Length of the recording at the log's start, s; None with other recordings: the whole log is
        estimated.
    recording
        More recordings of the same system: sources as above, "log.csv:0..20" for a part, s of its
        clock, or (source, a, b).
    time, time_unit, dt
        The clock's column, its unit (s, ms, us, ns, min, h, days), or the step, s, of a log without
        one.
    start, decimate
        Time of the first row to use, s or a date; keep every decimate-th sample.
    sep, decimal, comment, encoding
        How a text is written: separator, decimal mark, what begins a comment, encoding.
    missing
        Numbers and words that stand for "not measured".
    duplicates, sort
        Which row of a repeated stamp counts: "error", "first", "last" or "mean"; whether rows are
        put in the order of time.
    gaps
        Lost rows and blank cells: "fill" or "error".
    unwrap
        Columns of angles to be made continuous.
    delay
        By how much outputs are late, s: one number, or numbers by their names.
    resample
        Put the log on even steps of so many seconds: states and outputs on straight lines between
        measured values, inputs held. None: nothing is resampled.

    Raises
    ------
    LogError
        One sentence naming the file or the option.

    Examples
    --------
    >>> import ddmhe
    >>> import pandas as pd
    >>> record = ddmhe.models.detumbling().simulate(duration=30.0, dt=0.1, noise=0.01)
    >>> columns = {"t": record.t, "wx_rad_s": record.x[:, 0], "torque_N_m": record.y[:, 0]}
    >>> frame = pd.DataFrame(columns)
    >>> read = ddmhe.recordings.read(frame, state=["wx_rad_s"], output=["torque_N_m"], history=20.0)
    >>> read.history.T, read.Y.shape[1]
    (200, 1)
    """
    how = Reading(
        time, start, decimate, missing, unwrap, time_unit, dt, sep, decimal, comment, encoding,
        duplicates, sort, delay, resample,
    )  # fmt: skip
    choice("gaps", gaps, GAPS)
    sources = list(src) if isinstance(src, list | tuple) else [src]
    if not sources:
        raise LogError("src: expected a path, a frame or a list of these, found an empty list")
    columns = (state, output, input)
    others = [*sources[:-1], *_listed(recording)]
    log = log_of(sources[-1], columns, how)
    parts = [pick(other, columns, how) for other in others]
    return recorded_of(log, parts, history, fill=gaps == "fill")


def _listed(recording: Any) -> list[Any]:
    if isinstance(recording, str | os.PathLike) or not isinstance(recording, list | tuple):
        return [recording]
    span = len(recording) == 3 and all(end is None or is_real(end) for end in recording[1:])
    return [recording] if span else list(recording)


def pick(recording: Any, columns: tuple[Any, Any, Any], how: Reading) -> Log:
    """The log of a recording, between the times that it names."""
    src, a, b = recording, None, None
    if isinstance(recording, tuple | list):
        if len(recording) != 3:
            raise LogError(
                f"recording: expected a source or (source, a, b), found {shown(recording)}"
            )
        src, a, b = recording
    elif isinstance(recording, str | os.PathLike) and not os.path.exists(recording):
        found = _SPAN.match(str(recording))
        if found is not None:
            src, a, b = found["src"], _time(recording, found["a"]), _time(recording, found["b"])
    log = log_of(src, columns, replace(how, start=a))
    if b is None:
        return log
    kept = int(np.searchsorted(log.t, b, side="right"))
    if kept < 3:
        raise LogError(
            f"recording: expected at least 3 samples of {name_of(src)} up to {b:g} s, found {kept}"
        )
    return _first_rows(log, kept)


def _time(recording: Any, text: str) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        raise LogError(
            f"recording: expected FILE:a..b with times in seconds, found {shown(str(recording))}"
        ) from None


def _first_rows(log: Log, kept: int) -> Log:
    last = log.t[kept - 1]
    return replace(
        log, t=log.t[:kept], x=log.x[:kept], y=log.y[:kept], lines=log.lines[:kept],
        samples=log.samples[:kept], gaps=tuple(gap for gap in log.gaps if gap.t < last),
        u=None if log.u is None else log.u[:kept],
        y_lines=None if log.y_lines is None else log.y_lines[:kept],
        stamps=None if log.stamps is None else log.stamps.rows(slice(kept)),
    )  # fmt: skip


def recorded_of(
    log: Log, parts: Sequence[Log], history: float | None, *, fill: bool = True
) -> Recorded:
    """A log behind its recording: its own first `history` seconds, after those of other logs."""
    if history is None and not parts:
        raise LogError(
            "history: expected the length of the recording in seconds, or other recordings, found "
            "none"
        )
    log = log.fill_gaps() if fill else log
    recordings = [_whole(part, log, fill) for part in parts]
    if history is None:
        split = log.whole()
    else:
        split = log.split(history)
        recordings.append(split.history)
    T = len(log.t) - 1 - len(split.t)
    after = slice(len(log.t) - len(split.t), None)
    units = {name: unit for name in dict.fromkeys(_all(log.names)) if (unit := log.unit(name))}
    if log.stamps is not None:
        units.pop(log.names.time, None)  # dates have none, whatever the column's name says
        units |= {log.names.time: log.stamps.unit} if log.stamps.unit else {}
    return Recorded(
        recordings[0] if len(recordings) == 1 else History.concat(recordings),
        split.Y,
        split.U,
        split.t,
        split.x_true,
        log.names,
        units,
        (*log.notes, *_filled(log, T), *_of_recordings(log, parts)),
        log,
        log.t[after] if log.stamps is None else log.stamps.rows(after).written,
        tuple(parts),
        history is not None,
    )


def _all(names: Names) -> tuple[str, ...]:
    return (names.time, *names.state, *names.output, *names.input)


def _whole(part: Log, log: Log, fill: bool) -> History:
    """All of a recording, with the step of the log."""
    if abs(part.dt / log.dt - 1) > SAME_STEP:
        raise LogError(
            f"recording: expected the step of {log.path}, {log.dt:.4g} s, found {part.dt:.4g} s in "
            f"{part.path}"
        )
    part = replace(part.fill_gaps() if fill else part, dt=log.dt)
    return part.recording(len(part.t) - 1)


def _filled(log: Log, T: int) -> list[str]:
    """What is said of cells that were bridged inside the history of T samples."""
    if T < 1:
        return []
    recorded = np.column_stack([log.x[:T], log.y[:T]])
    blank = int(np.isnan(recorded[log.lines[:T] > 0]).sum())
    return [f"{blank} blank cells inside the history interpolated"] if blank else []


def _of_recordings(log: Log, parts: Sequence[Log]) -> list[str]:
    notes = []
    for part in parts:
        notes.append(
            f"recorded: {part.path} from {part.t[0]:.6g} to {part.t[-1]:.6g} s, {len(part.t)} rows"
        )
        notes += [note for note in part.notes if note not in log.notes]
        same = part.path == log.path and part.t[-1] >= log.t[0] and part.t[0] <= log.t[-1]
        if same and part.path not in ("standard input",) and not part.path.startswith("the "):
            notes.append("this part is also estimated, with errors that look too good")
    return notes
