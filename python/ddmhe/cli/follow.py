"""``ddmhe estimate --follow``: a log that is still being written. Lines in, estimates out.

A line (t, y) gives at once the estimate of the next instant, t plus a step. What was read and not
yet used is part of the snapshot, so that the run goes on bit for bit."""

from __future__ import annotations

import csv
import json
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from ddmhe._core import DdMhe, DdmheError, Estimate
from ddmhe.checks import check_path, file_words, one_line, reason
from ddmhe.cli.answer import Answer
from ddmhe.cli.beginning import beginning
from ddmhe.cli.telling import in_words_of
from ddmhe.files import write
from ddmhe.recordings.errors import LogError, Names
from ddmhe.recordings.reading import Recorded
from ddmhe.recordings.stream import Row, Stream
from ddmhe.report.trust import reason_words

__all__ = ["follow"]

POLL = 0.1
"""Seconds between looks at a file that may have grown."""
CHUNK = 1 << 16


class Lines:
    """Whole lines of a growing file or of standard input, until a signal asks to stop."""

    def __init__(self, log: Path, offset: int, tail: bytes) -> None:
        self.path = "standard input" if str(log) == "-" else str(log)
        self.file = str(log) != "-"
        try:
            self.fd = os.open(log, os.O_RDONLY) if self.file else sys.stdin.fileno()
        except OSError as e:
            raise LogError(
                f"{file_words(log)}: expected a readable log file, found that it is not "
                f"({e.strerror})"
            ) from e
        if self.file:
            os.lseek(self.fd, offset, os.SEEK_SET)
        self.offset, self.tail = offset, tail
        self.stopped = False
        self.number = 0
        self._wake, wake = os.pipe()
        os.set_blocking(wake, False)
        signal.set_wakeup_fd(wake)
        for kind in (signal.SIGTERM, signal.SIGINT):
            signal.signal(kind, self._stop)

    def _stop(self, number: int, frame: Any) -> None:
        self.stopped = True

    def __iter__(self) -> Iterator[str]:
        while True:
            *lines, self.tail = self.tail.split(b"\n")
            for line in lines:
                self.number += 1
                yield line.decode("utf-8", "replace").rstrip("\r")
            if not self._more():
                break
        if self.tail and not self.stopped:  # the end, without a line's end
            self.number += 1
            last, self.tail = self.tail, b""
            yield last.decode("utf-8", "replace")

    def _more(self) -> bool:
        """More bytes; False at the end of standard input, or when asked to stop."""
        while not self.stopped:
            waited = [self._wake] if self.file else [self._wake, self.fd]
            chunk = b""
            if self.file:
                chunk = os.read(self.fd, CHUNK)
                if not chunk:
                    select.select(waited, [], [], POLL)
                    continue
            elif self.fd in select.select(waited, [], [])[0]:
                chunk = os.read(self.fd, CHUNK)
                if not chunk:
                    return False
            self.offset += len(chunk)
            self.tail += chunk
            if chunk:
                return True
        return False


class Writer:
    """Estimates as lines of CSV or JSON, flushed one by one."""

    def __init__(self, stream: TextIO, as_json: bool, names: list[str], time: str) -> None:
        self.stream, self.as_json = stream, as_json
        self.header = [time, *names, *(f"{name}_std" for name in names)]
        self.header += ["trusted", "reasons", "status", "measured"]
        self.rows = csv.writer(stream, lineterminator="\n")

    def begin(self) -> None:
        if not self.as_json:
            self.rows.writerow(self.header)
            self.stream.flush()

    def put(self, written: Any, e: Estimate, measured: bool) -> None:
        """One estimate; not measured: of a sample that was lost."""
        std = [""] * len(e.x) if e.std is None else e.std.tolist()
        reasons = reason_words(np.array([e.reasons or 0], dtype=np.uint8))[0]
        trusted = "" if e.trusted is None else int(e.trusted)
        row = [written, *e.x.tolist(), *std, trusted, reasons, str(e.status), int(measured)]
        if self.as_json:
            known = {k: v for k, v in zip(self.header, row, strict=True) if v != ""}
            self.stream.write(json.dumps(known | {"reasons": reasons}) + "\n")
        else:
            self.rows.writerow(row)
        self.stream.flush()


def follow(
    answer: Answer,
    log: Path,
    given: dict[str, Any],
    settings: Callable[[Names, bool], dict[str, Any]],
    out: Path | None,
    resume: Path | None,
) -> None:
    """Estimate a log while it is written, until its end or a signal; `settings` gives the keywords
    of DdMhe, told the names of columns and whether the log goes on where its recording ends."""
    snapshot = resume if resume is not None else Path(
        "ddmhe-follow.snapshot" if str(log) == "-" else f"{log}.snapshot"
    )  # fmt: skip
    if resume is not None and resume.exists():
        est, stream, lines, names, time = _restored(log, resume)
        begun: Recorded | None = None
    else:
        lines = Lines(log, 0, b"")
        source = iter(lines)
        begun, stream = beginning(lines.path, source, given)
        est = DdMhe(begun.history, **settings(begun.names, begun.goes_on))
        names, time = list(begun.names.state), begun.names.time
        notes = one_line("; ".join(begun.notes))
        if not answer.quiet:
            print(f"ddmhe: {begun.log.path}: {notes}", file=sys.stderr)
        for sentence in in_words_of(begun.names, est.warnings):
            answer.warn(sentence)
    with _opened(out, begun is None) as target:
        writer = Writer(target, stream.format.sep is None, names, time)
        if begun is not None:
            writer.begin()
            _catch_up(begun, est, stream, writer)
        for line in lines if begun is None else source:
            _one(answer, line, lines, est, stream, writer)
        if not lines.stopped:
            _step(stream.rest(), est, writer)
    if lines.stopped:
        _store(snapshot, est, stream, lines, names, time)
        print(f"ddmhe: stopped; --resume {snapshot} goes on from here", file=sys.stderr)


def _opened(out: Path | None, resumed: bool) -> Any:
    if out is None:
        return open(sys.stdout.fileno(), "w", closefd=False, encoding="utf-8", newline="")
    return open(out, "a" if resumed else "w", encoding="utf-8", newline="")


def _catch_up(begun: Recorded, est: DdMhe, stream: Stream, writer: Writer) -> None:
    """The estimates of what was read beyond the recording."""
    log, first = begun.log, len(begun.log.t) - 1 - len(begun.t)
    for k in range(first, len(log.t)):
        e = est.step(log.y[k], None if log.u is None else log.u[k])
        measured = log.lines[k] > 0 and (stream.even is None or bool(np.isfinite(log.y[k]).any()))
        writer.put(stream.next_time(log, k), e, measured)


def _one(
    answer: Answer, line: str, lines: Lines, est: DdMhe, stream: Stream, writer: Writer
) -> None:
    """The estimates that a line brings: of samples that were lost before it, and of its own. A line
    that is none is told and left out."""
    if not line.strip():
        return
    held = "" if stream.u is None else ", their inputs taken as before"
    try:
        lost, rows = stream.take(line)
    except DdmheError as error:
        answer.warn(f"{lines.path}, line {lines.number}: {error}; left out")
        return
    if lost > 0:
        answer.warn(f"{lines.path}, line {lines.number}: {lost} samples lost before{held}")
    _step(rows, est, writer)


def _step(rows: Sequence[Row], est: DdMhe, writer: Writer) -> None:
    for row in rows:
        writer.put(row.after, est.step(row.y, row.u), row.measured)


def _store(
    path: Path, est: DdMhe, stream: Stream, lines: Lines, names: list[str], time: str
) -> None:
    """All that is needed to go on."""
    state = {
        "stream": stream.plain(),
        "lines": [lines.offset, lines.number],
        "names": names,
        "time": time,
    }
    arrays = {
        "estimator": np.frombuffer(est.snapshot(), dtype=np.uint8),
        "tail": np.frombuffer(lines.tail, dtype=np.uint8),
        "state": np.frombuffer(json.dumps(state).encode(), dtype=np.uint8),
    }

    def save(beside: Path) -> None:
        with open(beside, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    write(path, save)


def _restored(log: Path, path: Path) -> tuple[DdMhe, Stream, Lines, list[str], str]:
    check_path("resume", path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            state = json.loads(stored["state"].tobytes())
            est = DdMhe.restore(stored["estimator"].tobytes())
            tail = stored["tail"].tobytes()
        stream = Stream.restored(state["stream"])
        lines = Lines(log, state["lines"][0], tail)
        lines.number = state["lines"][1]
        return est, stream, lines, state["names"], state["time"]
    except (OSError, ValueError, KeyError, TypeError) as e:
        if isinstance(e, DdmheError):
            raise
        raise LogError(
            f"{file_words(path)}: expected a snapshot of --follow, found another file ({reason(e)})"
        ) from e
