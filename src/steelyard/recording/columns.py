"""The `[log]` section of robot.toml: which columns of a log are what."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi, prod
from typing import Any

from steelyard.errors import InputError
from steelyard.files import TomlSection

__all__ = ["LogColumns"]

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
MILLIDEGREE = pi / 180e3
POSITION_UNITS = {
    "rad": 1.0,
    "deg": pi / 180.0,
    "rev": 2.0 * pi,
    "mrad": 1e-3,
    "mdeg": MILLIDEGREE,
    "m": 1.0,
    "mm": 1e-3,
}
VELOCITY_UNITS = {
    "rad/s": 1.0,
    "deg/s": pi / 180.0,
    "rev/s": 2.0 * pi,
    "rpm": pi / 30.0,
    "mrad/s": 1e-3,
    "mdeg/s": MILLIDEGREE,
    "m/s": 1.0,
    "mm/s": 1e-3,
}
ACCELERATION_UNITS = {
    "rad/s²": 1.0,
    "deg/s²": pi / 180.0,
    "rev/s²": 2.0 * pi,
    "rpm/s": pi / 30.0,
    "mrad/s²": 1e-3,
    "mdeg/s²": MILLIDEGREE,
    "m/s²": 1.0,
    "mm/s²": 1e-3,
}
PER_SECOND = {
    "rad": "rad/s",
    "deg": "deg/s",
    "rev": "rev/s",
    "mrad": "mrad/s",
    "mdeg": "mdeg/s",
    "m": "m/s",
    "mm": "mm/s",
    "rad/s": "rad/s²",
    "deg/s": "deg/s²",
    "rev/s": "rev/s²",
    "rpm": "rpm/s",
    "mrad/s": "mrad/s²",
    "mdeg/s": "mdeg/s²",
    "m/s": "m/s²",
    "mm/s": "mm/s²",
}
"""The unit of what changes by one unit in a second."""
LENGTHS = ("m", "mm", "m/s", "mm/s")
"""Units of positions and velocities of joints that slide."""
TORQUE_UNITS = {
    "N·m": 1.0,
    "N m": 1.0,
    "Nm": 1.0,
    "N": 1.0,
    "mN·m": 1e-3,
    "mN m": 1e-3,
    "mNm": 1e-3,
    "kN·m": 1e3,
    "kN m": 1e3,
    "kNm": 1e3,
    "N·cm": 1e-2,
    "Ncm": 1e-2,
    "N·mm": 1e-3,
    "Nmm": 1e-3,
    "kN": 1e3,
    "A": 1.0,
    "mA": 1e-3,
}
CURRENT_UNITS = ("A", "mA")
FIND = "find"
"""Stands for a drive gain that is unknown."""
NUMBER = r"\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?"
FRACTION = re.compile(rf"([-+]?)\s*(?:({NUMBER})\s*\*\s*)?({NUMBER}|pi)((?:\s*/\s*(?:{NUMBER}))*)")

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]


@dataclass(frozen=True)
class LogColumns(TomlSection):
    """The meaning and the units of the columns of a log: the `[log]` section of robot.toml.

    Every key may be left out; what is left out is looked for in the header by the rules of `find_columns`.

    Parameters
    ----------
    time
        Name of the time column; two names for whole seconds and what is left of them, such as nanoseconds.
    rate
        Sample rate in Hz, for a log without time column (or whose stamps are too coarse to be used).
    time_unit
        "s", "ms", "us", "ns", "min" or "h".
    position, velocity, acceleration, torque
        List of column names, or a pattern: `{}` stands for 1, 2, … (or 0, 1, …) and `{name}` for the joint's name. The
        word "none" for velocity or acceleration leaves columns that are in the log unread.
    position_unit, velocity_unit, torque_unit
        One unit, or a list with one per column; where some joints turn and others slide, one unit is that of its kind,
        and the other kind has rad or m. Positions: rad, deg, rev, mrad, mdeg, m, mm. Velocities (and accelerations,
        per s more): rad/s, deg/s, rev/s, rpm, mrad/s, mdeg/s, m/s, mm/s; by default that of the positions per s.
        Torques: N·m, mN·m, kN·m, N·cm, N·mm, N, kN; A, mA with `gain`. By default what the names of the columns say,
        otherwise rad and N·m.
    position_matrix, position_offset
        (N, M) and (N,): q = position_matrix @ columns + position_offset, both after the units; the matrix also
        turns velocities and accelerations. Numbers, or strings such as "1/45" and "-pi/2".
    torque_matrix
        (N, M): torque = torque_matrix @ (gain * columns).
    gain
        Drive gains from current to torque, one per torque column. The word "find" in the place of one, or of them all,
        says that it is unknown: the torque is then read in units of the current, for `identify_drive_gains`.
    torque_sign
        +1 or -1, one for all or one per joint.
    header
        The names of all columns of a text file that has no line of names.
    topic
        Topic of a bag that is read, where several hold joint states; a list of those that belong together, each of
        which holds what those before it lack.
    channels
        What else is read, by the names that terms have for it: the name of one column, which holds for all joints, or
        a list of columns or a pattern with one for each joint, as in ``{"temperature": "temp_{}"}``.
    unread
        Columns, or patterns of columns, that are something else, such as references: they are taken for nothing by
        their names.
    missing
        What to do where positions or torques are missing, NaN or infinite: "refuse" the log, or "fill" them by
        interpolation and leave their rows out of the samples.

    Examples
    --------
    >>> LogColumns.from_dict({"position": "q{}", "torque": "i{}", "torque_unit": "A", "gain": [10, 10]}).gain
    (10.0, 10.0)
    """

    section_name = "[log]"

    time: str | tuple[str, ...] | None = None
    rate: float | None = None
    time_unit: str | None = None
    position: str | tuple[str, ...] | None = None
    velocity: str | tuple[str, ...] | None = None
    acceleration: str | tuple[str, ...] | None = None
    torque: str | tuple[str, ...] | None = None
    position_unit: str | tuple[str, ...] | None = None
    velocity_unit: str | tuple[str, ...] | None = None
    torque_unit: str | tuple[str, ...] | None = None
    position_matrix: Matrix | None = None
    position_offset: Vector | None = None
    torque_matrix: Matrix | None = None
    gain: str | tuple[float | str, ...] | None = None
    torque_sign: float | Vector | None = None
    header: tuple[str, ...] | None = None
    topic: str | tuple[str, ...] | None = None
    unread: tuple[str, ...] = ()
    missing: str = "refuse"
    channels: Mapping[str, str | tuple[str, ...]] | None = None

    def _clean(self, where: str) -> None:
        """Check every value and bring it into its stored form."""

        def store(name: str, parse: Callable[[Any, str], Any]) -> None:
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, parse(value, f"{where}, key {name!r},"))

        store("time", _clock)
        store("topic", _topics)
        store("header", _header)
        store("rate", _positive)
        store("time_unit", _one_of(TIME_UNITS))
        for name in ("position", "velocity", "acceleration", "torque"):
            store(name, _names)
        store("position_unit", _one_or_each_of(POSITION_UNITS))
        store("velocity_unit", _one_or_each_of(VELOCITY_UNITS))
        store("torque_unit", _one_or_each_of(TORQUE_UNITS))
        store("position_matrix", _matrix)
        store("torque_matrix", _matrix)
        store("position_offset", _vector)
        store("gain", _gains)
        store("torque_sign", _signs)
        store("channels", _channels)
        store("unread", _unread)
        if self.missing not in ("refuse", "fill"):
            raise InputError(f"{where}, key 'missing', is {self.missing!r}; it must be 'refuse' or 'fill'.")
        units = (self.torque_unit,) if isinstance(self.torque_unit, str) else self.torque_unit
        if self.gain is None and any(unit in CURRENT_UNITS for unit in units or ()):
            raise InputError(
                f"{where} gives torque_unit in amperes but no gain; add `gain`, N·m per A, one per column."
            )
        if self.finds_gains and self.torque_matrix is not None:
            raise InputError(
                f"{where} gives a torque_matrix and asks for drive gains; each gain must belong to one joint, so find "
                "them on joints that are not coupled, or state them."
            )
        if self.rate is not None and self.time is None and self.time_unit is not None:
            raise InputError(f"{where} gives time_unit and rate but no time; time_unit belongs to a time column.")

    def of_joints(self, usual: Sequence[str]) -> LogColumns:
        """Return the same for joints of which some turn and others slide: one unit for all is that of its kind.

        Degrees say nothing of a joint that slides, nor millimetres of one that turns; such joints keep their SI unit.

        Parameters
        ----------
        usual : sequence of str
            The SI units of the positions of all joints, ``"rad"`` or ``"m"``, as `Robot.position_units` tells them.

        Examples
        --------
        >>> LogColumns(position_unit="deg").of_joints(["rad", "m"]).position_unit
        ('deg', 'm')
        """
        if self.position_matrix is not None or len(set(usual)) < 2:
            return self

        def of_each(stated: str | tuple[str, ...] | None, own: Sequence[str]) -> str | tuple[str, ...] | None:
            if not isinstance(stated, str):
                return stated
            return tuple(stated if (one in LENGTHS) == (stated in LENGTHS) else one for one in own)

        return replace(
            self,
            position_unit=of_each(self.position_unit, usual),
            velocity_unit=of_each(self.velocity_unit, [PER_SECOND[one] for one in usual]),
        )

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that are read; none where that is left open."""
        return (self.topic,) if isinstance(self.topic, str) else self.topic or ()

    @property
    def finds_gains(self) -> bool:
        """Whether any drive gain is to be found."""
        return self.gain is not None and FIND in self.gain

    def gains_to_find(self, count: int) -> tuple[bool, ...]:
        """Return which of so many joints have a drive gain that is to be found."""
        if self.gain is None or isinstance(self.gain, str):
            return (self.gain is not None,) * count
        return tuple(one == FIND for one in self.gain)


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str) or not value:
        raise InputError(f"{where} is {value!r}; it must be a column name in quotes.")
    return value


def number(value: Any, where: str) -> float:
    """Return a number that is given as one, or as a string like "1/45", "-pi/2" or "2*pi/4096/101"."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        result = float(value)
        if result - result == 0.0:
            return result
    match = FRACTION.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        raise InputError(
            f'{where} holds {value!r}; it must be a finite number, or a string such as "1/45", "-pi/2" or '
            '"2*pi/4096/101".'
        )
    sign, factor, head, divisors = match.groups()
    denominator = prod(map(float, divisors.split("/")[1:]))
    if denominator == 0.0:
        raise InputError(f"{where} holds {value!r}, a division by zero.")
    top = (pi if head == "pi" else float(head)) * (float(factor) if factor else 1.0)
    return (-top if sign == "-" else top) / denominator


def _positive(value: Any, where: str) -> float:
    result = number(value, where)
    if result <= 0.0:
        raise InputError(f"{where} is {value!r}; it must be positive.")
    return result


def _names(value: Any, where: str) -> str | tuple[str, ...]:
    if isinstance(value, str):
        if value != "none" and "{" not in value:
            return (_text(value, where),)
        return value
    if not isinstance(value, Sequence) or not value or not all(isinstance(item, str) for item in value):
        raise InputError(f'{where} is {value!r}; it must be a list of column names or a pattern such as "q{{}}".')
    return tuple(value)


def _channels(value: Any, where: str) -> dict[str, str | tuple[str, ...]]:
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise InputError(f'{where} is {value!r}; it must be a table such as {{ temperature = "temp_{{}}" }}.')
    return {name: _names(given, f"{where} {name!r},") for name, given in value.items()}


def _unread(value: Any, where: str) -> tuple[str, ...]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, Sequence) or not all(isinstance(item, str) for item in names):
        raise InputError(f'{where} is {value!r}; it must be a list of column names or patterns, such as ["q_ref{{}}"].')
    return tuple(names)


def _clock(value: Any, where: str) -> str | tuple[str, ...]:
    if isinstance(value, str) or not isinstance(value, Sequence) or len(value) != 2:
        return _text(value, where)
    return tuple(_text(name, where) for name in value)


def _topics(value: Any, where: str) -> str | tuple[str, ...]:
    if isinstance(value, str) and value:
        return value
    listed = isinstance(value, (list, tuple)) and bool(value)
    if not listed or not all(isinstance(item, str) and item for item in value) or len(set(value)) != len(value):
        raise InputError(
            f"{where} is {value!r}; it must be the name of a topic in quotes, or a list of several, each once."
        )
    return tuple(value) if len(value) > 1 else str(value[0])


def _header(value: Any, where: str) -> tuple[str, ...]:
    texts = isinstance(value, Sequence) and not isinstance(value, str) and all(isinstance(item, str) for item in value)
    if not texts or not value or len(set(value)) != len(value):
        raise InputError(f"{where} is {value!r}; it must be a list of the names of all columns, each its own.")
    return tuple(value)


def _one_of(options: Mapping[str, float]) -> Callable[[Any, str], str]:
    def parse(value: Any, where: str) -> str:
        if not isinstance(value, str) or value not in options:
            raise InputError(f"{where} is {value!r}; it must be one of {', '.join(options)}.")
        return value

    return parse


def _one_or_each_of(options: Mapping[str, float]) -> Callable[[Any, str], str | tuple[str, ...]]:
    one = _one_of(options)

    def parse(value: Any, where: str) -> str | tuple[str, ...]:
        if isinstance(value, (list, tuple)):
            return tuple(one(item, where) for item in value)
        return one(value, where)

    return parse


def _vector(value: Any, where: str) -> Vector:
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        raise InputError(f"{where} is {value!r}; it must be a list of numbers.")
    result = tuple(number(_scalar(item), where) for item in value)
    if not result:
        raise InputError(f"{where} is empty; it must be a list of numbers.")
    return result


def _gains(value: Any, where: str) -> str | tuple[float | str, ...]:
    if isinstance(value, str) and value == FIND:
        return FIND
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        raise InputError(f'{where} is {value!r}; it must be a list of numbers, or "{FIND}".')
    found = tuple(FIND if item == FIND else number(_scalar(item), where) for item in value)
    if not found:
        raise InputError(f"{where} is empty; it must be a list of numbers.")
    return found


def _matrix(value: Any, where: str) -> Matrix:
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        raise InputError(f"{where} is {value!r}; it must be a list of rows.")
    rows = tuple(_vector(row, where) for row in value)
    if not rows or len({len(row) for row in rows}) != 1:
        raise InputError(f"{where} has rows of lengths {[len(row) for row in rows]}; it must be a matrix.")
    return rows


def _signs(value: Any, where: str) -> float | Vector:
    signs = _vector(value, where) if hasattr(value, "__iter__") and not isinstance(value, str) else number(value, where)
    if any(sign not in (1.0, -1.0) for sign in (signs if isinstance(signs, tuple) else (signs,))):
        raise InputError(f"{where} is {value!r}; each sign must be 1 or -1.")
    return signs


def _scalar(item: Any) -> Any:
    """Turn NumPy scalars, which arrays given from Python hold, into plain numbers."""
    return item.item() if hasattr(item, "item") else item
