"""Logs as programs export them: one motion, written by hand in each style, and what each column is."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from math import pi

import numpy as np

JOINTS = ("shoulder_joint", "elbow_joint", "wrist_1_joint")
"""In the order of the robot, which is not that of the alphabet."""
ALPHABETICAL = tuple(sorted(JOINTS))
EPOCH = 1_700_000_000
JOINT_STATE = (("position", "position", "rad"), ("velocity", "velocity", "rad/s"), ("effort", "torque", "N·m"))
"""The words of ROS's JointState, what they are, and in which unit."""


@dataclass(frozen=True)
class Motion:
    """A motion of three joints: times in s, positions, velocities and torques in SI units."""

    t: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    torque: np.ndarray

    def of(self, quantity: str, joint: str) -> np.ndarray:
        """Return one column."""
        return getattr(self, quantity)[:, JOINTS.index(joint)]


def motion(rows: int = 400, rate: float = 100.0) -> Motion:
    """Return sums of sines of 20 to 90 degrees, and torques that have nothing to do with them."""
    t = np.arange(rows) / rate
    size, frequency = np.array([1.5, 0.9, 0.4]), np.array([1.0, 1.7, 2.9])
    q = size * np.sin(frequency * t[:, None]) + np.array([0.3, -1.2, 0.8])
    dq = size * frequency * np.cos(frequency * t[:, None])
    torque = np.array([40.0, 15.0, 3.0]) * np.cos(np.array([2.1, 1.3, 0.7]) * t[:, None]) + np.array([5.0, -3.0, 1.0])
    return Motion(t, q, dq, torque)


@dataclass(frozen=True)
class Export:
    """A log and what it holds: `table` has (column, joint, quantity, unit), in the order of time and joints."""

    names: Sequence[str]
    columns: Sequence[Sequence[object]]
    table: Sequence[tuple[str, str, str, str]]
    separator: str = ","
    header: bool = True
    start: float = 0.0
    velocity: bool = True
    guesses: Sequence[str] = field(default_factory=tuple)

    def text(self, order: Sequence[int] | None = None) -> str:
        """Return the text of the file, with its columns in some order."""
        places = range(len(self.columns)) if order is None else order
        target = io.StringIO()
        writer = csv.writer(target, delimiter=self.separator, lineterminator="\n")
        if self.header:
            writer.writerow([self.names[k] for k in places])
        writer.writerows(zip(*(self.columns[k] for k in places), strict=True))
        return target.getvalue()


def _listed(values: np.ndarray) -> list[float]:
    return [float(value) for value in values]


def _by_number(
    forms: Sequence[tuple[str, str, str, float]], time: str, first: int, scale: float = 1.0, time_unit: str = "s"
) -> Callable[[Motion], Export]:
    """Return a writer of columns by number; `forms` has pattern, quantity, unit and how many of it make one of SI."""

    def write(log: Motion) -> Export:
        names, columns, table = [time], [_listed(log.t * scale)], [(time, "", "time", time_unit)]
        quantities = {"position": "q", "velocity": "dq", "torque": "torque"}
        for pattern, quantity, unit, factor in forms:
            for k, joint in enumerate(JOINTS):
                names.append(pattern.format(first + k))
                if quantity in quantities:
                    columns.append(_listed(log.of(quantities[quantity], joint) * factor))
                    table.append((names[-1], joint, quantity, unit))
                else:  # something else, which must be left alone
                    columns.append(_listed(np.cos(k + log.t)))
        return Export(names, columns, table, velocity=any(form[1] == "velocity" for form in forms))

    return write


def _with(write: Callable[[Motion], Export], **changes: object) -> Callable[[Motion], Export]:
    return lambda log: Export(**{**vars(write(log)), **changes})


def joint_state_pairs(log: Motion) -> Export:
    """A flattened JointState: columns of names beside the numbers, in the order of the alphabet."""
    names, columns, table = ["stamp"], [_listed(log.t)], [("stamp", "", "time", "s")]
    for k, joint in enumerate(ALPHABETICAL):
        names.append(f"name[{k}]")
        columns.append([joint] * len(log.t))
    for (word, kind, unit), quantity in zip(JOINT_STATE, ("q", "dq", "torque"), strict=True):
        for k, joint in enumerate(ALPHABETICAL):
            names.append(f"{word}[{k}]")
            columns.append(_listed(log.of(quantity, joint)))
        table += [(f"{word}[{ALPHABETICAL.index(joint)}]", joint, kind, unit) for joint in JOINTS]
    return Export(names, columns, table)


def _plotjuggler(form: str) -> Callable[[Motion], Export]:
    def write(log: Motion) -> Export:
        names, columns = ["__time"], [_listed(EPOCH + log.t)]
        for word, quantity in (("effort", "torque"), ("position", "q"), ("velocity", "dq")):
            for joint in ALPHABETICAL:
                names.append(form.format(joint=joint, word=word))
                columns.append(_listed(log.of(quantity, joint)))
        table = [("__time", "", "time", "s")]
        for word, kind, unit in JOINT_STATE:
            table += [(form.format(joint=joint, word=word), joint, kind, unit) for joint in JOINTS]
        return Export(names, columns, table, start=EPOCH)

    return write


def topic_echo(log: Motion) -> Export:
    """What `ros2 topic echo --csv` prints of a JointState: no names at all."""
    nanoseconds = np.round(log.t * 1e9).astype(np.int64)
    columns: list[Sequence[object]] = [
        (EPOCH + nanoseconds // 1_000_000_000).tolist(),
        (nanoseconds % 1_000_000_000).tolist(),
        [""] * len(log.t),
        *([joint] * len(log.t) for joint in ALPHABETICAL),
    ]
    columns += [_listed(log.of(kind, joint)) for kind in ("q", "dq", "torque") for joint in ALPHABETICAL]
    table = [("header.stamp.sec", "", "time", "s"), ("header.stamp.nanosec", "", "time", "ns")]
    for word, kind, unit in JOINT_STATE:
        table += [(f"{word}[{ALPHABETICAL.index(joint)}]", joint, kind, unit) for joint in JOINTS]
    return Export([], columns, table, header=False, start=EPOCH)


def rostopic_echo(log: Motion) -> Export:
    """What `rostopic echo -p` of ROS 1 prints of a JointState."""
    nanoseconds = (EPOCH * 10**9 + np.round(log.t * 1e9).astype(np.int64)).tolist()
    names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    late = [value + 1_000_000 + 10_000 * (k % 7) for k, value in enumerate(nanoseconds)]
    columns: list[Sequence[object]] = [late, list(range(len(log.t))), nanoseconds, [""] * len(log.t)]
    for k, joint in enumerate(ALPHABETICAL):
        names.append(f"field.name{k}")
        columns.append([joint] * len(log.t))
    for word, quantity in (("position", "q"), ("velocity", "dq"), ("effort", "torque")):
        for k, joint in enumerate(ALPHABETICAL):
            names.append(f"field.{word}{k}")
            columns.append(_listed(log.of(quantity, joint)))
    table = [("field.header.stamp", "", "time", "ns")]
    for word, kind, unit in JOINT_STATE:
        table += [(f"field.{word}{ALPHABETICAL.index(joint)}", joint, kind, unit) for joint in JOINTS]
    return Export(names, columns, table, start=EPOCH)


def dates(log: Motion) -> Export:
    """Times as dates, and joints by their names."""
    start = datetime.fromtimestamp(EPOCH, UTC)
    names = ["time"]
    columns: list[Sequence[object]] = [
        [(start + timedelta(milliseconds=round(1e3 * t))).isoformat(timespec="milliseconds") for t in log.t]
    ]
    table = [("time", "", "time", "s")]
    for word, quantity, kind, unit in (("pos", "q", "position", "rad"), ("torque", "torque", "torque", "N·m")):
        names += [f"{joint}.{word}" for joint in JOINTS]
        columns += [_listed(log.of(quantity, joint)) for joint in JOINTS]
        table += [(f"{joint}.{word}", joint, kind, unit) for joint in JOINTS]
    return Export(names, columns, table, start=EPOCH, velocity=False)


DEGREES = 180.0 / pi
RTDE = (
    ("target_q_{}", "wanted", "", 1.0),
    ("actual_q_{}", "position", "rad", 1.0),
    ("actual_qd_{}", "velocity", "rad/s", 1.0),
    ("actual_current_{}", "current", "", 1.0),
    ("target_moment_{}", "torque", "N·m", 1.0),
)
SPACED = tuple((pattern.replace("_", " "), *rest) for pattern, *rest in RTDE)
TARGET_MOMENT = ("The torque is read from target.moment.0 … target.moment.2: target_moment is what the controller",)

STYLES: dict[str, Callable[[Motion], Export]] = {
    "our own": _by_number(
        (
            ("q{}", "position", "rad", 1.0),
            ("dq{}", "velocity", "rad/s", 1.0),
            ("tau{}", "torque", "N·m", 1.0),
        ),
        "t",
        1,
    ),
    "position_0": _by_number(
        (
            ("position_{}", "position", "rad", 1.0),
            ("velocity_{}", "velocity", "rad/s", 1.0),
            ("effort_{}", "torque", "N·m", 1.0),
        ),
        "time",
        0,
    ),
    "name and position": joint_state_pairs,
    "PlotJuggler": _plotjuggler("/joint_states/{joint}/{word}"),
    "PlotJuggler, brackets": _plotjuggler("/joint_states/{word}[{joint}]"),
    "ros2 topic echo --csv": topic_echo,
    "rostopic echo -p": rostopic_echo,
    "UR RTDE": _with(_by_number(RTDE, "timestamp", 0), guesses=TARGET_MOMENT),
    "UR RTDE, spaces in names": _with(_by_number(SPACED, "timestamp", 0), guesses=TARGET_MOMENT),
    "UR RTDE, separated by spaces": _with(_by_number(RTDE, "timestamp", 0), guesses=TARGET_MOMENT, separator=" "),
    "Franka": _by_number(
        (
            ("q_{}", "position", "rad", 1.0),
            ("q_d_{}", "wanted", "", 1.0),
            ("dq_{}", "velocity", "rad/s", 1.0),
            ("tau_J_{}", "torque", "N·m", 1.0),
            ("tau_J_d_{}", "wanted", "", 1.0),
            ("tau_ext_hat_filtered_{}", "other", "", 1.0),
        ),
        "time",
        0,
    ),
    "KUKA": _with(
        _by_number((("A{}", "position", "deg", DEGREES), ("Torque_A{}", "torque", "N·m", 1.0)), "Time", 1),
        guesses=("The positions A1 … A3 are read in deg: KUKA writes axis positions in degrees",),
        separator=";",
    ),
    "ABB, degrees": _with(
        _by_number((("J{}", "position", "deg", DEGREES), ("T{}", "torque", "N·m", 1.0)), "time_ms", 1, 1e3, "ms"),
        guesses=("The positions J1 … J3 are read in deg, since they reach",),
    ),
    "ABB, radians": _with(
        _by_number((("J{}", "position", "rad", 1.0), ("T{}", "torque", "N·m", 1.0)), "t", 1),
        guesses=("The positions J1 … J3 are read in rad, since they reach",),
    ),
    "units in brackets": _by_number(
        (
            ("Joint {} position [deg]", "position", "deg", DEGREES),
            ("Joint {} velocity [rpm]", "velocity", "rpm", 30.0 / pi),
            ("Joint {} torque [mNm]", "torque", "mN·m", 1e3),
        ),
        "Time [ms]",
        1,
        1e3,
        "ms",
    ),
    "units in brackets, SI": _by_number(
        (
            ("Joint {} position [rad]", "position", "rad", 1.0),
            ("Joint {} velocity [rad/s]", "velocity", "rad/s", 1.0),
            ("Joint {} torque [Nm]", "torque", "N·m", 1.0),
        ),
        "Time [s]",
        1,
    ),
    "dates": dates,
}
