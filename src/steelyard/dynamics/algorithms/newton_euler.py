"""Newton-Euler dynamics in barycentric parameters, written over generic scalars.

All quantities of a link stand in its own frame, at its origin. With ``U = [dw]x + [w]x [w]x`` a body with moment of
inertia L about the origin, first moment l and mass m needs the force ``f = m a + U l`` and the moment
``n = L dw + w x L w + l x a`` (a: acceleration of the origin less gravity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.robot import Robot

from .kinematics import (
    ZERO,
    JointFrame,
    Matrix3,
    Vector3,
    add,
    coordinate_count,
    cross,
    dot,
    scale,
    times,
    transposed,
    unit_vector,
)

__all__ = ["Motion", "body_wrench", "inverse_dynamics", "joint_torques", "link_motions", "robot_gravity"]


@dataclass(frozen=True)
class Motion:
    """The motion of a link, in its own frame."""

    angular_velocity: Vector3
    angular_acceleration: Vector3
    u: Matrix3
    acceleration: Vector3  # of the link frame's origin, less gravity


def _u_matrix(w: Vector3, dw: Vector3) -> Matrix3:
    xx, yy, zz = w[0] * w[0], w[1] * w[1], w[2] * w[2]
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    return (
        (-(yy + zz), xy - dw[2], xz + dw[1]),
        (xy + dw[2], -(xx + zz), yz - dw[0]),
        (xz - dw[1], yz + dw[0], -(xx + yy)),
    )


def _turned(frame: JointFrame, parent: Motion, velocity: Any, acceleration: Any) -> tuple[Vector3, Vector3, Matrix3]:
    """Return w, dw and U of a link that turns on its parent.

    A turn about the unit vector e leaves ``U e`` alone: the points of the axis move with both links. Where e is a
    coordinate axis of both frames, a column of U is thus only turned, and gives the two elements of dw across it.
    """
    w = frame.to_link(parent.angular_velocity)
    place, parent_place = unit_vector(frame.axis), unit_vector(frame.parent_axis)
    if place is None or parent_place is None:
        spin = scale(frame.axis, velocity)
        dw = frame.to_link(parent.angular_acceleration)
        dw = add(add(dw, scale(frame.axis, acceleration)), cross(w, spin))
        w = add(w, spin)
        return w, dw, _u_matrix(w, dw)
    (k, sign), (parent_k, parent_sign) = place, parent_place
    w = add(w, scale(frame.axis, velocity))
    below = (parent.u[0][parent_k], parent.u[1][parent_k], parent.u[2][parent_k])
    column = scale(frame.to_link(below), sign * parent_sign)
    i, j = (k + 1) % 3, (k + 2) % 3
    along = sign * (parent_sign * parent.angular_acceleration[parent_k] + acceleration)
    ik, jk, ij = w[i] * w[k], w[j] * w[k], w[i] * w[j]
    across_j, across_i = column[i] - ik, jk - column[j]  # dw_j and dw_i
    jj, kk = w[j] * w[j], w[k] * w[k]
    u: list[list[Any]] = [[0.0] * 3 for _ in range(3)]
    u[i][k], u[j][k], u[k][k] = column[i], column[j], column[k]
    u[k][i], u[k][j] = ik - across_j, jk + across_i
    u[i][j], u[j][i] = ij - along, ij + along
    u[i][i] = -(jj + kk)
    u[j][j] = column[k] + (jj - kk)
    dw_list: list[Any] = [0.0] * 3
    dw_list[i], dw_list[j], dw_list[k] = across_i, across_j, along
    return w, tuple(dw_list), tuple(tuple(row) for row in u)  # type: ignore[return-value]


def _carried(frame: JointFrame, parent: Motion) -> tuple[Vector3, Vector3, Matrix3]:
    """Return w, dw and U of a link that only slides on its parent: the same, seen from its frame."""
    w, dw = frame.to_link(parent.angular_velocity), frame.to_link(parent.angular_acceleration)
    (factor,) = frame.factors
    places = [place for place in map(unit_vector, transposed(factor)) if place is not None]
    if len(places) < 3:
        return w, dw, _u_matrix(w, dw)
    rows = (tuple((si * sj) * parent.u[i][j] for j, sj in places) for i, si in places)
    return w, dw, tuple(rows)  # type: ignore[return-value]


def link_motions(frames: Sequence[JointFrame], dq: Sequence[Any], ddq: Sequence[Any], gravity: Vector3) -> list[Motion]:
    """Return the motion of every link, in its own frame."""
    motions: list[Motion] = []
    still = Motion(ZERO, ZERO, (ZERO, ZERO, ZERO), scale(gravity, -1.0))
    for frame in frames:
        joint = frame.joint
        parent = motions[joint.parent] if joint.parent >= 0 else still
        velocity, acceleration = frame.own(dq), frame.own(ddq)
        a = frame.to_link(add(parent.acceleration, times(parent.u, frame.base_point)))
        if frame.rotates:
            w, dw, u = _turned(frame, parent, velocity, acceleration)
            a = add(a, times(u, frame.arm))
        else:
            w, dw, u = _carried(frame, parent)
            a = add(a, times(u, frame.arm))
            a = add(add(a, scale(frame.axis, acceleration)), cross(w, scale(frame.axis, 2.0 * velocity)))
        motions.append(Motion(w, dw, u, a))
    return motions


def body_wrench(motion: Motion, p: Sequence[Any]) -> tuple[Vector3, Vector3]:
    """Return moment and force that move a body with parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``."""
    w, dw, u, a = motion.angular_velocity, motion.angular_acceleration, motion.u, motion.acceleration
    xx, xy, xz, yy, yz, zz = p[:6]
    first = (p[6], p[7], p[8])
    force = add(scale(a, p[9]), times(u, first))
    moment = (
        xx * dw[0] + (zz - yy) * (w[1] * w[2]) - u[2][0] * xy + u[1][0] * xz + (u[1][1] - u[2][2]) * yz,
        yy * dw[1] + (xx - zz) * (w[0] * w[2]) - u[0][1] * yz + u[2][1] * xy + (u[2][2] - u[0][0]) * xz,
        zz * dw[2] + (yy - xx) * (w[0] * w[1]) - u[1][2] * xz + u[0][2] * yz + (u[0][0] - u[1][1]) * xy,
    )
    return add(moment, cross(first, a)), force


def inverse_dynamics(
    frames: Sequence[JointFrame],
    dq: Sequence[Any],
    ddq: Sequence[Any],
    link_parameters: Sequence[Sequence[Any]],
    gravity: Vector3,
) -> list[Any]:
    """Compute the joint torques that the rigid links need (thesis eq. 2.7), by Newton-Euler recursion.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq, ddq : sequence of scalar
        N velocities and accelerations.
    link_parameters : sequence
        For each link its ten barycentric parameters (thesis eq. 2.18) in the link frame.
    gravity : Vector3
        In the base frame, m/s².

    Returns
    -------
    list of scalar
        N torques, N·m or N.
    """
    motions = link_motions(frames, dq, ddq, gravity)
    wrenches = [body_wrench(motion, p) for motion, p in zip(motions, link_parameters, strict=True)]
    return joint_torques(frames, wrenches)


def joint_torques(frames: Sequence[JointFrame], wrenches: Sequence[tuple[Vector3, Vector3]]) -> list[Any]:
    """Compute the N joint torques that bring a wrench (moment about the link's origin, force) to every link."""
    total = list(wrenches)
    torques: list[Any] = [0.0] * coordinate_count(frames)
    for index in reversed(range(len(frames))):
        frame = frames[index]
        moment, force = total[index]
        moment = add(moment, cross(frame.arm, force))  # now about the joint's point
        effort = dot(frame.axis, moment) if frame.rotates else dot(frame.axis, force)
        k = frame.joint.multiplier
        torques[frame.joint.coordinate] = torques[frame.joint.coordinate] + (effort if k == 1.0 else k * effort)
        if frame.joint.parent >= 0:
            force, moment = frame.to_parent(force), frame.to_parent(moment)
            moment = add(moment, cross(frame.base_point, force))
            below = total[frame.joint.parent]
            total[frame.joint.parent] = (add(below[0], moment), add(below[1], force))
    return torques


def robot_gravity(robot: Robot) -> Vector3:
    """Return the robot's gravity as a vector of floats, m/s², in the base frame."""
    return (float(robot.gravity[0]), float(robot.gravity[1]), float(robot.gravity[2]))
