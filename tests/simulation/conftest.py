"""Robots with known solutions."""

import csv

import numpy as np
import pytest

import steelyard as sy
from steelyard.robot import Term, TermParameter


class Spring(Term):
    """A linear spring at q = 0."""

    kind = "spring"
    parameters = (TermParameter("Ks", "N·m/rad", "N/m", "stiffness", nonnegative=True),)

    def columns(self, k, q, dq, ddq, algebra):
        return ({k: q[k]},)

    def potential(self, k, q, algebra):
        return (0.5 * q[k] * q[k],)


def delta_of(model, **values):
    """Return parameters by name; what is not named is zero."""
    delta = np.zeros(model.parameter_count)
    for name, value in values.items():
        delta[model.parameter_names.index(name)] = value
    return delta


@pytest.fixture(scope="session")
def pendulum():
    """A point mass at 1 m that hangs at q = 0, in gravity g = 9.81; model and parameters."""
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], name="pendulum", gravity=(9.81, 0, 0)))
    return model, delta_of(model, m1=2.0)


@pytest.fixture(scope="session")
def oscillator():
    """A mass of 2 kg on a slide with a spring of 50 N/m and a damper of 3 N·s/m."""
    robot = sy.Robot.from_dh([(0, 0, "q", 0)], name="slide", gravity=(0, 0, 0)).with_terms(Spring(), sy.Viscous())
    model = sy.Model(robot)
    return model, delta_of(model, m1=2.0, Ks1=50.0, Fvj1=3.0)


@pytest.fixture(scope="session")
def block():
    """A block of 2 kg on a slide with Coulomb friction of 10 N."""
    robot = sy.Robot.from_dh([(0, 0, "q", 0)], name="block", gravity=(0, 0, 0)).with_terms(sy.Coulomb())
    model = sy.Model(robot)
    return model, delta_of(model, m1=2.0, Fcj1=10.0)


@pytest.fixture(scope="session")
def two_links():
    """A double pendulum of two rods, without friction."""
    model = sy.Model(
        sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 0.8, 0, "q")], name="double pendulum", gravity=(0, -9.81, 0))
    )
    values = {}
    for k, (mass, length) in enumerate(((2.0, 1.0), (1.5, 0.8)), start=1):
        values |= {f"m{k}": mass, f"lx{k}": -mass * length / 2, f"Lzz{k}": mass * length**2 / 3}
        values |= {f"Lyy{k}": mass * length**2 / 3}
    return model, delta_of(model, **values)


@pytest.fixture(scope="session")
def table_4_9(thesis_tables):
    """The columns of thesis table 4.9 by name, (76,) each."""
    with (thesis_tables / "table_4_9_feasible_estimates.csv").open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0] if name != "beta"}
