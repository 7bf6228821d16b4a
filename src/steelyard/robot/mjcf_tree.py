"""Reading of a resolved MJCF: the links and joints of a robot, and the elements that a robot does not have."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown

from .described_tree import DescribedJoint, DescribedLink, DescribedMimic, DescribedTree, robot_parts, with_extension
from .mjcf_compiled import BALL, BODY, CONNECT, FREE, HINGE, JOINT, SLIDE, TENDON, WELD, CompiledMjcf, compiled
from .mjcf_document import OWN_NUMBER, MjcfDocument, new_name, read_mjcf_document
from .mjcf_reading import BeyondReadingError, read_compiled
from .mjcf_remarks import mjcf_remarks
from .placement import axis_frame, inverse, motion_z, translation

__all__ = ["MjcfTree", "mjcf_parts", "mjcf_tree", "read_mjcf_tree"]

Matrix = NDArray[np.float64]

KINDS = {FREE: "floating", BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}


@dataclass(frozen=True, eq=False)
class MjcfTree:
    """A description as read.

    Parameters
    ----------
    body_names, joint_names : tuple of str
        In MuJoCo's order; what has no name in the file has one that was made.
    link_of : dict
        From the name of a joint to that of the link that it moves: its body, or a link without a body where further
        joints of the body follow.
    """

    document: MjcfDocument
    compiled: CompiledMjcf
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    link_of: dict[str, str]
    tree: DescribedTree


def mjcf_parts(path: str | Path, tip: str | None, locked: Iterable[str] | Mapping[str, float]) -> dict[str, Any]:
    """Return the fields of the robot that an MJCF describes, see `Robot.from_mjcf`."""
    read = read_mjcf_tree(Path(path))
    parts = robot_parts(read.tree, tip, locked)
    parts["gravity"] = np.array(read.compiled.gravity)
    _refuse_loops(read, parts)
    return parts


def read_mjcf_tree(path: Path, data: bytes | None = None) -> MjcfTree:
    """Read the links and joints of an MJCF; `data` is what a file of this path would hold.

    Raises
    ------
    InputError
        If the file cannot be read, or what takes MuJoCo cannot be compiled.
    MissingExtraError
        If it takes MuJoCo to read it, which is not installed.
    """
    return mjcf_tree(read_mjcf_document(path, data))


def mjcf_tree(document: MjcfDocument) -> MjcfTree:
    """Return the links and joints of an MJCF, see `read_mjcf_tree`."""
    try:
        model = read_compiled(document)
    except BeyondReadingError as reason:
        model = compiled(document, str(reason))
    bodies = _named(model.bodies, "body")
    joints = _named(model.joints, "joint")
    of_body: dict[int, list[int]] = {}
    for index, joint in enumerate(model.joints):
        of_body.setdefault(joint["bodyid"], []).append(index)

    links: dict[str, DescribedLink] = {}
    described: dict[str, DescribedJoint] = {}
    link_of: dict[str, str] = {}
    mimics = _mimics(model, joints)
    taken = {*bodies}
    taken_joints = {*joints}
    for index, (name, body) in enumerate(zip(bodies, model.bodies, strict=True)):
        element = document.bodies.get(name)
        line = 1 if element is None else document.line(element)
        if index == 0:
            links[name] = DescribedLink(name, line, None)
            continue
        parent, frame = bodies[body["parentid"]], body["placement"]
        own = of_body.get(index, [])
        if not own:
            fixed = new_name(f"{name}_weld", taken_joints)
            described[fixed] = DescribedJoint(fixed, line, "fixed", parent, name, frame)
        for place, number in enumerate(own):
            last = place == len(own) - 1
            link = name if last else new_name(f"{name}_{joints[number]}", taken)
            if not last:
                links[link] = DescribedLink(link, line, None)
            described[joints[number]] = _joint(
                model.joints[number],
                joints[number],
                line,
                (parent, link),
                frame,
                mimics.get(number),
                model.of_actuators(number),
            )
            link_of[joints[number]] = link
            parent, frame = link, np.eye(4)
        links[name] = DescribedLink(name, line, body["inertia"])
    described = with_extension(described, {name: {"torque_offset": of} for name, of in _offsets(document).items()})
    remarks = mjcf_remarks(document, model, bodies, joints)
    path = document.path
    tree = DescribedTree(str(path), document.name, links, described, path, remarks=remarks)
    return MjcfTree(document, model, bodies, joints, link_of, tree)


def _offsets(document: MjcfDocument) -> dict[str, float]:
    """Return the offsets that stand as numbers of ours in ``<custom>``, by the names of joints."""
    found, prefix = {}, OWN_NUMBER.format("offset", "")
    for element in (one for section in document.root.all("custom") for one in section.all("numeric")):
        name, text = element.attributes.get("name", ""), element.attributes.get("data", "")
        if not name.startswith(prefix):
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        found[name.removeprefix(prefix)] = value
        if not math.isfinite(value):
            raise InputError(f"{element.where}: data of {shown(name)} must be one finite number, got {shown(text)}")
    return found


def _named(rows: Sequence[Mapping[str, Any]], noun: str) -> tuple[str, ...]:
    """Return the names of rows; copies that MuJoCo made may have none."""
    taken = {row["name"] for row in rows}
    return tuple(row["name"] or new_name(f"{noun}{index}", taken) for index, row in enumerate(rows))


def _joint(
    row: Mapping[str, Any],
    name: str,
    line: int,
    ends: tuple[str, str],
    frame: Matrix,
    mimic: DescribedMimic | None,
    of_actuators: Mapping[str, float],
) -> DescribedJoint:
    """Return a joint; `frame` is that of the child in the parent where the joint has its reference value."""
    kind = KINDS[row["type"]]
    if row["type"] in (FREE, BALL):
        return DescribedJoint(name, line, kind, *ends, frame)
    rotates = row["type"] == HINGE
    lower, upper = row["range"] if row["limited"] else (-math.inf, math.inf)
    anchor, turned = translation(*row["pos"]), axis_frame(row["axis"])
    # The frame is where the joint has its reference value, not where it has the value 0.
    zero = turned @ motion_z(-row["ref"], rotates) @ inverse(turned)
    return DescribedJoint(
        name,
        line,
        "continuous" if rotates and not row["limited"] else kind,
        *ends,
        origin=frame @ anchor @ zero,
        axis=tuple(row["axis"]),
        child_placement=inverse(anchor),
        mimic=mimic,
        lower=lower,
        upper=upper,
        effort_limit=max(map(abs, row["actfrcrange"])) if row["actfrclimited"] else math.inf,
        damping=row["damping"] + of_actuators["damping"],
        friction=row["friction"],
        rotor_inertia=row["armature"] + of_actuators["armature"],
        has_spring=bool(row["stiffness"]),
    )


def _mimics(model: CompiledMjcf, names: Sequence[str]) -> dict[int, DescribedMimic]:
    """Return what couples of joints say: y - y0 = c0 + c1 (x - x0), about the reference values."""
    found = {}
    for row in model.equalities:
        if row["type"] != JOINT or not row["active0"] or any(row["data"][2:5]):
            continue
        driven, driver = row["obj1id"], row["obj2id"]
        constant, slope = row["data"][:2]
        offset = constant + model.joints[driven]["ref"]
        if driver < 0:
            found[driven] = DescribedMimic("", 0.0, offset)
        else:
            found[driven] = DescribedMimic(names[driver], slope, offset - slope * model.joints[driver]["ref"])
    return found


def _refuse_loops(read: MjcfTree, parts: Mapping[str, Any]) -> None:
    """Refuse equalities between what moves that are no coupling of a joint to another one."""
    carrier = {parts["base_link"]: -1} | {one.name: -1 for one in parts["base_attachments"]}
    for index, link in enumerate(parts["links"]):
        carrier |= dict.fromkeys((link.name, *link.absorbed), index)
    moving = {joint.name for joint in parts["joints"]}
    where = read.document.path
    for row in read.compiled.equalities:
        if not row["active0"]:
            continue
        name = f' "{row["name"]}"' if row["name"] else ""
        if row["type"] in (CONNECT, WELD) and row["objtype"] in (BODY, None):
            ends = [read.body_names[row[key]] for key in ("obj1id", "obj2id")]
            held = any(read.compiled.bodies[row[key]]["mocapid"] >= 0 for key in ("obj1id", "obj2id"))
            if not held and all(end in carrier for end in ends) and carrier[ends[0]] != carrier[ends[1]]:
                raise InputError(
                    f'{where}: the equality{name} ties the bodies "{ends[0]}" and "{ends[1]}" together, which closes '
                    "a loop; a robot is a tree, so lock the joints of the loop, name a tip before it, or remove it"
                )
        elif row["type"] in (CONNECT, WELD):
            raise InputError(
                f"{where}: the equality{name} ties two sites together, which closes a loop; a robot is a tree, so "
                "remove the equality"
            )
        elif row["type"] == JOINT and any(row["data"][2:5]):
            ends = [read.joint_names[row[key]] for key in ("obj1id", "obj2id") if row[key] >= 0]
            if all(end in moving for end in ends):
                raise InputError(
                    f'{where}: the joint "{ends[0]}" follows "{ends[-1]}" by a curved polynomial, but a robot has '
                    f'straight couplings alone; lock it: locked=["{ends[0]}"]'
                )
        elif row["type"] == TENDON:
            tendons = [read.compiled.tendons[row[key]] for key in ("obj1id", "obj2id") if row[key] >= 0]
            ends = [read.joint_names[k] for tendon in tendons for k in tendon["joints"]]
            if any(end in moving for end in ends) or any(tendon["is_spatial"] for tendon in tendons):
                raise InputError(
                    f"{where}: the equality{name} of tendons couples the joints {', '.join(ends[:4])}; only couplings "
                    "of one joint to another can be modelled, so lock these joints or remove the equality"
                )
