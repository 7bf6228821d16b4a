"""The Coriolis matrix of the Christoffel symbols, written over generic scalars.

A robot is a set of mass points with positions x(q). With ``J = dx/dq`` its Coriolis matrix is ``C = sum m J' dJ/dt``,
which is the Christoffel choice, so that ``dM/dt - 2 C`` is skew-symmetric. Column j asks how the velocity field of a
unit velocity of joint j changes while the robot moves with dq: a recursion like Newton-Euler's, in which the field
(angular part u) and the motion (angular velocity w) are two different twists.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .inertia_matrix import second_moments
from .kinematics import ZERO, JointFrame, Matrix3, Vector3, add, coordinate_count, cross, dot, scale, times
from .newton_euler import joint_torques

__all__ = ["coriolis_matrix"]


@dataclass(frozen=True)
class _Field:
    """The velocity field of one coordinate on one link, and how it changes: ``rate + turning x`` at a point x."""

    angular: Vector3
    angular_rate: Vector3
    turning: Matrix3
    rate: Vector3


def _turning(angular_rate: Vector3, w: Vector3, u: Vector3) -> Matrix3:
    """Return ``[du]x + [u]x [w]x``: how ``u x r`` changes at a point that the body carries along."""
    x, y, z = angular_rate
    xx, yy, zz = w[0] * u[0], w[1] * u[1], w[2] * u[2]
    return (
        (-(yy + zz), w[0] * u[1] - z, w[0] * u[2] + y),
        (w[1] * u[0] + z, -(xx + zz), w[1] * u[2] - x),
        (w[2] * u[0] - y, w[2] * u[1] + x, -(xx + yy)),
    )


def _wrench(field: _Field, p: Sequence[Any]) -> tuple[Vector3, Vector3]:
    """Return moment and force of the changing field on a body with ten barycentric parameters."""
    first, second, t = (p[6], p[7], p[8]), second_moments(p), field.turning
    force = add(scale(field.rate, p[9]), times(t, first))
    moment = (
        dot(t[2], second[1]) - dot(t[1], second[2]),
        dot(t[0], second[2]) - dot(t[2], second[0]),
        dot(t[1], second[0]) - dot(t[0], second[1]),
    )
    return add(moment, cross(first, field.rate)), force


def coriolis_matrix(
    frames: Sequence[JointFrame], dq: Sequence[Any], link_parameters: Sequence[Sequence[Any]]
) -> list[list[Any]]:
    """Compute C(q, dq) of the rigid links (thesis eq. 2.7), with the Christoffel symbols.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq : sequence of scalar
        N velocities.
    link_parameters : sequence
        For each link its ten barycentric parameters.

    Returns
    -------
    list of list of scalar
        (N, N); ``C dq`` are the Coriolis and centripetal torques.
    """
    count = coordinate_count(frames)
    velocities: list[Vector3] = []
    for frame in frames:
        w = frame.to_link(velocities[frame.joint.parent]) if frame.joint.parent >= 0 else ZERO
        velocities.append(add(w, scale(frame.axis, frame.own(dq))) if frame.rotates else w)
    columns = [_column(frames, velocities, dq, link_parameters, k) for k in range(count)]
    return [[columns[j][i] for j in range(count)] for i in range(count)]


def _column(
    frames: Sequence[JointFrame],
    velocities: Sequence[Vector3],
    dq: Sequence[Any],
    link_parameters: Sequence[Sequence[Any]],
    coordinate: int,
) -> list[Any]:
    fields: list[_Field | None] = []  # None where the coordinate does not move the link
    for index, frame in enumerate(frames):
        parent = fields[frame.joint.parent] if frame.joint.parent >= 0 else None
        unit = frame.joint.multiplier if frame.joint.coordinate == coordinate else 0.0
        if parent is None and unit == 0.0:
            fields.append(None)
            continue
        angular, angular_rate, rate = ZERO, ZERO, ZERO
        if parent is not None:
            angular, angular_rate = frame.to_link(parent.angular), frame.to_link(parent.angular_rate)
            rate = frame.to_link(add(parent.rate, times(parent.turning, frame.base_point)))
        w = velocities[index]
        if frame.rotates:
            # w less its own part along the axis is the parent's; the cross product does not see the difference.
            angular_rate = add(angular_rate, scale(cross(w, frame.axis), unit))
            angular = add(angular, scale(frame.axis, unit))
        else:
            rate = add(rate, scale(cross(w, frame.axis), unit))
            rate = add(rate, scale(cross(angular, frame.axis), frame.own(dq)))
        turning = _turning(angular_rate, w, angular)
        fields.append(_Field(angular, angular_rate, turning, add(rate, times(turning, frame.arm))))
    wrenches: list[tuple[Vector3, Vector3]] = [
        (ZERO, ZERO) if field is None else _wrench(field, p) for field, p in zip(fields, link_parameters, strict=True)
    ]
    return joint_torques(frames, wrenches)
