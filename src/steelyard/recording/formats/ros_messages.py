"""Decoding of ROS messages, by the definitions that stand in a file or else by those that ROS ships."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from steelyard.errors import require_package

from .unpacking import BAGS, Unpacking

__all__ = ["ros_decoder"]

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
POINTS = ("desired", "actual", "error"), ("reference", "feedback", "error", "output")
"""Its points in the versions of control_msgs until Humble and since, which bags of SQLite do not tell until Iron."""
SEPARATOR = "=" * 80 + "\n"
CHARACTER, EXPRESSION = 2**11, 2**18
"""Bytes that are unpacked in the time in which the library reads a character of a definition, and a number of IDL."""
NO_CODE = re.compile(r'/[*](?:[^*]|[*](?!/))*(?:[*]/|\Z)|//[^\n]*|"(?:\\"|[^"])*(?:"|\Z)')
"""Comments and texts of IDL, the last of which may have no end."""
EXPRESSIONS = re.compile(r"[^\w\s]\s*\(|<<")
"""Brackets within brackets, for each of which the library takes a hundred times the time, and shifts, by which a number
fills the memory. Constants of messages have neither."""
EXPRESSIONS_BEGIN = re.compile(r"[=@(,<\[]")
MOST_WRITTEN_OUT = 10_000
"""Elements of arrays of fixed lengths that hold texts or messages; the library makes a line of code for each."""
PLACEHOLDER = "structure_needs_at_least_one_member"
"""What the library puts into a type that holds nothing."""


def ros_decoder(
    kind: str, language: str, definition: str, unpacking: Unpacking, *, ros1: bool
) -> Callable[[bytes], Any]:
    """Return the function that decodes messages of a type.

    Parameters
    ----------
    kind : str
        The type, such as ``"sensor_msgs/msg/JointState"``.
    language : str
        Of the definition: ``"msg"``, ``"idl"``, or ``""`` where the file holds none.
    definition : str
    unpacking : Unpacking
        What keeps the time to read definitions within bounds.
    ros1 : bool
        Whether messages are serialized as in ROS 1; otherwise as CDR.
    """
    key = kind, language, definition, ros1
    if key not in unpacking.decoders:
        unpacking.decoders[key] = _made(*key, unpacking)
    return unpacking.decoders[key]


def _made(kind: str, language: str, definition: str, ros1: bool, unpacking: Unpacking) -> Callable[[bytes], Any]:
    typesys = require_package("rosbags.typesys", "ROS messages are read with the module", BAGS)
    if language:
        unpacking.spend(CHARACTER * len(definition))
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        types = _types(typesys, kind, language, definition, unpacking)
        _require_bounded(types)
        store.register(types)
        return _decode(store, kind, ros1)
    stores = typesys.Stores
    store = typesys.get_typestore(stores.ROS1_NOETIC if ros1 else stores.ROS2_HUMBLE)
    if kind != CONTROLLER_STATE:
        return _decode(store, kind, ros1)
    decoders = []
    for points in POINTS:
        lines = ["std_msgs/Header header", "string[] joint_names"]
        lines += [f"trajectory_msgs/JointTrajectoryPoint {point}" for point in points]
        if "output" in points:
            lines.append("string[] multi_dof_joint_names")
            lines += [f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{point}" for point in points]
        versioned = typesys.get_typestore(stores.ROS2_HUMBLE)
        versioned.register(typesys.get_types_from_msg("\n".join(lines), kind))
        decoders.append(_decode(versioned, kind, ros1))
    return lambda data: _first(decoders, data)


def _types(typesys: Any, kind: str, language: str, definition: str, unpacking: Unpacking) -> Any:
    if language == "msg":
        return typesys.get_types_from_msg(definition, kind)
    parts = [definition]
    if definition.startswith(f"{SEPARATOR}IDL: "):
        parts = [part.partition("\n")[2] for part in definition.split(SEPARATOR)[1:]]
    types: dict[str, Any] = {}
    for part in parts:
        code = NO_CODE.sub("0", part)
        unpacking.spend(EXPRESSION * len(EXPRESSIONS_BEGIN.findall(code)))
        if EXPRESSIONS.search(code):
            raise ValueError(f"the definition of {kind} computes with brackets or shifts")
        types.update(typesys.get_types_from_idl(part))
    return types


def _require_bounded(types: Any) -> None:
    """Refuse types of which a message of a few bytes holds any number, or whose code is endless."""
    data: dict[str, bool] = {}

    def has_data(kind: str) -> bool:
        if kind not in data:
            data[kind] = kind not in types or any(
                name != PLACEHOLDER and field_has_data(*field) for name, field in types[kind][1]
            )
        return data[kind]

    def field_has_data(node: Any, what: Any) -> bool:
        if node.name == "ARRAY":
            return bool(what[1]) and field_has_data(*what[0])
        return node.name != "NAME" or has_data(what)

    written_out = 0
    for kind, (_, fields) in types.items():
        for name, (node, what) in fields:
            (inner, inside), count = what if node.name in ("ARRAY", "SEQUENCE") else ((node, what), 1)
            if inner.name == "NAME" and not has_data(inside):
                raise ValueError(f"the field {name} of {kind} is of a type that holds nothing")
            if node.name == "ARRAY" and (inner.name == "NAME" or inside[0] == "string"):
                written_out += count
    if written_out > MOST_WRITTEN_OUT:
        raise ValueError(f"the definition of {kind} has arrays of {written_out} elements")


def _decode(store: Any, kind: str, ros1: bool) -> Callable[[bytes], Any]:
    decode = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: decode(data, kind)


def _first(decoders: list[Callable[[bytes], Any]], data: bytes) -> Any:
    """Decode by the first definition that fits; the one that fitted is tried first for the next message."""
    problem: Exception | None = None
    for index, decode in enumerate(decoders):
        try:
            found = decode(data)
        except Exception as error:  # the decoders are generated and raise whatever they meet
            problem = problem or error
        else:
            decoders.insert(0, decoders.pop(index))
            return found
    assert problem is not None
    raise problem
