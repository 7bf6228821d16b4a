"""Huber's estimator by iterated re-weighting, against its direct minimisation."""

import numpy as np
import pytest
import scipy.optimize

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.estimators import robust_information
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet
from steelyard.recording import Samples
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot


@pytest.fixture(scope="module")
def arm():
    return Model(Robot.from_dh([("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]))


@pytest.fixture(scope="module")
def disturbed(arm):
    """One row in twelve of the second joint is off by a few newton metres."""
    random = np.random.default_rng(6)
    q, dq, ddq = random.normal(size=(3, 3000, 2))
    truth = np.array([0.1, 0, 0, 0.1, 0, 0.1, 0.1, 0.2, 0, 2.0] * 2)
    noise = random.normal(size=(3000, 2)) * [0.3, 0.1]
    noise[::12, 1] += random.normal(size=250) * 5.0 + 3.0
    return Samples(q=q, dq=dq, ddq=ddq, torque=arm.inverse_dynamics(q, dq, ddq, truth) + noise), truth


def rows_of(arm, samples):
    K = arm.base_parameters()
    H = arm.regressor(samples.q, samples.dq, samples.ddq)
    return H[:, :, np.asarray(K.independent)]  # columns of the independent parameters are those of the base


def huber_optimum(W, omega, scales, threshold, weights):
    """Least Σ over joints of weight² scale² ρ(residual / scale), by a quasi-Newton method."""
    limits = threshold * scales

    def value(base):
        error = W @ base - omega
        inner = np.abs(error) <= limits
        loss = np.where(inner, 0.5 * error**2, limits * (np.abs(error) - 0.5 * limits))
        slope = np.where(inner, error, limits * np.sign(error))
        factor = weights**2
        return float((loss * factor).sum()), np.einsum("sjk,sj->k", W, slope * factor)

    start = np.linalg.lstsq(W.reshape(-1, W.shape[2]), omega.ravel())[0]
    return scipy.optimize.minimize(value, start, jac=True, method="BFGS", options={"gtol": 1e-8}).x


@pytest.mark.parametrize("weights", [None, [1.0, 3.0]])
def test_fixed_point_is_hubers_estimate(arm, disturbed, weights):
    samples, truth = disturbed
    robust = robust_information(arm, samples, weights=weights, accuracy=1e-9)
    assert robust.huber.converged
    found = least_squares(robust, weights).base
    W = rows_of(arm, samples)
    factors = np.ones(2) if weights is None else np.array(weights)
    expected = huber_optimum(W, samples.torque, robust.huber.scales, 1.345, factors)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    true = arm.base_parameters().values(truth)
    plain = least_squares(Information.from_samples(arm, samples), weights).base
    assert np.linalg.norm(found - true) < 0.5 * np.linalg.norm(plain - true)


def test_record_tells_what_was_disturbed(arm, disturbed):
    samples, _ = disturbed
    robust = robust_information(arm, samples)
    np.testing.assert_allclose(robust.huber.scales, [0.3, 0.11], rtol=0.15)
    # A normal distribution has 17.9 % beyond 1.345 standard deviations; the second joint has 1 / 12 more.
    np.testing.assert_allclose(robust.huber.joint_share, [0.179, 0.25], atol=0.03)
    assert robust.huber.least_weight < 0.05
    assert any(remark.startswith("Huber weights: ") for remark in least_squares(robust).remarks)
    # Errors are those of the rows as measured.
    assert robust.relative_error(np.zeros(robust.base_count)) == pytest.approx(1.0)
    assert least_squares(robust).relative_error > least_squares(Information.from_samples(arm, samples)).relative_error


def test_among_feasible_robots(arm, disturbed):
    samples, _ = disturbed
    feasible = FeasibleSet(arm)
    robust = robust_information(arm, samples, feasible, prefer=None)
    estimate = fit(robust, feasible)
    assert feasible.contains(estimate.parameters)
    # Weights from the residuals of the answer itself: it is a fixed point.
    error = np.abs(samples.torque - arm.inverse_dynamics(samples.q, samples.dq, samples.ddq, estimate.parameters))
    share = np.mean(error > 1.345 * robust.huber.scales, axis=0)
    np.testing.assert_allclose(share, robust.huber.joint_share, atol=0.01)


def test_chunks_and_masks(arm, disturbed):
    samples, _ = disturbed
    cut = [slice(0, 100), slice(100, 3000)]
    parts = [Samples(q=samples.q[c], dq=samples.dq[c], ddq=samples.ddq[c], torque=samples.torque[c]) for c in cut]
    whole, pieces = robust_information(arm, samples), robust_information(arm, parts)
    np.testing.assert_allclose(least_squares(pieces).base, least_squares(whole).base, rtol=1e-9)
    mask = np.ones((3000, 2), dtype=bool)
    mask[::12, 1] = False
    masked = Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=samples.torque, mask=mask)
    robust = robust_information(arm, masked)
    np.testing.assert_allclose(robust.huber.joint_share, [0.179, 0.179], atol=0.03)
    assert robust.count == 5750


def test_clean_data_are_left_alone(arm, disturbed):
    samples, truth = disturbed
    exact = arm.inverse_dynamics(samples.q, samples.dq, samples.ddq, truth)
    clean = Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=exact)
    robust = robust_information(arm, clean)
    np.testing.assert_allclose(least_squares(robust).base, arm.base_parameters().values(truth), atol=1e-9)


def test_bad_arguments_are_refused(arm, disturbed):
    samples, _ = disturbed
    with pytest.raises(InputError, match="threshold must be a positive number"):
        robust_information(arm, samples, threshold=0.0)
    with pytest.raises(InputError, match="takes prefer only with feasible"):
        robust_information(arm, samples, prefer="lightest")
    with pytest.raises(InputError, match="no samples to reduce"):
        robust_information(arm, [])
    other = Model(Robot.from_dh([(0, 0.4, 0, "q")]))
    with pytest.raises(InputError, match="have 2 joints, but"):
        robust_information(other, samples)
