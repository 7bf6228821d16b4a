"""Batches of odd sizes, with `out` and with threads, against a loop over Pinocchio."""

import numpy as np
import pytest
from pinocchio_oracle import URDFS, Oracle, pinocchio

import steelyard as sy
from steelyard.graph import kernel as kernel_module


@pytest.mark.parametrize(("threads", "count"), [(1, 1), (1, 5), (2, 13), (2, 131)])
def test_batches(threads, count, monkeypatch):
    monkeypatch.setattr(kernel_module, "_WORTHWHILE", 1.0)
    monkeypatch.setattr(kernel_module, "_LARGE", 1 << 14)
    found = [path for path in URDFS if path.name == "ur5_robot.urdf"]
    if not found:
        pytest.skip("ur5_robot of example-robot-data is not installed")
    robot = sy.Robot.from_urdf(found[0])
    model, oracle = sy.Model(robot, threads=threads), Oracle(found[0], robot)
    q, dq, ddq = np.random.default_rng(count).normal(size=(3, count, robot.dof))
    parameters = np.asarray(robot.parameters)
    torque = np.array([oracle.torque(*row) for row in zip(q, dq, ddq, strict=True)])
    inertia = np.array([oracle.inertia_matrix(row) for row in q])
    out = np.empty((count, robot.dof, model.parameter_count))
    spread = np.repeat(q, 2, axis=0)[::2]
    for positions in (q, spread, np.asfortranarray(q)):
        assert model.regressor(positions, dq, ddq, out=out) is out
        np.testing.assert_allclose(out @ parameters, torque, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(model.inverse_dynamics(positions, dq, ddq, parameters), torque, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(model.inertia_matrix(positions, parameters), inertia, rtol=1e-9, atol=1e-9)
    back = np.empty_like(q)
    model.forward_dynamics(q, dq, torque, parameters, out=back)
    np.testing.assert_allclose(back, ddq, rtol=1e-7, atol=1e-7)
    acceleration = pinocchio.aba(oracle.model, oracle.data, *oracle.state(q[0], dq[0], dq[0])[:2], torque[0])
    np.testing.assert_allclose(model.forward_dynamics(q[0], dq[0], torque[0], parameters), acceleration, rtol=1e-7)
