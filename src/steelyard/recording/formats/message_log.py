"""Logs that hold messages by topic: the topic is found by what its messages say, or named."""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from steelyard.errors import InputError
from steelyard.files import shown, suggestion

from ..columns import LogColumns
from .decoded import decoded_once
from .joint_messages import QUANTITIES, JointMessage, JointRows, JointTable, joint_message
from .log_file import Columns, LogFile, reading_as

__all__ = ["JOINT_TYPES", "MessageLog", "Topic"]

JOINT_TYPES = ("JointState", "JointStates", "JointTrajectoryControllerState")
"""Last words of the types of topics that are looked at where no topic is named."""
LOOKED_AT = 20
"""First messages of a topic that are looked at: controllers may begin with an empty one."""
LISTED = 12


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic of a log.

    Parameters
    ----------
    name, kind : str
        The topic, and the type of its messages.
    count : int
        How many messages.
    messages : callable
        Returns an iterator over them: when each was recorded, in ns, and the message, decoded.
    may_hold_joints : bool
        Whether it is worth to look at the messages although their type is none of `JOINT_TYPES`.
    """

    name: str
    kind: str
    count: int
    messages: Callable[[], Iterator[tuple[int, Any]]]
    may_hold_joints: bool = False

    @property
    def is_of_joints(self) -> bool:
        """Whether the type is one that says something of joints."""
        return self.kind.replace(".", "/").rpartition("/")[2] in JOINT_TYPES

    def __str__(self) -> str:
        return f"{self.name} ({self.kind or 'of no type'}, {self.count} messages)"


class MessageLog(LogFile):
    """A log of messages: the joint states of one topic, see `JointTable`.

    Parameters
    ----------
    path : Path
    topic : str, optional
        By default the one that holds joint states; of several the one that holds torques, too.

    Raises
    ------
    InputError
        Where the file cannot be read, the topic is not there, or several would do.
    """

    kind: ClassVar[str]
    """What such a file is called in messages."""
    remedy: ClassVar[str] = "record it again"

    def __init__(self, path: Path, topic: str | None = None) -> None:
        super().__init__(path)
        self._table = decoded_once(path, (type(self), topic), lambda: self._decoded(topic))
        self.names = self._table.names

    def _decoded(self, topic: str | None) -> JointTable:
        with reading_as(self.path, self.kind, self.remedy), self._opened() as topics:
            chosen = self._named(topics, topic) if topic is not None else self._found(topics)
            table = JointTable(f"{self.path}, topic {chosen.name}")
            for recorded, decoded in chosen.messages():
                message = joint_message(decoded)
                if message is not None:
                    table.add(message, recorded)
            table.finish()
        if not table.joints:
            raise InputError(
                f"{self.path}: the topic {chosen} holds no numbers of joints; expected sensor_msgs/JointState or "
                "control_msgs/JointTrajectoryControllerState with names and positions: name another `topic` in [log]."
            )
        return table

    @classmethod
    def opened(cls, path: Path, columns: LogColumns) -> Self:
        """Open a file; `topic` says what of it is read."""
        return cls(path, columns.topic)

    @abstractmethod
    def _opened(self) -> contextlib.AbstractContextManager[list[Topic]]:
        """Open the file, and list its topics; their messages are read while it is open."""

    def _named(self, topics: Sequence[Topic], name: str) -> Topic:
        for topic in topics:
            if topic.name in (name, f"/{name}"):
                return topic
        found = suggestion(name, [topic.name for topic in topics])
        raise InputError(f"{self.path} has no topic {shown(name)}, which `topic` in [log] names; {found}")

    def _found(self, topics: Sequence[Topic]) -> Topic:
        """Return the topic of joint states, or ask which of several is meant."""
        known = [topic for topic in topics if topic.is_of_joints and topic.count]
        others = [topic for topic in topics if topic.may_hold_joints and topic.count and not topic.is_of_joints]
        for candidates in (known, others):
            looks = [(topic, said) for topic in candidates if (said := _quantities(topic))]
            useful = [topic for topic, said in looks if {"position", "effort"} <= said]
            choice = useful or [topic for topic, _ in looks]
            if len(choice) == 1:
                return choice[0]
            if choice:
                raise InputError(
                    f"{self.path} holds joint states in several topics, {_listed(choice)}; choose with "
                    f'`topic = "{choice[0].name}"` in [log], or with --topic {choice[0].name}.'
                )
        if known:
            raise InputError(
                f"{self.path}: no message of {_listed(known)} names joints and their positions; record them again."
            )
        what = f"it has {_listed(topics)}" if topics else "it has none at all"
        raise InputError(
            f"{self.path} has no topic of sensor_msgs/JointState or control_msgs/JointTrajectoryControllerState; "
            f"{what}: record such a topic, too, or name one that holds the same fields with `topic` in [log]."
        )

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints by their names in the messages."""
        return self._table.joints

    @property
    def _rows(self) -> JointRows:
        """The rows; those that are made by messages of other joints alone are left out."""
        return self._table.rows(self.names if self.kept is None else self.kept)

    def count(self) -> int:
        """Return the number of rows."""
        return self._rows.count

    def read(self, names: Sequence[str]) -> Columns:
        """Return whole columns."""
        rows = self._rows
        return rows.columns(names, 0, rows.count)

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Return columns in blocks of rows; memory is that of a block, since the numbers stand in a file."""
        table = self._rows
        for start in range(0, table.count, rows):
            yield table.columns(names, start, start + rows)


def _quantities(topic: Topic) -> set[str]:
    """Return what the first messages of a topic say of joints; nothing where they are no joint states."""
    found: set[str] = set()
    for index, (_, decoded) in enumerate(topic.messages()):
        message: JointMessage | None = joint_message(decoded)
        if message is not None:
            found |= {quantity for quantity, values in zip(QUANTITIES, message.values, strict=True) if len(values)}
        if found or index == LOOKED_AT:
            break
    return found


def _listed(topics: Sequence[Topic]) -> str:
    more = f" and {len(topics) - LISTED} others" if len(topics) > LISTED else ""
    return ", ".join(map(str, topics[:LISTED])) + more
