"""Bags of ROS 1 and ROS 2."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial
from typing import Any, ClassVar

from steelyard.errors import require_package

from .message_log import MessageLog, Topic
from .ros_messages import BAGS, ros_decoder

__all__ = ["Ros1Bag", "Ros2Bag"]


class _Bag(MessageLog):
    """A bag of either version of ROS."""

    version: ClassVar[int]

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        library = require_package(f"rosbags.rosbag{self.version}", "Bags are read with the module", BAGS)
        self._require_begin()
        with library.Reader(self.path) as reader:
            yield _topics(reader, ros1=self.version == 1)

    def _require_begin(self) -> None:
        """Refuse what the library would search for the end of its first line."""


class Ros1Bag(_Bag):
    """A bag of ROS 1, version 2.0, with or without compression."""

    version = 1
    kind = "a bag of ROS 1"
    remedy = "mend it with `rosbag reindex`, or record it again"
    _BEGIN = b"#ROSBAG V2.0\n"

    def _require_begin(self) -> None:
        with self.path.open("rb") as file:
            if file.read(len(self._BEGIN)) != self._BEGIN:
                raise ValueError("it does not begin with #ROSBAG V2.0")


class Ros2Bag(_Bag):
    """A bag of ROS 2: its folder, with files of SQLite or MCAP, or one file of SQLite."""

    version = 2
    kind = "a bag of ROS 2"
    remedy = "mend it with `ros2 bag reindex`, or record it again"


def _topics(reader: Any, *, ros1: bool) -> list[Topic]:
    """Return the topics of a bag; a topic may have several connections, one for each publisher."""
    connections: dict[tuple[str, str], list[Any]] = {}
    for connection in reader.connections:
        connections.setdefault((connection.topic, connection.msgtype), []).append(connection)
    return [
        Topic(name, kind, sum(one.msgcount for one in each), partial(_messages, reader, each, ros1))
        for (name, kind), each in connections.items()
    ]


def _messages(reader: Any, connections: list[Any], ros1: bool) -> Iterator[tuple[int, Any]]:
    definition = next((one.msgdef for one in connections if one.msgdef.data), None)
    language = "" if definition is None else definition.format.name.lower()
    text = "" if definition is None else definition.data
    decode = ros_decoder(connections[0].msgtype, language, text, ros1=ros1)
    for _, recorded, data in reader.messages(connections=connections):
        yield recorded, decode(data)
