"""What is said beside the values of drives: what they rest on, which are not seen, and when not to believe them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.diagnosis.transmission import position_ratio
from steelyard.robot import Robot, RobotFile

from .drive_logs import rms_of_joints
from .drive_result import WORDS, DriveValue
from .drive_settings import FIND, TERMS, DriveSettings
from .shooting import PositionLog

__all__ = ["remarks_on_settings", "remarks_on_values", "unbelievable"]

Array = NDArray[np.float64]

UNEXPLAINED = 0.2
"""Part of a joint's motion (rms about its mean) that a simulation may miss. On a recorded leg robot
it misses 0.01 to 0.04 of it; with commands of another sign a simulated pendulum misses 0.3, with degrees more."""


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
        ratios = [position_ratio(measured[:, k], told[:, k]) for k in off]
        far = [
            f"{robot.joint_names[k]} {x:.3g}"
            for k, x in zip(off, ratios, strict=True)
            if np.isfinite(x) and not 0.5 < x < 2.0
        ]
        if far:
            hint = f" The commands go so many times as far as the joints: {', '.join(far)}."
    return [
        f"Do not believe the values: even with the best of them the simulation is off by a good part of the motion "
        f"({listed}). Check unit, sign, order and zero of commands and positions, and the gains.{hint}"
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
