"""Bags of ROS 1 and ROS 2."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial
from typing import Any

from steelyard.errors import require_package

from .message_log import MessageLog, Topic
from .ros_messages import BAGS, ros_decoder

__all__ = ["Ros1Bag", "Ros2Bag"]


class Ros1Bag(MessageLog):
    """A bag of ROS 1, version 2.0, with or without compression."""

    kind = "a bag of ROS 1"
    remedy = "mend it with `rosbag reindex`, or record it again"

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        with require_package("rosbags.rosbag1", "Bags are read with the module", BAGS).Reader(self.path) as reader:
            yield _topics(reader, ros1=True)


class Ros2Bag(MessageLog):
    """A bag of ROS 2: its folder, with files of SQLite or MCAP, or one file of SQLite."""

    kind = "a bag of ROS 2"
    remedy = "mend it with `ros2 bag reindex`, or record it again"

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        with require_package("rosbags.rosbag2", "Bags are read with the module", BAGS).Reader(self.path) as reader:
            yield _topics(reader, ros1=False)


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
