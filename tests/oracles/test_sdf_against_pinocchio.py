"""Random trees, written as SDF, against models of Pinocchio that are made of the same placements."""

import numpy as np
import pytest

import steelyard as sy

pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")

from random_sdf import RandomTree  # noqa: E402


def compare(path, tree, seed):
    robot = sy.Robot.from_sdf(path, gravity=tree.links[0].rotation.T @ [0, 0, -9.81])
    model = tree.pinocchio_model()
    data = model.createData()
    assert sorted(robot.joint_names) == sorted(model.names[1:])
    order = [model.getJointId(name) - 1 for name in robot.joint_names]
    random = np.random.default_rng(seed)
    ours = sy.Model(robot)
    parameters = np.nan_to_num(robot.parameters)
    for _ in range(3):
        q, dq, ddq = random.uniform(-2, 2, (3, robot.dof))
        full = np.zeros((3, robot.dof))
        full[:, order] = q, dq, ddq
        expected = pinocchio.rnea(model, data, *full)[order]
        torque = ours.inverse_dynamics(q, dq, ddq, parameters)
        assert np.abs(torque - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("version", ["1.4", "1.5", "1.6", "1.7", "1.11"])
def test_random_trees_agree(tmp_path, version):
    for seed in range(2):
        tree = RandomTree(seed, 6)
        path = tmp_path / f"tree{seed}.sdf"
        path.write_text(tree.sdf(version))
        compare(path, tree, seed)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["1.4", "1.6", "1.7", "1.8", "1.9", "1.10", "1.11"])
def test_many_random_trees_agree(tmp_path, version):
    for seed in range(2, 30):
        tree = RandomTree(seed, int(3 + seed % 9))
        path = tmp_path / f"tree{seed}.sdf"
        path.write_text(tree.sdf(version))
        compare(path, tree, seed)
