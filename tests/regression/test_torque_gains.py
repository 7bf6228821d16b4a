"""How least squares change where the torques of a joint are scaled, beside the regression of all rows at once."""

from __future__ import annotations

import numpy as np
import pytest

import steelyard as sy
from steelyard.regression import torque_gains

ROBOT = sy.Robot.from_dh(
    [(0.0, 0.4, 0, "q"), ("pi/2", 0.3, 0.1, "q"), (0.0, 0.25, 0, "q")], gravity=(0, 0, -9.81)
).with_terms(sy.Viscous(), sy.Coulomb())


@pytest.fixture(scope="module")
def samples() -> sy.Samples:
    random = np.random.default_rng(1)
    model = sy.Model(ROBOT)
    q, dq, ddq = random.normal(size=(3, 400, 3))
    torque = model.inverse_dynamics(q, dq, ddq, random.uniform(0.5, 1.5, model.parameter_count))
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque + 0.1 * random.normal(size=torque.shape))


@pytest.mark.parametrize("weights", [None, (1.0, 3.0, 0.5)])
def test_the_change_is_that_of_the_regression_of_all_rows(
    samples: sy.Samples, weights: tuple[float, ...] | None
) -> None:
    model = sy.Model(ROBOT)
    info = sy.Information.from_samples(model, samples)
    gains = torque_gains(info, weights)
    assert gains is not None
    base = model.base_parameters()
    used = np.ones(3) if weights is None else np.array(weights)
    rows = (model.regressor(samples.q, samples.dq, samples.ddq) * used[:, None]) @ base.Pb
    for joint in range(3):
        alone = np.where(np.arange(3) == joint, samples.torque * used, 0.0)
        expected = np.linalg.lstsq(rows.reshape(-1, base.count), alone.ravel(), rcond=None)[0]
        assert np.allclose(gains[:, joint], expected, rtol=1e-9, atol=1e-9)
    assert np.allclose(gains.sum(axis=1), sy.least_squares(info, weights).base, rtol=1e-9, atol=1e-9)


def test_what_was_whitened_does_not_tell_joints_apart(samples: sy.Samples) -> None:
    model = sy.Model(ROBOT)
    assert torque_gains(sy.Information.from_samples(model, samples, np.eye(3))) is None


def test_a_joint_without_rows_changes_nothing(samples: sy.Samples) -> None:
    mask = np.ones_like(samples.torque, dtype=bool)
    mask[:, 1] = False
    masked = sy.Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=samples.torque, mask=mask)
    gains = torque_gains(sy.Information.from_samples(sy.Model(ROBOT), masked))
    assert gains is not None
    assert np.all(np.isfinite(gains))
    assert np.all(gains[:, 1] == 0.0)
