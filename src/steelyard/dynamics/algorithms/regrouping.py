"""Mass moved from link to link without changing any torque, written over generic scalars.

What lies on the axis of a revolute joint might belong to either of its links: a mass, a first moment along the axis,
and a second moment along it. Moving them towards the base leaves links with seven parameters or fewer, as in the base
parameters (thesis section 2.5.1), and the recursions over the links with fewer operations. It is a change of the
parameters alone, so that it is done once for any number of samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from steelyard.graph.expression import is_zero

from .kinematics import ZERO, JointFrame, Vector3, add, scale, unit_vector

__all__ = ["JointLine", "joint_line", "regrouped"]

_DIAGONAL = (0, 3, 5)


@dataclass(frozen=True)
class JointLine:
    """The axis of a revolute joint as a line of both links, along a coordinate axis of each.

    Attributes
    ----------
    axis, parent_axis : (int, float)
        Index and sign of the coordinate axis, in the link frame and in the parent's.
    point, parent_point : Vector3
        One and the same point of the line, in the link frame and in the parent's; the former lies across the axis.
    """

    axis: tuple[int, float]
    parent_axis: tuple[int, float]
    point: Vector3
    parent_point: Vector3


def joint_line(frame: JointFrame) -> JointLine | None:
    """Return the axis of a joint, or None where it slides or stands askew to the link frames."""
    axis, parent_axis = unit_vector(frame.axis), unit_vector(frame.parent_axis)
    if not frame.rotates or axis is None or parent_axis is None:
        return None
    k, sign = axis
    along = frame.arm[k]
    point = tuple(0.0 if i == k else -x for i, x in enumerate(frame.arm))
    parent_point = add(frame.base_point, scale(frame.parent_axis, along * sign))
    return JointLine(axis, parent_axis, point, parent_point)  # type: ignore[arg-type]


def _line_of_mass(p: Vector3, e: Vector3, mass: Any, first: Any) -> list[Any]:
    """Ten parameters of mass on the line ``p + s e``: its mass, and its first moment along the line about p."""
    moment = add(scale(p, mass), scale(e, first))
    # Second moments p l' + first e p', of which L = tr(S) 1 - S.
    inertia = _inertia([[p[i] * moment[j] + (first * p[j]) * e[i] for j in range(3)] for i in range(3)])
    return [*inertia, *moment, mass]


def _inertia(second: Sequence[Sequence[Any]]) -> list[Any]:
    """Return ``Lxx Lxy Lxz Lyy Lyz Lzz`` of second moments of mass."""
    xx, yy, zz = second[0][0], second[1][1], second[2][2]
    return [yy + zz, -second[0][1], -second[0][2], xx + zz, -second[1][2], xx + yy]


def _moved(parameters: Sequence[Any], s: Vector3) -> list[Any]:
    """Refer the parameters of a body to a new origin, from which the old one stands at `s`."""
    first, mass = (parameters[6], parameters[7], parameters[8]), parameters[9]
    shift = scale(s, mass)
    both = add(first, shift)
    change = _inertia([[s[i] * both[j] + first[i] * s[j] for j in range(3)] for i in range(3)])
    inertia = [p + c for p, c in zip(parameters[:6], change, strict=True)]
    return [*inertia, *both, mass]


def regrouped(
    frames: Sequence[JointFrame], link_parameters: Sequence[Sequence[Any]]
) -> tuple[list[JointFrame], list[list[Any]]]:
    """Move what lies on the joint axes towards the base, and the frames of the last links to their joints.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    link_parameters : sequence
        For each link its ten barycentric parameters.

    Returns
    -------
    frames : list of JointFrame
    link_parameters : list of list of scalar
        With these two all joint torques are as before, at all motions.
    """
    moved_frames = list(frames)
    parameters = [list(p) for p in link_parameters]
    parents = {frame.joint.parent for frame in frames}
    for index in reversed(range(len(frames))):
        frame = frames[index]
        line = joint_line(frame)
        if line is None:
            continue
        _move_to_parent(parameters, index, frame, line)
        if index not in parents:
            # No joint follows, so the origin may stand on the axis, as near to the parent's as can be.
            parent_k, parent_sign = line.parent_axis
            along = line.parent_point[parent_k]
            beside = tuple(0.0 if i == parent_k else x for i, x in enumerate(line.parent_point))
            shift = add(scale(frame.axis, parent_sign * along), scale(line.point, -1.0))
            moved_frames[index] = replace(frame, base_point=beside, arm=ZERO)  # type: ignore[arg-type]
            parameters[index] = _moved(parameters[index], shift)
    return moved_frames, parameters


def _move_to_parent(parameters: list[list[Any]], index: int, frame: JointFrame, line: JointLine) -> None:
    own = parameters[index]
    k, sign = line.axis
    mass, first = own[9], own[6 + k] * sign
    removed = _line_of_mass(line.point, frame.axis, mass, first)
    own = [a - b for a, b in zip(own, removed, strict=True)]
    own[6 + k] = own[9] = 0.0
    # The second moment along the axis: as much as leaves one moment of inertia zero.
    i, j = _DIAGONAL[(k + 1) % 3], _DIAGONAL[(k + 2) % 3]
    if is_zero(own[i]):
        i, j = j, i  # nothing needs to move
    spread = own[j]
    own[i], own[j] = own[i] - spread, 0.0
    parameters[index] = own
    if frame.joint.parent < 0:
        return
    below = parameters[frame.joint.parent]
    added = _line_of_mass(line.parent_point, frame.parent_axis, mass, first)
    below = [a + b for a, b in zip(below, added, strict=True)]
    parent_k = line.parent_axis[0]
    for n in (_DIAGONAL[(parent_k + 1) % 3], _DIAGONAL[(parent_k + 2) % 3]):
        below[n] = below[n] + spread
    parameters[frame.joint.parent] = below
