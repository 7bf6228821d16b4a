"""Settings of an identification from commands and positions: what is commanded to the drives, and how they act."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.errors import InputError
from steelyard.files import TomlSection, read_number, shown, suggestion
from steelyard.recording.recognition import numbered_columns
from steelyard.robot import Robot
from steelyard.simulation.driven_joints import FrictionLaw

__all__ = [
    "BY_LOAD",
    "BY_POSITION",
    "FIND",
    "FRICTION_LAWS",
    "FURTHER_TERMS",
    "SPRING",
    "TERMS",
    "TORQUE_LOSS",
    "DriveSettings",
]

LAWS = ("position", "signal")
BIASES = ("torque", "encoder", "none")
FRICTION_LAWS: dict[str, Callable[[], FrictionLaw]] = {"mujoco": FrictionLaw.mujoco, "coulomb": FrictionLaw.coulomb}
TERMS = ("rotor_inertia", "viscous", "coulomb")
TORQUE_LOSS = "torque_loss"
BY_POSITION, BY_LOAD, SPRING = FURTHER_TERMS = ("coulomb_by_position", "coulomb_by_load", "spring")
FIND = "find"
SLOWEST = 500.0
"""Hz of a position loop, at which a motion between two torques is nearly a parabola: values of simulated arms are up to
0.2 % off there, and eight standard errors at 200 Hz."""


@dataclass(frozen=True)
class DriveSettings(TomlSection):
    """The commands of drives and their law of control: the `[drive]` section of robot.toml.

    Parameters
    ----------
    command
        Columns of the commands: a list of names, or a pattern as in `[log]`. Commands of positions are in the unit of
        the positions.
    scale
        Column by which all the commands are multiplied, such as the voltage where they are duty cycles.
    law
        ``"position"``: the torque is ``kp (command - q) - kd dq``, command and delay of the motor's own loop included;
        ``"signal"``: the torque is ``gain command - kd dq``.
    kp, kd, gain
        Gains at the joints, a number or one for each; ``"find"`` where they are unknown.
    rate
        Hz at which drives compute the torque of a position law, which they hold until the next; without it the law acts
        all the time.
    delay
        s, from the stamp of a command to its torque; ``"find"`` looks for one that all the joints share.
    longest_delay
        s, up to which it is looked for.
    bias
        What is constant: ``"torque"`` (which a constant error of the targets is, too), ``"encoder"``, or ``"none"``.
    friction
        ``"mujoco"``, the law of its ``frictionloss`` with default constants, or ``"coulomb"``.
    find
        Which of ``"rotor_inertia"``, ``"viscous"`` and ``"coulomb"`` are looked for; the others stay at the
        description. Further terms of all joints may be added: ``"coulomb_by_position"``, ``"coulomb_by_load"`` and
        ``"spring"``. With ``"torque_loss"`` the torque m of the drive's law falls behind it, ``m (1 - loss |m|)``.
    free
        Links whose inertial parameters are looked for about their description.
    also
        Further descriptions of the same robot that get the results, such as an MJCF beside a URDF.

    Examples
    --------
    >>> DriveSettings.from_dict({"command": "q_des{}", "kp": 20.0, "kd": 1.5}).kp
    (20.0,)
    """

    section_name = "[drive]"

    command: str | tuple[str, ...] | None = None
    scale: str | None = None
    law: str = "position"
    kp: str | tuple[float, ...] | None = None
    kd: str | tuple[float, ...] = (0.0,)
    gain: str | tuple[float, ...] = FIND
    rate: float | None = None
    delay: str | float = FIND
    longest_delay: float = 0.05
    bias: str = "torque"
    friction: str = "mujoco"
    find: tuple[str, ...] = TERMS
    free: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    def _clean(self, where: str) -> None:
        if self.command is None or not self.command:
            raise InputError(
                f'{where} lacks command; name the columns of the commands, such as command = "q_des{{}}" or a list.'
            )
        if not isinstance(self.command, str):
            object.__setattr__(self, "command", _texts(self.command, f"{where}, key 'command',"))
        for key, known in (("law", LAWS), ("bias", BIASES), ("friction", tuple(FRICTION_LAWS))):
            value = getattr(self, key)
            if value not in known:
                raise InputError(f"{where}, key {key!r}, is {shown(value)}; {suggestion(str(value), known)}")
        for key in ("find", "free", "also"):
            named = dict.fromkeys(_texts(getattr(self, key), f"{where}, key {key!r},"))
            object.__setattr__(self, key, tuple(named))
        for term in self.find:
            known_terms = (*TERMS, *FURTHER_TERMS, TORQUE_LOSS)
            if term not in known_terms:
                raise InputError(f"{where}, key 'find', holds {shown(term)}; {suggestion(term, known_terms)}")
        if BY_POSITION in self.find and "coulomb" not in self.find:
            raise InputError(f"{where}, key 'find', holds {BY_POSITION!r} without 'coulomb', of which it is; add it.")
        if self.law == "position" and self.kp is None:
            raise InputError(
                f'{where} lacks kp, the position gain in N·m/rad; give a number, one for each joint, or kp = "find".'
            )
        other, own = ("gain", "signal") if self.law == "position" else ("kp", "position")
        if getattr(self, other) not in (None, FIND):
            raise InputError(
                f'{where} gives {other}, which belongs to law = "{own}", but its law is "{self.law}"; leave one of the '
                "two out."
            )
        for key in ("kp", "kd", "gain"):
            value = getattr(self, key)
            if value is not None and value != FIND:
                object.__setattr__(self, key, _gains(value, f"{where}, key {key!r},", key))
        if self.rate is not None:
            if self.law == "signal":
                raise InputError(
                    f'{where} gives rate, which is that of a position loop, but its law is "signal"; leave it out.'
                )
            expected = f"{SLOWEST:g} Hz or more, such as 1000"
            rate = read_number(self.rate, f"{where}, key 'rate',", expected, least=SLOWEST)
            object.__setattr__(self, "rate", rate)
        if self.delay != FIND:
            object.__setattr__(self, "delay", _seconds(self.delay, f"{where}, key 'delay',"))
        object.__setattr__(self, "longest_delay", _seconds(self.longest_delay, f"{where}, key 'longest_delay',"))
        wanted = (self.delay, self.kd, self.kp if self.law == "position" else self.gain)
        if not (self.find or self.free or self.bias != "none" or FIND in wanted):
            raise InputError(
                f'{where} leaves nothing to be found; name a term in find, as find = ["rotor_inertia"], or say "find" '
                "for a gain or the delay."
            )

    def command_columns(self, robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
        """Return the columns of the commands, one for each joint of a robot.

        Parameters
        ----------
        robot : Robot
        names : sequence of str
            Columns of the log, which tell whether a pattern counts from 0 or from 1.

        Raises
        ------
        InputError
            If there are not as many columns as joints.
        """
        assert self.command is not None
        if isinstance(self.command, str) and "{name}" in self.command:
            return tuple(self.command.replace("{name}", joint) for joint in robot.joint_names)
        if isinstance(self.command, str) and "{}" in self.command:
            return numbered_columns(self.command, robot, names)
        listed = (self.command,) if isinstance(self.command, str) else self.command
        if len(listed) != robot.dof:
            raise InputError(
                f"[drive] names {len(listed)} columns of commands, but {robot.name} has {robot.dof} joints; give one "
                "each."
            )
        return listed


def _texts(value: Any, where: str) -> tuple[str, ...]:
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, Sequence) or not all(isinstance(one, str) and one for one in given):
        raise InputError(f"{where} is {shown(value)}; give a list of texts.")
    return tuple(given)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f'{where} is {shown(value)}; give a finite number, or "find".')
    return float(value)


def _gains(value: Any, where: str, key: str) -> tuple[float, ...]:
    given = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
    found = tuple(_number(one, where) for one in given)
    # A signal may drive a joint backwards; a loop of positions with a gain below 0 runs away.
    good, what = {
        "kp": (all(one > 0.0 for one in found), "positive: without a gain the commands do not reach the joint"),
        "kd": (all(one >= 0.0 for one in found), "at least 0"),
        "gain": (0.0 not in found, "other than 0: without a gain the commands do not reach the joint"),
    }[key]
    if not good or not found:
        raise InputError(f"{where} is {shown(value)}; it must be {what}.")
    return found


def _seconds(value: Any, where: str) -> float:
    found = _number(value, where)
    if not 0.0 <= found <= 1.0:
        raise InputError(f"{where} is {shown(value)}; it must be from 0 to 1 s.")
    return found
