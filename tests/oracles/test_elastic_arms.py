"""The stiffness of an arm's joints against the springs with which Pinocchio and SciPy moved it."""

import numpy as np
import pytest
from elastic_logs import ElasticArm

import steelyard as sy


@pytest.mark.slow
def test_stiffnesses_of_a_simulated_arm_lie_within_three_percent_and_their_intervals(tmp_path):
    random = np.random.default_rng([0, 5])
    arm = ElasticArm("ur5", random)
    log = arm.log(random, duration=4.0)
    found = sy.identify(arm.robot_file(tmp_path, joints=[1, 2, 3]), log).elastic_joints
    for k, joint in enumerate(found):
        low, high = joint.stiffness_interval
        assert joint.verdict == "measured"
        assert abs(joint.stiffness / arm.stiffness[k] - 1.0) < 0.03
        assert low < arm.stiffness[k] < high
        assert abs(joint.delay - arm.delay[k]) < 1e-5
        assert abs(joint.zeros[0] - arm.zero[k]) < 1e-4


@pytest.mark.slow
def test_intervals_by_the_encoders_of_the_motors_alone_hold_the_stiffnesses_of_a_simulated_arm(tmp_path):
    """The noise of the positions drew compliances to zero: bounds of four to six errors beyond the truth."""
    random = np.random.default_rng([205, 5])
    arm = ElasticArm("ur5", random)
    log = arm.log(random)
    found = sy.identify(arm.robot_file(tmp_path, second=False), log).elastic_joints
    for joint, truth in zip(found, arm.stiffness, strict=True):
        low, high = joint.stiffness_interval
        assert low < truth < high
        assert (joint.verdict == "bounded") == (high == np.inf)
    assert found[1].verdict == "measured"
