"""Remarks on the values of drives: what they rest on, which the data does not show, and when not to believe them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.display import few_digits
from steelyard.recording.diagnosis.detectors import noise_deviation
from steelyard.recording.diagnosis.transmission import position_ratio
from steelyard.robot import Robot, RobotFile
from steelyard.simulation.driven_joints import DRIVE_PARAMETERS

from .drive_logs import rms_of_joints
from .drive_result import WORDS, DriveValue
from .drive_settings import FIND, TERMS, DriveSettings
from .shooting import PositionLog

__all__ = [
    "PASSING",
    "above_noise",
    "remarks_on_gains",
    "remarks_on_logs",
    "remarks_on_missing_commands",
    "remarks_on_missing_terms",
    "remarks_on_rate",
    "remarks_on_rows",
    "remarks_on_settings",
    "remarks_on_values",
    "remarks_on_zeros",
    "unbelievable",
]

Array = NDArray[np.float64]

UNEXPLAINED = 0.2
"""Part of a joint's motion (rms about its mean) that a simulation may miss. On a recorded leg robot
it misses 0.01 to 0.04 of it; with commands of another sign a simulated pendulum misses 0.3, with degrees more."""

ABOVE_NOISE = 5.0
"""Errors of a simulation over the noise of the encoder from which on the model lacks something."""

MISSED = 0.002
"""Part of a joint's motion that a simulation misses, below which it is not told that the model lacks something: that of
the leg robot misses 0.01 to 0.04, and without noise steps and what friction is near standstill leave some 1e-5."""

NEARER, OTHER = 0.5, 1.2
"""By how much other gains must lower a joint's error, and by what factor differ from those stated, to be told. With
gains that are off by a factor of 2 a simulated arm has errors of 4 mrad instead of 0.2; on a recorded leg robot, whose
gains are right, errors fall by 1 % with gains that are found."""

BLOCKS, MOST, FEW = 100, 0.8, 0.1
"""Of how many blocks of rows few hold most of the squared error where something happened at times. Of a recorded leg
robot, whose friction is not that of the model, MOST is in 0.35 to 0.49 of them."""

NEAR_STOP, OFTEN = 0.03, 0.01
"""Part of a joint's range that counts as at its end, since stops give way and are elsewhere than described, and part of
the rows from which on it is told."""

PASSING = 0.8
"""Errors with commands in lines from row to row, over errors with commands that hold until the next row (geometric
mean of the joints), below which commands changed between rows. Of a simulated arm it is 0.08 to 0.63 where some of the
commands are lost and the delay ends at 0 (rotor inertia 13 to 67 % off); where all are logged 0.97 to 1.08 at 200 Hz
and 1.19 to 2.0 at 50 Hz; and 0.88 to 1.29 where a delay that is found makes up for those lost (about 4 % off)."""

HELD = 1e-3
"""s that a drive may well hold a torque, where nobody says how long."""

FAR_ZERO = 0.1
"""rad or m by which a zero of commands or positions must be off to be told."""


def remarks_on_settings(file: RobotFile, settings: DriveSettings) -> list[str]:
    """Say what the values will rest on."""
    found = []
    beside = dict.fromkeys(
        kind for kind in (str(term["kind"]) for term in file.terms) if kind not in (*TERMS, "offset")
    )
    if beside:
        found.append(
            f"The terms {', '.join(beside)} of {file.path} are not simulated: drives have rotor inertia, viscous and "
            "Coulomb friction and a bias here."
        )
    if "viscous" in settings.find and settings.kd == FIND:
        found.append(
            "Kd and viscous friction brake alike, and positions do not tell one from the other: what is found as Kd is "
            "their sum, less the damping of the description."
        )
    if settings.law == "signal":
        found.append("Viscous friction includes the braking of the motor's own voltage, which acts alike.")
    if not settings.free:
        found.append(
            "The inertial parameters of the links are held at the description; the intervals do not cover their errors."
        )
    if settings.kp == FIND or (settings.law == "signal" and settings.gain == FIND):
        found.append("Gains that are found rest on the masses of the description, and scale with them.")
    return found


def unbelievable(robot: Robot, settings: DriveSettings, logs: Sequence[PositionLog], error: Array) -> list[str]:
    """Say which joints the simulation does not explain."""
    spread = rms_of_joints([log.q - log.q.mean(axis=0) for log in logs])
    off = [k for k in range(robot.dof) if error[k] > UNEXPLAINED * spread[k]]
    if not off:
        return []
    listed = ", ".join(
        f"{robot.joint_names[k]} by {error[k]:.2g} where it moves by {spread[k]:.2g} {robot.position_units[k]} (rms)"
        for k in off
    )
    hint = ""
    if settings.law == "position":
        measured, told = (np.concatenate([getattr(log, name) for log in logs]) for name in ("q", "command"))
        ratios = [_ratio(measured[:, k], told[:, k]) for k in off]
        far = [f"{robot.joint_names[k]} {x:.3g}" for k, x in zip(off, ratios, strict=True) if not 0.5 < x < 2.0]
        if far:
            hint = f" The commands go so many times as far as the joints: {', '.join(far)}."
    return [
        f"Do not believe the values: even with the best of them the simulation is off by a good part of the motion "
        f"({listed}). Check unit, sign, order and zero of commands and positions, and the gains.{hint}"
    ]


def _ratio(measured: Array, told: Array) -> float:
    """Return how many times as far commands go as a joint, with their sign where both go together."""
    found = position_ratio(measured, told)
    return found if np.isfinite(found) else float(np.std(told) / np.std(measured))


def above_noise(logs: Sequence[PositionLog], error: Array, factor: float = ABOVE_NOISE) -> NDArray[np.bool_]:
    """Return whether the error of each joint (N,) is above `factor` times the noise of its encoder."""
    noise = np.max([noise_deviation(log.q) for log in logs], axis=0)
    return np.asarray(error > factor * noise)


def remarks_on_missing_terms(
    robot: Robot, logs: Sequence[PositionLog], error: Array, above: NDArray[np.bool_], chosen: bool
) -> list[str]:
    """Say of which joints the simulation misses more than noise, where nothing else explains their errors (N,).

    `chosen` says whether friction and springs beside those of the model were tried.

    On simulated legs whose friction grows by 15 % of the load, errors are 2 to 46 times the noise, and of 47 values 31
    are outside of their intervals; with the friction of the model errors are the noise, and 3 of 77 are outside.
    """
    spread = rms_of_joints([log.q - log.q.mean(axis=0) for log in logs])
    missed = np.flatnonzero(above & (error > MISSED * spread))
    if not len(missed):
        return []
    listed = ", ".join(f"{robot.joint_names[k]} by {few_digits(1e3 * error[k], 2)}" for k in missed)
    advice = "" if chosen else " `--friction auto` tries friction that varies with travel or load, and springs."
    return [
        f"The simulation misses {listed} mrad or mm (rms), which is more than the noise of the encoders: something "
        "moves or brakes there that the model does not have, and how it draws the values is not in their intervals."
        f"{advice}"
    ]


def remarks_on_logs(
    robot: Robot, settings: DriveSettings, logs: Sequence[PositionLog], drives: Array, above: NDArray[np.bool_]
) -> list[str]:
    """Say which joints were told nothing, and which with errors above noise were at stops or asked for too much.

    `drives` are the parameters (12, N) of the drives, `above` says which errors are above noise.
    """
    if settings.law != "position":
        return []
    q, command = (np.concatenate([getattr(log, name) for log in logs]) for name in ("q", "command"))
    kp, kd = (drives[DRIVE_PARAMETERS.index(kind)] for kind in ("kp", "kd"))
    asked = np.concatenate([kp * (log.command - log.q) - kd * np.gradient(log.q, log.t, axis=0) for log in logs])
    found, stops, weak = [], [], []
    constant = [robot.joint_names[k] for k in range(robot.dof) if all(np.ptp(log.command[:, k]) == 0.0 for log in logs)]
    if constant:
        found.append(
            f"The commands of {', '.join(constant)} never change: what is found there rests on the little that the "
            "other joints make it move; do not believe it, and lock such a joint in [description]."
        )
    for k in np.flatnonzero(above):
        joint = robot.joints[robot.driving_joints[k]]
        reach = NEAR_STOP * (joint.upper - joint.lower)
        for limit, side in ((joint.lower, 1.0), (joint.upper, -1.0)):
            if np.isfinite(limit) and np.isfinite(reach):
                at = (side * (q[:, k] - limit) < reach) & (side * (command[:, k] - limit) < 0.0)
                if at.mean() > OFTEN:
                    stops.append(f"{robot.joint_names[k]} in {at.mean():.0%} of the rows")
        beyond = np.mean(np.abs(asked[:, k]) > joint.effort_limit)
        if beyond > OFTEN:
            limit, unit = joint.effort_limit, "N" if robot.position_units[k] == "m" else "N·m"
            weak.append(
                f"{robot.joint_names[k]} for more than {few_digits(limit, 3)} {unit} in {beyond:.0%} of the rows"
            )
    if stops:
        found.append(
            f"Commands press joints against the limits of the description ({', '.join(stops)}): a stop that carries a "
            "joint is not simulated; leave such rows out."
        )
    if weak:
        found.append(
            f"Commands and gains ask for more than the description says that drives have ({', '.join(weak)}): drives "
            "at their limit are not simulated; leave such rows out, or correct the gains or the limits."
        )
    return found


def remarks_on_gains(
    robot: Robot, stated: Array, found: Array, error: Array, nearer: Array, above: NDArray[np.bool_]
) -> list[str]:
    """Say at which joints other position gains (N,) than those stated explain the motion far better.

    `error` and `nearer` (N,) are what the simulation misses with the stated gains and with those found; `above` says
    which errors are more than noise.
    """
    ratio = found / stated
    wrong = above & (nearer < NEARER * error) & ((ratio > OTHER) | (ratio < 1.0 / OTHER))
    if not wrong.any():
        return []
    listed = ", ".join(
        f"{robot.joint_names[k]}: {few_digits(found[k], 3)} instead of {few_digits(stated[k], 3)}, error "
        f"{few_digits(1e3 * nearer[k], 2)} instead of {few_digits(1e3 * error[k], 2)} mrad or mm"
        for k in np.flatnonzero(wrong)
    )
    return [
        f"Do not believe the values: other position gains explain the motion far better ({listed}). Check kp and kd in "
        '[drive], or let them be found with kp = "find" and kd = "find".'
    ]


def remarks_on_rows(
    robot: Robot, logs: Sequence[PositionLog], residuals: Sequence[Array], above: NDArray[np.bool_]
) -> list[str]:
    """Say where a few rows hold most of what the simulation misses of joints whose errors are above noise."""
    size = max(5, sum(len(log.t) for log in logs) // BLOCKS)
    blocks = [
        (number, a, min(a + size, len(log.t))) for number, log in enumerate(logs) for a in range(0, len(log.t), size)
    ]
    found = []
    for k in np.flatnonzero(above):
        sums = np.array([np.sum(residuals[number][a:b, k] ** 2) for number, a, b in blocks])
        order = np.argsort(-sums)
        count = 1 + int(np.searchsorted(np.cumsum(sums[order]), MOST * sums.sum()))
        if count <= FEW * len(blocks):
            number, a, b = blocks[order[0]]
            log = logs[number]
            low, high = (few_digits(log.begin + float(log.t[row]), 3) for row in (a, b - 1))
            found.append(f"{robot.joint_names[k]}, most of all from {low} to {high} s of {log.name}")
    if not found:
        return []
    return [
        f"Most of what the simulation misses is in less than a tenth of the rows ({'; '.join(found)}). A stop, a "
        "collision, a drive at its limit or rows that are missing look so; leave such rows out: they spoil the values "
        "more than the intervals say."
    ]


def remarks_on_missing_commands(robot: Robot, error: Array, passing: Array) -> list[str]:
    """Say that commands changed between rows, if errors (N,) with commands in lines from row to row are far less."""
    ratio = passing / np.maximum(error, 1e-300)
    if not np.exp(np.mean(np.log(np.maximum(ratio, 1e-300)))) < PASSING:
        return []
    k = int(np.argmin(ratio))
    return [
        "Do not believe the values: commands that pass in lines from row to row explain the motion far better than "
        f"commands that each hold until the next row ({robot.joint_names[k]}: error {few_digits(1e3 * passing[k], 2)} "
        f"instead of {few_digits(1e3 * error[k], 2)} mrad or mm). The log seems to hold only some of the commands, or "
        "to show them later than the drive had them: log as often as commands change, and check `delay` in [drive]."
    ]


def remarks_on_zeros(robot: Robot, drives: Array) -> list[str]:
    """Say which torque biases are too large for one; `drives` are the parameters (12, N) of the drives."""
    offset, kp = (drives[DRIVE_PARAMETERS.index(kind)] for kind in ("offset", "kp"))
    far = [
        f"{name} by {few_digits(bias / gain, 2)}"
        for name, bias, gain in zip(robot.joint_names, offset, kp, strict=True)
        if 0.0 < FAR_ZERO * gain < abs(bias)
    ]
    if not far:
        return []
    return [
        f"The torque bias is as large as if commands were off ({', '.join(far)} rad or m): check unit and zero of "
        "commands and positions, the masses of the description, and whether the drive was on."
    ]


def remarks_on_rate(robot: Robot, settings: DriveSettings, drives: Array, values: Sequence[DriveValue]) -> list[str]:
    """Say which values differ by more than their intervals if drives (13, N) hold each torque for a while."""
    if settings.law != "position" or settings.rate is not None:
        return []
    kp, kd = (0.5 * HELD * drives[DRIVE_PARAMETERS.index(kind)] for kind in ("kp", "kd"))
    more = {"rotor_inertia": kd, "viscous": kp, "kd": kp}
    furthest: dict[str, tuple[float, str]] = {}
    for one in values:
        if one.kind not in more:
            continue
        by = float(more[one.kind][robot.joint_names.index(one.joint)])
        ratio = by / max(one.upper - one.value, 1e-300)
        if ratio > max(1.0, furthest.get(one.kind, (0.0, ""))[0]):
            what = f"{WORDS.get(one.kind, one.kind)} of {one.joint} by {few_digits(by, 2)} {one.unit}"
            furthest[one.kind] = ratio, what
    if not furthest:
        return []
    listed = " and ".join(what for _, what in furthest.values())
    return [
        f"The law of the drives counts as acting all the time. If they compute torques at {1.0 / HELD:g} Hz and hold "
        f"each until the next, what is found is too small, by more than intervals say: {listed}. State `rate` in "
        "[drive]."
    ]


def remarks_on_values(values: Sequence[DriveValue]) -> list[str]:
    """Say which values are not seen, or weak."""
    found = []
    for word, text in (
        ("not seen", "The logs do not tell from nothing"),
        ("weak", "Less certain than a tenth of themselves are"),
    ):
        chosen = [value for value in values if value.word == word]
        if chosen:
            parts: dict[str, list[str]] = {}
            for value in chosen:
                parts.setdefault(WORDS.get(value.kind, value.kind), []).append(value.joint)
            listed = "; ".join(f"{kind} of {', '.join(names)}" for kind, names in parts.items())
            found.append(f"{text}: {listed}.")
    return found
