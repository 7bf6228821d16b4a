"""The joint-space inertia matrix from composite bodies, written over generic scalars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .kinematics import (
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
    times,
    transposed,
)

__all__ = ["Body", "in_parent", "inertia_matrix", "joined", "rigid_body", "second_moments"]

Body = tuple[Matrix3, Vector3, Any]  # moment of inertia about the origin, first moment, mass


def _shifted(body: Body, arm: Vector3) -> Body:
    """Refer a body to a new origin, from which the old one stands at `arm` (Huygens and Steiner)."""
    inertia, first, mass = body
    moved = scale(arm, mass)
    spread = dot(arm, add(add(first, first), moved))
    rows = []
    for i in range(3):
        row = []
        for j in range(3):
            value = inertia[i][j] - (arm[i] * first[j] + (first[i] + moved[i]) * arm[j])
            row.append(value + spread if i == j else value)
        rows.append(tuple(row))
    return tuple(rows), add(first, moved), mass  # type: ignore[return-value]


def rigid_body(p: Sequence[Any]) -> Body:
    """Return a body from its ten barycentric parameters."""
    xx, xy, xz, yy, yz, zz, lx, ly, lz, m = p
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), (lx, ly, lz), m


def second_moments(p: Sequence[Any]) -> Matrix3:
    """Return the second moments of mass of a body from its ten barycentric parameters."""
    xx, xy, xz, yy, yz, zz = p[:6]
    a, b, c = 0.5 * (yy + zz - xx), 0.5 * (xx + zz - yy), 0.5 * (xx + yy - zz)
    return ((a, -xy, -xz), (-xy, b, -yz), (-xz, -yz, c))


def in_parent(frame: JointFrame, body: Body) -> Body:
    """Return a body of a link, seen from the frame of the parent link."""
    inertia, first, mass = _shifted(body, frame.arm)
    for factor in reversed(frame.factors):
        inertia = product(product(factor, inertia), transposed(factor))
        first = times(factor, first)
    return _shifted((inertia, first, mass), frame.base_point)


def joined(a: Body, b: Body) -> Body:
    """Return two bodies of one frame as one."""
    return matrix_add(a[0], b[0]), add(a[1], b[1]), a[2] + b[2]


def inertia_matrix(frames: Sequence[JointFrame], link_parameters: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """Compute the inertia matrix M(q) of the rigid links (thesis eq. 2.7).

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    link_parameters : sequence
        For each link its ten barycentric parameters.

    Returns
    -------
    list of list of scalar
        (N, N), symmetric; kg m², kg m or kg.
    """
    count = coordinate_count(frames)
    bodies = [rigid_body(p) for p in link_parameters]
    matrix: list[list[Any]] = [[0.0] * count for _ in range(count)]
    for index in reversed(range(len(frames))):
        frame = frames[index]
        inertia, first, mass = bodies[index]
        angular, linear = frame.unit_motion
        force = add(scale(linear, mass), cross(angular, first))
        moment = add(times(inertia, angular), cross(first, linear))
        column = frame.joint.coordinate
        at = index
        while True:
            step = frames[at]
            moment = add(moment, cross(step.arm, force))
            effort = dot(step.axis, moment) if step.rotates else dot(step.axis, force)
            row = step.joint.coordinate
            value = effort * (step.joint.multiplier * frame.joint.multiplier)
            matrix[row][column] = matrix[row][column] + value
            if at != index:
                matrix[column][row] = matrix[column][row] + value
            if step.joint.parent < 0:
                break
            force, moment = step.to_parent(force), step.to_parent(moment)
            moment = add(moment, cross(step.base_point, force))
            at = step.joint.parent
        if frame.joint.parent >= 0:
            bodies[frame.joint.parent] = joined(bodies[frame.joint.parent], in_parent(frame, bodies[index]))
    return matrix
