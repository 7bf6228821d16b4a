"""A base that is not level, by simulated logs whose gravity is known: told where it is sure, and counted."""

import numpy as np
import pytest
from simulated_arm import simulated_arm

import steelyard as sy
from steelyard.identification.tilted_base import tilted_base
from steelyard.recording import Samples
from steelyard.regression import Information


def tilted(seed: int, degrees: float):
    """The arm of the tests, moved where gravity acts at an angle to what its description says, with its noise."""
    arm = simulated_arm(seed, seconds=30.0)
    motion = arm.samples.q, arm.samples.dq, arm.samples.ddq
    noise = arm.samples.torque - arm.model.inverse_dynamics(*motion, arm.truth)
    own = np.asarray(arm.model.robot.gravity)
    angle = np.radians(degrees)
    aside = np.array([0.8, 0.6, 0.0])
    gravity = np.cos(angle) * own + np.sin(angle) * np.linalg.norm(own) * aside
    torque = arm.model.inverse_dynamics(*motion, arm.truth, gravity=gravity) + noise
    samples = Samples(*motion, torque=torque, t=arm.samples.t)
    information = Information.from_samples(arm.model, samples)
    return arm, samples, information, sy.least_squares(information), gravity


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("degrees", [5.0, 8.0])
def test_a_tilt_is_told_with_its_angle_and_what_it_moves(seed, degrees):
    arm, samples, information, unconstrained, gravity = tilted(seed, degrees)
    found = tilted_base(arm.model, information, [samples], arm.truth, unconstrained)
    assert found is not None
    assert abs(found.angle - degrees) < max(3.0 * found.deviation, 0.3)
    assert np.linalg.norm(found.gravity) == pytest.approx(9.81, abs=1e-6)
    assert np.degrees(np.linalg.norm(found.gravity - gravity)) / 9.81 < max(3.0 * found.deviation, 0.5)
    # The change is the difference to the same log of a level base, to second order of the tilt.
    _, _, _, level, _ = tilted(seed, 0.0)
    moved = unconstrained.base - level.base
    errors = np.asarray(unconstrained.standard_error)
    far = np.abs(moved) > 4.0 * errors
    assert far.any()
    assert np.all(np.abs(found.change - moved)[far] < 0.35 * np.abs(moved)[far])


@pytest.mark.parametrize("degrees", [0.0, 1.0])
def test_no_tilt_is_told_of_a_base_that_is_nearly_level(degrees):
    for seed in range(1, 5):
        arm, samples, information, unconstrained, _ = tilted(seed, degrees)
        assert tilted_base(arm.model, information, [samples], arm.truth, unconstrained) is None


def test_a_part_of_many_rows_tells_the_same_tilt(monkeypatch):
    arm, samples, information, unconstrained, _ = tilted(1, 8.0)
    monkeypatch.setattr("steelyard.identification.tilted_base.MOST_ROWS", samples.count // 4 + 1)
    found = tilted_base(arm.model, information, [samples], arm.truth, unconstrained)
    assert found is not None
    assert abs(found.angle - 8.0) < 3.0 * found.deviation
    monkeypatch.undo()
    every = tilted_base(arm.model, information, [samples], arm.truth, unconstrained)
    assert every is not None
    assert every.deviation < found.deviation
