"""Joints and links: the parts of a robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .inertia import Inertia
from .placement import frozen, motion_z

__all__ = ["Attachment", "Drives", "Joint", "JointKind", "LeftOut", "Link", "differing_joint", "joint_geometry"]

Matrix = NDArray[np.float64]
JointKind = Literal["revolute", "continuous", "prismatic"]

# Angles and lengths (rad, m) by which placements may differ: more than the rounding of "1.5708" in a description, and
# much less than an identified inertia can tell.
SAME_PLACEMENT = 1e-4


@dataclass(frozen=True, eq=False)
class Attachment:
    """A link of the source that was merged into a moving link or into the base.

    Parameters
    ----------
    name : str
        Its name in the source.
    placement : (4, 4) array
        Its frame in the frame of the link that carries it.
    locked : bool
        Whether a locked joint lies between the two; if not, only fixed joints do.
    inertia : Inertia or None
        Its own CAD inertia in its own frame; None where the source gives none.

    Examples
    --------
    >>> Attachment("camera", np.eye(4))
    Attachment('camera', fixed)
    """

    name: str
    placement: Matrix
    locked: bool = False
    inertia: Inertia | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "placement", frozen(self.placement, (4, 4)))

    def __repr__(self) -> str:
        return f"Attachment({self.name!r}, {'locked' if self.locked else 'fixed'})"


class LeftOut(NamedTuple):
    """A branch of a description that a moving link carries, and that is no part of the robot, since it has a tip.

    Attributes
    ----------
    carrier : str
        The name of the moving link.
    joints : tuple of str
        The joints of the branch that would have to be locked for it to be part of the robot.
    mass : float
        Of its links in the description, kg.
    """

    carrier: str
    joints: tuple[str, ...]
    mass: float


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body that a joint moves.

    Parameters
    ----------
    name : str
        Name of the link.
    inertia : Inertia or None
        CAD inertia in the link frame, all merged links included; None where it is unknown.
    attachments : tuple of Attachment
        The links of the source that were merged into this one.
    own_inertia : Inertia or None
        CAD inertia of the link alone, without the merged ones.

    Examples
    --------
    >>> Link("hand", attachments=(Attachment("camera", np.eye(4)),)).absorbed
    ('camera',)
    """

    name: str
    inertia: Inertia | None = None
    attachments: tuple[Attachment, ...] = ()
    own_inertia: Inertia | None = None

    @property
    def absorbed(self) -> tuple[str, ...]:
        """Names of the links that were merged into this one."""
        return tuple(attachment.name for attachment in self.attachments)

    def __repr__(self) -> str:
        mass = "unknown mass" if self.inertia is None else f"{self.inertia.mass:.6g} kg"
        merged = f", with {', '.join(self.absorbed)}" if self.attachments else ""
        return f"Link({self.name!r}, {mass}{merged})"


def _unknown() -> Matrix:
    """Stand for values of which none was given."""
    return np.zeros(0)


SPRINGS_AND_POWERS = ("spring_stiffness", "spring_rest", "quadratic_damping", "cubic_damping")
"""What few robots have, and few formats hold."""

FARTHEST_REST = 100.0
"""rad or m: springs that nobody has come out with 3e-7 N m/rad, the least that is feasible, and offsets of 0.01 N m."""


@dataclass(frozen=True, eq=False)
class Drives:
    """Inertia, damping and friction that drives add to each coordinate when it moves alone; NaN where unknown.

    Parameters
    ----------
    damping : (N,) array
        Viscous friction, N m s/rad or N s/m.
    friction : (N,) array
        Coulomb friction, N m or N.
    rotor_inertia : (N,) array
        Inertia of the rotors as the joints feel it, kg m² or kg.
    offset : (N,) array
        Constant torque, N m or N.
    spring_stiffness, spring_rest : (N,) array, optional
        Of a spring, N m/rad or N/m, and where it exerts no torque, rad or m.
    quadratic_damping, cubic_damping : (N,) array, optional
        Friction by ``|dq| dq`` and by ``dq³``, N m s²/rad² and N m s³/rad³, or N s²/m² and N s³/m³.
    stiffness, transmission_damping : (N,) array, optional
        Of the transmissions of elastic joints, N m/rad and N m s/rad, or N/m and N s/m.

    Examples
    --------
    >>> Drives.unknown(2).with_known(damping=[0.1, 0.2]).damping.tolist()
    [0.1, 0.2]
    """

    damping: Matrix
    friction: Matrix
    rotor_inertia: Matrix
    offset: Matrix
    spring_stiffness: Matrix = field(default_factory=_unknown)
    spring_rest: Matrix = field(default_factory=_unknown)
    quadratic_damping: Matrix = field(default_factory=_unknown)
    cubic_damping: Matrix = field(default_factory=_unknown)
    stiffness: Matrix = field(default_factory=_unknown)
    transmission_damping: Matrix = field(default_factory=_unknown)

    def __post_init__(self) -> None:
        for one in fields(self):
            values = np.asarray(getattr(self, one.name), dtype=float)
            if not values.size:
                values = np.full(np.shape(self.damping), np.nan)
            object.__setattr__(self, one.name, frozen(values, values.shape[:1]))

    @classmethod
    def unknown(cls, count: int) -> Drives:
        """Drives of which nothing is known."""
        return cls(*(np.full(count, np.nan) for _ in fields(cls)))

    def held_by_joints(self) -> dict[str, Matrix]:
        """The names of the values that are fields of `Joint`."""
        return {name: values for name, values in vars(self).items() if name not in self.without_joint}

    def always_told(self) -> dict[str, Any]:
        """The names of the values that every estimate tells."""
        return {name: getattr(self, name) for name in ("damping", "friction", "rotor_inertia", "offset")}

    def told_where_present(self) -> dict[str, Matrix]:
        """Springs and friction of higher powers, by their names, where the robot has any."""
        return {name: getattr(self, name) for name in SPRINGS_AND_POWERS if np.isfinite(getattr(self, name)).any()}

    def with_offsets_in_springs(self) -> Drives:
        """The same torques with the offsets of joints that have a spring in its place of rest, and zero themselves.

        No motion tells the two apart, and few formats hold an offset. That of a spring so weak that it would rest
        beyond `FARTHEST_REST` stays.

        Examples
        --------
        >>> drives = Drives.unknown(1).with_known(spring_stiffness=[40.0], spring_rest=[0.0], offset=[-12.0])
        >>> drives.with_offsets_in_springs().spring_rest.tolist()
        [0.3]
        """
        stiffness, offset = np.nan_to_num(self.spring_stiffness), np.nan_to_num(self.offset)
        rest = np.nan_to_num(self.spring_rest)
        far = np.maximum(np.abs(rest), FARTHEST_REST)
        held = (offset != 0.0) & (np.abs(stiffness * rest - offset) <= stiffness * far)
        moved = rest - np.divide(offset, stiffness, out=np.zeros_like(rest), where=held)
        return replace(
            self,
            offset=np.where(held, 0.0, self.offset),
            spring_rest=np.where(held, moved, self.spring_rest),
        )

    @property
    def without_joint(self) -> tuple[str, ...]:
        """Names of those that no joint of a description holds."""
        return ("offset", *SPRINGS_AND_POWERS, "stiffness", "transmission_damping")

    def told(self, name: str, joint: str, coordinate: int) -> float:
        """Return one of these values at the coordinate of a joint.

        Raises
        ------
        InputError
            If it is infinite.
        """
        value = float(getattr(self, name)[coordinate])
        if np.isinf(value):
            raise InputError(f'joint "{joint}": its {name} must be finite, got {value}')
        return value

    def with_known(self, **values: ArrayLike | None) -> Drives:
        """Return the same drives with other values; None leaves them."""
        return replace(self, **{name: np.asarray(value) for name, value in values.items() if value is not None})


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint with one degree of freedom, about or along the z axis between two constant placements.

    The frame of the moved link lies in the frame of the parent link at `before @ motion_z(value) @ after`, where
    `value = multiplier * q[coordinate] + offset`.

    Parameters
    ----------
    name : str
        Name of the joint.
    kind : {"revolute", "continuous", "prismatic"}
        Kind of motion: a turn about z (rad) or a shift along z (m).
    parent : int
        Index of the parent link, -1 for the base.
    before, after : (4, 4) array
        Constant placements before and after the motion.
    coordinate : int
        Index of the joint coordinate in q.
    multiplier, offset : float
        The joint value is `multiplier * q[coordinate] + offset`; other than 1 and 0 only in mimic joints.
    mimics : str or None
        Name of the joint that drives this one; None for a driving joint.
    lower, upper : float
        Limits of the joint value, rad or m; infinite where unknown.
    velocity_limit, effort_limit : float
        Limits of speed (rad/s or m/s) and effort (N m or N); infinite where unknown.
    before_lengths, after_lengths : mapping
        Symbolic lengths (m): for each name the vector (3,) by which it adds to the translation of `before` or `after`.
    damping, friction : float
        Viscous (N m s/rad or N s/m) and Coulomb friction (N m or N) of the description; NaN where unknown.
    rotor_inertia : float
        Inertia of the rotor as the joint feels it (kg m² or kg); NaN where the description does not say.
    torque_offset : float
        Constant torque that the drive gives beyond all others (N m or N); NaN where the description does not say.
    has_spring : bool
        Whether the description has a spring at the joint, which the term `spring` models.

    Examples
    --------
    >>> slide = Joint("slide", "prismatic", parent=-1, before=np.eye(4), after=np.eye(4), coordinate=0)
    >>> slide.placement(0.25)[:3, 3].tolist()
    [0.0, 0.0, 0.25]
    """

    name: str
    kind: JointKind
    parent: int
    before: Matrix
    after: Matrix
    coordinate: int
    multiplier: float = 1.0
    offset: float = 0.0
    mimics: str | None = None
    lower: float = -np.inf
    upper: float = np.inf
    velocity_limit: float = np.inf
    effort_limit: float = np.inf
    damping: float = np.nan
    friction: float = np.nan
    rotor_inertia: float = np.nan
    before_lengths: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    after_lengths: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    torque_offset: float = np.nan
    has_spring: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "before", frozen(self.before, (4, 4)))
        object.__setattr__(self, "after", frozen(self.after, (4, 4)))

    def with_lengths(self, values: Mapping[str, float]) -> Joint:
        """Return the same joint with numbers (m) for these symbolic lengths."""
        placements = []
        for placement, symbols in ((self.before, self.before_lengths), (self.after, self.after_lengths)):
            moved = np.array(placement)
            for name, direction in symbols.items():
                if name in values:
                    moved[:3, 3] += values[name] * np.array(direction)
            placements.append((moved, {name: d for name, d in symbols.items() if name not in values}))
        (before, before_lengths), (after, after_lengths) = placements
        return replace(self, before=before, after=after, before_lengths=before_lengths, after_lengths=after_lengths)

    @property
    def rotates(self) -> bool:
        """Whether the joint turns (revolute, continuous) rather than slides (prismatic)."""
        return self.kind != "prismatic"

    def placement(self, coordinate_value: float) -> Matrix:
        """Placement (4, 4) of the link frame in the parent link's frame, at this value of the coordinate."""
        motion = motion_z(self.multiplier * coordinate_value + self.offset, self.rotates)
        return np.asarray(self.before @ motion @ self.after)

    def __repr__(self) -> str:
        mimic = f", mimics {self.mimics!r}: {self.multiplier:g} q + {self.offset:g}" if self.mimics else ""
        return f"Joint({self.name!r}, {self.kind}, parent={self.parent}, coordinate={self.coordinate}{mimic})"


def joint_geometry(joints: Sequence[Joint]) -> list[dict[str, Any]]:
    """Return of every joint, mimic joints among them, what the frame of its link rests on, as plain data.

    Where the base stands is left out: nothing of an inertia in the frame of a moving link depends on it. The joints are
    those of a robot, in its order.
    """
    return [
        {
            "name": joint.name,
            "turns": joint.rotates,
            "parent": joint.parent,
            "before": joint.before[:3].ravel().tolist() if joint.parent >= 0 else [],
            "after": joint.after[:3].ravel().tolist(),
            "motion": [float(joint.coordinate), joint.multiplier, joint.offset],
        }
        for joint in joints
    ]


def differing_joint(recorded: Sequence[Any], joints: Sequence[Joint]) -> str:
    """Return the name of the first joint that is placed or moves otherwise than was recorded; empty where none does.

    Parameters
    ----------
    recorded : sequence of mapping
        What `joint_geometry` returned for joints of the same names.

    Raises
    ------
    TypeError, ValueError, KeyError
        If it is something else.
    """
    for one, own in zip(recorded, joint_geometry(joints), strict=True):
        same = all(one[key] == own[key] for key in ("name", "turns", "parent"))
        if not same or not all(
            len(one[key]) == len(own[key]) and np.allclose(one[key], own[key], rtol=0.0, atol=SAME_PLACEMENT)
            for key in ("before", "after", "motion")
        ):
            return str(own["name"])
    return ""
