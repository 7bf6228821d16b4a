"""From the elements of a URDF to a robot: the tree is checked, fixed and locked joints are merged, mimics resolved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import suggestion

from .inertia import Inertia
from .joint import Attachment, Joint, JointKind, Link
from .placement import axis_frame, inverse, motion_z
from .urdf_document import ONE_DOF, UrdfDocument, UrdfJoint, read_document

__all__ = ["urdf_parts"]

Matrix = NDArray[np.float64]


class _Drive(NamedTuple):
    """Joint value = multiplier * value of the joint `driver` + offset; held still at `offset` without a driver."""

    driver: str | None
    multiplier: float
    offset: float


class _Place(NamedTuple):
    """Where a link of the document is carried: index of the moving link (-1: base) and placement in its frame."""

    link: str
    carrier: int
    placement: Matrix
    locked: bool


def urdf_parts(path: str | Path, tip: str | None, locked: Iterable[str] | Mapping[str, float]) -> dict[str, Any]:
    """Return the fields of the robot that a URDF describes, all but gravity, see `Robot.from_urdf`."""
    document = read_document(path)
    positions = _positions(document, locked)
    root, children = _tree(document)
    chain = None if tip is None else _chain(document, tip)
    return _Assembly(document, positions, children, chain).parts(root)


def _positions(document: UrdfDocument, locked: Iterable[str] | Mapping[str, float]) -> dict[str, float]:
    if isinstance(locked, str):
        raise InputError(
            f'locked must be a list of joint names or a mapping to positions, got "{locked}"; write a list'
        )
    items = locked.items() if isinstance(locked, Mapping) else ((name, 0.0) for name in locked)
    positions: dict[str, float] = {}
    for name, value in items:
        if name not in document.joints:
            raise InputError(
                f'{document.path}: there is no joint "{name}" to lock; {suggestion(str(name), document.joints)}'
            )
        if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
            raise InputError(f'locked joint "{name}": its position must be a finite number (rad or m), got {value!r}')
        kind = document.joints[name].kind
        if kind not in ONE_DOF and value != 0:
            raise InputError(f'locked joint "{name}" is {kind} and can only be locked at 0, got {value!r}')
        positions[name] = float(value)
    return positions


def _tree(document: UrdfDocument) -> tuple[str, dict[str, list[UrdfJoint]]]:
    children: dict[str, list[UrdfJoint]] = {name: [] for name in document.links}
    parent_joint: dict[str, UrdfJoint] = {}
    for joint in document.joints.values():
        other = parent_joint.get(joint.child)
        if other is not None:
            raise InputError(
                f'{document.path}, line {joint.line}: link "{joint.child}" is the child of joint "{other.name}" and of '
                f'joint "{joint.name}"; a link can have one parent only (a closed loop must be cut)'
            )
        parent_joint[joint.child] = joint
        children[joint.parent].append(joint)
    roots = [name for name in document.links if name not in parent_joint]
    if len(roots) > 1:
        raise InputError(
            f"{document.path}: {len(roots)} links have no parent joint ({', '.join(roots[:6])}"
            f"{', ...' if len(roots) > 6 else ''}); a robot has one root, so join them or remove what is not used"
        )
    reached: set[str] = set()
    waiting = list(roots)
    while waiting:
        link = waiting.pop()
        reached.add(link)
        waiting += [joint.child for joint in children[link]]
    loop = [name for name in document.links if name not in reached]
    if loop:
        raise InputError(
            f"{document.path}: the links {', '.join(loop[:6])}{', ...' if len(loop) > 6 else ''} form a cycle; "
            "a robot is a tree, so remove one of their joints"
        )
    return roots[0], children


def _chain(document: UrdfDocument, tip: str) -> set[str]:
    """Names of the joints between the root and the link `tip`."""
    if tip not in document.links:
        raise InputError(f'{document.path}: there is no link "{tip}" for the tip; {suggestion(tip, document.links)}')
    joint_of = {joint.child: joint for joint in document.joints.values()}
    chain: set[str] = set()
    while tip in joint_of:
        chain.add(joint_of[tip].name)
        tip = joint_of[tip].parent
    return chain


class _Assembly:
    """Walks the tree from the root, depth first, and collects moving links and what is merged into them."""

    def __init__(
        self,
        document: UrdfDocument,
        positions: dict[str, float],
        children: dict[str, list[UrdfJoint]],
        chain: set[str] | None,
    ) -> None:
        self.document = document
        self.positions = positions
        self.children = children
        self.chain = chain
        self.joints: list[Joint] = []
        self.names: list[str] = []
        self.attachments: dict[int, list[Attachment]] = {-1: []}

    def parts(self, root: str) -> dict[str, Any]:
        stack = [_Place(root, -1, np.eye(4), False)]
        pending: list[tuple[_Place, UrdfJoint]] = []
        # Depth first without recursion: the children of a link are pushed in reverse, so that the first is taken first.
        self._push(stack.pop(), pending)
        while pending:
            place, joint = pending.pop()
            self._cross(place, joint, pending)
        if not self.joints:
            where = "" if self.chain is None else " between the root and the tip"
            raise InputError(f"{self.document.path}: no joint moves{where}; unlock a joint or choose another file")
        return {
            "name": self.document.name,
            "joints": self._numbered(),
            "links": self._links(),
            "base_link": root,
            "base_attachments": tuple(self.attachments[-1]),
            "source": self.document.path,
        }

    def _push(self, place: _Place, pending: list[tuple[_Place, UrdfJoint]]) -> None:
        pending += [(place, joint) for joint in reversed(self.children[place.link])]

    def _cross(self, place: _Place, joint: UrdfJoint, pending: list[tuple[_Place, UrdfJoint]]) -> None:
        drive = self._drive(joint)
        child = self.document.links[joint.child]
        if drive is None or drive.driver is None:
            held = joint.origin
            if drive is not None and joint.kind in ONE_DOF:
                turned = axis_frame(joint.axis)
                held = joint.origin @ turned @ motion_z(drive.offset, joint.kind != "prismatic") @ inverse(turned)
            merged = _Place(joint.child, place.carrier, place.placement @ held, place.locked or drive is not None)
            attachment = Attachment(child.name, merged.placement, merged.locked, child.inertia)
            self.attachments[place.carrier].append(attachment)
            self._push(merged, pending)
            return
        if self.chain is not None and joint.name not in self.chain:
            return
        index = len(self.joints)
        self.joints.append(self._moving(place, joint, drive))
        self.names.append(joint.child)
        self.attachments[index] = []
        self._push(_Place(joint.child, index, np.eye(4), False), pending)

    def _moving(self, place: _Place, joint: UrdfJoint, drive: _Drive) -> Joint:
        turned = axis_frame(joint.axis)
        return Joint(
            name=joint.name,
            kind=self._kind(joint),
            parent=place.carrier,
            before=place.placement @ joint.origin @ turned,
            after=inverse(turned),
            coordinate=-1,
            multiplier=drive.multiplier,
            offset=drive.offset,
            mimics=None if drive.driver == joint.name else drive.driver,
            lower=joint.lower,
            upper=joint.upper,
            velocity_limit=joint.velocity_limit,
            effort_limit=joint.effort_limit,
            damping=joint.damping,
            friction=joint.friction,
        )

    def _kind(self, joint: UrdfJoint) -> JointKind:
        match joint.kind:
            case "revolute" | "continuous" | "prismatic" as kind:
                return kind
        known = (*ONE_DOF, "fixed")
        hint = "" if joint.kind in ("floating", "planar", "spherical") else f" ({suggestion(joint.kind, known)})"
        raise InputError(
            f'{self.document.path}, line {joint.line}: joint "{joint.name}" is of type "{joint.kind}"; only '
            f'{", ".join(known)} can be modelled{hint}, so lock it: locked=["{joint.name}"]'
        )

    def _drive(self, joint: UrdfJoint) -> _Drive | None:
        """What moves a joint: None for a fixed one; mimics of mimics are followed to the joint that drives them all."""
        if joint.kind == "fixed":
            return None
        multiplier, offset = 1.0, 0.0
        followed: list[str] = []
        current = joint
        while True:
            if current.name in self.positions:
                return _Drive(None, 0.0, multiplier * self.positions[current.name] + offset)
            if current.kind == "fixed":
                return _Drive(None, 0.0, offset)
            if current.mimic is None:
                break
            if current.name in followed:
                raise InputError(
                    f'{self.document.path}, line {joint.line}: joint "{joint.name}" mimics itself through '
                    f"{' -> '.join([*followed, current.name])}; one of them must not mimic"
                )
            followed.append(current.name)
            offset += multiplier * current.mimic.offset
            multiplier *= current.mimic.multiplier
            if multiplier == 0.0:
                return _Drive(None, 0.0, offset)
            if current.mimic.joint not in self.document.joints:
                raise InputError(
                    f'{self.document.path}, line {current.line}: joint "{current.name}" mimics the unknown joint '
                    f'"{current.mimic.joint}" ({suggestion(current.mimic.joint, self.document.joints)}); '
                    f'mend the name or lock it: locked=["{current.name}"]'
                )
            current = self.document.joints[current.mimic.joint]
        return _Drive(current.name, multiplier, offset)

    def _numbered(self) -> tuple[Joint, ...]:
        """The joints with their coordinates: driving joints are counted in order, mimics share their driver's."""
        coordinates: dict[str, int] = {}
        for joint in self.joints:
            if joint.mimics is None:
                coordinates[joint.name] = len(coordinates)
        for joint in self.joints:
            if joint.mimics is not None and joint.mimics not in coordinates:
                raise InputError(
                    f'{self.document.path}: joint "{joint.name}" mimics "{joint.mimics}", which is not between the '
                    f'root and the tip; choose another tip or lock it: locked=["{joint.name}"]'
                )
        return tuple(replace(joint, coordinate=coordinates[joint.mimics or joint.name]) for joint in self.joints)

    def _links(self) -> tuple[Link, ...]:
        own = [self.document.links[name].inertia for name in self.names]
        parts = [
            one for index in range(len(own)) for one in (own[index], *(a.inertia for a in self.attachments[index]))
        ]
        if all(part is None for part in parts):
            return tuple(
                Link(name, attachments=tuple(self.attachments[index])) for index, name in enumerate(self.names)
            )
        links = []
        for index, name in enumerate(self.names):
            attachments = tuple(self.attachments[index])
            total = own[index] or Inertia.zero()
            for attachment in attachments:
                if attachment.inertia is not None:
                    total = total + attachment.inertia.moved(attachment.placement)
            links.append(Link(name, total, attachments, own[index]))
        return tuple(links)
