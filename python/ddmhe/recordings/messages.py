"""Messages by topic as a table: what bags and MCAP files have in common. Topics with other stamps
are joined to those of the first output, each with its latest message before."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.recordings.json_trees import table_of_objects
from ddmhe.recordings.table import Cells, Table

__all__ = ["Message", "plain", "table_of_messages", "wanted"]

LONGEST = 64
"""Lists of more elements are no channels."""
LOG_TIME = "log_time"
STAMPS = (("sec", "nanosec"), ("seconds", "nanos"))
FRESH = 0.999
"""A message joined to a row is younger than this many steps of the rows."""


class Message(NamedTuple):
    """One message."""

    topic: str
    ns: int
    """When it was logged, ns."""
    fields: Any


def plain(value: Any) -> Any:
    """A message as nested mappings of numbers and texts."""
    if isinstance(value, bool | int | float | str) or value is None:
        return value
    if isinstance(value, bytes | bytearray | memoryview):
        return None
    descriptor = getattr(value, "DESCRIPTOR", None)
    if descriptor is not None:
        return {field.name: plain(getattr(value, field.name)) for field in descriptor.fields}
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    slots = getattr(value, "__slots__", None)
    if slots is not None and not hasattr(value, "__len__"):
        names = (name for name in slots if not name.startswith("__"))
        return {name.removeprefix("_"): plain(getattr(value, name)) for name in names}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if hasattr(value, "__len__"):
        return [plain(one) for one in value] if len(value) <= LONGEST else None
    return str(value)


def table_of_messages(path: str, topics: Sequence[str], found: Iterable[Message]) -> Table:
    """The table of messages of these topics, the first of which has the rows."""
    messages: dict[str, list[Message]] = {topic: [] for topic in topics}
    for message in found:
        messages[message.topic].append(message)
    tables = [_of_topic(path, topic, of_topic) for topic, of_topic in messages.items()]
    return tables[0] if len(tables) == 1 else _joined(tables, topics)


def wanted(path: str, first: dict[str, Message], asked: Sequence[str]) -> list[str]:
    """Topics of the columns asked for, the first one's first; LogError where one is not there."""
    owner: dict[str, str] = {}
    for topic, message in first.items():
        header = table_of_objects(path, [(1, {topic: message.fields})]).header
        owner |= dict.fromkeys(header, topic)
    known = Table(path, list(owner), [[]] * len(owner), np.arange(0))
    topics = []
    for name in asked:
        at = known.index(name)
        if at is not None:
            topics.append(owner[known.header[at]])
        elif name != LOG_TIME:
            known.find("state, output, input, time", name)
    return list(dict.fromkeys(topics))


def _of_topic(path: str, topic: str, messages: Sequence[Message]) -> Table:
    """Fields of a topic, and when its messages were logged."""
    rows = [(k, {topic: message.fields}) for k, message in enumerate(messages, 1)]
    table = table_of_objects(path, rows, "message")
    logged = np.array([message.ns for message in messages], dtype=np.int64)
    return Table(
        path, [*table.header, LOG_TIME], [*table.columns, logged], table.places, "message",
        {LOG_TIME: "ns"},
    )  # fmt: skip


def _stamp_names(table: Table) -> tuple[str, str] | None:
    for name in table.header:
        for second, nano in STAMPS:
            stem = name.removesuffix(second)
            if name.endswith("." + second) and stem + nano in table.header:
                return name, stem + nano
    return None


def _stamped(table: Table) -> NDArray[np.int64] | None:
    names = _stamp_names(table)
    if names is None:
        return None
    sec, nano = (np.asarray(table.column(name)).astype(np.int64) for name in names)
    return np.asarray(sec * 10**9 + nano, dtype=np.int64)


def _joined(tables: Sequence[Table], topics: Sequence[str]) -> Table:
    """The first table with the latest rows of the others before each of its own."""
    stamps = [_stamped(table) for table in tables]
    by_stamps = all(one is not None for one in stamps)
    logged = [np.asarray(table.column(LOG_TIME)) for table in tables]
    times = [one for one in stamps if one is not None] if by_stamps else logged
    base = tables[0]
    dropped = () if by_stamps else _stamp_names(base) or ()
    header = [name for name in base.header if name not in dropped]
    columns: list[Cells] = [base.column(name) for name in header]
    fresh = FRESH * float(np.median(np.diff(times[0]))) if len(times[0]) > 1 else np.inf
    oldest = 0.0
    for table, t in zip(tables[1:], times[1:], strict=True):
        order = np.argsort(t, kind="stable")
        at = np.searchsorted(t[order], times[0], side="right") - 1
        age = times[0] - t[order][np.maximum(at, 0)]
        known = (at >= 0) & (age < fresh)
        oldest = max(oldest, float(age[known].max(initial=0)))
        for name in table.header:
            values = table.column(name)
            if name == LOG_TIME or not isinstance(values, np.ndarray):
                continue
            taken = values[order][np.maximum(at, 0)].astype(np.float64)
            header.append(name)
            columns.append(np.where(known, taken, np.nan))
    others = ", ".join(topics[1:])
    note = (
        f"{others} joined to the {'stamps' if by_stamps else 'log times'} of {topics[0]}, the "
        f"latest message before, at most {oldest / 1e6:.4g} ms old"
    )
    return Table(base.path, header, columns, base.places, "message", base.units, notes=(note,))
