"""Second encoders of elastic joints: the section [elastic] of robot.toml, and logs read by both encoders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.estimators.joint_stiffness import Motion
from steelyard.files import TomlSection, shown, suggestion
from steelyard.recording import LogColumns, Processing, Recording, Samples, decide
from steelyard.recording.columns import POSITION_UNITS
from steelyard.recording.diagnosis.transmission import position_ratio
from steelyard.recording.formats.registry import Source
from steelyard.recording.recognition import Layout
from steelyard.robot import RobotFile

from ..given import GivenLog, GivenSamples

__all__ = [
    "SecondEncoders",
    "TwoEncoders",
    "at_later",
    "log_columns",
    "names_in",
    "own_section",
    "read_two_encoders",
    "require_columns",
    "with_positions",
]

Array = NDArray[np.float64]
TRIM = 0.3
"""s at both ends of a log, in which a filter rings and the second derivatives of a motion are not to be trusted."""


@dataclass(frozen=True)
class SecondEncoders(TomlSection):
    """The columns of a log that are the second encoders of elastic joints: the section ``[elastic]`` of robot.toml.

    Parameters
    ----------
    joints
        Names of the joints that are elastic, or their numbers from 1.
    position
        A list with the column of each of these joints, or a pattern: ``{}`` stands for the joint's number and
        ``{name}`` for its name. Without it the motion of the motors alone is logged, which tells little.
    position_unit
        rad, deg, m or mm; by default the unit of the joint's first encoder.
    scale
        By which the positions of the second encoders are multiplied, one number for each of these joints: -1 where it
        counts the other way round, or the ratio of a gear that is not in the column.
    side
        On which side of the transmission the second encoder is: ``"link"``, while ``position`` of ``[log]`` is that of
        the motor divided by the gear ratio, or ``"motor"``, the other way round.
    delay
        By which second encoders are logged later than the first, s: one number, or one for each of these joints, or
        ``"automatic"``, which finds it.
    motor_inertia
        Of the motors on the joint side, kg·m² or kg, one for each of these joints, where it is known.
    encoder_errors
        ``"automatic"`` takes a wrong scale, an eccentricity and a lost motion of a second encoder in where they are
        significant; ``"none"`` does not.

    Examples
    --------
    >>> SecondEncoders.from_dict({"joints": [2, 3], "position": "q_se{}"}).delay
    'automatic'
    """

    section_name = "[elastic]"

    joints: tuple[str | int, ...] = ()
    position: str | tuple[str, ...] | None = None
    position_unit: str | None = None
    scale: tuple[float, ...] | None = None
    side: str = "link"
    delay: str | tuple[float, ...] = "automatic"
    motor_inertia: tuple[float, ...] | None = None
    encoder_errors: str = "automatic"

    def _clean(self, where: str) -> None:
        joints = self.joints
        if not isinstance(joints, list | tuple) or not joints:
            raise InputError(f"{where}: joints must be a list of names or numbers of joints, got {shown(joints)}")
        for one in joints:
            if isinstance(one, bool) or not isinstance(one, str | int):
                raise InputError(f"{where}: joints must be a list of names or numbers of joints, got {shown(one)}")
        object.__setattr__(self, "joints", tuple(joints))
        count = len(joints)
        if isinstance(self.position, list | tuple):
            if len(self.position) != count or not all(isinstance(one, str) and one for one in self.position):
                raise InputError(
                    f"{where}: position must name one column for each of the {count} joints, got {shown(self.position)}"
                )
            object.__setattr__(self, "position", tuple(self.position))
        elif self.position is not None and (
            not isinstance(self.position, str) or ("{" not in self.position and count > 1)
        ):
            raise InputError(
                f'{where}: position must be a list of columns, or a pattern such as "q_se{{}}", got '
                f"{shown(self.position)}"
            )
        for name, allowed in (
            ("position_unit", (None, *POSITION_UNITS)),
            ("side", ("link", "motor")),
            ("encoder_errors", ("automatic", "none")),
        ):
            if getattr(self, name) not in allowed:
                listed = ", ".join(str(one) for one in allowed if one)
                raise InputError(f"{where}: {name} must be one of {listed}, got {shown(getattr(self, name))}")
        if self.scale is not None:
            scale = _numbers(where, "scale", self.scale, count, signed=True)
            if 0.0 in scale:
                raise InputError(f"{where}: scale must not be zero, got {shown(self.scale)}")
            object.__setattr__(self, "scale", scale)
        if self.delay != "automatic":
            object.__setattr__(self, "delay", _numbers(where, "delay", self.delay, count, signed=True))
        if self.motor_inertia is not None:
            inertias = _numbers(where, "motor_inertia", self.motor_inertia, count, signed=False)
            object.__setattr__(self, "motor_inertia", inertias)

    @property
    def sign(self) -> float:
        """+1 where the first encoder is that of the motor, -1 where the second one is."""
        return 1.0 if self.side == "link" else -1.0

    def indices(self, names: Sequence[str], where: str = "[elastic]") -> tuple[int, ...]:
        """The places of the joints among all those of a robot."""
        found = []
        for one in self.joints:
            if isinstance(one, int) and 1 <= one <= len(names):
                found.append(one - 1)
            elif isinstance(one, str) and one in names:
                found.append(list(names).index(one))
            else:
                raise InputError(f"{where}: {shown(one)} is no joint of the robot; {suggestion(str(one), names)}")
        if len(set(found)) < len(found):
            raise InputError(f"{where}: joints names a joint twice; name each once")
        return tuple(found)

    def columns(self, names: Sequence[str], where: str = "[elastic]") -> tuple[str, ...]:
        """The columns of the second encoders, one for each of the joints."""
        places = self.indices(names, where)
        if self.position is None:
            raise InputError(
                f"{where}: no column of a second encoder is named, without which a motion shows no stiffness; "
                'name them, as position = ["q_link2", "q_link3"]'
            )
        if isinstance(self.position, str):
            return tuple(
                self.position.replace("{name}", names[place]).replace("{}", str(place + 1)) for place in places
            )
        return self.position


def _numbers(where: str, key: str, value: Any, count: int, *, signed: bool) -> tuple[float, ...]:
    values = [value] * count if isinstance(value, int | float) and not isinstance(value, bool) else value
    valid = isinstance(values, list | tuple) and len(values) == count
    if not valid or not all(
        isinstance(one, int | float) and not isinstance(one, bool) and np.isfinite(one) and (signed or one >= 0.0)
        for one in values
    ):
        kind = "numbers" if signed else "numbers, not negative"
        raise InputError(f"{where}: {key} must be {kind}, one for each of the {count} joints, got {shown(value)}")
    return tuple(float(one) for one in values)


def own_section(file: RobotFile) -> tuple[SecondEncoders, str]:
    """Return the section [elastic] of a robot file, and where it stands, for messages.

    Raises
    ------
    InputError
        If there is none, or it cannot be used.
    """
    where = f"{file.path}, [elastic]"
    section = file.section("elastic")
    if not section:
        raise InputError(
            f'{file.path}: it has no table [elastic]; name the elastic joints, as joints = ["joint2"], and the columns '
            'of their second encoders, as position = ["q_link2"]'
        )
    return SecondEncoders.from_dict(section, where), where


@dataclass(frozen=True, eq=False)
class TwoEncoders:
    """One log: the motion by its first encoders, and by its second ones, processed alike.

    Attributes
    ----------
    second : Samples or None
        None where the log has no second encoders.
    settings : SecondEncoders
        What [elastic] says of them.
    places : tuple of int
        The elastic joints among those of the robot.
    """

    name: str
    first: Samples
    second: Samples | None
    settings: SecondEncoders
    places: tuple[int, ...]

    @property
    def motion(self) -> Motion:
        """That of all joints by the first encoders."""
        return self.first.q, self.first.dq, self.first.ddq

    @property
    def t(self) -> Array:
        """(S,) s."""
        assert self.first.t is not None
        return self.first.t


def read_two_encoders(
    log: GivenLog, file: RobotFile, model: Model, processing: Processing | None, *, needs_second: bool = True
) -> TwoEncoders:
    """Read a log by its first and by its second encoders, and process both alike."""
    settings, where = own_section(file)
    names = list(model.robot.joint_names)
    columns = log_columns(file)
    there = names_in(log, columns)
    source: Source = log  # type: ignore[assignment]
    recording = Recording.read(source, columns, joints=model.robot)
    if processing is None:
        processing = Processing.from_dict(file.section("processing"), f"{file.path}, [processing]")
    settled = decide(processing, [recording], model).processing
    trim: Any = TRIM if settled.trim == "auto" else settled.trim
    settled = replace(settled, decimate=(), torque_cutoff=None, average=False, trim=trim)
    first = recording.process(settled)
    layout = recording.layout
    assert layout is not None
    places = settings.indices(names, where)
    own = () if settings.position is None and not needs_second else settings.columns(names, where)
    if not needs_second and not set(own) & set(there):
        return TwoEncoders(str(log), first, None, settings, places)
    require_columns(log, there, own, where)
    if layout.has_matrix:
        raise InputError(
            f"{where}: second encoders cannot be read beside a position_matrix, which makes joints of several motors; "
            "log the positions of the joints."
        )
    others = with_positions(columns, layout, dict(zip(places, own, strict=True)), settings.position_unit)
    beside = Recording.read(source, others, joints=model.robot)
    if settings.scale is not None:
        scaled = beside.q.copy()
        scaled[:, list(places)] *= settings.scale
        beside = replace(beside, q=scaled)
    second = beside.process(settled)
    if second.count != first.count:
        raise InputError(
            f"{log}: the first encoders leave {first.count} rows and the second {second.count}, so that they cannot be "
            "compared; record both in the same rows."
        )
    for place, column in zip(places, own, strict=True):
        _require_alike(first.q[:, place], second.q[:, place], f'{log}: the second encoder {column} of "{names[place]}"')
    return TwoEncoders(str(log), first, second, settings, places)


def with_positions(columns: LogColumns, layout: Layout, own: Mapping[int, str], unit: str | None) -> LogColumns:
    """Return the columns of a log with others as the positions of some joints, from which velocities are derived.

    Parameters
    ----------
    columns : LogColumns
        With which the log is read.
    layout : Layout
        What they are in this log.
    own : mapping
        From the places of these joints to their other columns.
    unit : str or None
        Of the other columns; None for that of the joint's own.
    """
    positions, units = list(layout.position), list(layout.units["position"])
    for place, column in own.items():
        positions[place] = column
        units[place] = unit or units[place]
    return replace(columns, position=tuple(positions), position_unit=tuple(units), velocity="none", acceleration="none")


def _require_alike(first: Array, second: Array, what: str) -> None:
    """Refuse a second encoder in another unit, of another sign or behind a gear: no deflection makes a factor of two.

    Smaller factors are errors of an encoder, or springs. Where both do not go together, as while a motor is held, none
    is told.
    """
    ratio = position_ratio(first, second)
    if np.isfinite(ratio) and not 0.5 < ratio < 2.0:
        raise InputError(
            f"{what} goes {ratio:.3g} times as far as its first; correct `position_unit` or `scale` in [elastic], for "
            "which `steelyard doctor` finds the line, or the positions of [log] where they are of a motor shaft. "
            "Both are on the joint side of the gear."
        )


def log_columns(file: RobotFile) -> LogColumns:
    """Return the section [log] of a robot file."""
    return LogColumns.from_dict(file.section("log"), f"{file.path}, [log]").of_joints(file.robot.position_units)


def names_in(log: GivenLog, columns: LogColumns) -> list[str]:
    """Return the names of all the columns of a log; samples have none, and are refused."""
    from steelyard.recording.formats import LogFiles

    if isinstance(log, GivenSamples):
        raise InputError(f"{log}: samples have one position of each joint; give the log itself, with both encoders.")
    return list(LogFiles(log, columns).names)


def require_columns(log: GivenLog, there: Sequence[str], own: Sequence[str], where: str) -> None:
    """Refuse a log that lacks the columns of second encoders."""
    for column in own:
        if column not in there:
            raise InputError(
                f"{log}: has no column {shown(column)}, which {where} names as a second encoder; "
                f"{suggestion(column, there)}. Without it a motion shows no stiffness."
            )


def at_later(t: Array, values: Array, delay: float) -> Array:
    """The values that were logged `delay` later."""
    if delay == 0.0:
        return values
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, values)(np.clip(t + delay, t[0], t[-1])))
