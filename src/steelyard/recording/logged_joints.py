"""The joints of a robot that a log holds: fewer than its description has, or more than move in the robot file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from steelyard.errors import InputError
from steelyard.files import listed
from steelyard.robot import Robot

from .columns import POSITION_UNITS, LogColumns
from .diagnosis.rest import MOST_TRAVEL
from .formats import LogFiles, Source
from .recognition import Layout, find_columns

__all__ = ["LockedThatMove", "LoggedJoints", "locked_that_move", "logged_joints"]

FIRST_ROWS = 200_000
"""Rows in which a joint that is locked is looked at."""
TAIL = 0.01
"""Share of its positions on either side that may be wild readings."""
OF_JOINTS = (
    *("position", "velocity", "acceleration", "torque", "position_unit", "velocity_unit", "torque_unit"),
    *("torque_matrix", "gain", "torque_sign", "channels"),
)
"""Keys of [log] whose lists have a value for each joint that moves."""


@dataclass(frozen=True)
class LoggedJoints:
    """The joints that a log speaks of.

    Attributes
    ----------
    names : tuple of str
        In the order of the robot.
    others : tuple of str
        Joints of which the log says nothing.
    reason : str
        What tells so.
    """

    names: tuple[str, ...]
    others: tuple[str, ...] = ()
    reason: str = ""


def logged_joints(files: LogFiles, joints: Sequence[str]) -> LoggedJoints:
    """Find the joints that a log speaks of, by their names in its columns, or else by how many columns there are.

    Numbered columns are those of the first joints of the robot, for parents come before their children: what follows
    them are hands and tools, or another arm.

    Parameters
    ----------
    joints : sequence of str
        Of the robot, in its order.

    Raises
    ------
    InputError
        Where the columns are not understood even so; the message is that for all joints.
    """
    labels = files.joint_labels()

    def layout(wanted: Sequence[str] | None) -> Layout:
        return find_columns(files.names, files.columns, wanted, values=files.values, labels=labels, log=files.name)

    try:
        layout(joints)
        return LoggedJoints(tuple(joints))
    except InputError as error:
        refused = error
    named = [name for name in joints if name in labels] if labels else []
    if not labels:
        for name in joints:
            try:
                table = layout([name]).table
            except InputError:
                continue
            if any(one.quantity == "position" and one.by.startswith("name") for one in table):
                named.append(name)
    reason = "the columns are named by joints, and these have none"
    if not named:
        try:
            count = len(layout(None).position)
        except InputError:
            raise refused from None
        named = list(joints[:count])
        reason = f"the log has columns of {count} joints, taken for the first {count}"
    others = tuple(name for name in joints if name not in named)
    try:
        layout(named)
    except InputError:
        raise refused from None
    if not others:
        raise refused
    return LoggedJoints(tuple(named), others, reason)


class LockedThatMove(NamedTuple):
    """What is said of joints that a robot holds still and that move in a log, and what mends it, a sentence each."""

    statement: str
    advice: str


def locked_that_move(log: Source, columns: LogColumns, layout: Layout, robot: Robot) -> LockedThatMove | None:
    """Say which joints that a robot holds still move in a log; None where none does, or their columns are not sure.

    Their columns are those which the log has for them if none is locked, and for all the others as they were read.

    Parameters
    ----------
    log : path, paths joined by "+", or LogFile
    layout : Layout
        Of the joints that move.
    """
    everything = robot.described_joints  # in the order of numbers of columns
    if not everything or layout.has_matrix:
        return None
    files = LogFiles(log, columns)
    of_others: dict[str, Any] = {key: None for key in OF_JOINTS if not isinstance(getattr(files.columns, key), str)}
    try:
        found = find_columns(
            files.names,
            replace(files.columns, **of_others),
            everything,
            values=files.values,
            labels=files.joint_labels(),
            log=files.name,
        )
    except InputError:  # the log has no such columns, or not of all joints
        return None
    at = dict(zip(everything, zip(found.position, found.units["position"], strict=True), strict=True))
    if any(at.pop(name)[0] != column for name, column in zip(robot.joint_names, layout.position, strict=True)):
        return None
    # What is left are those that are held.
    block = next(files.blocks(list(dict.fromkeys(column for column, _ in at.values())), FIRST_ROWS), {})
    moving = []
    for name, (column, unit) in at.items():
        known = block[column][np.isfinite(block[column])] * POSITION_UNITS[unit]
        low, high = np.quantile(known, [TAIL, 1.0 - TAIL]) if len(known) else (0.0, 0.0)
        if high - low > MOST_TRAVEL:
            moving.append(f"{name} (from {low:.3g} to {high:.3g}, {column!r})")
    if not moving:
        return None
    return LockedThatMove(
        "Joints that are locked in the robot file move in this log, so that the model has what they carry in another "
        f"place: {listed(moving)}.",
        "Take them out of `locked` in [description], or give a log where they stand still.",
    )
