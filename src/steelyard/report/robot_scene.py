"""Positions of the frames, joints and links of a robot in one configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.collision.configurations import place_links, upward
from steelyard.robot import Robot

__all__ = ["PlacedLink", "RobotScene", "robot_scene"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlacedLink:
    """A moving link and its joint, in the frame of the base.

    Attributes
    ----------
    rotates : bool
        Whether the joint turns, and does not slide.
    parent : int
        Index of the link that carries it, -1 for the base.
    placement : ndarray
        (4, 4): the frame of the link.
    joint_origin : ndarray
        (3,) m.
    joint_frame : ndarray
        (3, 3): a right-handed frame in columns, the last of which is the axis of the joint.
    ends : tuple of ndarray
        (3,) m each: where the link carries other joints, or, of a last link, its frame and what is fixed farthest away.
    """

    joint_name: str
    rotates: bool
    parent: int
    placement: Array
    joint_origin: Array
    joint_frame: Array
    ends: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class RobotScene:
    """A robot in one configuration, in the frame of the base.

    Attributes
    ----------
    links : tuple of PlacedLink
        In the order of the robot's links.
    up : ndarray
        (3,) a unit vector against gravity; z where there is none.
    size : float
        m: radius of the ball about `middle` that holds frames and joints; 0.5 where they are all in one place.
    middle : ndarray
        (3,) m.
    """

    links: tuple[PlacedLink, ...]
    up: Array
    size: float
    middle: Array


LEAST_SIZE = 0.05
"""m; frames that are nearer together than this say nothing of the size of the robot."""


def robot_scene(robot: Robot, q: ArrayLike | None = None) -> RobotScene:
    """Place joints and links of a robot whose lengths are numbers, at q (N,), rad or m; zeros by default.

    Examples
    --------
    >>> scene = robot_scene(Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")]), [0.0, np.pi / 2])
    >>> scene.links[1].joint_origin.round(9).tolist(), scene.links[1].placement[:3, 3].round(9).tolist()
    ([0.5, 0.0, 0.0], [0.5, 0.4, 0.0])
    """
    configuration = np.zeros(robot.dof) if q is None else np.asarray(q, dtype=float)
    placed = place_links(robot, configuration[None])
    placements = []
    for index in range(-1, len(robot.links)):
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = placed.rotations[index, 0], placed.positions[index, 0]
        placements.append(placement)
    joints = [placements[joint.parent + 1] @ joint.before for joint in robot.joints]
    links = []
    for index, (joint, link) in enumerate(zip(robot.joints, robot.links, strict=True)):
        placement, origin = placements[index + 1], joints[index][:3, 3]
        ends = [joints[k][:3, 3] for k, other in enumerate(robot.joints) if other.parent == index]
        if not ends:
            fixed = [(placement @ one.placement)[:3, 3] for one in link.attachments]
            candidates = [placement[:3, 3], *fixed]
            ends = [max(candidates, key=lambda place: float(np.linalg.norm(place - origin)))]
        links.append(
            PlacedLink(
                joint.name,
                joint.rotates,
                joint.parent,
                placement,
                origin,
                joints[index][:3, :3],
                tuple(ends),
            )
        )
    points = np.array(
        [np.zeros(3), *(link.joint_origin for link in links), *(end for link in links for end in link.ends)]
    )
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.linalg.norm(points - middle, axis=1).max())
    return RobotScene(tuple(links), upward(robot), size if size > LEAST_SIZE else 0.5, middle)
