"""A small simulated arm with a robot file and logs, whose parameters are known."""

from types import SimpleNamespace

import numpy as np
import pytest

import steelyard as sy

ROBOT_FILE = """\
name = "elbow"

[description]
convention = "standard"
rows = [["pi/2", 0, 0.3, "q"], [0, 0.4, 0, "q"], ["pi/2", 0.1, 0, "q"]]

[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"

[[terms]]
kind = "rotor_inertia"

[processing]
cutoff = 10.0
trim = 0.5
"""


def true_parameters(model):
    """Return CAD-like link parameters and positive friction."""
    random = np.random.default_rng(5)
    values = []
    for columns in model.link_columns:
        mass, com, spread = random.uniform(1, 5), random.normal(scale=0.1, size=3), random.uniform(0.01, 0.05, 3)
        inertia = sy.Inertia.from_com(mass=mass, com=com, about_com=np.diag(sum(spread) - spread))
        values.extend([*inertia.parameters, *random.uniform(0.1, 0.5, 3)])
        assert len(columns) == 10
    return np.array(values)


def trajectory(seed):
    random = np.random.default_rng(seed)
    return sy.excitation.FourierTrajectory(
        a=random.normal(size=(3, 4)), b=random.normal(size=(3, 4)), center=random.normal(size=3), frequency=0.1
    )


def record(model, path, seed, noise=0.05, rate=200.0, periods=1.0):
    """Write a log of the arm on a random trajectory."""
    t, q, dq, ddq = trajectory(seed).sample(rate, periods)
    torque = model.inverse_dynamics(q, dq, ddq, true_parameters(model))
    torque += np.random.default_rng(seed).normal(size=q.shape) * noise
    sy.Recording(t=t, q=q, torque=torque, source="simulation").save(path)
    return path


@pytest.fixture(scope="session")
def simulation():
    """The functions of this file, for the tests beside it."""
    return SimpleNamespace(robot_file=ROBOT_FILE, record=record, trajectory=trajectory, true_parameters=true_parameters)


@pytest.fixture
def elbow(tmp_path):
    """Return the robot file's path, the model, and the folder."""
    path = tmp_path / "robot.toml"
    path.write_text(ROBOT_FILE)
    return path, sy.Model.load(path), tmp_path
