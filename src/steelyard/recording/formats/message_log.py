"""Logs that hold messages by topic: the topic is found by what its messages say, or named."""

from __future__ import annotations

import contextlib
import itertools
import json
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from steelyard.errors import InputError
from steelyard.files import shown, suggestion

from ..columns import LogColumns
from .decoded import decoded_once
from .joined_topics import JoinedRows, JoinedTopics
from .joint_messages import QUANTITIES, TIME, JointMessage, JointRows, JointTable, joint_message
from .log_file import Columns, LogFile, reading_as

__all__ = ["JOINT_TYPES", "MessageLog", "Topic"]

JOINT_TYPES = ("JointState", "JointStates", "JointTrajectoryControllerState")
"""Last words of the types of topics that are looked at where no topic is named."""
LOOKED_AT = 20
"""First messages of a topic that are looked at: controllers may begin with an empty one."""
LISTED = 12
NEEDED = {"position", "effort"}
"""What topics must hold to be of use."""


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
    """A log of messages: the joint states of one topic, see `JointTable`, or of several, see `JoinedTopics`.

    Parameters
    ----------
    topics : sequence of str
        By default the one that holds positions and torques, or those that do together.

    Raises
    ------
    InputError
        Where the file cannot be read, a topic is not there, or several would do.
    """

    kind: ClassVar[str]
    """What such a file is called in messages."""
    remedy: ClassVar[str] = "record it again"

    def __init__(self, path: Path, topics: Sequence[str] = ()) -> None:
        super().__init__(path)
        self._table = decoded_once(path, (type(self), tuple(topics)), lambda: self._decoded(topics))
        self.names = self._table.names

    def _decoded(self, named: Sequence[str]) -> JoinedTopics:
        with reading_as(self.path, self.kind, self.remedy), self._opened() as topics:
            chosen = [self._named(topics, name) for name in dict.fromkeys(named)] or self._found(topics)
            tables = {topic.name: self._table_of(topic) for topic in chosen}
        joined = JoinedTopics(str(self.path), tables)
        idle = joined.adds_nothing()
        if idle is not None:
            raise InputError(
                f"{self.path}: the topic {idle} holds nothing of its joints that the topics named before it do not "
                "hold; leave it out of `topic` in [log], or name it first."
            )
        return joined

    def _table_of(self, topic: Topic) -> JointTable:
        table = JointTable(f"{self.path}, topic {topic.name}")
        for recorded, decoded in topic.messages():
            message = joint_message(decoded)
            if message is not None:
                table.add(message, recorded)
        table.finish()
        if not table.joints:
            raise InputError(
                f"{self.path}: the topic {topic} holds no numbers of joints; expected sensor_msgs/JointState or "
                "control_msgs/JointTrajectoryControllerState with names and positions: name another `topic` in [log]."
            )
        return table

    @classmethod
    def opened(cls, path: Path, columns: LogColumns) -> Self:
        """Open a file; `topic` says what of it is read."""
        return cls(path, columns.topics)

    @abstractmethod
    def _opened(self) -> contextlib.AbstractContextManager[list[Topic]]:
        """Open the file, and list its topics; their messages are read while it is open."""

    def _named(self, topics: Sequence[Topic], name: str) -> Topic:
        for topic in topics:
            if topic.name in (name, f"/{name}"):
                return topic
        found = suggestion(name, [topic.name for topic in topics])
        raise InputError(f"{self.path} has no topic {shown(name)}, which `topic` in [log] names; {found}")

    def _found(self, topics: Sequence[Topic]) -> list[Topic]:
        """Return the topics of joint states, or ask which of several are meant."""
        known = [topic for topic in topics if topic.is_of_joints and topic.count]
        others = [topic for topic in topics if topic.may_hold_joints and topic.count and not topic.is_of_joints]
        for candidates in (known, others):
            held = {topic: said for topic in candidates if (said := _held(topic))}
            useful = {topic: said for topic, said in held.items() if {quantity for quantity, _ in said} >= NEEDED}
            choice = useful or held
            if choice and (len(choice) == 1 or _are_apart(choice.values())):
                return list(choice)
            if choice:
                first, *further = choice
                several = json.dumps([first.name, further[0].name], ensure_ascii=False)
                raise InputError(
                    f"{self.path} holds joint states in several topics, {_listed(list(choice))}; choose with "
                    f'`topic = "{first.name}"` in [log], or with --topic {first.name}; of several that belong '
                    f"together, such as `topic = {several}`, each holds what those before it lack."
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
    def _rows(self) -> JoinedRows | JointRows:
        """The rows; those that are made by messages of other joints alone are left out."""
        return self._table.rows(self.names if self.kept is None else self.kept, kept=self.kept is not None)

    def notes(self) -> tuple[str, ...]:
        """Say which numbers come from which messages, where they were put together, and what decides the times."""
        return self._rows.notes()

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        return self._rows.begin if name == TIME else 0

    def count(self) -> int:
        """Return the number of rows."""
        return self._rows.count

    def read(self, names: Sequence[str]) -> Columns:
        """Return whole columns."""
        rows = self._rows
        return rows.columns(names, 0, rows.count)

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Return columns in blocks of rows; memory is that of a block, since the numbers stand in a file."""
        table = self._rows
        for first in range(start, table.count, rows):
            yield table.columns(names, first, first + rows)


def _held(topic: Topic) -> set[tuple[str, str]]:
    """Return of which joints the first messages of a topic say what; nothing where they are no joint states."""
    found: set[tuple[str, str]] = set()
    for _, decoded in itertools.islice(topic.messages(), LOOKED_AT):
        message: JointMessage | None = joint_message(decoded)
        if message is not None:
            held = (quantity for quantity, values in zip(QUANTITIES, message.values, strict=True) if len(values))
            found.update(itertools.product(held, message.names))
    return found


def _are_apart(held: Iterable[set[tuple[str, str]]]) -> bool:
    """Return whether no number of a joint stands in two topics, and together they hold positions and torques."""
    sets = list(held)
    together = set().union(*sets)
    return sum(map(len, sets)) == len(together) and {quantity for quantity, _ in together} >= NEEDED


def _listed(topics: Sequence[Topic]) -> str:
    more = f" and {len(topics) - LISTED} others" if len(topics) > LISTED else ""
    return ", ".join(map(str, topics[:LISTED])) + more
