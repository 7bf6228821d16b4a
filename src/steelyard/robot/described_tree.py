"""A robot from the links and joints of a description: fixed and locked joints are merged, mimics resolved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import is_real, shown, suggestion
from steelyard.files.arguments import LARGEST, LONGEST_NAME

from .inertia import Inertia
from .joint import Attachment, Joint, JointKind, LeftOut, Link
from .placement import axis_frame, inverse, motion_z

__all__ = [
    "ONE_DOF",
    "DescribedJoint",
    "DescribedLink",
    "DescribedMimic",
    "DescribedTree",
    "robot_parts",
    "with_extension",
]

Matrix = NDArray[np.float64]

ONE_DOF = ("revolute", "continuous", "prismatic")
REFUSED = {
    "floating": "this one has six degrees of freedom",
    "planar": "this one has three degrees of freedom",
    "spherical": "this one has three degrees of freedom",
    "ball": "this one has three degrees of freedom",
    "universal": "this one has two degrees of freedom",
    "revolute2": "this one has two degrees of freedom",
    "screw": "this one turns and slides together",
    "gearbox": "this one couples two joints and closes a loop",
}
"""Why joints of a kind are not modelled."""
ENDLESS = 1e4
"""rad or m. Some descriptions write ±999999 where a joint has no limit; taken for a stroke, a slide would be as long,
and so would bodies that are guessed by it."""
MOST_JOINTS, MOST_LINKS = 500, 5000
"""Joints that move, and links. The time and the memory that a model takes grow with their square or cube: a chain of
500 moving joints takes half a minute and 0.8 GB."""


@dataclass(frozen=True, eq=False)
class DescribedLink:
    """A link as a description has it; `line` is where it stands in the file."""

    name: str
    line: int
    inertia: Inertia | None


@dataclass(frozen=True)
class DescribedMimic:
    """The relation by which another joint drives this one: value = multiplier * value of `joint` + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class DescribedJoint:
    """A joint as a description has it.

    Parameters
    ----------
    line : int
        Where it stands in the file.
    kind : str
        One of `ONE_DOF` and ``"fixed"``; joints of other kinds can be locked alone.
    parent, child : str
        Names of links.
    origin : (4, 4) array
        Frame of the joint in the frame of the parent link.
    axis : tuple of 3 floats
        In the frame of the joint; not a zero vector.
    child_placement : (4, 4) array
        Frame of the child link in the frame of the joint, at the value 0.
    lower, upper, velocity_limit, effort_limit, damping, friction, rotor_inertia : float
        As in `Joint`, and so are `before_lengths`, `after_lengths`, `torque_offset` and `has_spring`.
    """

    name: str
    line: int
    kind: str
    parent: str
    child: str
    origin: Matrix
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    child_placement: Matrix = field(default_factory=lambda: np.eye(4))
    mimic: DescribedMimic | None = None
    lower: float = -math.inf
    upper: float = math.inf
    velocity_limit: float = math.inf
    effort_limit: float = math.inf
    damping: float = math.nan
    friction: float = math.nan
    rotor_inertia: float = math.nan
    before_lengths: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    after_lengths: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    torque_offset: float = math.nan
    has_spring: bool = False


@dataclass(frozen=True, eq=False)
class DescribedTree:
    """Links and joints in the order of a description; names are unique, parents and children are known.

    Parameters
    ----------
    where : str
        The file or table, for messages.
    name : str
        Of the robot.
    links, joints : dict
        By name.
    source : Path or None
        The file.
    unwritten_is_massless : bool
        Whether a link without inertia has no mass where others have one; if not, its inertia is unknown.
    remarks : tuple of str
        What the description holds that a robot does not, and how it was read.
    """

    where: str
    name: str
    links: dict[str, DescribedLink]
    joints: dict[str, DescribedJoint]
    source: Path | None = None
    unwritten_is_massless: bool = True
    remarks: tuple[str, ...] = ()


class _Drive(NamedTuple):
    """Joint value = multiplier * value of the joint `driver` + offset; held still at `offset` without a driver."""

    driver: str | None
    multiplier: float
    offset: float


class _Place(NamedTuple):
    """The moving link that carries a link of the description: its index (-1: base), and the placement in its frame."""

    link: str
    carrier: int
    placement: Matrix
    locked: bool


def with_extension(
    joints: Mapping[str, DescribedJoint], told: Mapping[str, Mapping[str, Any]]
) -> dict[str, DescribedJoint]:
    """Return the joints with these values of their fields, by the names of joints; other names are passed over."""
    return {name: replace(joint, **told.get(name, {})) for name, joint in joints.items()}


def robot_parts(tree: DescribedTree, tip: str | None, locked: Iterable[str] | Mapping[str, float]) -> dict[str, Any]:
    """Return the fields of the robot that a tree describes, all but gravity.

    Parameters
    ----------
    tip : str or None
        Keep only the chain from the root to this link.
    locked : iterable of names, or mapping from name to position
        Joints held still, at 0 or at the position (rad or m).

    Raises
    ------
    InputError
        If there is no such link or joint, links and joints form no tree, or nothing moves.
    """
    if len(tree.links) > MOST_LINKS:
        raise InputError(f"{tree.where}: has {len(tree.links)} links, more than {MOST_LINKS}; remove some")
    names = (("robot", [tree.name]), ("link", tree.links), ("joint", tree.joints))
    long = next(((kind, name) for kind, found in names for name in found if len(name) > LONGEST_NAME), None)
    if long is not None:
        raise InputError(f"{tree.where}: the name of a {long[0]} is {shown(long[1])}; give a shorter one")
    positions = _positions(tree, locked)
    root, children = _tree(tree)
    chain = None if tip is None else _chain(tree, tip)
    parts = _Assembly(tree, positions, children, chain).parts(root)
    return {**parts, "read_with": {key: value for key, value in (("tip", tip), ("locked", positions)) if value}}


def _positions(tree: DescribedTree, locked: Iterable[str] | Mapping[str, float]) -> dict[str, float]:
    if isinstance(locked, str):
        raise InputError(
            f'locked must be a list of joint names or a mapping to positions, got "{locked}"; write a list'
        )
    items = locked.items() if isinstance(locked, Mapping) else ((name, 0.0) for name in locked)
    positions: dict[str, float] = {}
    for name, value in items:
        if name not in tree.joints:
            raise InputError(f'{tree.where}: there is no joint "{name}" to lock; {suggestion(str(name), tree.joints)}')
        if not is_real(value) or not math.isfinite(value):
            raise InputError(f'locked joint "{name}": its position must be a finite number (rad or m), got {value!r}')
        kind = tree.joints[name].kind
        if kind not in ONE_DOF and value != 0:
            raise InputError(f'locked joint "{name}" is {kind} and can only be locked at 0, got {value!r}')
        positions[name] = float(value)
    return positions


def _tree(tree: DescribedTree) -> tuple[str, dict[str, list[DescribedJoint]]]:
    children: dict[str, list[DescribedJoint]] = {name: [] for name in tree.links}
    parent_joint: dict[str, DescribedJoint] = {}
    for joint in tree.joints.values():
        other = parent_joint.get(joint.child)
        if other is not None:
            raise InputError(
                f'{tree.where}, line {joint.line}: link "{joint.child}" is the child of joint "{other.name}" and of '
                f'joint "{joint.name}"; a link can have one parent only (a closed loop must be cut)'
            )
        parent_joint[joint.child] = joint
        children[joint.parent].append(joint)
    roots = [name for name in tree.links if name not in parent_joint]
    if len(roots) > 1:
        raise InputError(
            f"{tree.where}: {len(roots)} links have no parent joint ({', '.join(roots[:6])}"
            f"{', ...' if len(roots) > 6 else ''}); a robot has one root, so join them or remove what is not used"
        )
    reached: set[str] = set()
    waiting = list(roots)
    while waiting:
        link = waiting.pop()
        reached.add(link)
        waiting += [joint.child for joint in children[link]]
    loop = [name for name in tree.links if name not in reached]
    if loop:
        raise InputError(
            f"{tree.where}: the links {', '.join(loop[:6])}{', ...' if len(loop) > 6 else ''} form a cycle; "
            "a robot is a tree, so remove one of their joints"
        )
    return roots[0], children


def _chain(tree: DescribedTree, tip: str) -> set[str]:
    """Names of the joints between the root and the link `tip`."""
    if tip not in tree.links:
        raise InputError(f'{tree.where}: there is no link "{tip}" for the tip; {suggestion(tip, tree.links)}')
    joint_of = {joint.child: joint for joint in tree.joints.values()}
    chain: set[str] = set()
    while tip in joint_of:
        chain.add(joint_of[tip].name)
        tip = joint_of[tip].parent
    return chain


class _Assembly:
    """Walks the tree from the root, depth first, and collects moving links and what is merged into them."""

    def __init__(
        self,
        tree: DescribedTree,
        positions: dict[str, float],
        children: dict[str, list[DescribedJoint]],
        chain: set[str] | None,
    ) -> None:
        self.tree = tree
        self.positions = positions
        self.children = children
        self.chain = chain
        self.joints: list[Joint] = []
        self.names: list[str] = []
        self.described_joints: list[str] = []
        self.attachments: dict[int, list[Attachment]] = {-1: []}
        self.left_out: list[LeftOut] = []

    def parts(self, root: str) -> dict[str, Any]:
        stack = [_Place(root, -1, np.eye(4), False)]
        pending: list[tuple[_Place, DescribedJoint]] = []
        # Depth first without recursion: the children of a link are pushed in reverse, so that the first is taken first.
        self._push(stack.pop(), pending)
        while pending:
            place, joint = pending.pop()
            self._cross(place, joint, pending)
        if len(self.joints) > MOST_JOINTS:
            raise InputError(f"{self.tree.where}: more than {MOST_JOINTS} joints move; lock some, or give a tip")
        if not self.joints:
            where = "" if self.chain is None else " between the root and the tip"
            raise InputError(f"{self.tree.where}: no joint moves{where}; unlock a joint or choose another file")
        return {
            "name": self.tree.name,
            "joints": self._numbered(),
            "links": self._links(),
            "described_joints": tuple(self.described_joints) if self.positions else (),
            "base_link": root,
            "base_attachments": tuple(self.attachments[-1]),
            "base_inertia": self.tree.links[root].inertia,
            "source": self.tree.source,
            "remarks": self.tree.remarks,
            "left_out": tuple(self.left_out),
        }

    def _push(self, place: _Place, pending: list[tuple[_Place, DescribedJoint]]) -> None:
        pending += [(place, joint) for joint in reversed(self.children[place.link])]

    def _cross(self, place: _Place, joint: DescribedJoint, pending: list[tuple[_Place, DescribedJoint]]) -> None:
        drive = self._drive(joint)
        child = self.tree.links[joint.child]
        is_within = self.chain is None or joint.name in self.chain
        if is_within and joint.mimic is None and joint.kind in ONE_DOF:
            self.described_joints.append(joint.name)
        if drive is None or drive.driver is None:
            held = joint.origin
            if drive is not None and joint.kind in ONE_DOF:
                turned = axis_frame(joint.axis)
                held = joint.origin @ turned @ motion_z(drive.offset, joint.kind != "prismatic") @ inverse(turned)
            self._require_numbers(joint)
            held = held @ joint.child_placement
            merged = _Place(joint.child, place.carrier, place.placement @ held, place.locked or drive is not None)
            attachment = Attachment(child.name, merged.placement, merged.locked, child.inertia)
            self.attachments[place.carrier].append(attachment)
            self._push(merged, pending)
            return
        if not is_within:
            if place.carrier >= 0:
                self.left_out.append(self._branch(self.names[place.carrier], joint))
            return
        index = len(self.joints)
        self.joints.append(self._moving(place, joint, drive))
        self.names.append(joint.child)
        self.attachments[index] = []
        self._push(_Place(joint.child, index, np.eye(4), False), pending)

    def _branch(self, carrier: str, first: DescribedJoint) -> LeftOut:
        joints: list[str] = []
        mass, pending, chain = 0.0, [first], self.chain or ()
        while pending:
            joint = pending.pop()
            if joint.kind != "fixed":  # what follows a joint that is locked is locked with it
                follows = joint.mimic is not None and joint.mimic.joint not in chain
                joints.append(joint.mimic.joint if joint.mimic is not None and follows else joint.name)
            inertia = self.tree.links[joint.child].inertia
            mass += 0.0 if inertia is None else inertia.mass
            pending += reversed(self.children[joint.child])
        return LeftOut(carrier, tuple(dict.fromkeys(joints)), mass)

    def _moving(self, place: _Place, joint: DescribedJoint, drive: _Drive) -> Joint:
        turned = axis_frame(joint.axis)
        return Joint(
            name=joint.name,
            kind=self._kind(joint),
            parent=place.carrier,
            before=place.placement @ joint.origin @ turned,
            after=inverse(turned) @ joint.child_placement,
            coordinate=-1,
            multiplier=drive.multiplier,
            offset=drive.offset,
            mimics=None if drive.driver == joint.name else drive.driver,
            lower=joint.lower if abs(joint.lower) < ENDLESS else -math.inf,
            upper=joint.upper if abs(joint.upper) < ENDLESS else math.inf,
            # Descriptions write a speed or an effort of zero where they know none.
            velocity_limit=joint.velocity_limit if joint.velocity_limit > 0.0 else math.inf,
            effort_limit=joint.effort_limit if joint.effort_limit > 0.0 else math.inf,
            damping=joint.damping,
            friction=joint.friction,
            rotor_inertia=joint.rotor_inertia,
            torque_offset=joint.torque_offset,
            has_spring=joint.has_spring,
            before_lengths={
                name: tuple((place.placement[:3, :3] @ direction).tolist())
                for name, direction in joint.before_lengths.items()
            },
            after_lengths=joint.after_lengths,
        )

    def _require_numbers(self, joint: DescribedJoint) -> None:
        symbols = (*joint.before_lengths, *joint.after_lengths)
        if symbols:
            raise InputError(
                f'{self.tree.where}: joint "{joint.name}" is locked, but its length {symbols[0]} is a symbol; '
                "give it a number"
            )

    def _kind(self, joint: DescribedJoint) -> JointKind:
        match joint.kind:
            case "revolute" | "continuous" | "prismatic" as kind:
                return kind
        known = (*ONE_DOF, "fixed")
        hint = REFUSED.get(joint.kind) or suggestion(joint.kind, known)
        raise InputError(
            f'{self.tree.where}, line {joint.line}: joint "{joint.name}" is of type "{joint.kind}"; only '
            f'{", ".join(known)} can be modelled ({hint}), so lock it: locked=["{joint.name}"]'
        )

    def _drive(self, joint: DescribedJoint) -> _Drive | None:
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
                    f'{self.tree.where}, line {joint.line}: joint "{joint.name}" mimics itself through '
                    f"{' -> '.join([*followed, current.name])}; one of them must not mimic"
                )
            followed.append(current.name)
            offset += multiplier * current.mimic.offset
            multiplier *= current.mimic.multiplier
            if multiplier == 0.0:
                return _Drive(None, 0.0, offset)
            if current.mimic.joint not in self.tree.joints:
                raise InputError(
                    f'{self.tree.where}, line {current.line}: joint "{current.name}" mimics the unknown joint '
                    f'"{current.mimic.joint}" ({suggestion(current.mimic.joint, self.tree.joints)}); '
                    f'mend the name or lock it: locked=["{current.name}"]'
                )
            current = self.tree.joints[current.mimic.joint]
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
                    f'{self.tree.where}: joint "{joint.name}" mimics "{joint.mimics}", which is not between the '
                    f'root and the tip; choose another tip or lock it: locked=["{joint.name}"]'
                )
        return tuple(replace(joint, coordinate=coordinates[joint.mimics or joint.name]) for joint in self.joints)

    def _links(self) -> tuple[Link, ...]:
        own = [self.tree.links[name].inertia for name in self.names]
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
            if not self.tree.unwritten_is_massless and all(a.inertia is None for a in attachments) and not own[index]:
                links.append(Link(name, attachments=attachments))
                continue
            total = own[index] or Inertia.zero()
            for attachment in attachments:
                if attachment.inertia is not None:
                    total = total + attachment.inertia.moved(attachment.placement)
            # A number of the description may be one that a robot has, and its square, or a volume, not.
            if not np.all(np.abs(total.pseudo_inertia) <= LARGEST):
                raise InputError(
                    f'{self.tree.where}: link "{name}" has a mass or an inertia beyond {LARGEST:g}, which no robot '
                    "has; mend its mass, its shapes or where they stand"
                )
            links.append(Link(name, total, attachments, own[index]))
        return tuple(links)
