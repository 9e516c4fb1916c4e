"""A log read as the options say, and what looks odd in it said on stderr."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ddmhe._core import wrapped_angle
from ddmhe.cli.printing import warn
from ddmhe.recordings.csv_log import log_of
from ddmhe.recordings.log import Log
from ddmhe.recordings.oddities import far_out
from ddmhe.recordings.options import Reading
from ddmhe.recordings.reading import Recorded, pick, recorded_of

__all__ = ["print_notes", "read", "untold"]


SHOWN = 3
"""How many values and lines a warning names."""


def read(log: Path, given: dict[str, Any]) -> tuple[Log, Recorded]:
    """The samples of a log and what an estimator takes of it; takes the options of `log_options`
    out of `given`.

    What sits oddly in a column is pointed out on stderr.
    """
    columns = tuple(given.pop(name, ()) for name in ("state", "output", "input"))
    history, recording, gaps = (given.pop(name) for name in ("history", "recording", "gaps"))
    if history is None and not recording:
        raise click.UsageError("Missing option '--history' (or '--recording').")
    options = {option.name: given.pop(option.name) for option in fields(Reading)}
    how = Reading(**options | {"missing": options["missing"] or ()})
    samples = log_of(log, columns, how)
    parts = [pick(source, columns, how) for source in recording]
    for one in (*parts, samples):
        for sentence in _oddities(one):
            warn(sentence)
    recorded = recorded_of(samples, parts, history, fill=gaps == "fill")
    return recorded.log, recorded


def print_notes(console: Console, recorded: Recorded) -> None:
    """What was inferred in reading, in one line."""
    notes = "; ".join(recorded.notes)
    if notes:
        words = f"{recorded.log.path}: {notes}"
        console.print(words, markup=False, highlight=False, soft_wrap=True)


def _oddities(log: Log) -> Iterator[str]:
    """What sits oddly in the columns of a log, in words that name the option for it."""
    columns = dict(zip(log.names.state, log.x.T, strict=True)) | dict(
        zip(log.names.output, log.y.T, strict=True)
    )
    if log.u is not None:
        columns |= dict(zip(log.names.input, log.u.T, strict=True))
    for name, values in columns.items():
        rows = far_out(values)
        if rows.size:
            found = [f"{v:.10g}" for v in dict.fromkeys(values[rows])]
            lines = [str(line) for line in log.lines[rows]]
            yield (
                f"{log.path}, column {name!r}: {_some(found)} in {log.place} {_some(lines)} sits "
                "more than 50 deviations out on its own; if it says not measured: --missing "
                f"{','.join(found)}"
            )
        wrapped = wrapped_angle(values)
        if wrapped is not None:
            full, row = wrapped
            yield (
                f"{log.path}, column {name!r}, {log.place} {log.lines[row]}: looks like an angle "
                f"that jumps by a full turn of {full:.6g}, which no linear motion does; use its "
                f"cosine and sine as two columns, or --unwrap {name}"
            )


def untold(log: Log, warnings: Iterable[str]) -> Iterator[str]:
    """Warnings of an estimator without those on angles in columns that `_oddities` has named."""
    told = tuple(
        f"{kind} {index} (counted from 0) jumps by"
        for kind, columns in (("state", log.x.T), ("output", log.y.T))
        for index, values in enumerate(columns)
        if wrapped_angle(values) is not None
    )
    return (sentence for sentence in warnings if not sentence.startswith(told))


def _some(words: list[str]) -> str:
    more = f" and {len(words) - SHOWN} more" if len(words) > SHOWN else ""
    return ", ".join(words[:SHOWN]) + more
