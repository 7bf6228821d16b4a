"""Forward dynamics: accelerations from torques, by factors of the inertia matrix or by articulated bodies.

Both start from the wrenches of the links at the given velocities and zero joint accelerations. What remains is
linear, ``M ddq = tau - bias``, without velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from steelyard.graph.expression import is_zero

from .kinematics import (
    ZERO,
    JointFrame,
    Matrix3,
    Vector3,
    add,
    cross,
    dot,
    matrix_add,
    product,
    scale,
    times,
    transposed,
    unit_vector,
)

__all__ = ["articulated_body", "solve_inertia"]


def solve_inertia(matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
    """Solve ``M x = right`` with the factors ``M = L' D L`` (Featherstone 2008, section 6.5).

    The order, from the tips to the base, keeps the zeros that branches of a tree leave in M.

    Parameters
    ----------
    matrix : sequence
        (N, N), symmetric, positive definite.
    right : sequence
        (N,).

    Returns
    -------
    list of scalar
        (N,).
    """
    count = len(right)
    rows = [list(row[: i + 1]) for i, row in enumerate(matrix)]
    for k in reversed(range(count)):
        for i in reversed(range(k)):
            if is_zero(rows[k][i]):
                continue
            factor = rows[k][i] / rows[k][k]
            for j in range(i + 1):
                if not is_zero(rows[k][j]):
                    rows[i][j] = rows[i][j] - factor * rows[k][j]
            rows[k][i] = factor
    x = list(right)
    for i in reversed(range(count)):
        for j in range(i):
            if not is_zero(rows[i][j]):
                x[j] = x[j] - rows[i][j] * x[i]
    x = [value / rows[i][i] for i, value in enumerate(x)]
    for i in range(count):
        for j in range(i):
            if not is_zero(rows[i][j]):
                x[i] = x[i] - rows[i][j] * x[j]
    return x


# An articulated inertia: moment = J dw + H a and force = H' dw + M a of the handle's angular and linear acceleration.
_Articulated = tuple[Matrix3, Matrix3, Matrix3]


def _skew(v: Vector3) -> Matrix3:
    return ((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0))


def _minus(a: Matrix3, b: Matrix3) -> Matrix3:
    rows = (tuple(x - y for x, y in zip(r, s, strict=True)) for r, s in zip(a, b, strict=True))
    return tuple(rows)  # type: ignore[return-value]


def _symmetric(a: Matrix3) -> Matrix3:
    """Return a matrix known to be symmetric with one node for each pair of elements."""
    return ((a[0][0], a[0][1], a[0][2]), (a[0][1], a[1][1], a[1][2]), (a[0][2], a[1][2], a[2][2]))


def _rigid(p: Sequence[Any]) -> _Articulated:
    xx, xy, xz, yy, yz, zz, lx, ly, lz, m = p
    return (
        ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)),
        _skew((lx, ly, lz)),
        ((m, 0.0, 0.0), (0.0, m, 0.0), (0.0, 0.0, m)),
    )


def _shifted(body: _Articulated, arm: Vector3) -> _Articulated:
    """Refer an articulated inertia to a new origin, from which the old one stands at `arm`."""
    if all(is_zero(x) for x in arm):
        return body
    j, h, m = body
    s = _skew(arm)
    moved = matrix_add(h, product(s, m))
    return _symmetric(matrix_add(_minus(j, product(h, s)), product(s, transposed(moved)))), moved, m


def _turned(frame: JointFrame, body: _Articulated) -> _Articulated:
    j, h, m = body
    for factor in reversed(frame.factors):
        back = transposed(factor)
        j = _symmetric(product(product(factor, j), back))
        h = product(product(factor, h), back)
        m = _symmetric(product(product(factor, m), back))
    return j, h, m


def _reduced(body: _Articulated, angular: Vector3, linear: Vector3, divisor: Any) -> _Articulated:
    """Return the inertia that the parent feels: that of the body without what the joint's motion gives way to."""
    j, h, m = body
    ratio, slope = scale(angular, 1.0 / divisor), scale(linear, 1.0 / divisor)
    j = _minus(j, tuple(scale(angular, x) for x in ratio))  # type: ignore[arg-type]
    h = _minus(h, tuple(scale(linear, x) for x in ratio))  # type: ignore[arg-type]
    m = _minus(m, tuple(scale(linear, x) for x in slope))  # type: ignore[arg-type]
    return _symmetric(j), h, _symmetric(m)


def _without_axis(frame: JointFrame, body: _Articulated) -> _Articulated:
    """Set the elements along the axis exactly to zero, which the parent does not feel where the drive has no rotor."""
    place = unit_vector(frame.axis)
    if place is None:
        return body
    k = place[0]
    j, h, m = (tuple(list(row) for row in block) for block in body)
    for n in range(3):
        if frame.rotates:
            j[k][n] = j[n][k] = h[k][n] = 0.0
        else:
            m[k][n] = m[n][k] = h[n][k] = 0.0
    return tuple(tuple(tuple(row) for row in block) for block in (j, h, m))  # type: ignore[return-value]


def articulated_body(
    frames: Sequence[JointFrame],
    wrenches: Sequence[tuple[Vector3, Vector3]],
    link_parameters: Sequence[Sequence[Any]],
    torques: Sequence[Any],
    rotors: Sequence[Any],
) -> list[Any]:
    """Compute the joint accelerations with the articulated-body algorithm (Featherstone 2008, section 7.3).

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions; none may mimic another.
    wrenches : sequence of (Vector3, Vector3)
        Moment and force that each link needs at zero joint accelerations.
    link_parameters : sequence
        For each link its ten barycentric parameters.
    torques : sequence of scalar
        N joint torques, less those of the terms at zero acceleration.
    rotors : sequence of scalar
        N inertias that each drive adds to its own joint.

    Returns
    -------
    list of scalar
        N accelerations.
    """
    bodies = [_rigid(p) for p in link_parameters]
    total = list(wrenches)
    kept: list[tuple[Vector3, Vector3, Any, Any]] = []
    for index in reversed(range(len(frames))):
        frame, k = frames[index], frames[index].joint.coordinate
        body = _shifted(bodies[index], frame.arm)
        moment, force = total[index]
        moment = add(moment, cross(frame.arm, force))
        axis = frame.axis
        if frame.rotates:
            angular, linear = times(body[0], axis), times(transposed(body[1]), axis)
            own, effort = dot(axis, angular), dot(axis, moment)
        else:
            angular, linear = times(body[1], axis), times(body[2], axis)
            own, effort = dot(axis, linear), dot(axis, force)
        divisor = own + rotors[k]
        rest = torques[k] - effort
        kept.append((angular, linear, divisor, rest))
        if frame.joint.parent < 0:
            continue
        body = _reduced(body, angular, linear, divisor)
        if is_zero(rotors[k]):
            body = _without_axis(frame, body)
        gain = rest / divisor
        moment, force = add(moment, scale(angular, gain)), add(force, scale(linear, gain))
        force, moment = frame.to_parent(force), frame.to_parent(moment)
        moment = add(moment, cross(frame.base_point, force))
        parent = frame.joint.parent
        total[parent] = (add(total[parent][0], moment), add(total[parent][1], force))
        j, h, m = _shifted(_turned(frame, body), frame.base_point)
        bodies[parent] = (
            matrix_add(bodies[parent][0], j),
            matrix_add(bodies[parent][1], h),
            matrix_add(bodies[parent][2], m),
        )
    kept.reverse()
    accelerations: list[Any] = [0.0] * len(frames)
    changes: list[tuple[Vector3, Vector3]] = []
    for frame, (angular, linear, divisor, rest) in zip(frames, kept, strict=True):
        turn, slide = changes[frame.joint.parent] if frame.joint.parent >= 0 else (ZERO, ZERO)
        slide = frame.to_link(add(slide, cross(turn, frame.base_point)))
        turn = frame.to_link(turn)
        acceleration = (rest - (dot(angular, turn) + dot(linear, slide))) / divisor
        accelerations[frame.joint.coordinate] = acceleration
        if frame.rotates:
            turn = add(turn, scale(frame.axis, acceleration))
        else:
            slide = add(slide, scale(frame.axis, acceleration))
        changes.append((turn, add(slide, cross(turn, frame.arm))))
    return accelerations
