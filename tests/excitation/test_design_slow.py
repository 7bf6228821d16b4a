"""Designs of the size of real work: the seven-joint WAM, and a six-joint arm over a table that must not hit itself."""

import sysconfig
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.collision import geometry_from_dict
from steelyard.excitation import MotionLimits, SearchOptions
from steelyard.identification.wam import TRAJECTORIES

pytestmark = pytest.mark.slow

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"


def test_wam_within_the_envelope_of_the_thesis(wam):
    """Thesis section 4.3.2 stopped near a condition number of 110."""
    limits = MotionLimits.envelope(list(TRAJECTORIES.values()), wam.robot.joint_names, 1000.0)
    base = wam.base_parameters()

    def condition_number(motion):
        return np.linalg.cond(wam.regressor(*motion)[:, :, base.independent].reshape(-1, base.count))

    assert condition_number(TRAJECTORIES["A"].sample(1000.0)[1:]) == pytest.approx(107.938, abs=1e-3)
    found = []
    for seed in range(2):
        design = sy.design_excitation(wam, limits, period=12.5, harmonics=6, search=SearchOptions(seed=seed))
        _, q, dq, ddq = design.trajectory.sample(1000.0)
        assert np.all((q >= limits.lower) & (q <= limits.upper))
        assert np.all(np.abs(dq) <= limits.velocity)
        assert np.all(np.abs(ddq) <= limits.acceleration)
        found.append(condition_number(design.sample(1000.0)[1:]))
        assert found[-1] == pytest.approx(design.condition_number, rel=1e-6)
    assert max(found) <= 75.0
    assert min(found) <= 68.0


def test_six_joints_over_a_table_without_hitting_itself():
    pytest.importorskip("coal", reason="the extra collision (coal) is not installed")
    pinocchio = pytest.importorskip("pinocchio", reason="the extra oracles (pin) is not installed")
    path = ROBOTS / "ur_description/urdf/ur5_robot.urdf"
    if not path.exists():
        pytest.skip("example-robot-data is not installed")
    robot = sy.Robot.from_urdf(path).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset())
    model = sy.Model(robot)
    tables = {
        "collision": {"margin": 0.02},
        "table": {"offset": 0.0, "margin": 0.005, "ignore": ["base_link", "shoulder_link"]},
    }
    constraints = geometry_from_dict(tables, robot)
    torque = np.array([100.0, 80.0, 40.0, 15.0, 15.0, 15.0])
    design = sy.design_excitation(
        model,
        {"velocity": 2.5, "acceleration": 8.0, "torque": torque.tolist()},
        period=10.0,
        harmonics=5,
        search=SearchOptions(starts=2),
        constraints=constraints,
    )
    assert design.condition_number < 60.0
    _, q, dq, ddq = design.trajectory.sample(1000.0)
    assert np.abs(dq).max() <= 2.5
    assert np.abs(ddq).max() <= 8.0
    still = np.zeros_like(q)
    for constraint in constraints:
        assert constraint.clearance(q, still, still).min() >= 0.0, constraint.name
    own = pinocchio.buildModelFromUrdf(str(path))
    data = own.createData()
    friction = np.array([joint.friction for joint in robot.joints])
    damping = np.array([joint.damping for joint in robot.joints])
    for k in range(0, len(q), 7):
        predicted = pinocchio.rnea(own, data, q[k], dq[k], ddq[k])
        predicted = predicted + np.nan_to_num(damping) * dq[k] + np.nan_to_num(friction) * np.sign(dq[k])
        assert np.all(np.abs(predicted) <= torque + 1e-6)
