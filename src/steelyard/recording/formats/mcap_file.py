"""Logs as MCAP, with messages of ROS 1 or ROS 2, in JSON, or in Protobuf."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from steelyard.errors import InputError, require_package
from steelyard.files.arguments import all_listed

from .message_log import MessageLog, Topic
from .ros_messages import BAGS, ros_decoder

__all__ = ["McapFile"]

LARGEST_RECORD = 2**30
"""Bytes of a chunk, which stands in memory; writers make them of some MB."""
DECODED = ("cdr", "ros1", "json", "protobuf")


class McapFile(MessageLog):
    """An MCAP file; messages are decoded by the schemas that stand in it."""

    kind = "MCAP"
    remedy = "mend it with `mcap recover`, or record it again"

    @contextlib.contextmanager
    def _opened(self) -> Iterator[list[Topic]]:
        library = require_package("mcap.reader", "MCAP files are read with the module", BAGS)
        with self.path.open("rb") as file:
            options = {"validate_crcs": True, "record_size_limit": LARGEST_RECORD}

            def begin() -> Any:
                """Return a reader that goes through the file once, from its beginning."""
                file.seek(0)
                return library.NonSeekingReader(file, **options)

            reader = library.SeekingReader(file, **options)
            channels: dict[str, tuple[Any, Any]] = {}
            counts: dict[str, int] = {}
            summary = reader.get_summary()
            indexed = summary is not None and summary.statistics is not None and bool(summary.chunk_indexes)
            if indexed and set(summary.statistics.channel_message_counts) <= set(summary.channels):
                for number, channel in summary.channels.items():
                    channels[channel.topic] = channel, summary.schemas.get(channel.schema_id)
                    count = summary.statistics.channel_message_counts.get(number, 0)
                    counts[channel.topic] = counts.get(channel.topic, 0) + count
            else:  # without an index, messages come in the order in which they were written
                indexed = False
                for schema, channel, _ in begin().iter_messages(log_time_order=False):
                    channels[channel.topic] = channel, schema
                    counts[channel.topic] = counts.get(channel.topic, 0) + 1
            yield [
                Topic(
                    name,
                    "" if schema is None else schema.name,
                    counts[name],
                    partial(self._messages, (lambda: reader) if indexed else begin, name, indexed),
                    channel.message_encoding in ("json", "protobuf"),
                )
                for name, (channel, schema) in channels.items()
            ]

    def _messages(self, begin: Callable[[], Any], topic: str, in_order: bool) -> Iterator[tuple[int, Any]]:
        decoders: dict[int, Callable[[bytes], Any]] = {}  # each publisher has a channel of its own
        for schema, channel, message in begin().iter_messages(topics=[topic], log_time_order=in_order):
            decode = decoders.get(channel.id)
            if decode is None:
                decode = decoders[channel.id] = self._decoder(channel, schema)
            yield message.log_time, decode(message.data)

    def _decoder(self, channel: Any, schema: Any) -> Callable[[bytes], Any]:
        encoding = channel.message_encoding
        if encoding == "json":
            return json.loads
        if encoding == "protobuf":
            library = require_package(
                "mcap_protobuf.decoder", "Messages of Protobuf in MCAP files are read with the module", BAGS
            )
            decoder = library.DecoderFactory().decoder_for(encoding, schema)
            if decoder is not None:
                return decoder  # type: ignore[no-any-return]
        elif encoding in ("cdr", "ros1") and schema is not None:
            language = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl", "omgidl": "idl"}.get(schema.encoding, "")
            text = schema.data.decode("utf-8", errors="replace") if language else ""
            kind = schema.name if schema.name.count("/") == 2 else schema.name.replace("/", "/msg/", 1)
            return ros_decoder(kind, language, text, ros1=encoding == "ros1")
        raise InputError(
            f"{self.path}: the topic {channel.topic} has messages in the encoding {encoding!r} with "
            f"{'no schema' if schema is None else f'a schema in {schema.encoding!r}'}; read are "
            f"{all_listed(DECODED)} with their schemas: convert it, or name another `topic`."
        )
