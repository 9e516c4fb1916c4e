"""A log read as the options say, and what looks odd in it said on stderr."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from ddmhe._core import History, wrapped_angle
from ddmhe.checks import file_words, shown, word
from ddmhe.cli.answer import Answer
from ddmhe.cli.telling import in_words_of
from ddmhe.recordings.csv_log import log_of
from ddmhe.recordings.errors import Names
from ddmhe.recordings.log import Log
from ddmhe.recordings.oddities import far_out
from ddmhe.recordings.options import Reading
from ddmhe.recordings.reading import Recorded, pick, recorded_of

__all__ = ["late_words", "read", "untold"]


SHOWN = 3
"""How many values and lines a warning names."""


def read(answer: Answer, log: Path, given: dict[str, Any]) -> tuple[Log, Recorded]:
    """The samples of a log and what an estimator takes of it; takes the options of `log_options`
    out of `given`.

    What was inferred is said, what sits oddly in a column is warned of.
    """
    columns = tuple(given.pop(name, ()) for name in ("state", "output", "input"))
    history, recording, gaps = (given.pop(name) for name in ("history", "recording", "gaps"))
    if history is None and not recording:
        raise click.UsageError("Missing option '--history' (or '--recording').")
    options = {option.name: given.pop(option.name) for option in fields(Reading)}
    how = Reading(
        **options | {"missing": options["missing"] or (), "delay": options["delay"] or 0.0}
    )
    with answer.working("reading"):
        samples = log_of(log, columns, how)
        parts = [pick(source, columns, how) for source in recording]
    for one in (*parts, samples):
        for sentence in _oddities(one):
            answer.warn(sentence)
    recorded = recorded_of(samples, parts, history, fill=gaps == "fill")
    late = late_words(recorded.history, samples.names)
    if late:
        answer.warn(f"{samples.path}: {late}")
    if recorded.notes:
        answer.note(f"{samples.path}: {'; '.join(recorded.notes)}")
    answer.facts(notes=recorded.notes)
    return recorded.log, recorded


def late_words(history: History, names: Names) -> str:
    """Which recorded outputs surely lag the recorded states or lead them, and the option that takes
    it off; empty where none does."""
    from ddmhe.design.delay import output_delay

    found = output_delay(history)
    option = ",".join(
        f"{name}={d * history.dt:.4g}"
        for name, d in zip(names.output, found.samples, strict=True)
        if d
    )
    return f"{', '.join(in_words_of(names, found.words))}: --delay {option}" if option else ""


def _oddities(log: Log) -> Iterator[str]:
    """What sits oddly in the columns of a log, in words that name the option for it."""
    path = file_words(log.path)
    groups = [(log.names.state, log.x, False), (log.names.output, log.y, True)]
    if log.u is not None:
        groups.append((log.names.input, log.u, False))
    columns = {
        name: (values, log.output_lines[:, i] if moved else log.lines)
        for names, group, moved in groups
        for i, (name, values) in enumerate(zip(names, group.T, strict=True))
    }
    for name, (values, of_column) in columns.items():
        rows = far_out(values)
        if rows.size:
            found = [f"{v:.10g}" for v in dict.fromkeys(values[rows])]
            lines = [str(line) for line in of_column[rows]]
            yield (
                f"{path}, column {shown(name)}: {_some(found)} in {log.place} {_some(lines)} "
                "sits more than 50 deviations out on its own; if it says not measured: --missing "
                f"{','.join(found)}"
            )
        wrapped = wrapped_angle(values)
        if wrapped is not None:
            full, row = wrapped
            yield (
                f"{path}, column {shown(name)}, {log.place} {of_column[row]}: looks like an "
                "angle that "
                f"jumps by a full turn of {full:.6g}, which no linear motion does; use its cosine "
                f"and sine as two columns, or --unwrap {word(name)}"
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
