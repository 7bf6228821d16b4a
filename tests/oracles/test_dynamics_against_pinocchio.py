"""Inverse dynamics, regressor and inertia matrix against Pinocchio, for every robot of example-robot-data."""

import numpy as np
import pytest
from interpreted import interpreted
from pinocchio_oracle import URDFS, Oracle

import steelyard as sy
from steelyard.errors import InputError

LARGEST = "g1_29dof_with_hand_rev_1_0.urdf"  # 43 joints
FAST = ("panda.urdf", "ur5_robot.urdf", "xarm7.urdf", "solo12.urdf", "TwoDofs.urdf", "finger_edu.urdf", "z1.urdf")
QUICK = ("panda.urdf", "solo12.urdf", "TwoDofs.urdf")


def by_kernels(model, q, dq, ddq, parameters):
    torque, inertia = model.inverse_dynamics(q, dq, ddq, parameters), model.inertia_matrix(q, parameters)
    return torque, inertia, model.regressor(q, dq, ddq)


def by_interpreter(model, q, dq, ddq, parameters):
    """The same without a compiler, which takes some seconds for a humanoid."""
    values = {"q": q, "dq": dq, "ddq": ddq, "parameters": parameters}
    return [interpreted(model, name, **values) for name in ("inverse_dynamics", "inertia_matrix", "regressor")]


def check(path, robot, oracle, random, computed):
    parameters = np.nan_to_num(np.asarray(robot.parameters))
    q = random.uniform(-3.0, 3.0, (3, robot.dof))
    dq, ddq = random.normal(size=(2, 3, robot.dof))
    torque, inertia, regressor = computed(sy.Model(robot), q, dq, ddq, parameters)
    for s in range(3):
        for ours, theirs in (
            (torque[s], oracle.torque(q[s], dq[s], ddq[s])),
            (inertia[s], oracle.inertia_matrix(q[s])),
            (regressor[s], oracle.regressor(q[s], dq[s], ddq[s])),
        ):
            assert np.max(np.abs(ours - theirs)) <= 1e-9 * max(np.max(np.abs(theirs)), 1e-6), path.name


def robot_or_reason(path):
    try:
        return sy.Robot.from_urdf(path), ""
    except InputError as error:
        return None, str(error)


@pytest.mark.parametrize(
    "path",
    [p if p.name in QUICK else pytest.param(p, marks=pytest.mark.slow) for p in URDFS if p.name in FAST],
    ids=lambda p: p.stem,
)
def test_fast_robots(path, random):
    robot, _ = robot_or_reason(path)
    assert robot is not None
    check(path, robot, Oracle(path, robot), random, by_kernels)


@pytest.mark.slow
def test_every_robot_agrees_or_is_refused_with_a_reason(random):
    assert len(URDFS) > 60, "example-robot-data is not installed"
    agreed, refused = [], {}
    for path in URDFS:
        robot, reason = robot_or_reason(path)
        if robot is None:
            refused[path.name] = reason
            continue
        check(path, robot, Oracle(path, robot), random, by_kernels if path.name == LARGEST else by_interpreter)
        agreed.append(path.name)
    assert len(agreed) >= 60
    for name, reason in refused.items():
        assert name in reason
        assert any(phrase in reason for phrase in ("no joint moves", "mimics the unknown joint", "has no <link>")), (
            reason
        )
