"""Kinetic and potential energy of the rigid links, linear in their parameters, over generic scalars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .kinematics import ZERO, JointFrame, Vector3, add, cross, dot, scale

__all__ = ["kinetic_energy_regressor", "potential_energy_regressor"]


def kinetic_energy_regressor(frames: Sequence[JointFrame], dq: Sequence[Any]) -> list[list[Any]]:
    """Return for each link the ten coefficients of its kinetic energy ``w'L w/2 + v.(w x l) + m v.v/2``, J.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq : sequence of scalar
        N velocities.

    Returns
    -------
    list of list of scalar
    """
    twists: list[tuple[Vector3, Vector3]] = []
    rows: list[list[Any]] = []
    for frame in frames:
        joint = frame.joint
        velocity = frame.own(dq)
        below_w, below_v = twists[joint.parent] if joint.parent >= 0 else (ZERO, ZERO)
        w = frame.to_link(below_w)
        v = frame.to_link(add(below_v, cross(below_w, frame.base_point)))
        if frame.rotates:
            w = add(w, scale(frame.axis, velocity))
        else:
            v = add(v, scale(frame.axis, velocity))
        v = add(v, cross(w, frame.arm))
        twists.append((w, v))
        half = scale(w, 0.5)
        x, y, z = w
        rows.append([half[0] * x, x * y, x * z, half[1] * y, y * z, half[2] * z, *cross(v, w), 0.5 * dot(v, v)])
    return rows


def potential_energy_regressor(frames: Sequence[JointFrame], gravity: Vector3) -> list[list[Any]]:
    """Return for each link the ten coefficients of its potential energy ``-g.(m p + R l)``, J.

    It is zero for mass at the origin of the base frame.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    gravity : Vector3
        In the base frame, m/s².

    Returns
    -------
    list of list of scalar
    """
    seen: list[tuple[Vector3, Any]] = []  # gravity in the link frame, and its product with the origin's place
    rows: list[list[Any]] = []
    for frame in frames:
        below, height = seen[frame.joint.parent] if frame.joint.parent >= 0 else (gravity, 0.0)
        here = frame.to_link(below)
        height = height + dot(below, frame.base_point) + dot(here, frame.arm)
        seen.append((here, height))
        rows.append([0.0] * 6 + [-x for x in here] + [-height])
    return rows
