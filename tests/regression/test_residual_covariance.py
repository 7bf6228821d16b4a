"""Correlated noise: whitened rows against generalised least squares written out, and its covariance from residuals."""

import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.errors import InputError
from steelyard.recording import Samples
from steelyard.regression import Information, ParameterCovariance, least_squares, residual_covariance
from steelyard.robot import Robot

COVARIANCE = np.array([[4.0, 1.5, 0.2], [1.5, 1.0, -0.3], [0.2, -0.3, 0.5]])


@pytest.fixture(scope="module")
def arm():
    rows = [("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.0, "q"), ("pi/2", 0.3, 0.0, "q")]
    return Model(Robot.from_dh(rows, name="arm").with_terms(Viscous(), Coulomb()))


def recording(arm, count, seed, mask=False):
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, count, 3))
    torque = arm.inverse_dynamics(q, dq, ddq, np.linspace(0.5, 1.5, arm.parameter_count))
    torque += random.multivariate_normal(np.zeros(3), COVARIANCE, size=count)
    used = random.uniform(size=(count, 3)) > 0.2 if mask else None
    return Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=used)


def generalised(arm, samples):
    """(Wᵀ Ω⁻¹ W)⁻¹ Wᵀ Ω⁻¹ ω with each sample's own Ω, one sample at a time."""
    independent = np.asarray(arm.base_parameters().independent)
    H = arm.regressor(samples.q, samples.dq, samples.ddq)[:, :, independent]
    normal, right = np.zeros((len(independent),) * 2), np.zeros(len(independent))
    for i in range(samples.count):
        used = np.ones(3, dtype=bool) if samples.mask is None else samples.mask[i]
        if not used.any():
            continue
        inverse = np.linalg.inv(COVARIANCE[np.ix_(used, used)])
        normal += H[i, used].T @ inverse @ H[i, used]
        right += H[i, used].T @ inverse @ samples.torque[i, used]
    return np.linalg.solve(normal, right), np.linalg.inv(normal)


@pytest.mark.parametrize("mask", [False, True])
def test_whitened_rows_are_generalised_least_squares(arm, mask):
    samples = recording(arm, 700, 1, mask)
    info = Information.from_samples(arm, samples, COVARIANCE)
    estimate = least_squares(info)
    expected, covariance = generalised(arm, samples)
    np.testing.assert_allclose(estimate.base, expected, rtol=1e-8)
    assert estimate.method == "generalised least squares"
    # The rows have unit variance, so that deviations are those of the normal matrix, but for the estimated 1.
    found = ParameterCovariance.of_reduced(info.reduced())
    np.testing.assert_allclose(found.standard_error, np.sqrt(np.diag(covariance)), rtol=0.1)
    assert info.count == (int(samples.mask.sum()) if mask else 2100)


def test_errors_are_told_in_torques(arm):
    samples = recording(arm, 300, 2)
    info = Information.from_samples(arm, samples, COVARIANCE)
    plain = Information.from_samples(arm, samples)
    base = least_squares(info).base
    assert info.relative_error(base) == pytest.approx(plain.relative_error(base))
    np.testing.assert_allclose(info.joint_rms_error(base), plain.joint_rms_error(base))
    assert info.has_joint_errors
    assert not info.by_joint
    with pytest.raises(InputError, match="one number for each joint"):
        info.reduced("joints")
    np.testing.assert_array_equal(info.reduced("joint").R, info.reduced(None).R)


def test_chunks_files_and_sums(arm, tmp_path):
    parts = [recording(arm, 200, seed, mask=True) for seed in (3, 4)]
    whole = Information.from_samples(arm, Samples.joined(parts), COVARIANCE)
    total = Information.from_chunks(arm, parts, COVARIANCE)
    np.testing.assert_allclose(least_squares(total).base, least_squares(whole).base, rtol=1e-9)
    np.testing.assert_array_equal(total.covariance, COVARIANCE)
    total.save(tmp_path / "information.json")
    loaded = Information.load(tmp_path / "information.json")
    np.testing.assert_array_equal(least_squares(loaded).base, least_squares(total).base)
    assert least_squares(loaded).method == "generalised least squares"
    base = least_squares(loaded).base
    np.testing.assert_array_equal(loaded.joint_relative_error(base), total.joint_relative_error(base))
    with pytest.raises(InputError, match="only one of them was whitened"):
        total + Information.from_samples(arm, parts[0])


def test_covariance_is_estimated_from_residuals(arm):
    samples = recording(arm, 20000, 5)
    first = least_squares(Information.from_samples(arm, samples))
    found = residual_covariance(arm, samples, first)
    # The standard error of an element is about sqrt(2 / 20000) of its size.
    np.testing.assert_allclose(found, COVARIANCE, atol=0.05 * 4.0)
    chunks = [recording(arm, 20000, 5)]
    np.testing.assert_allclose(residual_covariance(arm, chunks, first.base), found)


def test_masked_rows_do_not_count(arm):
    samples = recording(arm, 5000, 6, mask=True)
    torque = np.where(samples.mask, samples.torque, 1e6)
    spoiled = Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=torque, mask=samples.mask)
    first = least_squares(Information.from_samples(arm, spoiled))
    np.testing.assert_allclose(residual_covariance(arm, spoiled, first), COVARIANCE, atol=0.1 * 4.0)


def test_two_joints_that_move_as_one_get_a_definite_covariance(arm):
    random = np.random.default_rng(7)
    samples = recording(arm, 500, 7)
    noise = random.normal(size=(500, 1)) * [1.0, 2.0, 3.0]
    exact = arm.inverse_dynamics(samples.q, samples.dq, samples.ddq, np.linspace(0.5, 1.5, arm.parameter_count))
    samples = Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=exact + noise)
    found = residual_covariance(arm, samples, least_squares(Information.from_samples(arm, samples)))
    assert np.linalg.eigvalsh(found)[0] > 0
    assert Information.from_samples(arm, samples, found).count == 1500


def test_bad_covariances_are_refused(arm):
    samples = recording(arm, 50, 8)
    for covariance, match in (
        (np.eye(2), r"must be of shape \(3, 3\)"),
        (np.triu(np.ones((3, 3))), "finite and symmetric"),
        (np.diag([1.0, 0.0, 1.0]), "the variance 0 for joint 2"),
        (np.ones((3, 3)), "not positive definite"),
    ):
        with pytest.raises(InputError, match=match):
            Information.from_samples(arm, samples, covariance)
    with pytest.raises(InputError, match="base parameters, all finite"):
        residual_covariance(arm, samples, np.ones(3))
    mask = np.ones((50, 3), dtype=bool)
    mask[:25, 0] = mask[25:, 1] = False
    apart = Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=samples.torque, mask=mask)
    with pytest.raises(InputError, match="joint 'joint1' and joint 'joint2' are never used in the same sample"):
        residual_covariance(arm, apart, np.zeros(arm.base_parameters().count))
