"""Logs of joint states as the libraries of each format write them, with no code of ours."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

START = 1_700_000_000_123_456_789
"""ns since 1970, as a robot's clock has them."""
JOINT_STATE = "sensor_msgs/msg/JointState"


class State(NamedTuple):
    """What one message says: ns of its header and of its recording, and numbers by joint."""

    stamp: int
    names: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]
    recorded: int | None = None

    @property
    def logged(self) -> int:
        return self.stamp + 40_000 if self.recorded is None else self.recorded

    def to_dict(self) -> dict[str, Any]:
        """Return the message as JSON has it."""
        stamp = {"sec": self.stamp // 10**9, "nanosec": self.stamp % 10**9}
        numbers = {key: [float(x) for x in getattr(self, key)] for key in ("position", "velocity", "effort")}
        return {"header": {"stamp": stamp, "frame_id": ""}, "name": list(self.names), **numbers}


def states(
    t: np.ndarray, names: Sequence[str], q: np.ndarray, dq: np.ndarray | None, torque: np.ndarray
) -> list[State]:
    """Return the messages of a recording whose times are whole numbers of ns."""
    stamps = START + np.round(t * 1e9).astype(np.int64)
    velocities = np.empty((len(t), 0)) if dq is None else dq
    rows = zip(stamps.tolist(), q, velocities, torque, strict=True)
    return [State(stamp, names, *numbers) for stamp, *numbers in rows]


def ros_message(store: Any, state: State, *, ros1: bool) -> Any:
    """Return a JointState of rosbags."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=state.stamp // 10**9, nanosec=state.stamp % 10**9)
    extra = {"seq": 0} if ros1 else {}
    numbers = (np.ascontiguousarray(x, dtype=float) for x in (state.position, state.velocity, state.effort))
    return types[JOINT_STATE](
        types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **extra), list(state.names), *numbers
    )


def write_ros1(
    path: Path, topics: dict[str, Iterable[State]], compression: str | None = None, chunk_size: int = 2**20
) -> Path:
    """Write a bag of ROS 1."""
    rosbag1, typesys = pytest.importorskip("rosbags.rosbag1"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = chunk_size
    if compression is not None:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression])
    with writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
            for state in messages:
                data = store.serialize_ros1(ros_message(store, state, ros1=True), JOINT_STATE)
                writer.write(connection, state.logged, data)
    return path


def write_ros2(
    path: Path, topics: dict[str, Iterable[State]], storage: str = "SQLITE3", compression: str | None = None
) -> Path:
    """Write a bag of ROS 2, a folder."""
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage])
    if compression is not None:
        writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    with writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
            for state in messages:
                data = store.serialize_cdr(ros_message(store, state, ros1=False), JOINT_STATE)
                writer.write(connection, state.logged, data)
    return path


def write_mcap_json(
    path: Path, topics: dict[str, Iterable[State]], schema: str = "sensor_msgs/JointState", chunk_size: int = 2**20
) -> Path:
    """Write MCAP with messages in JSON."""
    library = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        writer = library.Writer(file, chunk_size=chunk_size)
        writer.start()
        number = writer.register_schema(name=schema, encoding="jsonschema", data=b'{"type": "object"}')
        for topic, messages in topics.items():
            channel = writer.register_channel(topic=topic, message_encoding="json", schema_id=number)
            for state in messages:
                data = json.dumps(state.to_dict()).encode()
                writer.add_message(channel, log_time=state.logged, publish_time=state.stamp, data=data)
        writer.finish()
    return path


def write_mcap_protobuf(path: Path, topics: dict[str, Iterable[State]]) -> Path:
    """Write MCAP with messages of Protobuf, whose schema is in the file."""
    library = pytest.importorskip("mcap_protobuf.writer")
    kind = protobuf_type()
    with path.open("wb") as file, library.Writer(file) as writer:
        for topic, messages in topics.items():
            for state in messages:
                content = state.to_dict()
                message = kind(
                    name=content["name"], **{key: content[key] for key in ("position", "velocity", "effort")}
                )
                message.header.stamp.seconds = state.stamp // 10**9
                message.header.stamp.nanos = state.stamp % 10**9
                writer.write_message(topic, message, log_time=state.logged, publish_time=state.stamp)
    return path


def protobuf_type() -> Any:
    """Return a class of messages like JointState, made without a compiler."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    field = descriptor_pb2.FieldDescriptorProto
    text, real, inner = field.TYPE_STRING, field.TYPE_DOUBLE, field.TYPE_MESSAGE
    file = descriptor_pb2.FileDescriptorProto(
        name="robot.proto", package="robot", syntax="proto3", dependency=["google/protobuf/timestamp.proto"]
    )
    header = file.message_type.add(name="Header")
    header.field.add(
        name="stamp", number=1, type=inner, label=field.LABEL_OPTIONAL, type_name=".google.protobuf.Timestamp"
    )
    state = file.message_type.add(name="JointState")
    state.field.add(name="header", number=1, type=inner, label=field.LABEL_OPTIONAL, type_name=".robot.Header")
    for number, (name, kind) in enumerate(
        zip(("name", "position", "velocity", "effort"), (text, real, real, real), strict=True)
    ):
        state.field.add(name=name, number=2 + number, type=kind, label=field.LABEL_REPEATED)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("robot.JointState"))


def write_mcap_ros(path: Path, topics: dict[str, Iterable[State]], *, ros1: bool = False, **options: bool) -> Path:
    """Write MCAP with messages as ROS serializes them."""
    library, typesys = pytest.importorskip("mcap.writer"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
    text = store.generate_msgdef(JOINT_STATE, **({} if ros1 else {"ros_version": 2}))[0]
    with path.open("wb") as file:
        writer = library.Writer(file, compression=library.CompressionType.LZ4, **options)
        writer.start(profile="ros1" if ros1 else "ros2")
        number = writer.register_schema(
            name="sensor_msgs/JointState" if ros1 else JOINT_STATE,
            encoding="ros1msg" if ros1 else "ros2msg",
            data=text.encode(),
        )
        for topic, messages in topics.items():
            encoding = "ros1" if ros1 else "cdr"
            channel = writer.register_channel(topic=topic, message_encoding=encoding, schema_id=number)
            for state in messages:
                message = ros_message(store, state, ros1=ros1)
                data = (store.serialize_ros1 if ros1 else store.serialize_cdr)(message, JOINT_STATE)
                writer.add_message(channel, log_time=state.logged, publish_time=state.stamp, data=bytes(data))
        writer.finish()
    return path


BAGS: dict[str, Callable[[Path, dict[str, Iterable[State]]], Path]] = {
    "ros1.bag": write_ros1,
    "ros1_bz2.bag": lambda path, topics: write_ros1(path, topics, "BZ2"),
    "ros1_lz4.bag": lambda path, topics: write_ros1(path, topics, "LZ4"),
    "ros2_sqlite": write_ros2,
    "ros2_sqlite_messages": lambda path, topics: write_ros2(path, topics, compression="MESSAGE"),
    "ros2_sqlite_file": lambda path, topics: write_ros2(path, topics, compression="FILE"),
    "ros2_mcap": lambda path, topics: write_ros2(path, topics, "MCAP"),
    "ros2_mcap_chunks": lambda path, topics: write_ros2(path, topics, "MCAP", "STORAGE"),
    "ros2_mcap_messages": lambda path, topics: write_ros2(path, topics, "MCAP", "MESSAGE"),
    "ros2_mcap_file": lambda path, topics: write_ros2(path, topics, "MCAP", "FILE"),
    "json.mcap": write_mcap_json,
    "protobuf.mcap": write_mcap_protobuf,
    "cdr.mcap": write_mcap_ros,
    "ros1.mcap": lambda path, topics: write_mcap_ros(path, topics, ros1=True),
    "without_channels.mcap": lambda path, topics: write_mcap_ros(path, topics, repeat_channels=False),
    "without_statistics.mcap": lambda path, topics: write_mcap_ros(path, topics, use_statistics=False),
    "without_chunks.mcap": lambda path, topics: write_mcap_ros(
        path, topics, use_chunking=False, repeat_channels=False, repeat_schemas=False, use_statistics=False
    ),
}
"""Writers of messages by the name of the file or folder."""
