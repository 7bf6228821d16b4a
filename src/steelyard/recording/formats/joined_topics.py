"""Several topics of a bag as one table: what one lacks another has, at the stamps of the positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from .joint_messages import QUANTITIES, RECORDED, TIME, JointRows, JointTable, quantity_and_joint
from .log_file import Columns

__all__ = ["JoinedRows", "JoinedTopics"]

LONGEST_STEP = 4.0
"""Times the usual interval of a topic over which its numbers are interpolated; what lies in longer gaps is missing."""
SLOWER = 2.0
"""Times the interval of the positions from which it is told that a topic comes more seldom."""


class JoinedTopics:
    """The tables of topics as one; a number that several topics hold is that of the first one.

    The rows are those of the messages that hold the positions. What other messages hold, of another topic or of joints
    that are never in one message with these, is interpolated linearly to their stamps, and is exact where stamps are
    equal, as those of the broadcasters of ros2_control are.

    Parameters
    ----------
    source : str
        The log, for messages.
    tables : mapping from str to JointTable
        By topic; those named first count first.
    """

    def __init__(self, source: str, tables: Mapping[str, JointTable]) -> None:
        self.source, self.tables = source, dict(tables)
        self._parts: dict[str, tuple[str, int]] = {}
        for topic, table in self.tables.items():
            numbers = {joint: k for k, joints in enumerate(table.parted()) for joint in joints}
            for name in table.names:
                if (pair := quantity_and_joint(name)) is not None:
                    self._parts.setdefault(name, (topic, numbers[pair[1]]))
        self.joints = tuple(dict.fromkeys(joint for table in self.tables.values() for joint in table.joints))
        listed = (f"{quantity}[{joint}]" for quantity in QUANTITIES for joint in self.joints)
        self.names = (TIME, RECORDED, *(name for name in listed if name in self._parts))

    def adds_nothing(self) -> str | None:
        """Return a topic all of whose numbers others hold; None where there is none."""
        used = {topic for topic, _ in self._parts.values()}
        return next((topic for topic in self.tables if topic not in used), None)

    def rows(self, names: Sequence[str], *, kept: bool) -> JoinedRows | JointRows:
        """Return the rows of some columns.

        Parameters
        ----------
        kept : bool
            Whether no others will be asked for: rows of which a part has no messages are then left out.

        Raises
        ------
        InputError
            Where parts are not recorded at the same time.
        """
        chosen = [name for name in names if name in self._parts] or [name for name in self.names if name in self._parts]
        parts: dict[tuple[str, int], list[str]] = {}
        for name in chosen:
            parts.setdefault(self._parts[name], []).append(name)
        # Sorting is stable: of parts with as many positions the first is the clock.
        order = sorted(parts, key=lambda part: -sum(name.startswith(QUANTITIES[0]) for name in parts[part]))
        if len(order) == 1:
            return self.tables[order[0][0]].rows(parts[order[0]])
        by_header = TIME in names or RECORDED not in names
        by_header = by_header and all(self.tables[part[0]].has_stamps(parts[part]) for part in order)
        found = [self.tables[part[0]].rows(parts[part], by_header=by_header) for part in order]
        called = [self._called(part, parts[part]) for part in order]
        others = [
            _Other(rows, name, parts[part]) for rows, name, part in zip(found[1:], called[1:], order[1:], strict=True)
        ]
        joined = JoinedRows(found[0], called[0], others)
        if kept:
            joined.trim(self.source)
        return joined

    def _called(self, part: tuple[str, int], names: Sequence[str]) -> str:
        """Say which messages make a part."""
        topic = part[0]
        parted = self.tables[topic].parted()
        own = [quantity_and_joint(name) for name in names]
        joints = dict.fromkeys(pair[1] for pair in own if pair is not None)
        return f"the topic {topic}" + (f" with {', '.join(joints)}" if len(parted) > 1 else "")


@dataclass(eq=False)
class _Other:
    """Messages that are interpolated, what they are called, and the columns that come from them."""

    rows: JointRows
    name: str
    columns: Sequence[str]

    def __post_init__(self) -> None:
        self.time = self.rows.time + self.rows.begin
        steps = np.diff(self.time)
        if steps.size and steps.min() < 0:
            raise InputError(
                f"The stamps of {self.name} go back in time, so that it cannot be joined with other messages; "
                "split the log where a clock was set, or name one `topic` in [log]."
            )
        self.interval = float(np.median(steps)) if steps.size else 0.0


class JoinedRows:
    """Rows at the stamps of one part of the messages, with the numbers of the others in between.

    Parameters
    ----------
    clock : JointRows
        The messages whose stamps count.
    name : str
        What they are called.
    others : sequence of _Other
        Further messages.
    """

    def __init__(self, clock: JointRows, name: str, others: Sequence[_Other]) -> None:
        self.clock, self.name, self.others = clock, name, others
        self.time = clock.time + clock.begin
        self._first, self._stop = 0, clock.count

    @property
    def count(self) -> int:
        """Number of rows."""
        return self._stop - self._first

    @property
    def begin(self) -> int:
        """ns since 1970 of the first row."""
        return int(self.time[self._first])

    def trim(self, source: str) -> None:
        """Leave out rows before all parts have begun, and after the first has ended."""
        first = max(other.time[0] for other in self.others)
        last = min(other.time[-1] for other in self.others)
        self._first = int(np.searchsorted(self.time, first))
        self._stop = int(np.searchsorted(self.time, last, side="right"))
        if self.count < 2:
            named = ", ".join([self.name, *(other.name for other in self.others)])
            raise InputError(
                f"{source}: its messages were not recorded at the same time: {named}; record them together, or name "
                "one `topic` in [log]."
            )

    def notes(self) -> tuple[str, ...]:
        """Say what was put together, and how."""
        told = [f"Of {name}, {note}" for name, rows in self._parts() for note in rows.notes()]
        own = self.time[self._first : self._stop]
        interval = float(np.median(np.diff(own))) if own.size > 1 else 0.0
        for other in self.others:
            names = other.columns
            listed = names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}"
            exact = bool(np.isin(own, other.time).all())
            how = "the stamps are the same" if exact else f"interpolated to the stamps of {self.name}"
            told.append(f"{listed} come from {other.name}; {how}.")
            if other.interval > SLOWER * interval > 0.0:
                told.append(
                    f"{other.name[:1].upper()}{other.name[1:]} has messages every {other.interval / 1e6:.4g} ms where "
                    f"positions come every {interval / 1e6:.4g} ms: what changes faster is lost in between."
                )
        return tuple(told)

    def _parts(self) -> list[tuple[str, JointRows]]:
        return [(self.name, self.clock), *((other.name, other.rows) for other in self.others)]

    def columns(self, names: Sequence[str], start: int, stop: int) -> Columns:
        """Return the rows start:stop of columns."""
        start, stop = start + self._first, min(stop + self._first, self._stop)
        own = [name for name in names if all(name not in other.columns for other in self.others)]
        found = self.clock.columns(own, start, stop)
        for name in (TIME, RECORDED):
            if name in found:
                whole = self.clock.time if name == TIME else self.clock.recorded
                found[name] = (whole[start:stop] - whole[self._first]) / 1e9
        for other in self.others:
            theirs = [name for name in names if name in other.columns]
            if theirs and stop > start:
                found |= _between(other, theirs, self.time[start:stop])
        return {name: found[name] for name in names}


def _between(other: _Other, names: Sequence[str], time: NDArray[np.int64]) -> Columns:
    """Return columns at given times, between those of the messages; NaN before, behind, and in long gaps."""
    before = np.searchsorted(other.time, time, side="right") - 1
    after = np.minimum(before + 1, other.time.size - 1)
    inside = before >= 0
    before = np.maximum(before, 0)
    first, stop = int(before.min()), int(after.max()) + 1
    values = other.rows.columns(names, first, stop)
    step = other.time[after] - other.time[before]
    passed = time - other.time[before]
    known = inside & ((passed == 0) | ((step > 0) & (step <= LONGEST_STEP * other.interval)))
    share = np.where(passed == 0, 0.0, passed / np.maximum(step, 1))
    found: Columns = {}
    for name in names:
        low, high = values[name][before - first], values[name][after - first]
        # A message beside the one that has the very stamp may lack the number.
        between = np.where(passed == 0, low, low + share * (high - low))
        found[name] = np.where(known, between, np.nan)
    return found
