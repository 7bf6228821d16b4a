"""Which columns of a log are what: the `[log]` section of robot.toml, and the rules that read the header of a log."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

from steelyard.errors import InputError
from steelyard.files import TomlSection, suggestion

__all__ = ["LABELS", "Layout", "LogColumns", "label_columns", "resolve"]

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
POSITION_UNITS = {"rad": 1.0, "deg": pi / 180.0, "m": 1.0, "mm": 1e-3}
VELOCITY_UNITS = {"rad/s": 1.0, "deg/s": pi / 180.0, "rpm": pi / 30.0, "m/s": 1.0, "mm/s": 1e-3}
TORQUE_UNITS = {
    "N·m": 1.0,
    "N m": 1.0,
    "Nm": 1.0,
    "N": 1.0,
    "mN·m": 1e-3,
    "mN m": 1e-3,
    "mNm": 1e-3,
    "A": 1.0,
    "mA": 1e-3,
}
CURRENT_UNITS = ("A", "mA")
FIND = "find"
"""Stands for a drive gain that is unknown."""
NUMBER = r"\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?"
FRACTION = re.compile(rf"([-+]?)\s*(?:({NUMBER})\s*\*\s*)?({NUMBER}|pi)\s*(?:/\s*({NUMBER}))?")

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]
LONGEST_NAME = 60  # that a message shows of a column
TIME_NAMES = {
    **dict.fromkeys(("t", "time", "timestamp", "time_s", "t_s"), "s"),
    **dict.fromkeys(("time_ms", "t_ms", "timestamp_ms"), "ms"),
    **dict.fromkeys(("time_us", "t_us", "timestamp_us"), "us"),
    **dict.fromkeys(("time_ns", "t_ns", "timestamp_ns"), "ns"),
}
FAMILIES = {
    "position": ("q", "pos", "position"),
    "velocity": ("dq", "qd", "qdot", "vel", "velocity"),
    "acceleration": ("ddq", "qdd", "qddot", "acc", "acceleration"),
    "torque": ("tau", "torque", "effort"),
}
NUMBERED = ("{family}{number}", "{family}_{number}", "{family}[{number}]")
LABELS = ("name", "names", "joint_name", "joint_names")
"""Words for columns whose text names the joint of each number, as in ROS's JointState."""
NAMED = ("{name}_{family}", "{family}_{name}", "{name}.{family}", "{name}/{family}")


@dataclass(frozen=True)
class LogColumns(TomlSection):
    """Which columns of a log are what, in which units: the `[log]` section of robot.toml.

    Every key may be left out; what is left out is looked for in the header by the rules of `resolve`.

    Parameters
    ----------
    time
        Name of the time column.
    rate
        Sample rate in Hz, for a log without time column (or whose stamps are too coarse to be used).
    time_unit
        "s", "ms", "us" or "ns".
    position, velocity, acceleration, torque
        List of column names, or a pattern: `{}` stands for 1, 2, … and `{name}` for the joint's name. The word "none"
        for velocity or acceleration leaves columns that are in the log unread.
    position_unit, velocity_unit, torque_unit
        One unit, or a list with one per column. Positions: rad, deg, m, mm. Velocities (and accelerations, per s more):
        rad/s, deg/s, rpm, m/s, mm/s; by default that of the positions per s. Torques: N·m, mN·m, N; A, mA with `gain`.
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
        Topic of a bag that is read, where several hold joint states.
    missing
        What to do where positions or torques are missing, NaN or infinite: "refuse" the log, or "fill" them by
        interpolation and leave their rows out of the samples.

    Examples
    --------
    >>> LogColumns.from_dict({"position": "q{}", "torque": "i{}", "torque_unit": "A", "gain": [10, 10]}).gain
    (10.0, 10.0)
    """

    section_name = "[log]"

    time: str | None = None
    rate: float | None = None
    time_unit: str | None = None
    position: str | tuple[str, ...] | None = None
    velocity: str | tuple[str, ...] | None = None
    acceleration: str | tuple[str, ...] | None = None
    torque: str | tuple[str, ...] | None = None
    position_unit: str | tuple[str, ...] = "rad"
    velocity_unit: str | tuple[str, ...] | None = None
    torque_unit: str | tuple[str, ...] = "N·m"
    position_matrix: Matrix | None = None
    position_offset: Vector | None = None
    torque_matrix: Matrix | None = None
    gain: str | tuple[float | str, ...] | None = None
    torque_sign: float | Vector | None = None
    header: tuple[str, ...] | None = None
    topic: str | None = None
    missing: str = "refuse"

    def _clean(self, where: str) -> None:
        """Check every value and bring it into its stored form."""

        def store(name: str, parse: Callable[[Any, str], Any]) -> None:
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, parse(value, f"{where}, key {name!r},"))

        store("time", _text)
        store("topic", _text)
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
        if self.missing not in ("refuse", "fill"):
            raise InputError(f"{where}, key 'missing', is {self.missing!r}; it must be 'refuse' or 'fill'.")
        units = (self.torque_unit,) if isinstance(self.torque_unit, str) else self.torque_unit
        if self.gain is None and any(unit in CURRENT_UNITS for unit in units):
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
    """Return a number that is given as one, or as a string like "1/45", "-pi/2" or "3*pi/4"."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        result = float(value)
        if result - result == 0.0:
            return result
    match = FRACTION.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        raise InputError(f'{where} holds {value!r}; it must be a finite number, or a string such as "1/45" or "-pi/2".')
    sign, factor, head, divisor = match.groups()
    denominator = float(divisor) if divisor else 1.0
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
    if value == FIND:
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


@dataclass(frozen=True)
class Layout:
    """The columns of a log by what they hold, in the order of the joints (or of the motors, before a matrix)."""

    time: str | None
    time_unit: str
    position: tuple[str, ...]
    velocity: tuple[str, ...] | None
    acceleration: tuple[str, ...] | None
    torque: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns to be read, each once."""
        head = () if self.time is None else (self.time,)
        groups = (head, self.position, self.velocity or (), self.acceleration or (), self.torque)
        return tuple(dict.fromkeys(name for group in groups for name in group))


def label_columns(names: Sequence[str]) -> tuple[str, ...]:
    """Return the columns whose text may name the joints of numbered columns, as `name[0]`, in the order of numbers.

    Examples
    --------
    >>> label_columns(["time", "name[0]", "name[1]", "position[0]", "position[1]"])
    ('name[0]', 'name[1]')
    """
    return next(iter(_numbered(LABELS, names)), ())


def resolve(
    names: Sequence[str],
    columns: LogColumns,
    joints: int | Sequence[str] | None,
    source: str,
    labels: Sequence[str] = (),
) -> Layout:
    """Find the columns of a log.

    What `columns` states is taken; what it leaves out is found in the header `names`, whatever the case, by these
    rules.
    Time: a column t, time, timestamp (seconds), or with _ms, _us, _ns behind it. The others: a word, then the joint's
    number (`q1`, `q_1` or `q[1]`, from 1, or from 0 where the header has a 0), or a joint's name and a word
    (`elbow_pos`, `pos_elbow`, `elbow.pos`, `elbow/pos`; a joint's bare name is its position). Where the log says whose
    each number is (`labels`), joints are found by that. Words: q, pos, position;
    dq, qd, qdot, vel, velocity; ddq, qdd, qddot, acc, acceleration; tau, torque, effort. Where two groups of columns
    fit, or none, nothing is guessed.

    Raises
    ------
    InputError
        For a missing column, an ambiguous header or a wrong number of joints.
    """
    found = {kind: _find(kind, names, columns, joints, source, labels) for kind in FAMILIES}
    position, torque = found["position"], found["torque"]
    for kind, group in (("position", position), ("torque", torque)):
        if group is None:
            raise InputError(
                f"{source} has no columns that look like {kind}s; it has {_listing(names)}; "
                f'say which they are with `{kind} = "…{{}}"` or a list of names in [log].'
            )
    assert position is not None
    assert torque is not None
    _check_counts(found, columns, joints, source)
    time, unit = _find_time(names, columns, source)
    return Layout(time, unit, position, found["velocity"], found["acceleration"], torque)


def _find_time(names: Sequence[str], columns: LogColumns, source: str) -> tuple[str | None, str]:
    if columns.time is not None:
        _require(columns.time, names, "time", source)
        return columns.time, columns.time_unit or TIME_NAMES.get(columns.time.lower(), "s")
    if columns.rate is not None:
        return None, "s"
    matches = [name for name in names if name.strip().lower() in TIME_NAMES]
    if len(matches) > 1:
        raise InputError(f"{source} has several columns of time, {_listing(matches)}; choose with `time` in [log].")
    if not matches:
        raise InputError(
            f"{source} has no column of time; it has {_listing(names)}; "
            "name it with `time` in [log], or give the sample rate in Hz with `rate`."
        )
    return matches[0], columns.time_unit or TIME_NAMES[matches[0].strip().lower()]


def _find(
    kind: str,
    names: Sequence[str],
    columns: LogColumns,
    joints: int | Sequence[str] | None,
    source: str,
    labels: Sequence[str],
) -> tuple[str, ...] | None:
    stated: str | tuple[str, ...] | None = getattr(columns, kind)
    if stated == "none":
        if kind in ("position", "torque"):
            raise InputError(f'{source} cannot be used with `{kind} = "none"`; {kind}s are needed.')
        return None
    if isinstance(stated, tuple):
        for name in stated:
            _require(name, names, kind, source)
        if len(set(stated)) != len(stated):
            raise InputError(f"{source}: `{kind}` in [log] names a column twice; each joint needs its own.")
        return stated
    if isinstance(stated, str):
        return _expand(kind, stated, names, columns, joints, source)
    candidates = _candidates(kind, names, joints)
    if len(candidates) > 1:
        groups = " or ".join(f"{group[0]} … {group[-1]}" for group in candidates)
        raise InputError(f"{source} has several groups of columns for {kind}: {groups}; choose with `{kind}` in [log].")
    if not candidates:
        return None
    (group,) = candidates
    if not labels or joints is None or isinstance(joints, int) or group not in _numbered(FAMILIES[kind], names):
        return group
    return _labelled(kind, group, labels, joints, source)


def _labelled(
    kind: str, group: tuple[str, ...], labels: Sequence[str], joints: Sequence[str], source: str
) -> tuple[str, ...]:
    """Choose the numbered columns of the joints by the names that the log gives them."""
    absent = [joint for joint in joints if joint not in labels]
    if absent or len(labels) != len(group) or len(set(labels)) != len(labels):
        what = f"no {absent[0]!r}" if absent else f"{len(group)} columns of {kind} for {len(labels)} names"
        raise InputError(
            f"{source} names its joints {_listing(labels)}, and has {what}; name the columns of {', '.join(joints)} "
            f"with a list in `{kind}` of [log]."
        )
    return tuple(group[labels.index(joint)] for joint in joints)


def _expand(
    kind: str, pattern: str, names: Sequence[str], columns: LogColumns, joints: int | Sequence[str] | None, source: str
) -> tuple[str, ...]:
    """Return the columns that a pattern stands for, by the joints' names or numbers, or as far as the header goes."""
    if "{name}" in pattern:
        if joints is None or isinstance(joints, int):
            raise InputError(
                f"{source}: the pattern {pattern!r} needs the names of the joints; use {{}} for their numbers."
            )
        wanted = tuple(pattern.replace("{name}", name) for name in joints)
    elif pattern.count("{}") != 1:
        raise InputError(f"{source}: the pattern {pattern!r} for {kind} must hold {{}} or {{name}} once.")
    else:
        matrix = columns.torque_matrix if kind == "torque" else columns.position_matrix
        count = len(matrix[0]) if matrix is not None else _count(joints)
        if count is None:
            count = 0
            while pattern.replace("{}", str(count + 1)) in names:
                count += 1
            count = max(count, 1)
        wanted = tuple(pattern.replace("{}", str(number + 1)) for number in range(count))
    for name in wanted:
        _require(name, names, kind, source)
    return wanted


def _candidates(kind: str, names: Sequence[str], joints: int | Sequence[str] | None) -> list[tuple[str, ...]]:
    """Return all groups of columns that the documented rules find for `kind`."""
    by_lower = {name.strip().lower(): name for name in reversed(names)}
    groups = _numbered(FAMILIES[kind], names)
    if joints is not None and not isinstance(joints, int):
        forms = [form.replace("{family}", family) for form in NAMED for family in FAMILIES[kind]]
        if kind == "position":
            forms.append("{name}")
        for form in forms:
            keys = [form.format(name=name).lower() for name in joints]
            if all(key in by_lower for key in keys):
                groups.append(tuple(by_lower[key] for key in keys))
    return list(dict.fromkeys(groups))


def _numbered(families: Sequence[str], names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the groups of columns named by a word and numbers in a row, in their order."""
    by_lower = {name.strip().lower(): name for name in reversed(names)}
    groups: list[tuple[str, ...]] = []
    for family in families:
        for form in NUMBERED:
            first = 0 if form.format(family=family, number=0) in by_lower else 1
            group: list[str] = []
            while (key := form.format(family=family, number=first + len(group))) in by_lower:
                group.append(by_lower[key])
            if group:
                groups.append(tuple(group))
    return groups


def _check_counts(
    found: dict[str, tuple[str, ...] | None], columns: LogColumns, joints: int | Sequence[str] | None, source: str
) -> None:
    position = found["position"]
    assert position is not None
    count = len(position) if columns.position_matrix is None else len(columns.position_matrix)
    expected = _count(joints)
    if expected is not None and count != expected:
        how = f"({_listing(position)})" if columns.position_matrix is None else "(rows of position_matrix)"
        raise InputError(
            f"{source} has positions of {count} joints {how} but the robot has {expected}; "
            "name the right columns with `position` in [log] or use the robot that was logged."
        )
    for kind, group in found.items():
        if group is None:
            continue
        matrix = columns.torque_matrix if kind == "torque" else columns.position_matrix
        need = count if matrix is None else len(matrix[0])
        if len(group) != need:
            why = "joints" if matrix is None else "columns in the matrix"
            raise InputError(
                f"{source} has {len(group)} columns of {kind} ({_listing(group)}) for {need} {why}; "
                f"name one for each with `{kind}` in [log]."
            )
        if matrix is not None and len(matrix) != count:
            raise InputError(f"torque_matrix in [log] has {len(matrix)} rows but there are {count} joints.")


def _require(name: str, names: Sequence[str], kind: str, source: str) -> None:
    if name not in names:
        raise InputError(f"{source} has no column {name!r} (wanted for {kind}); {suggestion(name, names)}")


def _count(joints: int | Sequence[str] | None) -> int | None:
    return joints if joints is None or isinstance(joints, int) else len(joints)


def _listing(names: Sequence[str], most: int = 24) -> str:
    short = ", ".join(name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}…" for name in names[:most])
    return short if len(names) <= most else f"{short}, … ({len(names)} in all)"
