"""Tables from bags of ROS that are no MCAP: SQLite databases of ROS 2, bags of ROS 1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from ddmhe.checks import reason
from ddmhe.recordings.errors import LogError
from ddmhe.recordings.libraries import library
from ddmhe.recordings.messages import Message, plain, table_of_messages, wanted
from ddmhe.recordings.table import Table

__all__ = ["bag_table"]


def bag_table(path: str, source: Path | IO[bytes], asked: Sequence[str]) -> Table:
    """The table of a bag: one database or file, or a folder of several with its metadata. Messages
    whose definitions the bag does not hold are taken as those of the latest ROS 2."""
    rosbags = library("rosbags.highlevel", path, "a bag of ROS")
    types = library("rosbags.typesys", path, "a bag of ROS")
    if not isinstance(source, Path):
        raise LogError(f"{path}: expected a bag of ROS in a file of its own, found it in another")
    try:
        usual = types.get_typestore(types.Stores.LATEST)
        with rosbags.AnyReader([source], default_typestore=usual) as reader:
            every = [next(_messages(reader, [c]), None) for c in reader.connections]
            first = {message.topic: message for message in every if message is not None}
            if not first:
                raise LogError(f"{path}: expected messages, found none")
            topics = wanted(path, first, asked)
            chosen = [c for c in reader.connections if c.topic in topics]
            return table_of_messages(path, topics, _messages(reader, chosen))
    except LogError:
        raise
    except Exception as e:  # the reader and its database have a class of error each
        raise LogError(f"{path}: expected a whole bag of ROS, found another ({reason(e)})") from e


def _messages(reader: Any, connections: Sequence[Any]) -> Iterator[Message]:
    for connection, ns, raw in reader.messages(connections=connections):
        fields = plain(reader.deserialize(raw, connection.msgtype))
        yield Message(connection.topic, int(ns), fields)
