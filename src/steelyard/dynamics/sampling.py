"""The model evaluated with NumPy, sample by sample side by side, where compiling would not pay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kinematics import joint_frames
from .layout import ParameterLayout
from .newton_euler import robot_gravity
from .regressor import regressor

__all__ = ["regressor_with_numpy", "term_torques"]

Array = NDArray[np.float64]


def regressor_with_numpy(layout: ParameterLayout, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the regressor (S, N, n) of links and terms at S samples of a motion, (S, N) each."""
    robot = layout.robot
    result = np.zeros((len(q), robot.dof, len(layout.names)))
    frames = joint_frames(robot, list(q.T), np)
    for (row, column), value in layout.with_links(
        regressor(frames, list(dq.T), list(ddq.T), robot_gravity(robot))
    ).items():
        result[:, row, column] = value
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np):
        result[:, row, column] = value
    return result


def term_torques(layout: ParameterLayout, q: Array, dq: Array, ddq: Array, parameters: Array) -> Array:
    """Return the torques (S, N) of the terms."""
    torques = np.zeros_like(q)
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np):
        torques[:, row] += parameters[column] * value
    return torques
