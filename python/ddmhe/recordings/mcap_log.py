"""Tables from MCAP, which bags of ROS 2 are: messages of JSON, Protobuf or ros2msg by topic and
path of fields, `/imu.angular_velocity.x`. Topics with other stamps are joined to those of the first
output, each with its latest message before."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ddmhe.checks import reason
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.json_lines import table_of_objects
from ddmhe.recordings.libraries import library
from ddmhe.recordings.table import Cells, Table

__all__ = ["mcap_table"]

LONGEST = 64
"""Lists of more elements are no channels."""
LOG_TIME = "log_time"
DECODERS = {
    "protobuf": ("mcap_protobuf.decoder", "messages of Protobuf"),
    "cdr": ("mcap_ros2.decoder", "messages of ROS 2"),
}
"""Encoding of messages, what decodes it, and how a message calls it."""
STAMPS = (("sec", "nanosec"), ("seconds", "nanos"))
FRESH = 0.999
"""A message joined to a row is younger than this many steps of the rows."""


class Message(NamedTuple):
    """One message."""

    topic: str
    ns: int
    """When it was logged, ns."""
    fields: Any


def mcap_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of an MCAP file."""
    library("mcap.reader", path, "an MCAP file")
    try:
        first = _first_messages(path, source)
        topics = _wanted(path, first, asked)
        messages: dict[str, list[Message]] = {topic: [] for topic in topics}
        for message in _messages(path, source, topics):
            messages[message.topic].append(message)
    except LogError:
        raise
    except Exception as e:  # the reader and its decoders have a class of error each
        raise LogError(f"{path}: expected a whole MCAP file, found another ({reason(e)})") from e
    tables = [_of_topic(path, topic, found) for topic, found in messages.items()]
    return tables[0] if len(tables) == 1 else _joined(tables, topics)


def _messages(path: str, source: Path | IO[bytes], topics: Sequence[str] | None) -> Iterator[Any]:
    reader = library("mcap.reader", path, "an MCAP file")
    if isinstance(source, Path):
        with open(source, "rb") as file:
            yield from _decoded(path, reader.make_reader(file), topics)
    else:
        source.seek(0)
        yield from _decoded(path, reader.make_reader(source), topics)


def _decoded(path: str, reader: Any, topics: Sequence[str] | None) -> Iterator[Message]:
    decoders: dict[int, Callable[[bytes], Any]] = {}
    for schema, channel, message in reader.iter_messages(topics=topics):
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(path, schema, channel)
        fields = decoders[channel.id](message.data)
        yield Message(channel.topic, int(message.log_time), fields)


def _decoder(path: str, schema: Any, channel: Any) -> Callable[[bytes], Any]:
    if channel.message_encoding == "json":
        return json.loads
    known = DECODERS.get(channel.message_encoding)
    if known is None:
        return lambda _: {}
    factory = library(known[0], path, known[1]).DecoderFactory()
    decode = factory.decoder_for(channel.message_encoding, schema)
    if decode is None:
        return lambda _: {}
    return lambda data: _plain(decode(data))


def _plain(value: Any) -> Any:
    """A message as nested mappings of numbers and texts."""
    if isinstance(value, bool | int | float | str) or value is None:
        return value
    if isinstance(value, bytes | bytearray | memoryview):
        return None
    descriptor = getattr(value, "DESCRIPTOR", None)
    if descriptor is not None:
        return {field.name: _plain(getattr(value, field.name)) for field in descriptor.fields}
    slots = getattr(value, "__slots__", None)
    if slots is not None and not hasattr(value, "__len__"):
        names = (name for name in slots if not name.startswith("__"))
        return {name.removeprefix("_"): _plain(getattr(value, name)) for name in names}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if hasattr(value, "__len__"):
        return [_plain(one) for one in value] if len(value) <= LONGEST else None
    return str(value)


def _first_messages(path: str, source: Path | IO[bytes]) -> dict[str, Message]:
    """The first message of every topic."""
    found: dict[str, Message] = {}
    every = _topics(path, source)
    for message in _messages(path, source, None):
        found.setdefault(message.topic, message)
        if every and set(found) == every:
            break
    if not found:
        raise LogError(f"{path}: expected messages, found none")
    return found


def _topics(path: str, source: Path | IO[bytes]) -> set[str]:
    """Topics with messages, as the file's summary lists them; empty where it has none."""
    reader = library("mcap.reader", path, "an MCAP file")

    def listed(stream: IO[bytes]) -> set[str]:
        summary = reader.make_reader(stream).get_summary()
        if summary is None or summary.statistics is None:
            return set()
        counts = summary.statistics.channel_message_counts
        return {c.topic for c in summary.channels.values() if counts.get(c.id)}

    if isinstance(source, Path):
        with open(source, "rb") as file:
            return listed(file)
    source.seek(0)
    return listed(source)


def _wanted(path: str, first: dict[str, Message], asked: Sequence[str]) -> list[str]:
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
