"""Every kind of term in generated C, against the torques of the model."""

from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import term_from_dict

from .conftest import compiled, project_of

LINK = sy.Inertia.from_com(mass=2.0, com=(0.2, 0.05, 0.1), about_com=np.eye(3) * 0.02)
GROUPS = (
    (
        {"kind": "stribeck", "velocity": [0.3, 0.1], "exponent": 0.7},
        {"kind": "viscous_by_direction"},
        {"kind": "friction_piecewise", "speeds": [0.5, 2.0]},
        {"kind": "spring", "rest": 0.2},
        {"kind": "counterbalance", "fixed": 0.4, "moving": 0.1, "gas": 0.8},
        {"kind": "tendon", "arms": [[0.1, -0.2]]},
    ),
    (
        {"kind": "coulomb_smooth", "velocity": 0.1},
        {"kind": "friction_polynomial", "powers": [1, 2, 3]},
        {"kind": "coulomb_by_direction"},
        {"kind": "cogging", "harmonics": [6, 7.5]},
    ),
    ({"kind": "friction_by_load", "power": 1}, {"kind": "rotor_inertia"}),
    ({"kind": "friction_by_channel", "channel": "heat", "range": [0, 60]},),
    ({"kind": "dahl", "displacement": 0.01}, {"kind": "viscous"}),
    ({"kind": "lugre", "displacement": 0.01, "ratio": 0.5, "velocity": 0.1},),
)


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group[0]["kind"])
def test_generated_torques_are_those_of_the_model(group, tmp_path: Path, random) -> None:
    links = {"link1": LINK, "link2": LINK}
    robot = sy.Robot.from_dh([("pi/2", 0.1, 0.3, "q"), ("pi/2", 0.4, 0, "q")], inertias=links, gravity=(0, -9.81, 0))
    model = sy.Model(robot.with_terms(*map(term_from_dict, group)))
    (call,) = compiled("c", project_of("arm", [model.function("inverse_dynamics")]), tmp_path)
    parameters = random.uniform(0.1, 1.0, model.parameter_count)
    for q, dq, ddq in random.uniform(-2.0, 2.0, (5, 3, 2)):
        logged = random.uniform(-1.0, 1.0, 2) if model.remembers else random.uniform(10.0, 50.0, 2)
        channels = dict.fromkeys(model.robot.channels, logged) or None
        given = (q, dq, ddq, logged, parameters) if channels else (q, dq, ddq, parameters)
        expected = model.regressor(q, dq, ddq, channels=channels) @ parameters  # compiled apart
        np.testing.assert_allclose(call(*given)[0], expected, rtol=1e-11, atol=1e-11)
