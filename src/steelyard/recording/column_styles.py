"""A table of the names that programs give to the columns of a log; each entry is one way of naming one quantity.

In a pattern, ``{word}`` stands for one of the words of the entry, ``{name}`` for the name of a joint and ``{number}``
for its number, which counts from 0 where the log has a 0, and from 1 otherwise. Capitals do not matter, nor whether
words are separated by blanks, by ``_`` or by ``-``. A topic may stand in front, up to a ``/`` or a ``.``, and a unit
behind, in brackets (``[deg]``), after ``_`` (``_deg``), ``/`` or ``in`` (``in deg``), or before the joint
(``q_deg_1``).
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache

from .columns import ACCELERATION_UNITS, CURRENT_UNITS, POSITION_UNITS, TIME_UNITS, TORQUE_UNITS, VELOCITY_UNITS

__all__ = [
    "BY_SIZE",
    "COMMANDED",
    "FURTHER_TIME_WORDS",
    "LABELS",
    "SECONDS_AND_REST",
    "STYLES",
    "TIME_WORDS",
    "ColumnStyle",
    "normalised",
    "styles_of",
    "time_unit_behind",
    "unit_left_open",
    "units_said",
]

NAME, NUMBER = "\N{SYMBOL FOR SUBSTITUTE}", "\N{SYMBOL FOR NULL}"
"""What stands for a joint's name and for its number in a shape, which is a normalised name without them."""

BY_SIZE = "deg or rad"
"""The unit of positions that are degrees where they are too large for radians."""


@dataclass(frozen=True)
class ColumnStyle:
    """One way of naming the columns of one quantity.

    Parameters
    ----------
    writer
        Who names columns so; it stands in the table of what was understood.
    quantity
        "position", "velocity", "acceleration", "torque", "current", or "label" for texts that name joints.
    patterns
        Such as "{word}_{number}".
    words
        What {word} stands for; without digits.
    unit
        Of columns that do not say theirs; None is rad, the unit of the positions per s, or N·m.
    needs_unit
        Whether only columns are meant that say their unit.
    takes_topic
        Whether a topic may stand in front.
    last_resort
        Whether these columns are taken only where nothing else is this quantity.
    note
        A sentence on what was assumed, where something was.

    Examples
    --------
    >>> ColumnStyle("my logger", "torque", ("load_{number}",), unit="mN·m").patterns
    ('load_{number}',)
    """

    writer: str
    quantity: str
    patterns: tuple[str, ...]
    words: tuple[str, ...] = ()
    unit: str | None = None
    needs_unit: bool = False
    takes_topic: bool = True
    last_resort: bool = False
    note: str = ""


def _measured(*words: str) -> tuple[str, ...]:
    """Return words, and the same where they say that the quantity was measured."""
    ways = ("{}", "actual_{}", "measured_{}", "{}_actual", "{}_measured", "{}_act", "{}_meas", "{}_msr", "joint_{}")
    return tuple(way.format(word) for way in ways for word in words)


POSITION = _measured("q", "pos", "position", "positions", "angle", "angles", "theta", "θ", "winkel")
VELOCITY = _measured("dq", "qd", "qdot", "q_dot", "vel", "velocity", "velocities", "speed", "speeds", "geschwindigkeit")
ACCELERATION = _measured(
    "ddq", "qdd", "qddot", "q_ddot", "acc", "accel", "acceleration", "accelerations", "beschleunigung"
)
TORQUE = _measured("tau", "τ", "torque", "torques", "effort", "efforts", "moment", "moments", "drehmoment")
FORCE = _measured("force", "forces")
CURRENT = _measured("i", "current", "currents", "motor_current", "motor_currents", "strom")

NAMED = (
    *("{name}_{word}", "{word}_{name}", "{name}.{word}", "{word}.{name}", "{name}/{word}", "{word}/{name}"),
    *("{word}[{name}]", "{word}_[{name}]", "{word}({name})", "{word}_({name})"),
    *("{name}[{word}]", "{name}_[{word}]", "{name}({word})", "{name}_({word})"),
)
JOINT_NUMBERS = (
    *("joint{number}", "joint_{number}", "j{number}", "axis{number}", "axis_{number}", "a{number}"),
    "joint({number})",  # arrays of structs in MATLAB
)
NUMBERED = (
    *("{word}{number}", "{word}_{number}", "{word}.{number}", "{word}/{number}"),
    *("{word}[{number}]", "{word}_[{number}]", "{word}({number})", "{word}_({number})", "{number}_{word}"),
    *(pattern.replace("{name}", joint) for joint in JOINT_NUMBERS for pattern in NAMED),
)
LABELS = ("name", "names", "joint_name", "joint_names")
"""Words for columns whose text names the joint of each number, as in ROS's JointState."""

_TARGET_MOMENT = (
    "target_moment is what the controller's own model computes for the commanded motion and is not measured, so that "
    "the answer describes that model; measured currents, actual_current, are used instead where the log has them "
    "and the drive gains are stated, N·m per A of each joint: `gain = [...]` in [log]"
)
_DEGREES = 'KUKA writes axis positions in degrees; state `position_unit = "rad"` in [log] if these are not'

STYLES: tuple[ColumnStyle, ...] = (
    ColumnStyle("UR RTDE", "position", ("actual_q_{number}", "actual_q{number}")),
    ColumnStyle("UR RTDE", "velocity", ("actual_qd_{number}", "actual_qd{number}")),
    ColumnStyle("UR RTDE", "current", ("actual_current_{number}", "actual_current{number}"), unit="A"),
    ColumnStyle("UR RTDE", "torque", ("actual_current_as_torque_{number}", "actual_current_as_torque{number}")),
    ColumnStyle(
        "UR RTDE",
        "torque",
        ("target_moment_{number}", "target_moment{number}"),
        last_resort=True,
        note=_TARGET_MOMENT,
    ),
    ColumnStyle(
        "LeRobot",
        "position",
        (
            "observation.state[{name}]",
            "observation.state_{number}",
            "observation.state[{number}]",
            "observation.state{number}",
        ),
    ),
    *(
        ColumnStyle("MuJoCo", quantity, ("{word}{number}", "{word}_{number}", "{word}[{number}]", *NAMED), (word,))
        for quantity, word in (
            ("position", "qpos"),
            ("velocity", "qvel"),
            ("acceleration", "qacc"),
            ("torque", "qfrc_actuator"),
        )
    ),
    ColumnStyle("Franka", "torque", ("tau_j_{number}", "tau_j{number}", "tau_j[{number}]")),
    ColumnStyle("KUKA", "position", ("a{number}",), unit="deg", takes_topic=False, last_resort=True, note=_DEGREES),
    ColumnStyle(
        "KUKA",
        "position",
        (
            *("$axis_act[{number}]", "$axis_act.a{number}", "axis_act_a{number}", "axisact.a{number}"),
            *("$axis_act_meas[{number}]", "$axis_act_meas.a{number}", "aipos.a{number}"),
        ),
        unit="deg",
        note=_DEGREES,
    ),
    ColumnStyle(
        "KUKA", "torque", ("$torque_axis_act[{number}]", "torque_axis_act_{number}", "torque_axis_act_a{number}")
    ),
    ColumnStyle("ABB", "position", ("j{number}",), unit=BY_SIZE, takes_topic=False, last_resort=True),
    ColumnStyle("ABB", "torque", ("t{number}",), takes_topic=False, last_resort=True),
    *(
        ColumnStyle("", quantity, ("{name}", *JOINT_NUMBERS), needs_unit=True, takes_topic=False)
        for quantity in ("position", "velocity", "acceleration", "torque", "current")
    ),
    ColumnStyle("", "position", ("{name}",), takes_topic=False),
    ColumnStyle("", "position", ("joint{number}", "joint_{number}"), takes_topic=False, last_resort=True),
    *(
        ColumnStyle("", quantity, (*NAMED, *NUMBERED, "{word}"), words, unit="A" if quantity == "current" else None)
        for quantity, words in (
            ("position", POSITION),
            ("velocity", VELOCITY),
            ("acceleration", ACCELERATION),
            ("torque", TORQUE),
            ("current", CURRENT),
        )
    ),
    # Of joints that slide; `force_x` is as a rule that of a sensor at the tool.
    ColumnStyle("", "torque", tuple(pattern for pattern in NAMED if pattern.startswith("{name}")), FORCE),
    ColumnStyle("", "label", ("{word}{number}", "{word}_{number}", "{word}[{number}]", "{word}.{number}"), LABELS),
)
"""The ways of naming that are known. Of two that fit the same columns the earlier one counts."""

COMMANDED = frozenset(
    [
        "desired",
        "des",
        "reference",
        "ref",
        "target",
        "command",
        "commands",
        "commanded",
        "cmd",
        "setpoint",
        "goal",
        "error",
        "errors",
    ]
)
"""Words in a topic that say that its columns were wanted, not measured."""

TIME_WORDS = ("t", "time", "timestamp", "time_stamp", "stamp", "%time", "zeit")
"""Words for the times of the rows; ``header/stamp`` is the word ``stamp`` in a topic."""
FURTHER_TIME_WORDS = (
    *("elapsed", "elapsed_time", "seconds", "secs", "rosbagtimestamp", "log_time", "epoch"),
    *("date", "datetime", "date_time"),
)
"""Words for times that are taken where there is none of the above; often they are coarser."""
SECONDS_AND_REST: Mapping[tuple[str, str], str] = {
    **dict.fromkeys((("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanoseconds")), "ns"),
    **dict.fromkeys((("sec", "nanoseconds"), ("secs", "nanosecs"), ("sec", "nanosecs")), "ns"),
    **dict.fromkeys((("sec", "usec"), ("secs", "usecs"), ("seconds", "microseconds")), "us"),
}
"""Ends of the names of two columns that make one time: whole seconds, and what is left in the given unit."""

_UNIT_SPELLINGS: Mapping[str, str] = {
    **{unit.casefold(): unit for units in (POSITION_UNITS, VELOCITY_UNITS, TIME_UNITS) for unit in units},
    **dict.fromkeys(("n·m", "nm", "n m", "n*m", "n.m", "n-m", "newton meter", "newton metre"), "N·m"),
    **dict.fromkeys(("mn·m", "mnm", "mn m", "mn*m", "mn.m", "mn-m"), "mN·m"),
    **dict.fromkeys(("kn·m", "knm", "kn m", "kn*m", "kn.m", "kn-m"), "kN·m"),
    **dict.fromkeys(("n·cm", "ncm", "n cm", "n*cm", "n.cm"), "N·cm"),
    **dict.fromkeys(("n·mm", "nmm", "n mm", "n*mm", "n.mm"), "N·mm"),
    "kn": "kN",
    **dict.fromkeys(("n", "newton"), "N"),
    **dict.fromkeys(("a", "amp", "amps", "ampere", "amperes"), "A"),
    "ma": "mA",
    **dict.fromkeys(("radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("°", "deg.", "degs", "degree", "degrees"), "deg"),
    **dict.fromkeys(("millirad", "milliradian", "milliradians"), "mrad"),
    **dict.fromkeys(("m°", "millideg", "millidegree", "millidegrees"), "mdeg"),
    **dict.fromkeys(("turn", "turns", "revs", "revolution", "revolutions"), "rev"),
    **dict.fromkeys(("rev/sec", "revs/s", "turn/s", "turns/s", "rev_s", "turns_s", "u/s", "rps"), "rev/s"),
    **dict.fromkeys(("rev/s^2", "rev/s2", "turn/s²", "turn/s^2", "turns/s^2"), "rev/s²"),
    **dict.fromkeys(("rad/sec", "rad s^-1", "rad*s^-1", "rad·s^-1", "rad_s", "radians/s", "rad s-1"), "rad/s"),
    **dict.fromkeys(("°/s", "deg/sec", "deg*s^-1", "deg_s", "degrees/s", "deg s-1", "dps"), "deg/s"),
    **dict.fromkeys(("mrad/sec", "mrad_s", "milliradians/s"), "mrad/s"),
    **dict.fromkeys(("mdeg/sec", "mdeg_s", "m°/s", "millidegrees/s"), "mdeg/s"),
    **dict.fromkeys(("1/min", "min^-1", "min-1", "rev/min", "u/min", "r/min"), "rpm"),
    **dict.fromkeys(("rad/s^2", "rad/s²", "rad/s2", "rad/s/s"), "rad/s²"),
    **dict.fromkeys(("deg/s^2", "deg/s²", "deg/s2", "°/s²", "°/s^2"), "deg/s²"),
    **dict.fromkeys(("mrad/s^2", "mrad/s²", "mrad/s2"), "mrad/s²"),
    **dict.fromkeys(("mdeg/s^2", "mdeg/s²", "mdeg/s2"), "mdeg/s²"),
    **dict.fromkeys(("m/s^2", "m/s²", "m/s2"), "m/s²"),
    **dict.fromkeys(("mm/s^2", "mm/s²", "mm/s2"), "mm/s²"),
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "milliseconds"), "ms"),
    **dict.fromkeys(("µs", "μs", "usec", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nanosec", "nanoseconds"), "ns"),
    **dict.fromkeys(("minute", "minutes"), "min"),
    **dict.fromkeys(("hour", "hours"), "h"),
}

_OWN_WORDS = (
    *("rad_s", "deg_s", "mrad_s", "mdeg_s", "rev_s", "turns_s", "rpm", "dps", "rad", "deg", "degree", "degrees"),
    *("mrad", "millirad", "mdeg", "°", "nm", "mnm", "knm"),
)
"""Units that are no part of a name, wherever they stand in it between ``_``."""
_UNIT_SUFFIXES = (*_OWN_WORDS, "rev", "turns", "mm", "ncm", "nmm", "ma", "amp", "amps")
"""Units that are understood behind ``_``; shorter ones may be part of a name, such as ``arm_a``."""
_INSIDE = re.compile(f"_({'|'.join(_OWN_WORDS)})(?=[_./[(][^_./[(]|[0-9]+$)")
_SEPARATORS = re.compile(r"\s+in\s+|\s*/\s*|,\s*")
_LEFT_OPEN: Mapping[str, Collection[str]] = {
    "time": ("min", "hours", "day", "days", "ticks", "cycles"),
    "position": ("deg", "degs", "degree", "degrees", "grad", "gon", "mrad", "urad", "μrad", "mdeg", "°", "cm"),
    "velocity": ("deg", "degrees", "grad", "mrad", "mdeg", "dps", "rpm", "rps", "°", "cm"),
    "torque": ("knm", "mnm", "ncm", "nmm", "kgcm", "kgfcm", "kgf", "ozin", "lbf", "lbft", "lbin", "percent", "%", "‰"),
}
_COUNTS = ("counts", "ticks", "pulses", "lsb")
"""What is counted in, and is a unit of position or velocity for who knows how many make a turn."""
_TIME_SUFFIXES = frozenset(
    [
        "s",
        "sec",
        "seconds",
        "ms",
        "msec",
        "milliseconds",
        "us",
        "usec",
        "microseconds",
        "ns",
        "nsec",
        "nanosec",
        "nanoseconds",
    ]
)

UNITS: Mapping[str, Collection[str]] = {
    "time": TIME_UNITS,
    "position": POSITION_UNITS,
    "velocity": VELOCITY_UNITS,
    "acceleration": ACCELERATION_UNITS,
    "torque": TORQUE_UNITS,
    "current": CURRENT_UNITS,
    "label": (),
}
"""The units of each quantity."""


def normalised(text: str) -> str:
    """Return a name as it is compared with others: without capitals, and with one way of separating words.

    Examples
    --------
    >>> normalised("Joint 1 - Position"), normalised("__time"), normalised("position [2]")
    ('joint_1_position', 'time', 'position_[2]')
    """
    text = re.sub(r"[\s_-]+", "_", unicodedata.normalize("NFC", text).casefold())
    return re.sub(r"_?([:/.])_?", r"\1", text).replace(":", "/").strip("_")


def units_said(column: str) -> tuple[tuple[str, str], ...]:
    """Return the units that a column's name may say, each with the name without it.

    Examples
    --------
    >>> units_said("Joint 1 position [deg]"), units_said("tau_1_nm"), units_said("position[elbow]")
    ((('joint_1_position', 'deg'),), (('tau_1', 'N·m'),), ())
    >>> units_said("q_mrad_1"), units_said("Winkel 1 in Grad")
    ((('q_1', 'mrad'),), (('winkel_1', 'deg'),))
    """
    column = _GRAD.sub("deg", column)
    found = []
    for match in re.finditer(r"[\[({<]([^\[\](){}<>]*)[\])}>]", column):
        unit = _spelled(match[1])
        if unit is not None:
            rest = f"{column[: match.start()].rstrip('/ ')} {column[match.end() :]}"
            found.append((normalised(rest), unit))
    if not found:
        text = normalised(column)
        for suffix in _UNIT_SUFFIXES:
            if text.endswith(f"_{suffix}"):
                found.append((text.removesuffix(f"_{suffix}").removesuffix("_in"), _UNIT_SPELLINGS[suffix]))
        for match in _INSIDE.finditer(text):
            found.append((text[: match.start()] + text[match.end() :], _UNIT_SPELLINGS[match[1]]))
        for match in _SEPARATORS.finditer(column):
            unit, said = _spelled(column[match.end() :]), column[match.end() :].strip()
            if unit is not None and (len(said) > 1 or said == "°" or match[0] != "/"):  # `arm/a` may be a joint
                found.append((normalised(column[: match.start()]), unit))
    return tuple(dict.fromkeys(found))


def unit_left_open(column: str, quantity: str) -> str | None:
    """Return the word in a column's name, if there is one, that may be a unit of a quantity and is not understood so.

    Examples
    --------
    >>> unit_left_open("q1 [gon]", "position"), unit_left_open("posDeg1", "position"), unit_left_open("q1", "position")
    ('gon', 'Deg', None)
    """
    words = _LEFT_OPEN.get("velocity" if quantity == "acceleration" else quantity, ())
    counts = _COUNTS if quantity in ("position", "velocity", "acceleration") else ()
    parts = re.findall(r"[A-ZÄÖÜ]*[a-zäöüµμ]+|[A-Z]+|[°%‰]", unicodedata.normalize("NFC", column))
    return next((part for part in parts if part.casefold() in (*words, *counts)), None)


def _spelled(text: str) -> str | None:
    """Return the unit that a text is."""
    return _UNIT_SPELLINGS.get(unicodedata.normalize("NFC", text).replace("⁻¹", "^-1").casefold().strip())


_GRAD = re.compile(r"(?<![^\W\d_])Grad(?![^\W\d_])")
"""German for degrees; without the capital it may be gons."""


def time_unit_behind(text: str) -> tuple[str, str | None]:
    """Split a normalised name into itself and the unit of time that stands behind it.

    Examples
    --------
    >>> time_unit_behind("time_ms"), time_unit_behind("stamp")
    (('time', 'ms'), ('stamp', None))
    """
    head, _, suffix = text.rpartition("_")
    return (head, _UNIT_SPELLINGS[suffix]) if head and suffix in _TIME_SUFFIXES else (text, None)


def styles_of(shape: str) -> Iterator[ColumnStyle]:
    """Yield the styles of a name in which `NAME` or `NUMBER` stand for the joint, the earlier ones of `STYLES` first.

    Examples
    --------
    >>> [style.quantity for style in styles_of(f"actual_velocity_{NUMBER}")]
    ['velocity']
    """
    whole, parts = _table()
    found = list(whole.get(shape, ()))
    if _DIGIT.search(shape):  # no word has one, and a long header has thousands of such names
        parts = {NAME: {}, NUMBER: {}, "": {}}
    place = NAME if NAME in shape else NUMBER if NUMBER in shape else ""
    for (before, after), styles in parts[place].items():
        if shape.startswith(before) and shape.endswith(after) and len(shape) > len(before) + len(after):
            word = shape[len(before) : len(shape) - len(after)]
            found += [(rank, style) for rank, style in styles if word in _set_of(style.words)]
    yield from (style for _, style in sorted(found, key=lambda one: one[0]))


_DIGIT = re.compile("[0-9]")
_Ranked = list[tuple[int, ColumnStyle]]


_set_of = cache(frozenset[str])


@cache
def _table() -> tuple[dict[str, _Ranked], dict[str, dict[tuple[str, str], _Ranked]]]:
    """Return the styles by shapes without a word, and by what stands before and after a word; each with its rank."""
    whole: dict[str, _Ranked] = {}
    parts: dict[str, dict[tuple[str, str], _Ranked]] = {NAME: {}, NUMBER: {}, "": {}}
    for rank, style in enumerate(STYLES):
        for pattern in style.patterns:
            shape = pattern.replace("{name}", NAME).replace("{number}", NUMBER)
            before, found, after = shape.partition("{word}")
            if not found:
                whole.setdefault(shape, []).append((rank, style))
                continue
            place = NAME if NAME in shape else NUMBER if NUMBER in shape else ""
            parts[place].setdefault((before, after), []).append((rank, style))
    return whole, parts
