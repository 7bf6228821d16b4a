"""Configurations of a robot, the poses of its links in them, and the joint torques of forces on the links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.algorithms.kinematics import JointFrame, joint_frames, link_poses
from steelyard.robot import Robot

__all__ = ["LinkPlacements", "default_neutral_configuration", "place_links", "random_configurations", "upward"]

Array = NDArray[np.float64]


def _range(robot: Robot) -> tuple[Array, Array]:
    joints = [robot.joints[index] for index in robot.driving_joints]
    widest = np.array([np.pi if joint.rotates else 0.5 for joint in joints])
    lower, upper = (np.array([getattr(joint, name) for joint in joints]) for name in ("lower", "upper"))
    # A joint without limits gets a range of one turn, or of 1 m.
    lower = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * widest, -widest))
    upper = np.where(np.isfinite(upper), upper, lower + 2 * widest)
    return lower, upper


def default_neutral_configuration(robot: Robot) -> Array:
    """Return the configuration (N,) of zeros, with the middle of the range where the limits of a joint exclude 0.

    Examples
    --------
    >>> default_neutral_configuration(Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")])).tolist()
    [0.0, 0.0]
    """
    lower, upper = _range(robot)
    return np.where((lower <= 0) & (upper >= 0), 0.0, (lower + upper) / 2)


def random_configurations(robot: Robot, count: int, seed: int = 0) -> Array:
    """Return configurations (count, N) from a uniform distribution between the limits of the joints."""
    lower, upper = _range(robot)
    return np.random.default_rng(seed).uniform(lower, upper, (count, robot.dof))


def upward(robot: Robot) -> Array:
    """Return the direction (3,) against gravity, of length 1; z where there is none.

    Examples
    --------
    >>> upward(Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0))).tolist()
    [0.0, 1.0, 0.0]
    """
    gravity = np.asarray(robot.gravity, dtype=np.float64)
    size = float(np.linalg.norm(gravity))
    return (-gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])) + 0.0


@dataclass(frozen=True, eq=False)
class LinkPlacements:
    """Poses of the B moving links at S configurations, in the base frame; the base comes last, with the index -1.

    Attributes
    ----------
    rotations : ndarray
        (B + 1, S, 3, 3).
    positions : ndarray
        (B + 1, S, 3), m.
    frames : tuple of JointFrame
        Frames of the joints.
    """

    rotations: Array
    positions: Array
    frames: tuple[JointFrame, ...]

    @property
    def count(self) -> int:
        """Number S of configurations."""
        return int(self.positions.shape[1])

    def of(self, body: int, placement: Array) -> tuple[Array, Array]:
        """Return rotations (S, 3, 3) and positions (S, 3) of a frame with a given placement on a moving link."""
        rotation, position = self.rotations[body], self.positions[body]
        return rotation @ placement[:3, :3], position + rotation @ placement[:3, 3]

    def vjp(self, forces: Array, moments: Array, dof: int) -> Array:
        """Return the joint torques (S, N) of forces and moments on the links, by the transposed Jacobians.

        Parameters
        ----------
        forces : ndarray
            (B + 1, S, 3) forces in the base frame; those on the base have no effect.
        moments : ndarray
            (B + 1, S, 3) moments about the origin of the base frame.
        dof : int
            Number N of coordinates.
        """
        forces, moments = forces.copy(), moments.copy()
        result = np.zeros((self.count, dof))
        for index in reversed(range(len(self.frames))):
            frame = self.frames[index]
            joint = frame.joint
            turn, place = self.rotations[joint.parent], self.positions[joint.parent]
            axis = turn @ np.array(frame.parent_axis, dtype=np.float64)
            if frame.rotates:
                point = place + turn @ np.array(frame.base_point, dtype=np.float64)
                effort = _dot(axis, moments[index] - np.cross(point, forces[index]))
            else:
                effort = _dot(axis, forces[index])
            result[:, joint.coordinate] += joint.multiplier * effort
            if joint.parent >= 0:
                forces[joint.parent] += forces[index]
                moments[joint.parent] += moments[index]
        return result


def place_links(robot: Robot, q: Array) -> LinkPlacements:
    """Return the frames of the moving links at configurations (S, N)."""
    columns = [np.ascontiguousarray(column) for column in q.T]
    frames = joint_frames(robot, columns, np)
    poses = link_poses(frames)
    count = len(q)
    rotations = np.empty((len(poses) + 1, count, 3, 3))
    positions = np.empty((len(poses) + 1, count, 3))
    rotations[-1], positions[-1] = np.eye(3), 0.0
    for index, (rotation, position) in enumerate(poses):
        for row in range(3):
            _fill(rotations[index, :, row], rotation[row])
        _fill(positions[index], position)
    return LinkPlacements(rotations, positions, tuple(frames))


def _fill(target: Array, values: Sequence[Any]) -> None:
    for column, value in enumerate(values):
        target[:, column] = value


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))
