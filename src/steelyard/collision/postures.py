"""Postures that stand for all that a robot can take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.robot import Robot

__all__ = ["neutral_posture", "random_postures"]

Array = NDArray[np.float64]


def _range(robot: Robot) -> tuple[Array, Array]:
    joints = [robot.joints[index] for index in robot.driving_joints]
    widest = np.array([np.pi if joint.rotates else 0.5 for joint in joints])
    lower, upper = (np.array([getattr(joint, name) for joint in joints]) for name in ("lower", "upper"))
    # A joint without limits turns once around, or slides 0.5 m to both sides.
    lower = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * widest, -widest))
    upper = np.where(np.isfinite(upper), upper, lower + 2 * widest)
    return lower, upper


def neutral_posture(robot: Robot) -> Array:
    """Return the posture (N,) of zeros, save where the limits of a joint exclude 0: there their middle.

    Examples
    --------
    >>> neutral_posture(Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")])).tolist()
    [0.0, 0.0]
    """
    lower, upper = _range(robot)
    return np.where((lower <= 0) & (upper >= 0), 0.0, (lower + upper) / 2)


def random_postures(robot: Robot, count: int, seed: int = 0) -> Array:
    """Return postures (count, N) drawn evenly between the limits of the joints."""
    lower, upper = _range(robot)
    return np.random.default_rng(seed).uniform(lower, upper, (count, robot.dof))
