"""Recognition of the columns of a log, by the `[log]` section and by the names of the columns."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from fractions import Fraction
from itertools import pairwise, permutations
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table, text_table
from steelyard.errors import InputError
from steelyard.files import suggestion
from steelyard.robot import Robot

from .column_styles import (
    BY_SIZE,
    COMMANDED,
    FURTHER_TIME_WORDS,
    NAME,
    NUMBER,
    SECONDS_AND_REST,
    STYLES,
    TIME_WORDS,
    UNITS,
    ColumnStyle,
    normalised,
    styles_of,
    time_unit_behind,
    unit_left_open,
    units_said,
)
from .columns import CURRENT_UNITS, LENGTHS, PER_SECOND, TIME_UNITS, LogColumns

__all__ = ["ColumnMeaning", "Joints", "Layout", "find_columns", "label_columns", "names_of", "numbered_columns"]

Joints = int | Sequence[str] | Robot | None
"""How many joints a log must have, their names, or the robot that was logged; None where any are right."""
Values = Callable[[str], Iterable[NDArray[np.float64]]]
_OF_SLIDES = {"rad": "m", "rad/s": "m/s", "rad/s²": "m/s²", "N·m": "N"}
"""Units of joints that slide by those of joints that turn; a name does not tell which it is."""
KINDS = ("position", "velocity", "acceleration", "torque")
_STATED, _NAME, _LABEL, _NUMBER = "[log]", "name", "list of names", "number"
_MOST_LINES = 4  # of TOML that a question offers
_JOINT = "_joint"
"""The end of joints' names that many logs leave out; it is no part of a name where all joints have it."""
_LONGEST_NAME = 60  # that a message shows of a column
_SURELY_DEGREES = 4.0 * pi
"""Positions above it are degrees where either may be meant: wrists turn two times at most in either direction."""
_LOOKED_AT = 200_000
"""Rows by which it is told whether positions are degrees; a motion is under way by then."""
_EPOCHS = {"s": (1e8, 1e10), "ms": (1e11, 1e13), "us": (1e14, 1e16), "ns": (1e17, 1e19)}
"""Times since 1970, from 1973 on, by their unit; times since the start of a log are below 1e8 in any unit."""


@dataclass(frozen=True)
class ColumnMeaning:
    """The meaning that was found for a column of a log.

    Attributes
    ----------
    column : str
        Its name.
    joint : str
        The name of the joint, its number where it has no name, or what else the column belongs to.
    quantity : str
        "time", "position", "velocity", "acceleration" or "torque".
    unit : str
        Such as "rad" or "N·m".
    by : str
        What tells so: ``[log]``, a name, a number, or who names columns in this way.
    """

    column: str
    joint: str
    quantity: str
    unit: str
    by: str


@dataclass(frozen=True)
class Layout:
    """The columns of a log by what they hold, in the order of the joints (or of the motors, before a matrix).

    Attributes
    ----------
    time : str or None
        None where there is a rate alone.
    time_unit : str
    position, torque : tuple of str
        The torque of a joint is empty where none was logged of it.
    velocity, acceleration : tuple of str, or None
    time_rest : (str, str) or None
        The column that holds what is left of whole seconds, and its unit.
    units : mapping from str to tuple of str
        The units of the columns of each quantity.
    table : tuple of ColumnMeaning
        All the above, a column a line.
    guesses : tuple of str
        What was assumed, a sentence each.
    has_matrix : bool
        Whether a matrix makes joints of the columns, so that a column belongs to no single one.
    channels : tuple of (str, tuple of str)
        What else is read, by name: one column, or one for each joint.
    """

    time: str | None
    time_unit: str
    position: tuple[str, ...]
    velocity: tuple[str, ...] | None
    acceleration: tuple[str, ...] | None
    torque: tuple[str, ...]
    time_rest: tuple[str, str] | None = None
    units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    table: tuple[ColumnMeaning, ...] = ()
    guesses: tuple[str, ...] = ()
    has_matrix: bool = False
    channels: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def stamps(self) -> tuple[str, ...]:
        """The columns that make the times of the rows."""
        rest = () if self.time_rest is None else (self.time_rest[0],)
        return () if self.time is None else (self.time, *rest)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns to be read, each once."""
        groups = [self.stamps, self.position, self.velocity or (), self.acceleration or (), self.torque]
        groups += [columns for _, columns in self.channels]
        return tuple(dict.fromkeys(name for group in groups for name in group if name))

    @property
    def without_torque(self) -> tuple[int, ...]:
        """The joints, from 0, of which no torque was logged."""
        return tuple(k for k, name in enumerate(self.torque) if not name)

    def seconds(self, raw: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the times of rows, s."""
        assert self.time is not None
        if self.time_rest is None:
            scale = TIME_UNITS[self.time_unit]
            # Divided once, whole numbers of ms, µs and ns are rounded as the decimal number of s is.
            return raw[self.time] * scale if scale >= 1.0 else raw[self.time] / round(1.0 / scale)
        parts = round(1.0 / TIME_UNITS[self.time_rest[1]])
        return (raw[self.time] * parts + raw[self.time_rest[0]]) / parts

    def nanoseconds(self, offsets: Mapping[str, int | Fraction]) -> int:
        """Return whole numbers of the columns that make the times, such as what was taken off them, in ns."""
        units = {self.time: self.time_unit}
        if self.time_rest is not None:
            units[self.time_rest[0]] = self.time_rest[1]
        return sum(
            round(offset * Fraction(10**9) * _exact(TIME_UNITS[units[name]])) for name, offset in offsets.items()
        )

    @property
    def heads(self) -> tuple[str, ...]:
        """The heads of the table."""
        return ("column", "joint", "quantity", "unit", "told by")

    def rows(self) -> list[tuple[str, ...]]:
        """Return the rows of the table."""
        return [(one.column, one.joint, one.quantity, one.unit, one.by) for one in self.table]

    def brief(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return heads and rows of the table in short: a row for all the columns of a quantity, a unit and a reason."""
        groups: dict[tuple[str, str, str], list[str]] = {}
        for one in self.table:
            name = one.column if one.joint in (one.column, "") else f"{one.joint} = {one.column}"
            groups.setdefault((one.quantity, one.unit, one.by), []).append(name)
        heads = ("quantity", "unit", "told by", "joint = column")
        return heads, [(*what, ", ".join(columns)) for what, columns in groups.items()]

    def to_list(self) -> list[dict[str, str]]:
        """Return the table as plain data."""
        return [asdict(one) for one in self.table]

    def __str__(self) -> str:
        return "\n".join((text_table(self.heads, self.rows()), *self.guesses))

    def _repr_html_(self) -> str:
        return html_table("Columns", self.heads, self.rows(), self.guesses)

    def of_joints(self, usual: Sequence[str]) -> Layout:
        """Return the same with the units of joints that slide, where they are those of joints that turn.

        `usual` are the SI units of all joints, as for `LogColumns.of_joints`.
        """
        slides = [unit == "m" for unit in usual]
        if len(slides) != len(self.position) or self.has_matrix:
            return self
        places = {column: k for kind in KINDS for k, column in enumerate(getattr(self, kind) or ())}
        sliding = {column for column, k in places.items() if slides[k]}
        table = [replace(m, unit=_OF_SLIDES.get(m.unit, m.unit)) if m.column in sliding else m for m in self.table]
        units = {
            kind: tuple(_OF_SLIDES.get(unit, unit) if slide else unit for unit, slide in zip(told, slides, strict=True))
            for kind, told in self.units.items()
            if len(told) == len(slides)
        }
        return replace(self, table=tuple(table), units={**self.units, **units})

    def settings(self) -> dict[str, Any]:
        """Return the keys of `[log]` that state what was found."""
        said: dict[str, Any] = {}
        if self.time is not None:
            said["time"] = self.time if self.time_rest is None else list(self.stamps)
            if self.time_rest is None:
                said["time_unit"] = self.time_unit
        for kind in KINDS:
            group = getattr(self, kind)
            if group is not None:
                said[kind] = list(group)
            if group is not None and kind != "acceleration":
                units = self.units[kind]
                said[f"{kind}_unit"] = units[0] if len(set(units)) == 1 else list(units)
        return said


@dataclass(frozen=True)
class _Group:
    """Columns of one quantity that one way of naming finds, in the order of the joints.

    `units` are those that the columns say, `by` is what tells whose they are, `first` the number of the first one,
    `labels` the names that the log has for them, `fault` why they cannot be used, and `chosen_by` what tells which of
    numbered columns are those of joints that move, where not all are.
    """

    columns: tuple[str, ...]
    units: tuple[str | None, ...]
    style: ColumnStyle
    by: str
    shape: str = ""
    topic: str = ""
    first: int = 1
    labels: tuple[str, ...] = ()
    fault: str = ""
    chosen_by: str = ""

    def told(self) -> str:
        """Say what tells whose the columns are."""
        how = f"number, from {self.first}" if self.by == _NUMBER and len(self.columns) > 1 else self.by
        return f"{how} ({self.style.writer})" if self.style.writer else how


def label_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns whose text may name the joints of numbered columns, as `name[0]`, in the order of numbers.

    Examples
    --------
    >>> label_columns(["time", "name[0]", "name[1]", "position[0]", "position[1]"])
    ('name[0]', 'name[1]')
    """
    groups = _groups(names).get("label", ())
    return groups[0].columns if groups else ()


def names_of(joints: Joints) -> tuple[str, ...] | None:
    """Return the names of the joints where `joints` is no number."""
    if joints is None or isinstance(joints, int):
        return None
    return joints.joint_names if isinstance(joints, Robot) else tuple(joints)


def numbered_columns(pattern: str, joints: int | Robot, names: Sequence[str], log: str = "the log") -> tuple[str, ...]:
    """Return the columns that a pattern with ``{}`` stands for: numbered from 1, or from 0 where a log has those.

    Of a robot that holds joints still, all joints of the description are counted where the log has columns of them all,
    and those that move where it has no further ones.

    Raises
    ------
    InputError
        Where the log has some further columns, so that either may be meant.

    Examples
    --------
    >>> numbered_columns("q{}", 2, ["t", "q0", "q1"])
    ('q0', 'q1')
    """

    def counted(count: int) -> tuple[str, ...]:
        from_0, from_1 = (tuple(pattern.replace("{}", str(first + k)) for k in range(count)) for first in (0, 1))
        return from_0 if from_1[-1] not in names and all(name in names for name in from_0) else from_1

    if isinstance(joints, int):
        return counted(joints)
    moving, described = counted(joints.dof), joints.described_joints or joints.joint_names
    everything = counted(len(described))
    chosen = tuple(everything[described.index(name)] for name in joints.joint_names)
    there = {pattern.replace("{}", str(k)) for k in range(len(described) + 1)}.intersection(names)
    if there.issuperset(everything) or chosen == moving:
        return chosen
    if len(there) > len(moving):
        raise InputError(
            f"{log} has {len(there)} columns {pattern!r}, which may count the {len(moving)} joints that move or all "
            f"{len(described)} of the description; give a list of columns in the place of the pattern, for "
            f"{_listing(joints.joint_names)}, such as {_toml(moving)}."
        )
    return moving


def find_columns(
    names: Sequence[str],
    columns: LogColumns | None = None,
    joints: Joints = None,
    *,
    values: Values | None = None,
    labels: Sequence[str] = (),
    log: str = "the log",
) -> Layout:
    """Find which columns of a log are what.

    What `columns` states is taken. What it leaves out is found by the names of the columns: first those that hold the
    name of a joint, then those that hold its number. The ways of naming are those of the table
    ``steelyard.recording.column_styles.STYLES``. Where the log says whose each number is (`labels`), numbers count as
    names. Where two groups of columns fit equally well, or none, nothing is guessed.

    Parameters
    ----------
    names : sequence of str
        Of all columns.
    columns : LogColumns, optional
        What is stated.
    joints : int, sequence of str or Robot, optional
        How many joints the robot has, their names, or the robot. Of a robot that holds joints still, numbered columns
        may be those of all joints of the description.
    values : callable, optional
        ``values(name)`` returns the values of a column, in blocks; it is called where a name does not tell the unit.
    labels : sequence of str
        The joints of numbered columns, in the order of the numbers, where the log names them.
    log : str
        What the log is called in messages.

    Raises
    ------
    InputError
        For a missing column, an ambiguous header or a wrong number of joints.

    Examples
    --------
    >>> layout = find_columns(["time", "pos_elbow", "pos_wrist", "tau_elbow", "tau_wrist"], joints=["wrist", "elbow"])
    >>> layout.position, layout.torque
    (('pos_wrist', 'pos_elbow'), ('tau_wrist', 'tau_elbow'))
    >>> layout.table[1]
    ColumnMeaning(column='pos_wrist', joint='wrist', quantity='position', unit='rad', by='name')
    """
    search = _Search(names, joints, LogColumns() if columns is None else columns, values, labels, log)
    return search.layout()


class _Search:
    """The search for the columns of one log."""

    def __init__(
        self,
        names: Sequence[str],
        joints: Joints,
        columns: LogColumns,
        values: Values | None,
        labels: Sequence[str],
        source: str,
    ) -> None:
        self.names, self.columns, self.values, self.source = names, columns, values, source
        self.robot = joints if isinstance(joints, Robot) else None
        self.joint_names = names_of(joints) or ()
        self.described = (self.robot and self.robot.described_joints) or self.joint_names
        self.joint_count = joints if joints is None or isinstance(joints, int) else len(self.joint_names)
        self.labels = tuple(labels)
        self.called = self.joint_names or self.labels
        unread = [re.escape(one).replace(r"\{\}", "[0-9]+").replace(r"\{name\}", ".+") for one in self.columns.unread]
        names = [name for name in names if not any(re.fullmatch(one, name) for one in unread)]
        self.groups = _groups(names, self.called)
        if not self.called and not any(NUMBER in group.shape for group in self.groups.get("position", ())):
            self.called = _joints_named(names)
            self.groups = _groups(names, self.called)
        self.guesses: list[str] = []

    def layout(self) -> Layout:
        """Find everything."""
        found = {kind: group for kind in KINDS if (group := self._find(kind)) is not None}
        for kind in ("position", "torque"):
            if kind not in found:
                raise self._absent(kind)
        self._check_counts(found)
        self._require_same_joints(found)
        units = self._units(found)
        self._require_units_of_joints(found, units)
        time, time_unit, time_rest, by = self._time(found["position"].topic)
        table = []
        if time is not None:
            table.append(ColumnMeaning(time, "", "time", time_unit, by))
        if time_rest is not None:
            table.append(ColumnMeaning(time_rest[0], "", "time", time_rest[1], by))
        for kind, group in found.items():
            table += [
                ColumnMeaning(column, self._joint(kind, i), kind, unit, group.told())
                for i, (column, unit) in enumerate(zip(group.columns, units[kind], strict=True))
                if column
            ]
        has_matrix = any(self._matrix(kind) is not None for kind in found)
        columns = {kind: group.columns for kind, group in found.items()}
        channels = self._channels(len(columns["position"]) if not has_matrix else self.joint_count)
        table += [
            ColumnMeaning(column, self._joint("torque", i) if len(own) > 1 else "", name, "", _STATED)
            for name, own in channels
            for i, column in enumerate(own)
        ]
        layout = Layout(
            time=time,
            time_unit=time_unit,
            position=columns["position"],
            velocity=columns.get("velocity"),
            acceleration=columns.get("acceleration"),
            torque=columns["torque"],
            time_rest=time_rest,
            units=units,
            table=tuple(table),
            guesses=tuple(self.guesses),
            has_matrix=has_matrix,
            channels=channels,
        )
        return layout if self.robot is None else layout.of_joints(self.robot.position_units)

    def _channels(self, joints: int | None) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """Return the columns of what else is read."""
        found = []
        for name, stated in (self.columns.channels or {}).items():
            columns = self._expanded(name, stated) if isinstance(stated, str) else stated
            for column in columns:
                self._require(column, name)
            if len(columns) > 1 and len(columns) != joints:
                raise InputError(
                    f"{self.source}: the channel {name!r} in [log] has {len(columns)} columns, but there are {joints} "
                    "joints; name one column for all of them, or one for each."
                )
            found.append((name, columns))
        return tuple(found)

    def _matrix(self, kind: str) -> tuple[tuple[float, ...], ...] | None:
        return self.columns.torque_matrix if kind == "torque" else self.columns.position_matrix

    def _expected(self, kind: str) -> int | None:
        """Return how many columns of a quantity there must be, where that is known."""
        matrix = self._matrix(kind)
        return self.joint_count if matrix is None else len(matrix[0])

    def _joint(self, kind: str, index: int) -> str:
        if self._matrix(kind) is not None:
            return f"column {index + 1} of {'torque' if kind == 'torque' else 'position'}_matrix"
        return self.called[index] if index < len(self.called) else str(index + 1)

    def _find(self, kind: str) -> _Group | None:
        """Return the columns of a quantity, as they are stated or as their names tell."""
        stated: str | tuple[str, ...] | None = getattr(self.columns, kind)
        if stated == "none":
            if kind in ("position", "torque"):
                raise InputError(f'{self.source} cannot be used with `{kind} = "none"`; {kind}s are needed.')
            return None
        counts = isinstance(stated, str) and "{name}" not in stated
        if isinstance(stated, str):
            stated = self._expanded(kind, stated)
        if stated is not None:
            named = [name for name in stated if name or kind != "torque"]  # empty where none was logged
            for name in named:
                self._require(name, kind)
            if counts and self._matrix(kind) is None and (doubt := self._doubt_of_order(kind, stated)):
                self.guesses.append(f"The {kind} is read in the robot's order, as {_ends(stated)}: {doubt}.")
            if len(set(named)) != len(named):
                raise InputError(f"{self.source}: `{kind}` in [log] names a column twice; each joint needs its own.")
            said = tuple(_unit_of(name, kind) for name in stated)
            return _Group(stated, said, ColumnStyle("", kind, ()), _STATED)
        candidates = self._candidates(kind)
        if kind == "torque":
            certain = any(not group.style.last_resort for group in candidates)
            if not certain and self.columns.gain is not None and (currents := self._candidates("current")):
                candidates = currents
            whole = any(len(one.columns) == self._expected(kind) for one in candidates)
            if not whole and (part := self._torques_of_some()) is not None:
                return part
        return self._chosen(kind, candidates)

    def _torques_of_some(self) -> _Group | None:
        """Return the torques that are named by joints, where positions are there of all and torques of some.

        The drive of a rail or of a gripper often has a controller of its own. Such joints move the others all the same,
        and the arm would be weighed wrongly with them held still. Torques of fewer than half of the joints are asked
        about: they may be those of a sensor at the tool.
        """
        whole = any(group.by == _NAME and not group.labels for group in self.groups.get("position", ()))
        parts = [one for one in self.groups.get("part of torque", ()) if one.by == _NAME and not one.style.last_resort]
        if not whole or len(parts) != 1 or self._matrix("torque") is not None:
            return None
        (part,) = parts
        if len(part.columns) < len(part.labels):
            return None
        own = [joint for joint in self.joint_names if joint not in part.labels]
        there = dict(zip(own, zip(part.columns, part.units, strict=True), strict=True))
        columns, units = zip(*(there.get(joint, ("", None)) for joint in self.joint_names), strict=True)
        names = _listing([joint for joint in self.joint_names if joint in part.labels])
        self.guesses.append(
            f"No torque of {names} was logged: the motion is used, and the torques of the other joints."
        )
        return replace(part, columns=columns, units=units, labels=())

    def _candidates(self, kind: str) -> list[_Group]:
        """Return the groups of columns that may be a quantity, those with the columns of another one left out."""
        expected = self._expected(kind)
        topic = next((group.topic for group in self.groups.get("label", ())), "")
        found: dict[tuple[str, ...], _Group] = {}
        for group in self.groups.get(kind, ()):
            if NUMBER not in group.shape and NAME not in group.shape:  # such as `q`, of a robot with one joint
                several = any(NUMBER in other.shape or NAME in other.shape for other in self.groups[kind])
                if expected not in (1, None) or (expected is None and several):
                    continue
            if group.by == _NUMBER and self.labels and self.joint_names and group.topic.startswith(topic):
                group = self._labelled(kind, group)
            elif group.by == _NUMBER:
                group = self._numbered(kind, group)
            before = found.get(group.columns)
            if before is None or self._tier(kind, group) < self._tier(kind, before):
                found[group.columns] = group
        return list(found.values())

    def _labelled(self, kind: str, group: _Group) -> _Group:
        """Choose the numbered columns of the joints by the names that the log gives them."""
        labels, joints = self.labels, self.joint_names
        absent = [joint for joint in joints if joint not in labels]
        if absent or len(labels) != len(group.columns) or len(set(labels)) != len(labels):
            what = f"no {absent[0]!r}" if absent else f"{len(group.columns)} columns of {kind} for {len(labels)} names"
            fault = (
                f"{self.source} names its joints {_listing(labels)}, and has {what}; name the columns of "
                f"{', '.join(joints)} with a list in `{kind}` of [log]."
            )
            return replace(group, by=_LABEL, fault=fault)
        places = [labels.index(joint) for joint in joints]
        return replace(self._at(group, places), by=_LABEL)

    def _numbered(self, kind: str, group: _Group) -> _Group:
        """Choose, of numbered columns of more joints than move, those with the numbers in the joints' names.

        A joint that is locked, or beyond the tip, has a column but is no joint of the robot. Where the numbers do not
        tell, as many columns as the description has joints are theirs.
        """
        chosen = self._by_numbers_in_names(kind, group)
        count = len(group.columns)
        if chosen is not group or not len(self.joint_names) < len(self.described) == count or self._matrix(kind):
            return chosen
        return self._at(group, [self.described.index(name) for name in self.joint_names], self._count_of_all())

    @staticmethod
    def _at(group: _Group, places: Sequence[int], chosen_by: str = "") -> _Group:
        """Return the columns at some places of a group."""
        columns = tuple(group.columns[place] for place in places)
        return replace(group, columns=columns, units=tuple(group.units[place] for place in places), chosen_by=chosen_by)

    def _count_of_all(self) -> str:
        """Say why numbers of columns are those of all joints of the description."""
        held = [name for name in self.described if name not in self.joint_names]
        return f"of {len(self.described)} numbered columns, which count joints that are locked, too ({_listing(held)})"

    def _by_numbers_in_names(self, kind: str, group: _Group) -> _Group:
        numbers, count = _last_numbers(self.joint_names), len(self.joint_names)
        if not 0 < len(numbers) == count < len(group.columns) or self._matrix(kind) is not None:
            return group
        labels = [re.findall(r"[0-9]+", name) for name in group.columns]
        from_0, from_1 = (
            any(
                [int(label) for label in one] == list(range(first, first + len(labels)))
                for one in zip(*labels, strict=False)
            )
            for first in (0, 1)
        )
        if from_0 and max(numbers) < len(labels) and 0 not in numbers:  # joint1 may be the first or the second column
            return group
        places = [number - (0 if from_0 and 0 in numbers else 1) for number in numbers]
        fit = len(set(places)) == len(places) and all(0 <= place < len(labels) for place in places)
        if not fit or not (from_0 or from_1):
            return group
        why = f"of {len(labels)} numbered columns, by the numbers in the names of the joints that move"
        return self._at(group, places, why)

    def _tier(self, kind: str, group: _Group) -> tuple[bool, ...]:
        """Return what is the smaller the better a group fits."""
        expected = self._expected(kind)
        wrong = expected is not None and len(group.columns) != expected
        bare = group.shape == NAME
        return (bool(group.fault), wrong, group.style.last_resort, group.by == _NUMBER, bare, bool(group.topic))

    def _chosen(self, kind: str, candidates: Sequence[_Group]) -> _Group | None:
        """Return the best of groups of columns, and refuse to choose among equals."""
        if not candidates:
            return None
        tiers = [self._tier(kind, group) for group in candidates]
        best = [group for group, tier in zip(candidates, tiers, strict=True) if tier == min(tiers)]
        best.sort(key=lambda group: group.columns)
        if len(best) > 1:
            lines = " or ".join(f"{_ends(group.columns)} (`{self._line(kind, group)}`)" for group in best)
            raise InputError(
                f"{self.source} has several groups of columns for {kind}: {lines}; choose with one of these lines in "
                "[log]."
            )
        (group,) = best
        if group.fault:
            raise InputError(group.fault)
        if group.by == _NUMBER and self._matrix(kind) is None and not group.chosen_by:
            doubt = self._doubt_of_order(kind, group.columns)
            if doubt:
                raise InputError(f"{self.source} numbers its columns, {_ends(group.columns)}: {doubt}.")
        others = [
            other
            for other, tier in zip(candidates, tiers, strict=True)
            if other is not group and not any(tier[:3]) and set(other.columns) != set(group.columns)
        ]
        for other in others:
            self.guesses.append(
                f"The {kind} is read from {_ends(group.columns)} and not from {_ends(other.columns)}, which "
                f"`{self._line(kind, other)}` in [log] would choose."
            )
        if group.chosen_by:
            self.guesses.append(f"The {kind} is read from {_listing(group.columns)} {group.chosen_by}.")
        if group.style.note and group.style.quantity != "position":
            self.guesses.append(f"The {kind} is read from {_ends(group.columns)}: {group.style.note}.")
        return group

    def _doubt_of_order(self, kind: str, columns: Sequence[str]) -> str:
        """Ask whose columns are that are numbered in one order, where the joints of the robot are in another."""
        numbers = _last_numbers(self.joint_names)
        count = len(self.joint_names)
        first = min(numbers, default=0)
        if len(numbers) != count or sorted(numbers) != list(range(first, first + count)) or first not in (0, 1):
            return ""
        if numbers == sorted(numbers) or len(columns) != count:
            return ""
        other = [columns[number - first] for number in numbers]
        return (
            f"the joints of the robot are, in order, {_listing(self.joint_names)}; say whose they are with "
            f"`{kind} = {_toml(other)}` (by the numbers in the joints' names) or `{kind} = {_toml(columns)}` (in the "
            "robot's order) in [log]"
        )

    def _line(self, kind: str, group: _Group) -> str:
        """Return the line of TOML that chooses a group."""
        return f"{kind} = {_toml(_pattern(group.columns, self.called) or group.columns)}"

    def _absent(self, kind: str) -> InputError:
        """Say that a quantity has no columns, and what comes nearest."""
        currents = self._candidates("current") if kind == "torque" else []
        if currents:
            group = min(currents, key=lambda one: self._tier(kind, one))
            return InputError(
                f"{self.source} has currents, {_ends(group.columns)}, but no torques; state the drive gains, N·m per "
                f"A of each joint, with `gain = [...]` in [log], or name other columns with `torque`."
            )
        partly = self.groups.get(f"part of {kind}", ())
        near = ""
        if partly:
            part = max(partly, key=lambda one: len(one.columns))
            near = f" for {_listing(part.labels)}, but has {_listing(part.columns)}"
        lines = [f"`{kind} = {_toml(pattern)}`" for pattern in self._patterns(kind)]
        line = " or ".join(lines[:_MOST_LINES]) or f'`{kind} = "…{{}}"`'
        return InputError(
            f"{self.source} has no columns that look like {kind}s{near}; it has {_listing(self.names)}; "
            f"say which they are with {line} or a list of names in [log]{self._instead(kind)}."
        )

    def _instead(self, kind: str) -> str:
        """Say what commands of positions are good for where no torque was logged."""
        commands = self._commands() if kind == "torque" and self.groups.get("position") else []
        if not commands:
            return ""
        return (
            ". Where none was logged, commands and positions alone tell of the drives: state "
            f"`command = {_toml(commands[0])}` and `kp` in [drive] of robot.toml, and identify with --from positions"
        )

    def _commands(self) -> list[str]:
        """Return patterns of columns, one for each joint, that look like commanded positions."""
        words = {word for style in STYLES if style.quantity == "position" for word in style.words}
        found = []
        single = self.names if max(len(group.columns) for group in self.groups["position"]) == 1 else ()
        for pattern in (*self._numbered_patterns("torque"), *single):
            said = [word for word in re.split(r"[/._{}\[\]]+", normalised(pattern)) if word]
            rest = [word for word in said if word not in COMMANDED]
            if len(rest) < len(said) and words.union(("joint", "joints", "motor")).issuperset(rest):
                found.append(pattern)
        return found

    def _numbered_patterns(self, kind: str) -> list[str]:
        """Return patterns of columns that are numbered, one for each joint."""
        families: dict[str, set[int]] = {}
        for name in self.names:
            for match in re.finditer("[0-9]{1,6}", name):
                families.setdefault(f"{name[: match.start()]}{{}}{name[match.end() :]}", set()).add(int(match[0]))
        count = self._expected(kind)
        return [
            pattern
            for pattern, numbers in families.items()
            if numbers in (set(range(len(numbers))), set(range(1, len(numbers) + 1))) and count in (None, len(numbers))
        ]

    def _patterns(self, kind: str) -> list[str]:
        """Return patterns of columns, one for each joint, that may be a quantity under a name of its own."""
        taken = {_pattern(group.columns, ()) for other in KINDS for group in self.groups.get(other, ())}
        words = tuple({word for style in STYLES if style.quantity == kind for word in style.words})
        long = [word for word in words if len(word) > 1]
        return [
            pattern
            for pattern in self._numbered_patterns(kind)
            if pattern not in taken and not _is_commanded(text := normalised(pattern))
            if text.startswith(words) or any(word in text for word in long)
        ]

    def _expanded(self, kind: str, pattern: str) -> tuple[str, ...]:
        """Return the columns that a pattern stands for, by the joints' names or numbers, or as far as they go."""
        if "{name}" in pattern:
            if not self.joint_names:
                raise InputError(
                    f"{self.source}: the pattern {pattern!r} needs the names of the joints; use {{}} for their numbers."
                )
            return tuple(pattern.replace("{name}", name) for name in self.joint_names)
        if pattern.count("{}") != 1:
            raise InputError(f"{self.source}: the pattern {pattern!r} for {kind} must hold {{}} or {{name}} once.")
        count = self._expected(kind)
        if count is None:
            count = 0
            while pattern.replace("{}", str(count + 1)) in self.names:
                count += 1
            count = max(count, 1)
        if self.robot is None or count != self.robot.dof:  # motors before a matrix with other numbers
            return numbered_columns(pattern, count, self.names)
        columns = numbered_columns(pattern, self.robot, self.names, self.source)
        if columns != numbered_columns(pattern, count, self.names):
            self.guesses.append(f"The {kind} is read from {_listing(columns)} {self._count_of_all()}.")
        return columns

    def _check_counts(self, found: Mapping[str, _Group]) -> None:
        position = found["position"]
        plain = self.columns.position_matrix is None
        count = len(position.columns) if plain else len(self.columns.position_matrix or ())
        if self.joint_count is not None and count != self.joint_count:
            how = f"({_listing(position.columns)})" if plain else "(rows of position_matrix)"
            line = "`position`"
            if plain and self.joint_count and count > self.joint_count and self.described == self.joint_names:
                line = f"`position` (the first ones: `position = {_toml(position.columns[: self.joint_count])}`)"
            held = ""
            if count < self.joint_count:
                held = ", or hold joints that were not logged still with `locked = [...]` in [description]"
            raise InputError(
                f"{self.source} has positions of {count} joints {how} but the robot has {self.joint_count}; "
                f"name the right columns with {line} in [log]{held}, or use the robot that was logged."
            )
        for kind, group in found.items():
            matrix = self._matrix(kind)
            need = count if matrix is None else len(matrix[0])
            if len(group.columns) != need:
                why = "joints" if matrix is None else "columns in the matrix"
                instead = ""
                if matrix is None and len(group.columns) < need:
                    instead = f', or leave out what was measured of this kind with `{kind} = "none"`'
                    if kind == "torque":
                        instead = ', and "" for a joint of which none was logged'
                raise InputError(
                    f"{self.source} has {len(group.columns)} columns of {kind} ({_listing(group.columns)}) for {need} "
                    f"{why}; name one for each with `{kind}` in [log]{instead}."
                )
            if matrix is not None and len(matrix) != count:
                raise InputError(f"torque_matrix in [log] has {len(matrix)} rows but there are {count} joints.")

    def _require_same_joints(self, found: Mapping[str, _Group]) -> None:
        """Refuse numbered columns that count joints that are locked, beside a list of columns that does not."""

        def steps(group: _Group) -> list[int]:
            numbers = _last_numbers(group.columns)
            return [b - a for a, b in pairwise(numbers)] if len(set(numbers)) == len(group.columns) else []

        groups = [(kind, group) for kind, group in found.items() if self._matrix(kind) is None]
        lists = [(kind, group) for kind, group in groups if isinstance(getattr(self.columns, kind), tuple)]
        for kind, group in groups:
            for other, listed in lists:
                if group.chosen_by and steps(listed) and steps(listed) != steps(group):
                    raise InputError(
                        f"{self.source}: {other} is stated in [log] as {_listing(listed.columns)}, and {kind} is "
                        f"{_listing(group.columns)} {group.chosen_by}; state `{kind}` as a list as well."
                    )

    def _units(self, found: Mapping[str, _Group]) -> dict[str, tuple[str, ...]]:
        """Return the units of the columns of each quantity: as stated, as the columns say, or as is usual."""
        columns, units = self.columns, {}
        stated: dict[str, str | tuple[str, ...] | None] = {
            kind: getattr(columns, f"{kind}_unit") for kind in KINDS if kind != "acceleration"
        }
        per_second = stated["velocity"]
        if per_second is not None:
            single = isinstance(per_second, str)
            stated["acceleration"] = (
                PER_SECOND[str(per_second)] if single else tuple(PER_SECOND[unit] for unit in per_second)
            )
        for kind, group in found.items():
            count, said = len(group.columns), stated.get(kind)
            if said is not None:
                if not isinstance(said, str) and len(said) != count:
                    key = "velocity_unit" if kind == "acceleration" else f"{kind}_unit"
                    raise InputError(
                        f"{self.source} needs {count} values in `{key}` of [log] but there are {len(said)}; "
                        "give one for each."
                    )
                units[kind] = (said,) * count if isinstance(said, str) else said
                continue
            self._ask_unit(kind, group)
            usual: tuple[str, ...] = ("N·m",) * count
            if kind == "position":
                usual = self._conventions(group)
            elif kind != "torque":
                usual = tuple(PER_SECOND[unit] for unit in units["position"])
                usual = usual if kind == "velocity" else tuple(PER_SECOND[unit] for unit in usual)
                usual = usual if len(usual) == count else usual[:1] * count
            own = group.style.unit if kind != "position" else None
            units[kind] = tuple(unit or own or default for unit, default in zip(group.units, usual, strict=True))
            currents = [name for name, unit in zip(group.columns, units[kind], strict=True) if unit in CURRENT_UNITS]
            if currents and columns.gain is None:
                raise InputError(
                    f"{self.source} has torques in amperes, {_ends(currents)}; state the drive gains, N·m per A of "
                    "each joint, with `gain = [...]` in [log]."
                )
        return units

    def _require_units_of_joints(self, found: Mapping[str, _Group], units: Mapping[str, tuple[str, ...]]) -> None:
        """Refuse degrees of a joint that slides and millimetres of one that turns; radians may be a default."""
        for kind in ("position", "velocity"):
            if kind not in found or self._matrix(kind) is not None:
                continue
            columns = found[kind].columns
            for i, (column, slides) in enumerate(zip(columns, self._slides(len(columns)), strict=True)):
                unit = units[kind][i]
                if self.robot is None or (slides and unit.startswith("rad")) or slides == (unit in LENGTHS):
                    continue
                moves, fitting = ("slides", "mm") if slides else ("turns", "deg")
                per_second = "/s" * (kind == "velocity")
                each = [fitting + per_second if k == i else one for k, one in enumerate(units[kind])]
                line = ", ".join(f'"{one}"' for one in each)
                raise InputError(
                    f"{self.source}: the column {column!r} of the joint {self._joint(kind, i)}, which {moves}, is in "
                    f"{unit}; state its own unit with `{kind}_unit = [{line}]` in [log]."
                )

    def _ask_unit(self, kind: str, group: _Group) -> None:
        """Refuse columns whose names have words for a unit that is not understood; none has one where a matrix has."""
        if self._matrix(kind) is not None or (kind == "torque" and self.columns.gain is not None):
            return
        named = "".join(self.joint_names).casefold()
        for column, unit in zip(group.columns, group.units, strict=True):
            word = unit_left_open(column, kind) if column else None
            if unit is None and word is not None and word.casefold() not in named:
                key = "velocity" if kind == "acceleration" else kind
                own = f"{'torque' if kind == 'torque' else 'position'}_matrix"
                raise InputError(
                    f"{self.source}: the name of the column {column!r} says {word!r}, a unit that is not understood "
                    f"there; state `{key}_unit` in [log], or what one of it is on the diagonal of `{own}`."
                )

    def _conventions(self, group: _Group) -> tuple[str, ...]:
        """Return the unit of each position that does not say its own, by who writes such names.

        Who writes degrees writes millimetres of joints that slide: as degrees, the stroke of a SCARA of 0.2 m was read
        as 3.5 m, its quill weighed a tenth, and the prediction was as good.
        """
        slides = self._slides(len(group.columns))
        turning = [column for column, slide in zip(group.columns, slides, strict=True) if not slide]
        unit = self._convention(group, turning or group.columns, any(slides))
        of_slides = "mm" if unit == "deg" else "m"
        return tuple(of_slides if slide else unit for slide in slides)

    def _slides(self, count: int) -> tuple[bool, ...]:
        """Return which of so many columns are those of joints that slide, as far as the robot tells."""
        units = () if self.robot is None else self.robot.position_units
        return tuple(unit == "m" for unit in units) if len(units) == count else (False,) * count

    def _convention(self, group: _Group, turning: Sequence[str], any_slides: bool) -> str:
        """Return the unit of positions that do not say theirs, where the joint turns."""
        if all(group.units) or group.by == _STATED:
            return "rad"
        style = group.style
        if style.unit is None:
            # A robot whose joints are named A1, A2, ... may come from one who writes A1, A2, ... in degrees.
            alike = (other for other in self.groups.get("position", ()) if set(other.columns) == set(group.columns))
            style = next((other.style for other in alike if other.style.unit is not None), style)
        if style.unit is None:
            return "rad"
        largest = self._largest(turning)
        beside = " (those of joints that slide in mm)" if any_slides else ""
        if style.unit != BY_SIZE:
            if group.by == _NAME and largest is not None and largest <= _SURELY_DEGREES:
                raise InputError(
                    f"{self.source} has the positions {_ends(group.columns)}, which {style.writer} would write in "
                    f"degrees and others in radians, and none is beyond {largest:.3g}; say which with "
                    '`position_unit = "deg"` or `position_unit = "rad"` in [log].'
                )
            self.guesses.append(f"The positions {_ends(group.columns)} are read in {style.unit}{beside}: {style.note}.")
            return style.unit
        unit = "deg" if largest is not None and largest > _SURELY_DEGREES else "rad"
        other = "rad" if unit == "deg" else "deg"
        reach = "" if largest is None else f", since they reach {largest:.3g}"
        self.guesses.append(
            f"The positions {_ends(group.columns)} are read in {unit}{beside if unit == 'deg' else ''}{reach}; state "
            f'`position_unit = "{other}"` in [log] if that is wrong.'
        )
        return unit

    def _largest(self, columns: Sequence[str]) -> float | None:
        """Return the largest absolute value of columns; any that can only be degrees where there is one."""
        if self.values is None:
            return None
        largest = 0.0
        for column in columns:
            rows = 0
            for block in self.values(column):
                finite = np.abs(block[np.isfinite(block)])
                largest, rows = max(largest, float(finite.max(initial=0.0))), rows + len(block)
                if largest > _SURELY_DEGREES:
                    return largest
                if rows >= _LOOKED_AT:
                    break
        return largest

    def _require(self, name: str, kind: str) -> None:
        if name not in self.names:
            raise InputError(
                f"{self.source} has no column {name!r} (wanted for {kind}); {suggestion(name, self.names)}"
            )

    def _time(self, topic: str) -> tuple[str | None, str, tuple[str, str] | None, str]:
        """Return the column of time, its unit, the column and unit of what is left of whole seconds, and what tells.

        `topic` is that of the positions.
        """
        columns = self.columns
        if columns.time is None and columns.rate is not None:
            return None, "s", None, ""
        if columns.time is not None:
            names = (columns.time,) if isinstance(columns.time, str) else columns.time
            for name in names:
                self._require(name, "time")
            if len(names) > 1:
                whole, rest = (re.split(r"[/._]", normalised(name))[-1] for name in names)
                return names[0], "s", (names[1], SECONDS_AND_REST.get((whole, rest), "ns")), _STATED
            said = next((unit for _, unit in _times_said(names[0]) if unit is not None), None)
            word = unit_left_open(names[0], "time")
            if said is None and columns.time_unit is None and word is not None:
                raise InputError(
                    f"{self.source}: the name of the column {names[0]!r} says {word!r}, a unit that is not understood "
                    "there; state `time_unit` in [log], or the sample rate in Hz with `rate` in the place of `time`."
                )
            unit, _ = self._time_unit(_Clock(names[0], columns.time_unit or said))
            return names[0], unit, None, _STATED
        found = _clocks(self.names) or _clocks(self.names, FURTHER_TIME_WORDS)
        if len(found) > 1:
            found = [clock for clock in found if self._runs(clock)] or found
            ranks = [clock.rank(topic) for clock in found]
            found = [clock for clock, rank in zip(found, ranks, strict=True) if rank == min(ranks)]
        if not found:
            raise InputError(
                f"{self.source} has no column of time; it has {_listing(self.names)}; "
                "name it with `time` in [log], or give the sample rate in Hz with `rate`."
            )
        if len(found) > 1 and not self._agree(found):
            lines = " or ".join(f"`time = {_toml(clock.columns)}`" for clock in found)
            raise InputError(
                f"{self.source} has several columns of time, {_listing([clock.column for clock in found])}; choose "
                f"with {lines} in [log]."
            )
        clock = found[0]
        if clock.rest is not None:
            return clock.column, "s", clock.rest, "name"
        unit, by = self._time_unit(clock if columns.time_unit is None else replace(clock, unit=columns.time_unit))
        return clock.column, unit, None, by

    def _time_unit(self, clock: _Clock) -> tuple[str, str]:
        """Return the unit of times, and what tells: the name, or the size of times since 1970."""
        if clock.unit is not None:
            return clock.unit, "name"
        first = self._first(clock.column)
        for unit, (low, high) in _EPOCHS.items():
            if first is not None and low <= first < high:
                return unit, "name, and size as a time since 1970"
        return "s", "name"

    def _first(self, column: str) -> float | None:
        """Return the first value of a column that is a number."""
        if self.values is None:
            return None
        blocks = (block[np.isfinite(block)] for block in self.values(column))
        return next((float(block[0]) for block in blocks if len(block)), None)

    def _head(self, clock: _Clock) -> NDArray[np.float64]:
        """Return the first times of a clock in s, of some size."""
        if self.values is None:
            return np.empty(0)
        whole = next(iter(self.values(clock.column)), np.empty(0))
        if clock.rest is not None:
            rest = next(iter(self.values(clock.rest[0])), np.empty(0))
            count = min(len(whole), len(rest))
            return whole[:count] + rest[:count] * TIME_UNITS[clock.rest[1]]
        return whole * TIME_UNITS[self._time_unit(clock)[0]]

    def _runs(self, clock: _Clock) -> bool:
        """Return whether a clock has times, and they are not all the same."""
        try:
            head = self._head(clock)
        except InputError:  # texts
            return False
        return len(head) < 2 or bool(np.any(head != head[0]))

    def _agree(self, clocks: Sequence[_Clock]) -> bool:
        """Return whether clocks run alike: the same intervals, to a thousandth of the span."""
        heads = [self._head(clock) for clock in clocks]
        if any(len(head) < 2 or len(head) != len(heads[0]) for head in heads):
            return False
        spans = [head - head[0] for head in heads]
        return all(np.allclose(span, spans[0], rtol=1e-3, atol=1e-3 * abs(spans[0][-1])) for span in spans[1:])


@dataclass(frozen=True)
class _Clock:
    """A column of times, or two that make one, with the unit that its name says."""

    column: str
    unit: str | None
    rest: tuple[str, str] | None = None
    topic: str = ""

    @property
    def columns(self) -> str | tuple[str, ...]:
        """What `time` in [log] says of it."""
        return self.column if self.rest is None else (self.column, self.rest[0])

    def rank(self, topic: str) -> int:
        """Return what is the smaller the better it fits positions of a topic.

        The stamp in the header of a message says when its positions were measured; a time without topic may be that of
        their arrival.
        """
        owner = re.sub(r"(header[/.])?(stamp[/._])?$", "", self.topic)
        if "header" in self.topic and owner == topic:
            return 0
        return 1 if not self.topic else 2 if owner == topic else 3


def _exact(scale: float) -> Fraction:
    return Fraction(round(scale)) if scale >= 1.0 else Fraction(1, round(1.0 / scale))


def _times_said(name: str) -> list[tuple[str, str | None]]:
    """Return how the name of a column may be read as a time: what stands before its unit, and the unit."""
    text = normalised(name)
    said = [(base, unit) for base, unit in units_said(name) if unit in TIME_UNITS]
    return [(text, None), time_unit_behind(text), *said]


def _clocks(names: Sequence[str], words: Sequence[str] = TIME_WORDS) -> list[_Clock]:
    """Return the columns of times; two that make one time come once."""
    by_text = {normalised(name): name for name in reversed(names)}
    found: list[_Clock] = []
    taken: set[str] = set()
    for text, name in by_text.items():
        for (whole, rest), unit in SECONDS_AND_REST.items():
            front = text.removesuffix(whole)
            partner = by_text.get(front + rest)
            if text.endswith(whole) and (not front or front[-1] in "/._") and partner is not None:
                found.append(_Clock(name, "s", (partner, unit), front))
                taken.update((name, partner))
    for name in names:
        if name in taken:
            continue
        clock = next(
            (
                _Clock(name, unit, None, base[:cut])
                for base, unit in _times_said(name)
                for cut in _cuts(base, len(base))
                if base[cut:] in words and not _is_commanded(base[:cut])
            ),
            None,
        )
        if clock is not None:
            found.append(clock)
    return sorted(found, key=lambda clock: list(names).index(clock.column))


def _joints_named(names: Sequence[str]) -> tuple[str, ...]:
    """Return the joints that names speak of where nobody says what they are called: those with position and torque."""
    texts = [(text, name) for name in names for text in (normalised(name), *(base for base, _ in units_said(name)))]
    best: list[str] = []
    for before, after in (("", "/{}"), ("", ".{}"), ("{}[", "]"), ("{}/", ""), ("{}.", ""), ("", "_{}"), ("{}_", "")):
        spoken: dict[str, dict[str, str]] = {"position": {}, "torque": {}}
        for kind, found in spoken.items():
            for word in dict.fromkeys(word for style in STYLES if style.quantity == kind for word in style.words):
                start, end = before.format(word), after.format(word)
                for text, name in texts:
                    cuts = _cuts(text, len(text)) if start else (0,)
                    place = next((cut for cut in cuts if text.startswith(start, cut)), None)
                    if place is None or not text.endswith(end) or _is_commanded(text[:place]):
                        continue
                    joint = text[place + len(start) : len(text) - len(end)]
                    if end[:1] in ("/", "."):
                        joint = re.split("[/.]", joint)[-1]
                    if end == "]" and "]" in joint:
                        continue
                    if len(joint) > len(found.get(name, "")):  # the joint of `elbow_joint_position` is no elbow
                        found[name] = joint
        both = {joint: name for name, joint in spoken["position"].items() if joint in spoken["torque"].values()}
        if len(both) > len(best):
            written = [re.search(re.escape(joint), column, re.IGNORECASE) for joint, column in both.items()]
            best = [match[0] if match else joint for match, joint in zip(written, both, strict=True)]
    return tuple(best)


def _groups(names: Sequence[str], joints: Sequence[str] = ()) -> dict[str, list[_Group]]:
    """Return all groups of columns that the styles find, by quantity.

    Under ``part of position`` and so on stand columns named by joints of which some have none; `labels` are those.
    """
    forms: dict[str, list[int]] = {}
    for index, joint in enumerate(joints):
        forms.setdefault(normalised(joint), []).append(index)
    forms.pop("", None)
    short = {form.removesuffix(_JOINT): indices for form, indices in forms.items() if form.endswith(_JOINT)}
    if len(short) == len(forms) and not any(form in normalised(column) for column in names for form in forms):
        forms = short  # `pan_torque` of `pan_joint`
    found: dict[tuple[Any, ...], dict[int, list[tuple[str, str | None]]]] = {}
    styles: dict[tuple[Any, ...], ColumnStyle] = {}
    for column in names:
        for text, unit in ((normalised(column), None), *units_said(column)):
            for shape, place, by, key in _placed(text, column, forms, joints):
                for cut in _cuts(shape, place):
                    for style in styles_of(shape[cut:]):
                        if not _fits(style, unit) or (cut and (not style.takes_topic or _is_commanded(shape[:cut]))):
                            continue
                        group = (style.quantity, by, shape[cut:], shape[:cut], unit is not None)
                        if styles.setdefault(group, style) is style:
                            found.setdefault(group, {}).setdefault(key, []).append((column, unit))
    result: dict[str, list[_Group]] = {}
    for group, members in found.items():
        quantity, by, shape, topic, _ = group
        for own in _split(members):
            first = 1 if by == _NUMBER and 0 not in own else 0
            count = len(joints) if by == _NAME else next(k for k in range(len(own) + 1) if first + k not in own)
            missing = tuple(joints[k] for k in range(count) if k not in own) if by == _NAME else ()
            there = [own[first + k] for k in range(count) if first + k in own]
            kind = f"part of {quantity}" if missing else quantity
            if there and not (missing and shape == NAME):
                columns, units = zip(*there, strict=True)
                result.setdefault(kind, []).append(
                    _Group(columns, units, styles[group], by, shape, topic, first, missing)
                )
    whole = list(_forces_and_torques(result.get("part of torque", ()), joints))
    return {**result, "torque": [*result.get("torque", ()), *whole]} if whole else result


def _forces_and_torques(parts: Sequence[_Group], joints: Sequence[str]) -> Iterator[_Group]:
    """Join the forces of joints that slide with the torques of those that turn, which the word alone tells apart."""
    for forces, torques in permutations(parts, 2):
        if "force" in torques.shape or torques.shape != forces.shape.replace("force", "torque"):
            continue
        if forces.topic != torques.topic or set(forces.labels) & set(torques.labels):
            continue
        found: dict[str, tuple[str, str | None]] = {}
        for group in (forces, torques):
            own = [joint for joint in joints if joint not in group.labels]
            found.update(zip(own, zip(group.columns, group.units, strict=True), strict=True))
        columns, units = zip(*(found[joint] for joint in joints), strict=True)
        yield replace(torques, columns=columns, units=units, labels=())


def _split(members: Mapping[int, list[tuple[str, str | None]]]) -> list[dict[int, tuple[str, str | None]]]:
    """Return one column a joint; where joints have several, one such choice for each unit or for each place."""
    most = max(len(columns) for columns in members.values())
    if most == 1:
        return [{key: columns[0] for key, columns in members.items()}]
    units = dict.fromkeys(unit for columns in members.values() for _, unit in columns)
    by_unit = [
        {key: column for key, columns in members.items() for column in columns if column[1] == unit} for unit in units
    ]
    if len(units) > 1 and sum(map(len, by_unit)) == sum(map(len, members.values())):
        return by_unit
    return [{key: columns[min(k, len(columns) - 1)] for key, columns in members.items()} for k in range(most)]


def _placed(
    text: str, column: str, forms: Mapping[str, Sequence[int]], joints: Sequence[str]
) -> Iterator[tuple[str, int, str, int]]:
    """Yield the shapes that a normalised name may have: each with where the joint stands in it, and which it is."""
    for match in re.finditer("[0-9]{1,6}", text):
        yield f"{text[: match.start()]}{NUMBER}{text[match.end() :]}", match.start(), _NUMBER, int(match[0])
    yield text, len(text), _NUMBER, 1
    for form, indices in forms.items():
        if form not in text:
            continue
        if len(indices) > 1:  # names that differ in capitals or separators alone
            edge = r"(?<![^\W_]){}(?![^\W_])"
            indices = [index for index in indices if re.search(edge.format(re.escape(joints[index])), column)]
        start = text.find(form) if len(indices) == 1 else -1
        while start >= 0:
            yield f"{text[:start]}{NAME}{text[start + len(form) :]}", start, _NAME, indices[0]
            start = text.find(form, start + 1)


def _cuts(text: str, before: int) -> Iterator[int]:
    """Yield where a name may begin: at its beginning, and behind each part of a topic."""
    yield 0
    yield from (k + 1 for k in range(min(before, len(text))) if text[k] in "/.")


def _is_commanded(topic: str) -> bool:
    return not COMMANDED.isdisjoint(re.split(r"[/._]", topic))


def _fits(style: ColumnStyle, unit: str | None) -> bool:
    if unit is None:
        return not style.needs_unit
    return unit in UNITS[style.quantity] and not (
        style.needs_unit and style.quantity == "torque" and unit in CURRENT_UNITS
    )


def _unit_of(column: str, kind: str) -> str | None:
    """Return the unit that a column's name says, where it is one of a quantity."""
    return next((unit for _, unit in units_said(column) if unit in UNITS[kind]), None)


def _last_numbers(names: Sequence[str]) -> list[int]:
    """Return the last number in each name that has one."""
    return [int(found[-1]) for name in names if (found := re.findall(r"[0-9]+", name))]


def _pattern(columns: Sequence[str], joints: Sequence[str]) -> str | None:
    """Return the pattern that stands for columns in robot.toml; None where there is none."""
    for name in joints[:1]:
        for match in re.finditer(re.escape(name), columns[0]):
            pattern = f"{columns[0][: match.start()]}{{name}}{columns[0][match.end() :]}"
            if [pattern.replace("{name}", joint) for joint in joints] == list(columns):
                return pattern
    for match in re.finditer("[0-9]+", columns[0]):
        pattern = f"{columns[0][: match.start()]}{{}}{columns[0][match.end() :]}"
        for first in (0, 1):
            if [pattern.replace("{}", str(first + k)) for k in range(len(columns))] == list(columns):
                return pattern
    return None


def _toml(value: str | Sequence[str]) -> str:
    return json.dumps(value if isinstance(value, str) else list(value), ensure_ascii=False)


def _ends(columns: Sequence[str]) -> str:
    return columns[0] if len(columns) == 1 else f"{columns[0]} … {columns[-1]}"


def _listing(names: Sequence[str]) -> str:
    most = 24
    short = ", ".join(name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…" for name in names[:most])
    return short if len(names) <= most else f"{short}, … ({len(names)} in all)"
