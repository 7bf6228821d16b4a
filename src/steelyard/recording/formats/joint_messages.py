"""Messages about joints: what each says, and all of them as one table, put together by joint and by stamp."""

from __future__ import annotations

import tempfile
import weakref
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown

from .decoded import large_files
from .log_file import Columns

__all__ = [
    "QUANTITIES",
    "RECORDED",
    "TIME",
    "JointMessage",
    "JointRows",
    "JointTable",
    "joint_message",
    "quantity_and_joint",
]

QUANTITIES = ("position", "velocity", "effort")
TIME, RECORDED = "time", "recorded"
PLURALS = {"position": "positions", "velocity": "velocities", "effort": "efforts"}
STAMPED = ("stamp", "timestamp")
SECONDS, NANOSECONDS = ("sec", "secs", "seconds"), ("nanosec", "nsec", "nsecs", "nanos")
BLOCK = 1024
"""Messages that stand in memory before they are written to the temporary file."""
MOST_ORDERS = 300
"""Messages name their joints in a few orders, one for each publisher; a table is kept for each."""
MOST_NAMES = 10_000
"""Names in all of these orders together, for each of which numbers of so many messages stand in memory."""
LATEST = 1_000_000_000
"""ns by which the messages of one publisher may come later than younger ones of another. Where stamps go back further,
a clock was set or a simulation begun anew, and the rows are left as they were recorded, for a message that says so."""


class JointMessage(NamedTuple):
    """The values that a message holds of joints: for each quantity one number per joint, or nothing."""

    stamp: int
    """ns of its header; 0 where it has none, or none was filled in."""
    names: tuple[str, ...]
    values: tuple[Sequence[float], ...]


def joint_message(message: Any) -> JointMessage | None:
    """Return what a decoded message says of joints; None where it is of another kind.

    Three kinds are known by their fields, whatever the type is called: `sensor_msgs/JointState` (`name` and `position`,
    `velocity`, `effort`), `control_msgs/JointTrajectoryControllerState` (`joint_names`, and what was measured in
    `actual` or, in newer versions, `feedback`), and a list `joints` of objects with a `name` and these numbers, as in
    Foxglove's JointStates. The fields of a message are attributes, or keys.

    Examples
    --------
    >>> joint_message({"header": {"stamp": {"sec": 2, "nanosec": 5}}, "name": ["elbow"], "position": [0.5]})
    JointMessage(stamp=2000000005, names=('elbow',), values=([0.5], (), ()))
    """
    names = _field(message, "name", "names")
    if names is not None:
        values = _quantities(message)
    elif (measured := _field(message, "actual", "feedback")) is not None:
        names, values = _field(message, "joint_names"), _quantities(measured)
    elif isinstance(joints := _field(message, "joints"), Sequence) and not isinstance(joints, str):
        names = [_field(joint, "name") for joint in joints]
        columns = [[_field(joint, quantity) for joint in joints] for quantity in QUANTITIES]
        values = tuple([] if all(one is None for one in column) else column for column in columns)
    else:
        names, values = _field(message, "joint_names"), _quantities(message)
    if names is None or isinstance(names, str | bytes) or not hasattr(names, "__len__"):
        return None
    named = tuple(names)
    if any(type(name) is not str for name in named) or not any(len(value) for value in values):
        return None
    return JointMessage(_stamp(message), named, values)


def _field(message: Any, *names: str) -> Any:
    """Return the first field that is there; messages come by the million, so that this is kept quick."""
    if isinstance(message, dict):
        for name in names:
            if (value := message.get(name)) is not None:
                return value
        return None
    for name in names:
        if (value := getattr(message, name, None)) is not None:
            return value
    return None


def _quantities(message: Any) -> tuple[Any, ...]:
    found = [_field(message, quantity, plural) for quantity, plural in PLURALS.items()]
    return tuple([() if value is None or not hasattr(value, "__len__") else value for value in found])


def _stamp(message: Any) -> int:
    header = _field(message, "header")
    stamp = _field(message if header is None else header, *STAMPED)
    seconds, nanoseconds = _field(stamp, *SECONDS), _field(stamp, *NANOSECONDS)
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        return 0
    return seconds * 1_000_000_000 + nanoseconds


@dataclass(eq=False)
class _Order:
    """The messages that name the same joints in the same order."""

    names: tuple[str, ...]
    stamps: array[int] = field(default_factory=lambda: array("q"))
    recorded: array[int] = field(default_factory=lambda: array("q"))
    arrivals: array[int] = field(default_factory=lambda: array("q"))
    begins: list[int] = field(default_factory=list)
    present: list[bool] = field(default_factory=lambda: [False] * len(QUANTITIES))

    def __post_init__(self) -> None:
        self.block = np.full((BLOCK, len(QUANTITIES) * len(self.names)), np.nan)

    def column(self, quantity: str, joint: str) -> int | None:
        """Return the place of a joint's number in a row; None where these messages do not have it."""
        kind = QUANTITIES.index(quantity)
        return kind * len(self.names) + self.names.index(joint) if self.present[kind] and joint in self.names else None

    def taken(
        self, table: NDArray[np.float64], messages: NDArray[np.int64], places: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return some of the numbers of some of these messages from all numbers of a table."""
        width = len(QUANTITIES) * len(self.names)
        begins = np.array(self.begins, dtype=np.int64)[messages // BLOCK] + (messages % BLOCK) * width
        return np.asarray(table[begins[:, None] + places])


@dataclass(frozen=True, eq=False)
class JointRows:
    """The rows that some of the messages of a table make."""

    numbers: NDArray[np.float64]
    """All numbers of the table."""
    time: NDArray[np.int64]
    recorded: NDArray[np.int64]
    members: list[tuple[_Order, NDArray[np.int64], NDArray[np.int64]]]
    """The orders; and for each the numbers of its messages and of their rows, both in the order of the rows."""
    begin: int
    """ns since 1970 of the first row."""
    unstamped: tuple[int, int] = (0, 0)
    """Messages without a stamp in their header, for which all others are not taken by theirs; and all messages."""

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.time.size)

    def notes(self) -> tuple[str, ...]:
        """Say that a few messages without a stamp decide the times of all."""
        few, every = self.unstamped
        if not 0 < few < every:
            return ()
        return (
            f"{few} of {every} messages {'has' if few == 1 else 'have'} no stamp in the header, so that the times of "
            "all are those at which they were recorded.",
        )

    def columns(self, names: Sequence[str], start: int, stop: int) -> Columns:
        """Return the rows start:stop of columns."""
        stop = min(stop, self.count)
        found: Columns = {}
        for name in names:
            if name in (TIME, RECORDED):
                found[name] = (self.time if name == TIME else self.recorded)[start:stop] / 1e9
            else:
                found[name] = np.full(stop - start, np.nan)
        for order, numbers, rows in self.members:
            places = {name: order.column(*pair) for name in names if (pair := quantity_and_joint(name))}
            chosen = {name: place for name, place in places.items() if place is not None}
            first, last = np.searchsorted(rows, (start, stop))
            columns = np.array(list(chosen.values()), dtype=np.int64)
            values = order.taken(self.numbers, numbers[first:last], columns)
            for index, name in enumerate(chosen):
                own = values[:, index]
                there = ~np.isnan(own)
                found[name][rows[first:last][there] - start] = own[there]
        return found


class JointTable:
    """All messages of a topic as rows of columns: ``time``, ``recorded``, ``position[elbow]`` and so on.

    Messages of one stamp make one row, whatever joints each of them names and in which order. Numbers that no message
    has are NaN. Times count in s from the first row, and are whole numbers of ns, rounded once. ``time`` is that of the
    header; where any message has none, or all have the same, that at which the message was recorded, which is also
    ``recorded``. The numbers stand in a temporary file. Messages to the user name the log by its source.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self._orders: dict[tuple[str, ...], _Order] = {}
        self._rows: dict[tuple[tuple[_Order, ...], bool], JointRows] = {}
        self._file = tempfile.TemporaryFile(prefix="steelyard-", dir=large_files())  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._written = self._count = 0
        self._numbers: NDArray[np.float64] = np.empty(0)

    def add(self, message: JointMessage, recorded: int) -> None:
        """Add the next message.

        Raises
        ------
        InputError
            Where its arrays have other lengths than its list of names, or hold no numbers.
        """
        order = self._orders.get(message.names)
        if order is None:
            order = self._new_order(message.names)
        place, size = len(order.stamps) % BLOCK, len(message.names)
        row = order.block[place]
        for kind, values in enumerate(message.values):
            if len(values) == 0:
                row[kind * size : (kind + 1) * size] = np.nan
                continue
            if len(values) != size:
                raise InputError(
                    f"{self.source}, message {self._count + 1}, has {len(values)} values of {QUANTITIES[kind]} for "
                    f"{size} joints; each needs one: mend what records it, or choose another `topic` in [log]."
                )
            order.present[kind] = True
            try:
                row[kind * size : (kind + 1) * size] = values
            except (TypeError, ValueError):
                row[kind * size : (kind + 1) * size] = [self._number(value, QUANTITIES[kind]) for value in values]
        if not (-(2**62) < message.stamp < 2**62 and -(2**62) < recorded < 2**62):
            raise InputError(
                f"{self.source}, message {self._count + 1}, has a stamp of {shown(message.stamp)} ns, recorded at "
                f"{shown(recorded)} ns, which is no time; record it again."
            )
        order.stamps.append(message.stamp)
        order.recorded.append(recorded)
        order.arrivals.append(self._count)
        self._count += 1
        if place == BLOCK - 1:
            self._flush(order)

    def _new_order(self, names: tuple[str, ...]) -> _Order:
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(
                f"{self.source}, message {self._count + 1}, names the joint {shown(twice)} twice; mend what records it."
            )
        if len(self._orders) == MOST_ORDERS:
            raise InputError(
                f"{self.source} names its joints in more than {MOST_ORDERS} ways; a robot's messages do so in a few."
            )
        if sum(map(len, self._orders)) + len(names) > MOST_NAMES:
            raise InputError(
                f"{self.source} names its joints in {len(self._orders) + 1} ways with more than {MOST_NAMES} names; a "
                "robot has at most some hundred: choose another `topic` in [log]."
            )
        order = self._orders[names] = _Order(names)
        return order

    def _number(self, value: Any, quantity: str) -> float:
        try:
            return float("nan") if value is None else float(value)
        except (TypeError, ValueError):
            raise InputError(
                f"{self.source}, message {self._count + 1}, holds {shown(value)} as {quantity}; expected a number."
            ) from None

    def _flush(self, order: _Order) -> None:
        order.begins.append(self._written)
        self._file.write(order.block.data)
        self._written += order.block.size

    def finish(self) -> None:
        """Put the rows together, after the last message."""
        for order in self._orders.values():
            if len(order.stamps) % BLOCK:
                self._flush(order)
            order.block = np.empty((0, order.block.shape[1]))
        self._file.flush()
        if self._written:
            self._numbers = np.memmap(self._file, np.float64, "r")

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints, in the order in which they were named first."""
        return tuple(dict.fromkeys(name for order in self._orders.values() for name in order.names))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all columns."""
        orders = self._orders.values()
        found = {
            quantity: {name for order in orders if order.present[kind] for name in order.names}
            for kind, quantity in enumerate(QUANTITIES)
        }
        numbers = (
            f"{quantity}[{joint}]" for quantity in QUANTITIES for joint in self.joints if joint in found[quantity]
        )
        return (TIME, RECORDED, *numbers)

    def parted(self) -> list[tuple[str, ...]]:
        """Return the joints in groups, none of which is ever in one message with joints of another group."""
        groups: list[dict[str, None]] = []
        for order in self._orders.values():
            own = dict.fromkeys(order.names)
            met = [group for group in groups if not group.keys().isdisjoint(own)]
            groups = [group for group in groups if all(group is not one for one in met)]
            groups.append({name: None for group in (*met, own) for name in group})
        return [tuple(group) for group in groups]

    def _orders_of(self, names: Sequence[str]) -> tuple[_Order, ...]:
        pairs = [pair for name in names if (pair := quantity_and_joint(name))]
        kept = [
            order
            for order in self._orders.values()
            if any(order.column(quantity, joint) is not None for quantity, joint in pairs)
        ]
        return tuple(kept or self._orders.values())

    def has_stamps(self, names: Sequence[str]) -> bool:
        """Whether the messages that have one of these columns have stamps in their headers, which are not all alike."""
        stamps = np.concatenate([np.frombuffer(order.stamps, np.int64) for order in self._orders_of(names)])
        return bool((stamps != 0).all()) and bool(stamps.size == 1 or (stamps != stamps[0]).any())

    def rows(self, names: Sequence[str], *, by_header: bool | None = None) -> JointRows:
        """Make rows of those messages alone that have one of these columns; of all of them where none has.

        The stamps of headers count where all messages have one, unless `by_header` says otherwise.
        """
        orders = self._orders_of(names)
        if by_header is None:
            by_header = self.has_stamps(names)
        key = (orders, by_header)
        if key not in self._rows:  # a log is opened several times, and asked for a few choices of columns
            self._rows[key] = self._arranged(orders, by_header)
        return self._rows[key]

    def _arranged(self, orders: Sequence[_Order], by_header: bool) -> JointRows:
        which = np.repeat(np.arange(len(orders)), [len(order.stamps) for order in orders])
        number = np.concatenate([np.arange(len(order.stamps)) for order in orders])
        stamps, recorded, arrivals = (
            np.concatenate([np.frombuffer(getattr(order, name), np.int64) for order in orders])
            for name in ("stamps", "recorded", "arrivals")
        )
        time = stamps if by_header else recorded
        arrived = np.argsort(arrivals, kind="stable")
        late = np.max(np.maximum.accumulate(time[arrived]) - time[arrived], initial=0)
        each = np.split(time, np.cumsum([len(order.stamps) for order in orders])[:-1])
        in_order = all((np.diff(one) >= 0).all() for one in each)
        if late and late <= LATEST and in_order:
            arrived = arrived[np.argsort(time[arrived], kind="stable")]
        which, number, time, recorded = which[arrived], number[arrived], time[arrived], recorded[arrived]
        begins = np.r_[True, np.diff(time) != 0]
        self._part_contradictions(orders, which, number, begins)
        row = np.cumsum(begins) - 1
        members = [(order, number[which == k], row[which == k]) for k, order in enumerate(orders)]
        missing = 0 if by_header else int(np.count_nonzero(stamps == 0))
        return JointRows(
            self._numbers,
            time[begins] - time[0],
            recorded[begins] - recorded[0],
            members,
            int(time[0]),
            (missing, stamps.size),
        )

    def _part_contradictions(
        self, orders: Sequence[_Order], which: NDArray[np.int64], number: NDArray[np.int64], begins: NDArray[np.bool_]
    ) -> None:
        """Begin a new row where a message contradicts another one of its stamp, for a message that stamps repeat."""
        edges = np.r_[np.flatnonzero(begins), begins.size]
        for first, stop in zip(edges[:-1][np.diff(edges) > 1], edges[1:][np.diff(edges) > 1], strict=True):
            said: dict[str, float] = {}
            for index in range(first, stop):
                order = orders[which[index]]
                values = order.taken(self._numbers, number[index : index + 1], np.arange(order.block.shape[1]))[0]
                keys = [f"{quantity}[{joint}]" for quantity in QUANTITIES for joint in order.names]
                own = {key: value for key, value in zip(keys, values.tolist(), strict=True) if value == value}
                if any(said.get(key, value) != value for key, value in own.items()):
                    begins[index] = True
                    said = {}
                said.update(own)


def quantity_and_joint(name: str) -> tuple[str, str] | None:
    """Split the name of a column such as ``position[elbow]``; None for those of times."""
    quantity, bracket, joint = name.partition("[")
    return (quantity, joint.removesuffix("]")) if bracket and quantity in QUANTITIES else None
