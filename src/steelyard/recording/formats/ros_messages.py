"""Decoding of ROS messages, by the definitions that stand in a file or else by those that ROS ships."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from steelyard.errors import require_package

__all__ = ["BAGS", "ros_decoder"]

BAGS = "bags"
"""The extra that brings the packages for bags and MCAP."""
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
POINTS = ("desired", "actual", "error"), ("reference", "feedback", "error", "output")
"""Its points in the versions of control_msgs until Humble and since, which bags of SQLite do not tell until Iron."""
SEPARATOR = "=" * 80 + "\n"


def ros_decoder(kind: str, language: str, definition: str, *, ros1: bool) -> Callable[[bytes], Any]:
    """Return the function that decodes messages of a type.

    Parameters
    ----------
    kind : str
        The type, such as ``"sensor_msgs/msg/JointState"``.
    language : str
        Of the definition: ``"msg"``, ``"idl"``, or ``""`` where the file holds none.
    ros1 : bool
        Whether messages are serialized as in ROS 1; otherwise as CDR.
    """
    typesys = require_package("rosbags.typesys", "ROS messages are read with the module", BAGS)
    if language:
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        store.register(_types(typesys, kind, language, definition))
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


def _types(typesys: Any, kind: str, language: str, definition: str) -> Any:
    if language == "msg":
        return typesys.get_types_from_msg(definition, kind)
    if not definition.startswith(f"{SEPARATOR}IDL: "):
        return typesys.get_types_from_idl(definition)
    types: dict[str, Any] = {}
    for part in definition.split(SEPARATOR)[1:]:
        types.update(typesys.get_types_from_idl(part.partition("\n")[2]))
    return types


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
