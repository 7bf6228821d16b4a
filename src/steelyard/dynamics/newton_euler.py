"""Newton-Euler dynamics and its regressor in barycentric parameters, written over generic scalars.

All quantities of a link stand in its own frame, at its origin. With ``U = [dw]x + [w]x [w]x`` a body with moment of
inertia L about the origin, first moment l and mass m needs the force ``f = m a + U l`` and the moment
``n = L dw + w x L w + l x a`` (a: acceleration of the origin less gravity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from steelyard.robot import Robot

from .kinematics import ZERO, JointFrame, Matrix3, Vector3, add, cross, dot, joint_frames, scale, times, transposed

__all__ = ["inverse_dynamics", "regressor"]


@dataclass(frozen=True)
class _Motion:
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


def _motions(
    robot: Robot, frames: Sequence[JointFrame], dq: Sequence[Any], ddq: Sequence[Any], gravity: Vector3
) -> list[_Motion]:
    motions: list[_Motion] = []
    still = _Motion(ZERO, ZERO, (ZERO, ZERO, ZERO), scale(gravity, -1.0))
    for frame in frames:
        joint = frame.joint
        parent = motions[joint.parent] if joint.parent >= 0 else still
        k = joint.multiplier
        velocity = dq[joint.coordinate] if k == 1.0 else k * dq[joint.coordinate]
        acceleration = ddq[joint.coordinate] if k == 1.0 else k * ddq[joint.coordinate]
        w = frame.to_link(parent.angular_velocity)
        dw = frame.to_link(parent.angular_acceleration)
        a = frame.to_link(add(parent.acceleration, times(parent.u, frame.base_point)))
        if frame.rotates:
            spin = scale(frame.axis, velocity)
            dw = add(add(dw, scale(frame.axis, acceleration)), cross(w, spin))
            w = add(w, spin)
            u = _u_matrix(w, dw)
            a = add(a, times(u, frame.arm))
        else:
            u = _u_matrix(w, dw)
            slide = scale(frame.axis, velocity)
            a = add(a, times(u, frame.arm))
            a = add(add(a, scale(frame.axis, acceleration)), scale(cross(w, slide), 2.0))
        motions.append(_Motion(w, dw, u, a))
    return motions


def _body_wrench(motion: _Motion, p: Sequence[Any]) -> tuple[Vector3, Vector3]:
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
    robot: Robot,
    q: Sequence[Any],
    dq: Sequence[Any],
    ddq: Sequence[Any],
    link_parameters: Sequence[Sequence[Any]],
    algebra: Any,
    gravity: Vector3 | None = None,
) -> list[Any]:
    """Compute the joint torques that the rigid links need (thesis eq. 2.7), by Newton-Euler recursion.

    Parameters
    ----------
    robot : Robot
    q, dq, ddq : sequence of scalar
        N positions, velocities and accelerations.
    link_parameters : sequence
        For each link its ten barycentric parameters (thesis eq. 2.18) in the link frame.
    algebra : module
        Brings ``sin`` and ``cos``.
    gravity : Vector3, optional
        In the base frame, m/s²; None takes the robot's.

    Returns
    -------
    list of scalar
        N torques, N·m or N.
    """
    frames = joint_frames(robot, q, algebra)
    motions = _motions(robot, frames, dq, ddq, robot_gravity(robot) if gravity is None else gravity)
    wrenches = [_body_wrench(motion, p) for motion, p in zip(motions, link_parameters, strict=True)]
    torques: list[Any] = [0.0] * robot.dof
    for index in reversed(range(len(frames))):
        frame = frames[index]
        moment, force = wrenches[index]
        moment = add(moment, cross(frame.arm, force))  # now about the joint's point
        effort = dot(frame.axis, moment) if frame.rotates else dot(frame.axis, force)
        k = frame.joint.multiplier
        torques[frame.joint.coordinate] = torques[frame.joint.coordinate] + (effort if k == 1.0 else k * effort)
        if frame.joint.parent >= 0:
            force, moment = frame.to_parent(force), frame.to_parent(moment)
            moment = add(moment, cross(frame.base_point, force))
            below = wrenches[frame.joint.parent]
            wrenches[frame.joint.parent] = (add(below[0], moment), add(below[1], force))
    return torques


def _row(motion: _Motion, angular: Vector3, linear: Vector3) -> tuple[Any, ...]:
    """Power of the wrench of a moving body on a unit motion, by its ten parameters."""
    w, dw, u, a = motion.angular_velocity, motion.angular_acceleration, motion.u, motion.acceleration
    x, y, z = angular
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    first = add(times(transposed(u), linear), cross(a, angular))
    return (
        x * dw[0] + y * xz - z * xy,
        y * u[2][1] - x * u[2][0] + z * (u[0][0] - u[1][1]),
        x * u[1][0] + y * (u[2][2] - u[0][0]) - z * u[1][2],
        y * dw[1] + z * xy - x * yz,
        x * (u[1][1] - u[2][2]) - y * u[0][1] + z * u[0][2],
        z * dw[2] + x * yz - y * xz,
        *first,
        dot(linear, a),
    )


def regressor(
    robot: Robot, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
) -> dict[tuple[int, int], Any]:
    """Compute the regressor of the rigid links (thesis eq. 2.22) from the joint axes.

    Each joint's unit motion is carried into the frames of the links beyond it, and meets there the wrench of the
    link, which is linear in its ten parameters.

    Parameters
    ----------
    robot : Robot
    q, dq, ddq : sequence of scalar
        N positions, velocities and accelerations.
    algebra : module

    Returns
    -------
    dict
        Scalars by (torque row, 10 * link + parameter); what is missing is 0.
    """
    frames = joint_frames(robot, q, algebra)
    motions = _motions(robot, frames, dq, ddq, robot_gravity(robot))
    entries: dict[tuple[int, int], Any] = {}
    carried: list[dict[int, tuple[Vector3, Vector3]]] = []
    for index, frame in enumerate(frames):
        here: dict[int, tuple[Vector3, Vector3]] = {}
        if frame.joint.parent >= 0:
            for source, (angular, linear) in carried[frame.joint.parent].items():
                angular, linear = frame.to_link(angular), frame.to_link(add(linear, cross(angular, frame.base_point)))
                here[source] = (angular, add(linear, cross(angular, frame.arm)))
        here[index] = frame.unit_motion
        carried.append(here)
        for source, (angular, linear) in here.items():
            joint = robot.joints[source]
            for parameter, value in enumerate(_row(motions[index], angular, linear)):
                key = (joint.coordinate, 10 * index + parameter)
                scaled = value if joint.multiplier == 1.0 else joint.multiplier * value
                entries[key] = entries[key] + scaled if key in entries else scaled
    return entries


def robot_gravity(robot: Robot) -> Vector3:
    """Return the robot's gravity as a vector of floats, m/s², in the base frame."""
    return (float(robot.gravity[0]), float(robot.gravity[1]), float(robot.gravity[2]))
