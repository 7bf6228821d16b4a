"""Which columns of a log are what, by the `[log]` section and by the names of the columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import suggestion

from .columns import LogColumns

__all__ = ["LABELS", "Layout", "find_columns", "label_columns"]

Head = Callable[[str], NDArray[Any]]
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
NAMED = ("{name}_{family}", "{family}_{name}", "{name}.{family}", "{name}/{family}", "{family}[{name}]")


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


def find_columns(
    names: Sequence[str],
    joints: int | Sequence[str] | None = None,
    columns: LogColumns | None = None,
    *,
    head: Head | None = None,
    labels: Sequence[str] = (),
    source: str = "the log",
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

    Parameters
    ----------
    names : sequence of str
        Of all columns.
    joints : int or sequence of str, optional
        How many joints the robot has, or their names.
    columns : LogColumns, optional
        What is stated.
    head : callable, optional
        ``head(name)`` returns the first values of a column, numbers or texts, where a name alone does not tell.
    labels : sequence of str
        The joints of numbered columns, in the order of the numbers, where the log names them.
    source : str
        The log, for messages.

    Returns
    -------
    Layout

    Raises
    ------
    InputError
        For a missing column, an ambiguous header or a wrong number of joints.

    Examples
    --------
    >>> layout = find_columns(["time", "q1", "q2", "tau1", "tau2"], joints=2)
    >>> layout.position, layout.torque
    (('q1', 'q2'), ('tau1', 'tau2'))
    """
    columns = LogColumns() if columns is None else columns
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
    candidates = _candidates(kind, names, labels if joints is None or isinstance(joints, int) else joints)
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


def _candidates(kind: str, names: Sequence[str], joints: Sequence[str]) -> list[tuple[str, ...]]:
    """Return all groups of columns that the documented rules find for `kind`."""
    by_lower = {name.strip().lower(): name for name in reversed(names)}
    groups = _numbered(FAMILIES[kind], names)
    if joints:
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
