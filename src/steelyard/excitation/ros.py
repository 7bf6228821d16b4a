"""ROS 2 JointTrajectory messages as YAML."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import parse_json, read_text

__all__ = ["joint_trajectory_text", "read_joint_trajectory"]

Array = NDArray[np.float64]
_NANO = 1_000_000_000
_NAMES = "joint_names:"


def joint_trajectory_text(names: Sequence[str], t: Array, q: Array, dq: Array, ddq: Array) -> str:
    """Return a ``trajectory_msgs/msg/JointTrajectory`` as YAML, as ``ros2 topic pub`` reads it.

    Parameters
    ----------
    names : sequence of str
        Names of the N joints.
    t : ndarray
        (S,) times, s.
    q, dq, ddq : ndarray
        (S, N).
    """
    lines = [
        "# trajectory_msgs/msg/JointTrajectory",
        "header:",
        '  {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}',
        f"{_NAMES} {json.dumps(list(names), ensure_ascii=False)}",
        "points:",
    ]
    # Each point is written in flow style, which is valid JSON and YAML.
    for k, instant in enumerate(t):
        seconds, nanoseconds = divmod(round(float(instant) * _NANO), _NANO)
        point = {
            "positions": q[k].tolist(),
            "velocities": dq[k].tolist(),
            "accelerations": ddq[k].tolist(),
            "effort": [],
            "time_from_start": {"sec": seconds, "nanosec": nanoseconds},
        }
        lines.append(f"- {json.dumps(point)}")
    return "\n".join(lines) + "\n"


def read_joint_trajectory(path: Path) -> tuple[Any, tuple[Array, Array, Array, Array]]:
    """Read a file written by `joint_trajectory_text`: what it gives as names, and t (S,), q, dq and ddq (S, N).

    Raises
    ------
    InputError
        If the file is not written in this way.
    """
    lines = read_text(path, remedy="give a JointTrajectory that steelyard wrote").splitlines()
    start = next((k for k, line in enumerate(lines) if line.strip() == "points:"), None)
    if start is None:
        raise InputError(f"{path}: has no line 'points:'; expected a JointTrajectory that steelyard wrote.")
    above = (line.removeprefix(_NAMES) for line in lines[:start] if line.startswith(_NAMES))
    names = next((parse_json(text, f"{path}, joint_names", remedy="write it again") for text in above), None)
    t, motion = [], []
    for number, line in enumerate(lines[start + 1 :], start=start + 2):
        if not line.strip():
            continue
        try:
            point = parse_json(line.removeprefix("-"), f"{path}, line {number}", remedy="write it again")
            stamp = point["time_from_start"]
            t.append(stamp["sec"] + stamp["nanosec"] / _NANO)
            motion.append([point[name] for name in ("positions", "velocities", "accelerations")])
        except (ValueError, KeyError, TypeError):
            raise InputError(
                f"{path}: line {number} is not a point with positions, velocities, accelerations and time_from_start "
                "in one line; expected a JointTrajectory that steelyard wrote."
            ) from None
    if len(t) < 2:
        raise InputError(f"{path}: has {len(t)} points; a trajectory needs at least 2.")
    values = np.array(motion, dtype=np.float64)
    return names, (np.array(t) - t[0], values[:, 0], values[:, 1], values[:, 2])
