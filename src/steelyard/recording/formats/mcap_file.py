"""Logs as MCAP, with messages of ROS 1 or ROS 2, in JSON, or in Protobuf."""

from __future__ import annotations

import contextlib
import heapq
import io
import json
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import IO, Any

from steelyard.errors import InputError, require_package
from steelyard.files.arguments import all_listed

from .message_log import MessageLog, Topic
from .ros_messages import ros_decoder
from .unpacking import AT_ONCE, BAGS, DECODED, RECORD, TIMES, Unpacking

__all__ = ["McapFile", "McapMessages"]

LARGEST_RECORD = 2**30
"""Bytes of a chunk, which stands in memory; writers make them of some MB."""
DECODED_KINDS = ("cdr", "ros1", "json", "protobuf")
END = 37
"""Bytes of the footer and of the mark behind it."""
RECORD_HEAD, MESSAGE_HEAD = struct.Struct("<BQ"), struct.Struct("<HIQQ")
SCHEMA, CHANNEL, MESSAGE = 3, 4, 5
HELD = 200
"""Bytes that a message takes beside its own."""


class McapFile(MessageLog):
    """An MCAP file; messages are decoded by the schemas that stand in it."""

    kind = "MCAP"
    remedy = "mend it with `mcap recover`, or record it again"

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        with self.path.open("rb") as file:
            yield McapMessages(file, Unpacking(self.path, self.path.stat().st_size)).topics()


class McapMessages:
    """The messages of an open MCAP file.

    Chunks are unpacked and taken apart here, not by the library: it makes objects of all that a chunk holds, of which
    a few kB may be millions.

    Parameters
    ----------
    file : IO[bytes]
    unpacking : Unpacking
    compression : str
        How each message is packed beside.
    """

    def __init__(self, file: IO[bytes], unpacking: Unpacking, compression: str = "") -> None:
        self._file, self._unpacking, self._compression = file, unpacking, compression
        self._library = require_package("mcap.stream_reader", "MCAP files are read with the module", BAGS)
        self._records = require_package("mcap.records", "MCAP files are read with the module", BAGS)
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._chunks: list[Any] = []  # without an index, messages come in the order in which they were written

    def topics(self) -> list[Topic]:
        """Return the topics, with what reads their messages as long as the file is open."""
        counts = self._indexed_counts()
        if counts is None:
            self._chunks, counts = [], {}
            for channel, _ in self._as_written(None):
                counts[channel.id] = counts.get(channel.id, 0) + 1
        topics: dict[str, tuple[Any, int]] = {}
        for number, count in counts.items():
            channel = self._channels[number]
            topics[channel.topic] = channel, count + topics.get(channel.topic, (None, 0))[1]
        return [
            Topic(
                name,
                schema.name if (schema := self._schemas.get(channel.schema_id)) else "",
                count,
                partial(self._decoded, name),
                channel.message_encoding in ("json", "protobuf"),
            )
            for name, (channel, count) in topics.items()
        ]

    def _read(self, start: int, **options: bool) -> Iterator[Any]:
        self._file.seek(start)
        reader = self._library.StreamReader(self._file, emit_chunks=True, record_size_limit=LARGEST_RECORD, **options)
        for record in reader.records:
            self._unpacking.spend(RECORD)
            yield record

    def _indexed_counts(self) -> dict[int, int] | None:
        """Return the numbers of messages by channel that the index tells, None where it does not tell them."""
        self._library.read_magic(self._library.ReadDataStream(self._file))
        end = self._file.seek(-END, io.SEEK_END)
        footer = next(self._read(end, skip_magic=True))
        if not isinstance(footer, self._records.Footer):
            raise ValueError("it does not end with a footer")
        statistics = None
        for record in self._read(footer.summary_start, skip_magic=True) if footer.summary_start else ():
            if isinstance(record, self._records.Statistics):
                statistics = record
            elif isinstance(record, self._records.Schema):
                self._schemas[record.id] = record
            elif isinstance(record, self._records.Channel):
                self._channels[record.id] = record
            elif isinstance(record, self._records.ChunkIndex):
                self._chunks.append(record)
        if statistics is None or not self._chunks:
            return None
        counts = statistics.channel_message_counts  # writers that do not count by channel leave it empty
        schemas = {channel.schema_id for channel in self._channels.values()} - {0}  # 0 is none
        if not counts or not counts.keys() <= self._channels.keys() or not schemas <= self._schemas.keys():
            return None
        return {number: counts.get(number, 0) for number in self._channels}

    def _as_written(self, topic: str | None) -> Iterator[tuple[Any, Any]]:
        """Yield the messages of one topic, or of all, with their channels, as they stand in the file."""
        for record in self._read(0, validate_crcs=True):
            for one in self._unpacked(record) if isinstance(record, self._records.Chunk) else (record,):
                if isinstance(one, self._records.Schema):
                    self._schemas[one.id] = one
                elif isinstance(one, self._records.Channel):
                    self._channels[one.id] = one
                elif isinstance(one, self._records.Message):
                    channel = self._channel(one.channel_id)
                    if topic is None or channel.topic == topic:
                        yield channel, one

    def _channel(self, number: int) -> Any:
        if number not in self._channels:
            raise ValueError(f"it has messages of the channel {number}, which is not there")
        return self._channels[number]

    def _in_order(self, topic: str) -> Iterator[tuple[Any, Any]]:
        """Yield the messages of a topic by when they were recorded, and by where they stand."""
        self._unpacking.spend(RECORD * len(self._chunks))
        waiting: list[tuple[int, int, int, Any]] = []
        held = 0
        for index in sorted(self._chunks, key=lambda one: (one.message_start_time, one.chunk_start_offset)):
            offsets = index.message_index_offsets
            if offsets and not any(self._channel(number).topic == topic for number in offsets):
                continue
            start = index.message_start_time, index.chunk_start_offset
            while waiting and waiting[0][:2] < start:
                *_, message = heapq.heappop(waiting)
                held -= len(message.data) + HELD
                yield self._channel(message.channel_id), message
            self._file.seek(index.chunk_start_offset + RECORD_HEAD.size)
            chunk = self._records.Chunk.read(self._library.ReadDataStream(self._file))
            for number, record in enumerate(self._unpacked(chunk)):
                if isinstance(record, self._records.Message) and self._channel(record.channel_id).topic == topic:
                    heapq.heappush(waiting, (record.log_time, index.chunk_start_offset, number, record))
                    held += len(record.data) + HELD
                    if held > max(AT_ONCE, TIMES * len(chunk.data)):
                        raise InputError(
                            f"{self._unpacking.path} has too many chunks that begin before others end; put its "
                            "messages in order with `mcap sort`."
                        )
        while waiting:
            *_, message = heapq.heappop(waiting)
            yield self._channel(message.channel_id), message

    def _unpacked(self, chunk: Any) -> Iterator[Any]:
        """Yield the records of a chunk, one after the other."""
        data = self._unpacking.unpacked(chunk.compression, chunk.data, chunk.uncompressed_size)
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("the checksum of a chunk does not fit to it")
        kinds = {SCHEMA: self._records.Schema, CHANNEL: self._records.Channel}
        begin = 0
        while begin < len(data):
            self._unpacking.spend(RECORD)
            kind, length = RECORD_HEAD.unpack_from(data, begin)
            begin += RECORD_HEAD.size
            end = begin + length
            if end > len(data):
                raise ValueError("a record ends behind its chunk")
            if kind == MESSAGE:
                channel, sequence, logged, published = MESSAGE_HEAD.unpack_from(data, begin)
                content = data[begin + MESSAGE_HEAD.size : end]
                yield self._records.Message(channel, logged, content, published, sequence)
            elif kind in kinds:
                yield kinds[kind].read(self._library.ReadDataStream(io.BytesIO(data[begin:end])))
            begin = end

    def _decoded(self, topic: str) -> Iterator[tuple[int, Any]]:
        decoders: dict[int, Callable[[bytes], Any]] = {}  # each publisher has a channel of its own
        for channel, message in self._in_order(topic) if self._chunks else self._as_written(topic):
            decode = decoders.get(channel.id)
            if decode is None:
                schema = self._schemas.get(channel.schema_id)
                decode = decoders[channel.id] = _decoder(channel, schema, self._unpacking)
            data = self._unpacking.unpacked(self._compression, message.data)
            if self._unpacking.takes(data):
                yield message.log_time, decode(data)


def _decoder(channel: Any, schema: Any, unpacking: Unpacking) -> Callable[[bytes], Any]:
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding == "protobuf" and schema is not None and schema.encoding == encoding:
        key = schema.name, schema.data
        if key not in unpacking.decoders:
            library = require_package(
                "mcap_protobuf.decoder", "Messages of Protobuf in MCAP files are read with the module", BAGS
            )
            unpacking.spend(DECODED * len(schema.data))
            unpacking.decoders[key] = library.DecoderFactory().decoder_for(encoding, schema)
        return unpacking.decoders[key]
    if encoding in ("cdr", "ros1") and schema is not None:
        language = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl"}.get(schema.encoding, "")
        text = schema.data.decode("utf-8", errors="replace") if language else ""
        kind = schema.name if schema.name.count("/") == 2 else schema.name.replace("/", "/msg/", 1)
        return ros_decoder(kind, language, text, unpacking, ros1=encoding == "ros1")
    raise InputError(
        f"{unpacking.path}: the topic {channel.topic} has messages in the encoding {encoding!r} with "
        f"{'no schema' if schema is None else f'a schema in {schema.encoding!r}'}; read are "
        f"{all_listed(DECODED_KINDS)} with their schemas: convert it, or name another `topic`."
    )
