"""The partial derivatives of inverse dynamics by positions, velocities and accelerations, over generic scalars.

With all spatial vectors in one frame, a joint axis S_j (a twist) moves with the links before it, and the torques of
the joints beyond and before j change by the closed forms of Singh, Russell and Wensing (2022, eq. 45 to 50)::

    d tau_i / d q_j  = S_i' (2 B_i P_j + I_i R_j),           d tau_j / d q_i = S_j' (2 B_i P_i + I_i R_i + S_i x* f_i)
    d tau_i / d dq_j = S_i' (2 B_i S_j + 2 I_i P_j),         d tau_j / d dq_i = S_j' (2 B_i S_i + 2 I_i P_i)

for j on the way from the base to i, where I_i, B_i and f_i belong to all the links beyond joint i together, P_j is
``V_j x S_j`` and R_j is ``A_j x S_j + V_j x P_j``. For a mass point with velocity v the matrix B sends a twist with
angular velocity u to the force ``u x v``. It is thus known by the momentum p and by ``Q``, the sum of
``m v r'``. The vectors are carried from link frame to link frame as in Newton-Euler.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from .inertia_matrix import Body, in_parent, joined, rigid_body, second_moments
from .kinematics import (
    ZERO,
    JointFrame,
    Matrix3,
    Vector3,
    add,
    coordinate_count,
    cross,
    dot,
    matrix_add,
    product,
    scale,
    subtract,
    times,
    transposed,
)
from .newton_euler import body_wrench, link_motions

__all__ = ["InverseDynamicsDerivatives", "inverse_dynamics_derivatives"]

_Twist = tuple[Vector3, Vector3]  # angular part, linear part at the link's origin; or moment and force


@dataclass(frozen=True)
class InverseDynamicsDerivatives:
    """Derivatives of the N torques of the rigid links, (N, N) each: row = torque, column = coordinate."""

    by_q: list[list[Any]]
    by_dq: list[list[Any]]
    by_ddq: list[list[Any]]


@dataclass(frozen=True)
class _Moving:
    """A link with all that it carries, in its own frame."""

    axis: _Twist
    rate: _Twist  # P
    second_rate: _Twist  # R
    body: Body
    q: Matrix3
    momentum: Vector3
    wrench: _Twist


def _outer(a: Vector3, b: Vector3) -> Matrix3:
    return (scale(b, a[0]), scale(b, a[1]), scale(b, a[2]))


def _crossed(v: _Twist, s: _Twist) -> _Twist:
    """Return the spatial cross product of two twists."""
    return cross(v[0], s[0]), add(cross(v[0], s[1]), cross(v[1], s[0]))


def _momentum(v: _Twist, p: Sequence[Any]) -> tuple[Matrix3, Vector3]:
    """Return ``Q = sum m v r'`` and the momentum of a body that moves with a twist."""
    first, m, second, w = (p[6], p[7], p[8]), p[9], second_moments(p), v[0]
    turning: Matrix3 = ((0.0, -w[2], w[1]), (w[2], 0.0, -w[0]), (-w[1], w[0], 0.0))
    return matrix_add(_outer(v[1], first), product(turning, second)), add(scale(v[1], m), cross(w, first))


def _inertial(body: Body, s: _Twist) -> _Twist:
    """Return moment and force of a body that accelerates with a twist from rest."""
    inertia, first, mass = body
    return add(times(inertia, s[0]), cross(first, s[1])), add(scale(s[1], mass), cross(s[0], first))


def _gyroscopic(link: _Moving, angular: Vector3) -> _Twist:
    """Return twice ``B``, moment and force, of a twist, of which only the angular velocity matters."""
    trace = link.q[0][0] + link.q[1][1] + link.q[2][2]
    twice = scale(angular, 2.0)
    return subtract(scale(twice, trace), times(link.q, twice)), cross(twice, link.momentum)


def _both(a: _Twist, b: _Twist) -> _Twist:
    return add(a[0], b[0]), add(a[1], b[1])


def _scaled(a: _Twist, factor: Any) -> _Twist:
    return scale(a[0], factor), scale(a[1], factor)


def inverse_dynamics_derivatives(
    frames: Sequence[JointFrame],
    dq: Sequence[Any],
    ddq: Sequence[Any],
    link_parameters: Sequence[Sequence[Any]],
    gravity: Vector3,
) -> InverseDynamicsDerivatives:
    """Compute the derivatives of the torques that the rigid links need.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq, ddq : sequence of scalar
        N velocities and accelerations.
    link_parameters : sequence
        For each link its ten barycentric parameters.
    gravity : Vector3
        In the base frame, m/s².
    """
    links = _moving_links(frames, dq, ddq, link_parameters, gravity)
    count = coordinate_count(frames)
    result = InverseDynamicsDerivatives(*([[0.0] * count for _ in range(count)] for _ in range(3)))
    for index in reversed(range(len(frames))):
        _differentiate(index, frames, links, result)
        parent = frames[index].joint.parent
        if parent >= 0:
            links[parent] = _with_child(links[parent], frames[index], links[index])
    return result


def _moving_links(
    frames: Sequence[JointFrame],
    dq: Sequence[Any],
    ddq: Sequence[Any],
    link_parameters: Sequence[Sequence[Any]],
    gravity: Vector3,
) -> list[_Moving]:
    motions = link_motions(frames, dq, ddq, gravity)
    velocities: list[_Twist] = []
    links: list[_Moving] = []
    for frame, motion, p in zip(frames, motions, link_parameters, strict=True):
        w = motion.angular_velocity
        velocity = frame.own(dq)
        v = ZERO
        if frame.joint.parent >= 0:
            below = velocities[frame.joint.parent]
            v = frame.to_link(add(below[1], cross(below[0], frame.base_point)))
        v = add(v, cross(w, frame.arm))
        if not frame.rotates:
            v = add(v, scale(frame.axis, velocity))
        axis = frame.unit_motion
        # The spatial acceleration: of the field of velocities at the origin, not of the point that is there.
        acceleration = (motion.angular_acceleration, subtract(motion.acceleration, cross(w, v)))
        rate = _crossed((w, v), axis)
        changed, turned = _crossed(acceleration, axis), _crossed((w, v), rate)
        velocities.append((w, v))
        links.append(
            _Moving(
                axis,
                rate,
                (add(changed[0], turned[0]), add(changed[1], turned[1])),
                rigid_body(p),
                *_momentum((w, v), p),
                body_wrench(motion, p),
            )
        )
    return links


def _with_child(link: _Moving, frame: JointFrame, child: _Moving) -> _Moving:
    """Add a link, with all that it carries, to its parent."""
    # Q and p refer to a new origin, then to other axes, then to the parent's origin.
    q = matrix_add(child.q, _outer(child.momentum, frame.arm))
    momentum = frame.to_parent(child.momentum)
    for factor in reversed(frame.factors):
        q = product(product(factor, q), transposed(factor))
    q = matrix_add(q, _outer(momentum, frame.base_point))
    moment, force = _step(frame, child.wrench)[1]
    return replace(
        link,
        body=joined(link.body, in_parent(frame, child.body)),
        q=matrix_add(link.q, q),
        momentum=add(link.momentum, momentum),
        wrench=(add(link.wrench[0], moment), add(link.wrench[1], force)),
    )


def _step(frame: JointFrame, wrench: _Twist) -> tuple[Any, _Twist]:
    """Return what a wrench on a link does at its joint, and the wrench as the parent has it."""
    moment, force = wrench
    moment = add(moment, cross(frame.arm, force))
    effort = dot(frame.axis, moment) if frame.rotates else dot(frame.axis, force)
    force, moment = frame.to_parent(force), frame.to_parent(moment)
    return effort, (add(moment, cross(frame.base_point, force)), force)


def _power(wrench: _Twist, twist: _Twist) -> Any:
    return dot(wrench[0], twist[0]) + dot(wrench[1], twist[1])


def _differentiate(
    index: int, frames: Sequence[JointFrame], links: Sequence[_Moving], result: InverseDynamicsDerivatives
) -> None:
    """Fill in the derivatives between joint `index` and the joints on the way to it."""
    link, joint = links[index], frames[index].joint
    s, rate, second = link.axis, link.rate, link.second_rate
    held = link.wrench
    crossed = (add(cross(s[0], held[0]), cross(s[1], held[1])), cross(s[0], held[1]))
    by_velocity = _both(_gyroscopic(link, s[0]), _inertial(link.body, _scaled(rate, 2.0)))
    by_position = _both(_both(_gyroscopic(link, rate[0]), _inertial(link.body, second)), crossed)
    inertial = _inertial(link.body, s)
    trace = link.q[0][0] + link.q[1][1] + link.q[2][2]
    turning = subtract(scale(s[0], trace), times(transposed(link.q), s[0]))
    turning = scale(add(turning, cross(link.momentum, s[1])), 2.0)
    column, at = joint.coordinate, index
    while True:
        step, below = frames[at], links[at]
        row, factor = step.joint.coordinate, step.joint.multiplier * joint.multiplier
        if at != index:
            _add(result.by_q, column, row, factor, dot(turning, below.rate[0]) + _power(inertial, below.second_rate))
            _add(result.by_dq, column, row, factor, dot(turning, below.axis[0]) + 2.0 * _power(inertial, below.rate))
        effort, by_position = _step(step, by_position)
        _add(result.by_q, row, column, factor, effort)
        effort, by_velocity = _step(step, by_velocity)
        _add(result.by_dq, row, column, factor, effort)
        effort, inertial = _step(step, inertial)
        _add(result.by_ddq, row, column, factor, effort)
        if at != index:
            _add(result.by_ddq, column, row, factor, effort)
        if step.joint.parent < 0:
            return
        turning = step.to_parent(turning)
        at = step.joint.parent


def _add(matrix: list[list[Any]], row: int, column: int, factor: float, value: Any) -> None:
    matrix[row][column] = matrix[row][column] + (value if factor == 1.0 else factor * value)
