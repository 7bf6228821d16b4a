"""The table `[limits]` of a robot file: limits of the motion, in place of those of the description."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from steelyard.errors import InputError
from steelyard.files import shown

from .names import suggestion
from .robot import Robot

__all__ = ["with_limits"]

FIELDS = {"lower": "lower", "upper": "upper", "velocity": "velocity_limit", "effort": "effort_limit"}


def with_limits(robot: Robot, section: Mapping[str, Any], where: str) -> Robot:
    """Return the robot with the limits of a `[limits]` table.

    Parameters
    ----------
    robot : Robot
    section : mapping
        ``lower`` and ``upper`` (rad or m), ``velocity`` (rad/s or m/s), ``effort`` (N·m or N): a number for all the
        driving joints, or a list with one for each.
    where : str
        Named in messages.

    Raises
    ------
    InputError
        For an unknown key, a wrong count, a value that is no number, or a lower limit above the upper one.
    """
    joints = list(robot.joints)
    for key, value in section.items():
        if key not in FIELDS:
            raise InputError(f"{where}: {shown(key)} is no limit; {suggestion(key, tuple(FIELDS))}")
        values = value if isinstance(value, list) else [value] * robot.dof
        if len(values) != robot.dof:
            raise InputError(f"{where}: {key} has {len(values)} values, but {robot.name} has {robot.dof} joints")
        for number, index in zip(values, robot.driving_joints, strict=True):
            if isinstance(number, bool) or not isinstance(number, int | float) or math.isnan(number):
                raise InputError(f"{where}: {key} of {joints[index].name} must be a number, got {number!r}")
            if key in ("velocity", "effort") and number <= 0:
                raise InputError(f"{where}: {key} of {joints[index].name} must be positive, got {number!r}")
            change: dict[str, Any] = {FIELDS[key]: float(number)}
            joints[index] = replace(joints[index], **change)
    for joint in joints:
        if joint.lower > joint.upper:
            raise InputError(
                f"{where}: the lower limit of {joint.name} is {joint.lower:g}, above its upper limit of {joint.upper:g}"
            )
    return replace(robot, joints=tuple(joints))
