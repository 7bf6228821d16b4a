"""Jacobians of points of the links, and how they change, over generic scalars, in the base frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .kinematics import (
    IDENTITY,
    ZERO,
    JointFrame,
    Vector3,
    add,
    coordinate_count,
    cross,
    link_poses,
    scale,
    subtract,
    times,
)

__all__ = ["jacobian", "jacobian_rate"]


def _way(frames: Sequence[JointFrame], link: int) -> list[int]:
    """Return the joints from the base to a link."""
    way: list[int] = []
    while link >= 0:
        way.append(link)
        link = frames[link].joint.parent
    return way[::-1]


def _axes(frames: Sequence[JointFrame], link: int, point: Vector3) -> tuple[list[tuple[Vector3, Vector3]], Vector3]:
    """Return axis and a point of the axis of every joint on the way, and the place of the point, in the base frame."""
    poses = link_poses(frames)
    axes = []
    for index in _way(frames, link):
        frame = frames[index]
        turn, place = poses[frame.joint.parent] if frame.joint.parent >= 0 else (IDENTITY, ZERO)
        axes.append((times(turn, frame.parent_axis), add(place, times(turn, frame.base_point))))
    turn, place = poses[link]
    return axes, add(place, times(turn, point))


def jacobian(frames: Sequence[JointFrame], link: int, point: Vector3 = ZERO) -> list[list[Any]]:
    """Return the Jacobian of a point of a link in the base frame, (6, N), linear rows first.

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    link : int
        Index of the link.
    point : Vector3
        In the link frame, m.

    Returns
    -------
    list of list of scalar
        Rows: m/rad or 1 (linear), then 1 or 0 (angular).
    """
    axes, target = _axes(frames, link, point)
    result: list[list[Any]] = [[0.0] * coordinate_count(frames) for _ in range(6)]
    for index, (axis, on_axis) in zip(_way(frames, link), axes, strict=True):
        joint = frames[index].joint
        column = (*cross(axis, subtract(target, on_axis)), *axis) if frames[index].rotates else (*axis, *ZERO)
        for row, value in enumerate(column):
            scaled = value if joint.multiplier == 1.0 else joint.multiplier * value
            result[row][joint.coordinate] = result[row][joint.coordinate] + scaled
    return result


def jacobian_rate(frames: Sequence[JointFrame], dq: Sequence[Any], link: int, point: Vector3 = ZERO) -> list[list[Any]]:
    """Return the time derivative of :func:`jacobian` while the robot moves with `dq`, (6, N).

    Parameters
    ----------
    frames : sequence of JointFrame
        The joints at their positions.
    dq : sequence of scalar
        N velocities.
    link : int
        Index of the link.
    point : Vector3
        In the link frame, m.
    """
    axes, target = _axes(frames, link, point)
    way = _way(frames, link)
    # Angular velocity before each joint, and how fast points that coincide with places on the axes travel.
    angular: list[Vector3] = [ZERO]
    for index, (axis, _) in zip(way, axes, strict=True):
        frame = frames[index]
        speed = frame.own(dq)
        angular.append(add(angular[-1], scale(axis, speed)) if frame.rotates else angular[-1])
    place_rates: list[Vector3] = []
    velocity, last = ZERO, ZERO
    for step, (index, (axis, on_axis)) in enumerate(zip(way, axes, strict=True)):
        velocity = add(velocity, cross(angular[step], subtract(on_axis, last)))
        place_rates.append(velocity)
        last = on_axis
        if not frames[index].rotates:
            velocity = add(velocity, scale(axis, frames[index].own(dq)))
    target_rate = add(velocity, cross(angular[-1], subtract(target, last)))
    result: list[list[Any]] = [[0.0] * coordinate_count(frames) for _ in range(6)]
    for step, (index, (axis, on_axis)) in enumerate(zip(way, axes, strict=True)):
        joint = frames[index].joint
        turned = cross(angular[step], axis)
        if frames[index].rotates:
            moved = cross(axis, subtract(target_rate, place_rates[step]))
            column = (*add(cross(turned, subtract(target, on_axis)), moved), *turned)
        else:
            column = (*turned, *ZERO)
        for row, value in enumerate(column):
            scaled = value if joint.multiplier == 1.0 else joint.multiplier * value
            result[row][joint.coordinate] = result[row][joint.coordinate] + scaled
    return result
