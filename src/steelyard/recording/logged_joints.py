"""The joints of a robot that a log holds: arms are often logged without the fingers that their description has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from steelyard.errors import InputError

from .formats import LogFiles
from .recognition import Layout, find_columns

__all__ = ["LoggedJoints", "logged_joints"]


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
    files : LogFiles
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
