"""The inertias that a robot file gives for Denavit-Hartenberg rows, against Pinocchio."""

import numpy as np
import pytest
from pinocchio_oracle import pinocchio

import steelyard as sy

ROWS = ((np.pi / 2, 0.05, 0.3, 0.2), (0.4, 0.5, -0.1, -0.3), (-0.7, 0.1, 0.2, 1.1))


def chain(convention):
    """Pinocchio's model of the rows, each joint turning about z between the motions of its row."""

    def turn(axis, angle):
        return pinocchio.SE3(pinocchio.utils.rotate(axis, angle), np.zeros(3))

    def shift(x, z):
        return pinocchio.SE3(np.eye(3), np.array([x, 0.0, z]))

    model, parent, behind, links = pinocchio.Model(), 0, pinocchio.SE3.Identity(), []
    for number, (alpha, a, d, theta) in enumerate(ROWS, start=1):
        along_x, along_z = turn("x", alpha) * shift(a, 0.0), turn("z", theta) * shift(0.0, d)
        before, after = (
            (along_z, along_x) if convention == "standard" else (along_x * along_z, pinocchio.SE3.Identity())
        )
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), behind * before, f"joint{number}")
        links.append((parent, after))
        behind = after
    return model, links


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_torques_of_a_robot_file_with_inertials(convention, random, tmp_path):
    model, links = chain(convention)
    rows = [[alpha, a, d, f"q + {theta}"] for alpha, a, d, theta in ROWS]
    text = f'[description]\nconvention = "{convention}"\nrows = {rows}\n'.replace("'", '"')
    for number in (3, 1, 2):  # in any order
        joint, after = links[number - 1]
        mass, center, spread = random.uniform(0.5, 5.0), random.normal(scale=0.2, size=3), random.normal(size=(3, 3))
        tensor = np.trace(spread @ spread.T) * np.eye(3) - spread @ spread.T
        model.appendBodyToJoint(joint, pinocchio.Inertia(mass, center, tensor), after)
        elements = tensor[np.triu_indices(3)].tolist()
        text += (
            f'[[description.inertials]]\nlink = "link{number}"\nmass = {mass!r}\n'
            f"center_of_mass = {center.tolist()}\ninertia = {elements}\n"
        )
    path = tmp_path / "arm.toml"
    path.write_text("terms = []\n" + text)
    ours = sy.Model.load(path)
    data = model.createData()
    for _ in range(3):
        q, dq, ddq = random.normal(size=(3, 3))
        torque = ours.inverse_dynamics(q, dq, ddq, np.asarray(ours.robot.parameters))
        assert np.allclose(torque, pinocchio.rnea(model, data, q, dq, ddq), rtol=1e-10, atol=1e-10)
