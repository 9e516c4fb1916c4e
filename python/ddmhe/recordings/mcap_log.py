"""Tables from MCAP, which bags of ROS 2 are: messages of JSON, Protobuf or ros2msg by topic and
path of fields, `/imu.angular_velocity.x`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from ddmhe.checks import reason
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.libraries import library
from ddmhe.recordings.messages import Message, plain, table_of_messages, wanted
from ddmhe.recordings.table import Table

__all__ = ["mcap_table"]

DECODERS = {
    "protobuf": ("mcap_protobuf.decoder", "messages of Protobuf"),
    "cdr": ("mcap_ros2.decoder", "messages of ROS 2"),
}
"""Encoding of messages, what decodes it, and how a message calls it."""


def mcap_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of an MCAP file."""
    library("mcap.reader", path, "an MCAP file")
    try:
        first = _first_messages(path, source)
        topics = wanted(path, first, asked)
        return table_of_messages(path, topics, _messages(path, source, topics))
    except LogError:
        raise
    except Exception as e:  # the reader and its decoders have a class of error each
        raise LogError(f"{path}: expected a whole MCAP file, found another ({reason(e)})") from e


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
    return lambda data: plain(decode(data))


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
