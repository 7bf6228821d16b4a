"""Remarks on an MJCF: where the numbers of the robot come from, and which of its elements a robot does not have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from steelyard.files import listed

from .mjcf_classes import DefaultClasses
from .mjcf_compiled import HINGE, ON_JOINT, SLIDE, CompiledMjcf
from .mjcf_document import MjcfDocument

__all__ = ["mjcf_remarks"]

MOST = 6
DRIVES = {"damping": "damping", "frictionloss": "friction", "armature": "armature"}
SETTINGS = {
    "settotalmass": "scales all masses to a total",
    "boundmass": "raises masses to a least one",
    "boundinertia": "raises moments of inertia to a least one",
    "balanceinertia": "balances moments of inertia that no body has",
}


def mjcf_remarks(
    document: MjcfDocument, model: CompiledMjcf, body_names: Sequence[str], joint_names: Sequence[str]
) -> tuple[str, ...]:
    """Return the sentences."""
    named = [(name, row) for name, row in zip(joint_names, model.joints, strict=True) if row["type"] in (SLIDE, HINGE)]
    return (
        *_inertias(document, model, body_names),
        *_defaults(document, named),
        *_actuators(model, joint_names),
        *_left_out(document, model, body_names, joint_names, named),
    )


def _listed(names: Iterable[str]) -> str:
    return listed(dict.fromkeys(names), MOST)


def _inertias(document: MjcfDocument, model: CompiledMjcf, names: Sequence[str]) -> list[str]:
    """Say which inertias are written, and which follow from shapes."""
    mode = document.setting("compiler", "inertiafromgeom") or "auto"
    written, computed = [], []
    for index in sorted(model.moving()):
        element = document.bodies.get(names[index])
        explicit = element is not None and any(element.all("inertial")) and mode != "true"
        if explicit:
            written.append(names[index])
        elif model.bodies[index]["inertia"].mass > 0.0:
            computed.append(names[index])
    said = [f"Inertias that the file gives (<inertial>): {_listed(written)}."] if written else []
    if computed:
        said.append(f"Inertias that follow from shapes and their densities: {_listed(computed)}.")
    for key, what in SETTINGS.items():
        value = document.setting("compiler", key)
        if value not in (None, "false", "0", "-1"):
            said.append(f'The compiler {what} ({key}="{value}"), which counts in these inertias.')
    return said


def _defaults(document: MjcfDocument, joints: Sequence[tuple[str, Mapping[str, Any]]]) -> list[str]:
    """Say which values of joints come from classes of defaults."""
    classes = DefaultClasses(document)
    of_joint = dict(classes.of_joints(document))
    said = []
    for key, noun in DRIVES.items():
        found: dict[str, list[str]] = {}
        for name, _ in joints:
            element = document.joints.get(name)
            if element is None or element.tag == "freejoint" or key in element.attributes:
                continue
            holder = classes.holder(of_joint[name], "joint", key)
            if holder is not None:
                file = holder[1].file
                line = file.edit.line(holder[1].place)
                found.setdefault(f"{holder[0]} ({file.path.name}, line {line})", []).append(name)
        for place, names in found.items():
            said.append(f"The {noun} of {_listed(names)} is that of the default class {place}.")
    return said


def _actuators(model: CompiledMjcf, joints: Sequence[str]) -> list[str]:
    """Say what drives the joints, since a log may hold controls and not torques."""
    parts = []
    for row in model.actuators:
        if row["trntype"] in ON_JOINT.values():
            factor = row["gear"][0] * row["gainprm"][0]
            # A bias that depends on position or velocity makes a servo, whose control is no torque.
            servo = "position servo" if row["biasprm"][1] else "velocity servo" if row["biasprm"][2] else ""
            parts.append(f"{joints[row['trnid'][0]]} ({servo or f'{factor:g}'})")
    other = sum(row["trntype"] not in ON_JOINT.values() for row in model.actuators)
    said = []
    if parts:
        shown = listed(parts, MOST)
        said.append(
            f"Actuators, with the torque of a control of 1: {shown}; a log must hold torques of joints, or [log] the "
            "gains."
        )
    for key, what in (("armature", "rotor inertia"), ("damping", "damping")):
        giving = [name for index, name in enumerate(joints) if model.of_actuators(index)[key]]
        if giving:
            said.append(f"The {what} of {_listed(giving)} is that of the joint and of its actuators.")
    if other:
        verb = "do" if other > 1 else "does"
        said.append(f"{other} actuator{'s' * (other > 1)} {verb} not act on one joint; they are no part of the robot.")
    return said


def _left_out(
    document: MjcfDocument,
    model: CompiledMjcf,
    bodies: Sequence[str],
    names: Sequence[str],
    joints: Sequence[tuple[str, Mapping[str, Any]]],
) -> list[str]:
    """Name what acts in a simulation and is no part of the robot."""
    parts = []
    springs = [name for name, row in joints if row["stiffness"]]
    if springs:
        parts.append(f"springs at the joints {_listed(springs)}")
    curved = [name for name, row in joints if row["poly"]]
    curved += [names[row["trnid"][0]] for row in model.actuators if row["poly"] and row["trntype"] in ON_JOINT.values()]
    if curved:
        parts.append(f"damping beyond the linear one at {_listed(curved)}")
    acting = ("stiffness", "damping", "frictionloss", "armature")
    tendons = [row["name"] for row in model.tendons if any(row[k] for k in acting)]
    if tendons:
        parts.append(f"springs, friction and inertia of the tendons {_listed(tendons)}")
    sections = document.root.all("actuator")
    motors = [one.attributes.get("joint", "") for section in sections for one in section.all("dcmotor")]
    if motors:
        parts.append(f"the motors (dcmotor) of {_listed(motors)}, with their armature and damping")
    floating = [name for name, row in zip(bodies, model.bodies, strict=True) if row["gravcomp"]]
    if floating:
        parts.append(f"compensated gravity (gravcomp) of {_listed(floating)}")
    for key in ("density", "viscosity"):
        value = document.setting("option", key)
        if value is not None and any(word.strip("0.") for word in value.split()):
            parts.append(f"the {key} of the medium")
    return [f"Not part of the robot: {'; '.join(parts)}."] if parts else []
