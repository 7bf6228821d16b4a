"""Bags of ROS 1."""

from __future__ import annotations

import contextlib
import heapq
import io
import os
from collections.abc import Iterator, Sequence
from functools import partial
from typing import IO, Any

from steelyard.errors import require_package

from .message_log import MessageLog, Topic
from .ros_messages import ros_decoder
from .unpacking import BAGS, DECODED, LARGEST_MESSAGE, RECORD, Unpacking

__all__ = ["Ros1Bag"]

MESSAGE, CONNECTION = 2, 7
BEGIN = b"#ROSBAG V2.0\n"


class Ros1Bag(MessageLog):
    """A bag of ROS 1, version 2.0, with or without compression."""

    kind = "a bag of ROS 1"
    remedy = "mend it with `rosbag reindex`, or record it again"

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        library = require_package("rosbags.rosbag1.reader", "Bags are read with the module", BAGS)
        with self.path.open("rb") as file:
            if file.read(len(BEGIN)) != BEGIN:  # the library would search for the end of the first line
                raise ValueError("it does not begin with #ROSBAG V2.0")
            with _reader(library, self.path) as reader:
                content = _Content(library, reader, file, Unpacking(self.path, self.path.stat().st_size))
                yield content.topics()


def _reader(library: Any, path: os.PathLike[str]) -> Any:
    """Return the library's reader, which reads the index; chunks of a forged bag may share their parts of it."""
    most = os.path.getsize(path)
    numbers: set[int] = set()

    class Reader(library.Reader):  # type: ignore[misc, name-defined, unused-ignore]
        indexed = 0

        def read_index_data(self, pos: int, indexes: Any) -> None:
            begin = self.bio.tell()
            super().read_index_data(pos, indexes)
            self.indexed += self.bio.tell() - begin
            if self.indexed > most:
                raise ValueError("its index lists more messages than it holds")

        def read_connection(self) -> Any:
            connection = super().read_connection()
            if connection.id in numbers:
                raise ValueError("its index lists a connection twice")
            numbers.add(connection.id)
            return connection

    return Reader(path)


class _Content:
    """What an open bag holds.

    Chunks are unpacked here, since the library unpacks whatever is in them, and again whenever messages of two chunks
    alternate.
    """

    def __init__(self, library: Any, reader: Any, file: IO[bytes], unpacking: Unpacking) -> None:
        self._library, self._reader, self._file, self._unpacking = library, reader, file, unpacking

    def topics(self) -> list[Topic]:
        """Return the topics; one may have several connections, one for each publisher."""
        connections: dict[tuple[str, str], list[Any]] = {}
        for connection in self._reader.connections:
            connections.setdefault((connection.topic, connection.msgtype), []).append(connection)
        return [
            Topic(name, kind, sum(one.msgcount for one in each), partial(self._decoded, each))
            for (name, kind), each in connections.items()
        ]

    def _decoded(self, connections: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        text = next((one.msgdef.data for one in connections if one.msgdef.data), "")
        decode = ros_decoder(connections[0].msgtype, "msg" if text else "", text, self._unpacking, ros1=True)
        place, chunk = -1, io.BytesIO()
        for entry in heapq.merge(*(self._reader.indexes[one.id] for one in connections)):
            if entry.chunk_pos != place:
                place, chunk = entry.chunk_pos, self._chunk(entry.chunk_pos)
            data = self._message(chunk, entry)
            if self._unpacking.takes(data):
                yield entry.time, decode(data)

    def _chunk(self, place: int) -> io.BytesIO:
        self._file.seek(place)
        header = self._library.Header.read(self._file)
        data = self._library.read_bytes(self._file, self._library.read_uint32(self._file))
        return io.BytesIO(self._unpacking.unpacked(header.get_string("compression"), data, header.get_uint32("size")))

    def _message(self, chunk: io.BytesIO, entry: Any) -> bytes:
        chunk.seek(entry.offset)
        while True:
            length = self._library.read_uint32(chunk)
            if length > LARGEST_MESSAGE:
                raise ValueError("the header of a message is longer than any message")
            self._unpacking.spend(RECORD + DECODED * length)
            chunk.seek(-4, os.SEEK_CUR)
            header = self._library.Header.read(chunk)
            if header.get_uint8("op") != CONNECTION:
                break
            chunk.seek(self._library.read_uint32(chunk), os.SEEK_CUR)
        if header.get_uint8("op") != MESSAGE or header.get_time("time") != entry.time:
            raise ValueError("its index names places and times at which there is no message")
        data: bytes = self._library.read_bytes(chunk, self._library.read_uint32(chunk))
        return data
