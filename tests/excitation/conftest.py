"""A planar arm with all kinds of terms, small enough to be designed for in a moment."""

import numpy as np
import pytest

import steelyard as sy


@pytest.fixture(scope="session")
def arm():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.4, 0, "q + pi/2")], name="arm")
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))


@pytest.fixture(scope="session")
def arm_parameters(arm):
    """Return parameters of thin rods with friction."""
    values = []
    for mass, length in ((6.0, 0.3), (4.0, 0.5), (2.0, 0.4)):
        com = np.array([-0.5 * length, 0.02, 0.01])
        about_com = mass * length**2 / 12.0 * np.diag([0.05, 1.0, 1.0])
        values += [*sy.Inertia.from_com(mass=mass, com=com, about_com=about_com).parameters, 0.6, 0.9, 0.05]
    return np.array(values)


@pytest.fixture(scope="session")
def arm_limits():
    return {"lower": [-2.0, -1.5, -1.0], "upper": [2.0, 1.0, 2.0], "velocity": 2.5, "acceleration": [8.0, 9.0, 10.0]}
