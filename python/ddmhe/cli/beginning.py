"""The beginning of a log that is still being written: the recording to learn from, and the habit in
which later lines are read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from ddmhe.recordings.clock import start_of
from ddmhe.recordings.csv_log import Clocked, clocked, log_of_clocked
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.even_steps import settled
from ddmhe.recordings.log import Log
from ddmhe.recordings.options import Reading
from ddmhe.recordings.reading import Recorded, pick, recorded_of
from ddmhe.recordings.resampled import SEEN, steps_in
from ddmhe.recordings.sources import InMemory
from ddmhe.recordings.stream import Stream

__all__ = ["beginning"]

FIRST = 12
"""Lines from which the habit of a log is told."""


def beginning(path: str, lines: Iterator[str], given: dict[str, Any]) -> tuple[Recorded, Stream]:
    """The recording at the beginning of a stream, and where the stream goes on."""
    columns = (given["state"], given["output"], given.get("input") or ())
    usual: dict[str, Any] = {option.name: option.default for option in fields(Reading)}
    how = Reading(**{name: given[name] or value for name, value in usual.items()})
    parts = [pick(other, columns, how) for other in given["recording"]]
    history, fill = given["history"], given["gaps"] == "fill"
    head: list[str] = []
    wanted = FIRST
    while True:
        ended = _read_to(head, lines, wanted)
        if any("\0" in line for line in head):
            raise LogError(
                f"{path}: expected lines of CSV or JSON in UTF-8 with --follow, found bytes of "
                "another encoding or format; without --follow it is read as a whole"
            )
        try:
            found = clocked(InMemory(path, "\n".join([*head, ""]).encode()), columns, how)
            size, lacking = (None, 0) if how.resample is None else _even(found, history, how, ended)
            if not lacking:
                log = log_of_clocked(found, how, size)
                lacking = lacking or _lacking(log, history)
            if not lacking:
                recorded = recorded_of(log, parts, history, fill=fill)
                return recorded, Stream.after(log, found, how, size or 0)
        except LogError:
            if ended or wanted > FIRST:
                raise
            lacking = FIRST
        if ended:
            recorded_of(log_of_clocked(found, how), parts, history)  # says what is lacking
            raise LogError(f"{path}: expected at least {lacking} more lines, found the end")
        wanted = len(head) + lacking


def _read_to(head: list[str], lines: Iterator[str], wanted: int) -> bool:
    """More lines, up to as many as are wanted; whether the stream ended before."""
    while len(head) < wanted:
        line = next(lines, None)
        if line is None:
            return True
        head.append(line)
    return False


def _lacking(log: Log, history: float | None) -> int:
    """Rows that a recording of that length still lacks."""
    if history is None:
        return 0
    samples = round(history / log.dt) + 2 - (int(log.samples[-1]) + 1)
    return max(samples, 0) * log.decimate


def _even(found: Clocked, history: float | None, how: Reading, ended: bool) -> tuple[int, int]:
    """How many even steps are settled, and how many rows are lacking for a recording of that
    length, about; none where the log has ended."""
    t, names, dt = found.stamps.t, found.names, float(how.resample or 0.0)
    if len(t) < 2:
        return 0, 0 if ended else SEEN
    if ended:
        return steps_in(t, dt), 0
    size = settled(t, found.values((*names.state, *names.output), how), dt, bool(names.input))
    begin = 0.0 if how.start is None else start_of("the log", found.stamps, how.start)[0] - t[0]
    samples = 3 + round((history or 0.0) / (dt * how.decimate))
    seconds = dt * (samples * how.decimate - size) + max(begin, 0.0)
    rows = math.ceil(seconds / float(np.median(np.diff(t))))
    return size, max(rows, SEEN + 1 - len(t), 0)
