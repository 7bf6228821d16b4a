"""Identified effects for which a description has no place, and the error of a simulation without them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model, MotorSide
from steelyard.files import listed
from steelyard.recording import Samples
from steelyard.regression import Estimate
from steelyard.robot import Drives, Robot
from steelyard.robot.description import URDF, description_format
from steelyard.robot.robot import PRESLIDING

from .mistakes import POOR, POOR_JOINT

__all__ = ["MissedTerms", "missed_terms", "undescribed_kinds"]

NAMES = {
    "damping": "damping",
    "friction": "friction",
    "rotor_inertia": "rotor inertia",
    "offset": "torque offsets",
    "stiffness": "springs",
    "quadratic_damping": "quadratic friction",
    "cubic_damping": "cubic friction",
}
NEGLIGIBLE = 5e-4  # of the torques; less is printed as 0.0 %
LEAST_INERTIA = 0.5
"""Part of its inertia that a joint must keep without its rotor: half of it takes twice the gain, which is the margin
that controllers commonly have. *Measured* in MuJoCo with the URDF, under the PD controller of the robot: a six-joint
arm whose joints keep 6, 13 and 23 % flies away, and moves as the robot does, to 6 % of the tracking error, with the
rotors as armature; two robots that keep 21 to 47 % at some joints miss 6 to 17 % of the tracking error."""
MOST_NAMED = 3
CONFIGURATIONS = 100  # of each log, at which inertias are compared


class MissedTerms(NamedTuple):
    """What the description cannot hold in its own elements.

    Attributes
    ----------
    sentence : str
        With the root mean square of the torques of the terms that are missed, relative to that of the measured ones,
        over all joints and of the joint where it is largest.
    matters : bool
        Whether a simulation of the description would predict so much worse than the answer that it must be told first.
    """

    sentence: str
    matters: bool


def missed_terms(model: Model, estimate: Estimate, samples: Sequence[Samples]) -> MissedTerms | None:
    """Say what the description cannot hold in its own elements.

    Parameters
    ----------
    samples : sequence of Samples
        Motions with which to compare torques.

    Returns
    -------
    MissedTerms or None
        None where nothing is missed.
    """
    source = model.robot.source
    if source is None or estimate.parameters is None:
        return None
    kind = description_format(source) or URDF
    refused = kind.refusal(model.robot)
    if refused:
        return MissedTerms(refused, matters=False)
    if not kind.is_written:
        return None
    parts, whole = np.zeros(model.robot.dof), np.zeros(model.robot.dof)
    of_terms = np.array(estimate.parameters)
    of_terms[np.ravel(model.link_columns)] = 0.0
    drives = model.drives(estimate.parameters)
    if "stiffness" in kind.holds and "offset" not in kind.holds:
        drives = drives.with_offsets_in_springs()  # as it is written
    for one in samples:
        rows = one.used_rows
        torque = model.inverse_dynamics(one.q, one.dq, one.ddq, of_terms, channels=one.channels)
        torque = torque - _torque_of_drives(drives, kind.holds, one)
        parts += np.sum(np.where(rows, torque, 0.0) ** 2, axis=0)
        whole += np.sum(np.where(rows, one.torque, 0.0) ** 2, axis=0)
    if not whole.sum() > 0.0:
        return None
    share = float(np.sqrt(parts.sum() / whole.sum()))
    each = np.sqrt(np.divide(parts, whole, out=np.zeros_like(parts), where=whole > 0.0))
    if max(share, float(each.max())) < NEGLIGIBLE:
        return None
    worst = int(np.argmax(each))
    known = [NAMES[name] for name in NAMES if name not in kind.holds and name in model.described_as]
    what = [*known, *undescribed_kinds(model.robot)]
    partly = _partly_described(model.robot) or ([] if what else [term.kind for term in model.robot.terms])
    if partly:
        what.append(f"all that {' and '.join(partly)} can say")
    beside = "" if what == known else f", those of {' and '.join(known)}"
    beside = f"{beside} and in an extension of ours, which simulators pass over" if known else ""
    light = "" if "rotor_inertia" in kind.holds else _without_rotors(model, estimate.parameters, drives, samples)
    return MissedTerms(
        f"The format of {source.name} has no place for {' and '.join(what)}: their values stand in "
        f"estimate.json{beside}. A simulation without them misses {share:.1%} of the torques of these logs, and "
        f"{each[worst]:.1%} at joint {model.robot.joint_names[worst]}.{light}",
        matters=bool(light) or share > POOR or float(each.max()) > POOR_JOINT,
    )


def _without_rotors(model: Model, parameters: NDArray[np.float64], drives: Drives, samples: Sequence[Samples]) -> str:
    """Say which joints lose most of their inertia without their rotors, a sentence; empty where none does."""
    of_links = np.zeros_like(parameters)
    columns = np.ravel(model.link_columns)
    of_links[columns] = parameters[columns]
    inertia, count = np.zeros(model.robot.dof), 0
    for one in samples:
        rows = np.linspace(0, len(one.q) - 1, min(CONFIGURATIONS, len(one.q))).astype(int)
        q, still = one.q[rows], np.zeros((len(rows), model.robot.dof))
        channels = None if one.channels is None else {name: values[rows] for name, values in one.channels.items()}
        # By the inverse dynamics, which are compiled already.
        at_rest = model.inverse_dynamics(q, still, still, of_links, channels=channels)
        for k, unit in enumerate(np.eye(model.robot.dof)):
            moved = model.inverse_dynamics(q, still, still + unit, of_links, channels=channels)
            inertia[k] += float(np.sum(moved[:, k] - at_rest[:, k]))
        count += len(rows)
    rotors = np.nan_to_num(drives.rotor_inertia)
    kept = np.divide(inertia, inertia + count * rotors, out=np.ones_like(inertia), where=rotors > 0.0)
    few = np.flatnonzero(kept < LEAST_INERTIA)
    if not len(few):
        return ""
    names = model.robot.joint_names
    told = listed([f"{names[k]} {kept[k]:.0%}" for k in few[np.argsort(kept[few])]], MOST_NAMED)
    return (
        f" Without their rotors some joints keep only a part of their inertia ({told}), so that a controller that is "
        "stable on the robot may not be so there: give the simulator the rotor inertia, which MuJoCo calls armature."
    )


def _torque_of_drives(drives: Drives, held: Collection[str], samples: Samples) -> NDArray[np.float64]:
    """Return what the elements of a description do in a simulation, (S, N)."""
    q, dq, ddq = samples.q, samples.dq, samples.ddq
    each = {
        "damping": drives.damping * dq,
        "friction": drives.friction * np.sign(dq),
        "quadratic_damping": drives.quadratic_damping * np.abs(dq) * dq,
        "cubic_damping": drives.cubic_damping * dq**3,
        "rotor_inertia": drives.rotor_inertia * ddq,
        "offset": np.broadcast_to(drives.offset, q.shape),
        "stiffness": drives.spring_stiffness * (q - drives.spring_rest),
    }
    return np.asarray(sum((np.nan_to_num(each[name]) for name in each if name in held), np.zeros_like(q)))


def _partly_described(robot: Robot) -> list[str]:
    """Return the kinds of the laws that have several numbers for one of a description, or couple joints."""
    laws = [law for term in robot.terms for law in term.laws]
    told = [[one.described_as for one in law.parameters if one.described_as] for law in laws]
    several = [
        law.kind
        for law, names in zip(laws, told, strict=True)
        if len(set(names)) < len(names)
        or (isinstance(law, MotorSide) and np.count_nonzero(law.coupling) > len(law.coupling))
    ]
    return list(dict.fromkeys(several))


def undescribed_kinds(robot: Robot) -> list[str]:
    """Return the kinds of the terms, or of their laws, that have parameters of which no description knows."""
    laws = [law for term in robot.terms for law in term.laws]
    undescribed = (
        law.kind
        for law in laws
        if PRESLIDING in law.channels or any(one.described_as is None for one in law.parameters)
    )
    return list(dict.fromkeys(undescribed))
