"""Arms of two joints with friction, and the parameters of their links."""

import numpy as np

import steelyard as sy

LINKS = [[0.3, 0.0, 0.0, 0.3, 0.0, 0.2, 0.4, 0.05, 0.1, 2.0], [0.1, 0.0, 0.0, 0.2, 0.0, 0.2, 0.3, 0.0, 0.05, 1.5]]


def two_joint_model():
    """Return its model with viscous friction, Coulomb friction and an offset at each joint."""
    rows = [("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))


BODY = sy.Inertia.from_com(3.0, [-0.2, 0.0, 0.05], 0.02 * np.eye(3)).parameters
HELD = sy.Inertia.from_com(1.5, [0.02, 0.03, 0.1], 0.01 * np.eye(3)).parameters
"""A link of `unstated_arm`, and what its last link may hold."""


def unstated_arm(length=0.5, gravity=(0.0, 0.0, -9.81)):
    """Return the model of an arm without offsets, whose description states no masses."""
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, length, 0, "q")], name="arm", gravity=gravity)
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))


def unstated_parameters(held=0.0):
    """Return the parameters that it has in truth, with so much of what it may hold."""
    return np.concatenate([BODY, [0.5, 0.8], BODY + held * HELD, [0.3, 0.4]])
