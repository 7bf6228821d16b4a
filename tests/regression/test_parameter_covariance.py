"""Uncertainty under correlated residuals: exact covariances, an independent Newey-West estimate, repetition."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student

import steelyard as sy
from steelyard.regression import ParameterCovariance
from steelyard.regression.batch_means import BATCH_LENGTHS

RATE = 500.0


@pytest.fixture(scope="module")
def arm():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")], name="arm")
    return sy.Model(robot.with_terms(sy.Viscous(), sy.Offset()))


def motion(count, seed=0):
    random = np.random.default_rng(seed)
    t = np.arange(count)[:, None] / RATE
    w, phase = 2 * np.pi * random.uniform(0.1, 0.6, (3, 2)), random.uniform(0, 6, (3, 2))
    angles = [w[i] * t + phase[i] for i in range(3)]
    return (
        sum(np.sin(a) for a in angles),
        sum(w[i] * np.cos(a) for i, a in enumerate(angles)),
        -sum(w[i] ** 2 * np.sin(a) for i, a in enumerate(angles)),
    )


def colored(random, shape, keep, sizes=(0.5, 0.1)):
    white = random.normal(size=(shape[0] + 2000, shape[1]))
    return np.sqrt(1 - keep**2) * lfilter([1.0], [1.0, -keep], white, axis=0)[2000:] * sizes


def samples_of(model, count, keep, seed, mask=None):
    q, dq, ddq = motion(count)
    torque = model.inverse_dynamics(q, dq, ddq, np.linspace(0.5, 1.5, model.parameter_count))
    torque = torque + colored(np.random.default_rng(seed), torque.shape, keep)
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask)


def regressors(model, samples):
    H = model.regressor(samples.q, samples.dq, samples.ddq)[:, :, model.base_parameters().independent]
    return [H[:, k] for k in range(model.dof)]


def independent(information, weights="joint"):
    """Standard errors as if each row were independent (thesis eq. 4.27)."""
    return ParameterCovariance.of_reduced(information.reduced(weights)).standard_error


def exact_covariance(model, samples, keep, weights, sizes=(0.5, 0.1)):
    """Of weighted least squares under first-order autoregressive noise of known size, by dense matrices."""
    W = regressors(model, samples)
    A = sum(w**2 * X.T @ X for w, X in zip(weights, W, strict=True))
    gamma = toeplitz(keep ** np.arange(samples.count))
    middle = sum(w**4 * s**2 * X.T @ gamma @ X for w, s, X in zip(weights, sizes, W, strict=True))
    inverse = np.linalg.inv(A)
    return inverse @ middle @ inverse


def newey_west(model, samples, base, weights, lags):
    """Heteroskedasticity and autocorrelation consistent covariance, Bartlett weights, summed lag by lag."""
    W = regressors(model, samples)
    A = sum(w**2 * X.T @ X for w, X in zip(weights, W, strict=True))
    middle = np.zeros_like(A)
    for k, (w, X) in enumerate(zip(weights, W, strict=True)):
        scores = w**2 * X * (samples.torque[:, k] - X @ base)[:, None]
        middle += scores.T @ scores
        for lag in range(1, lags):
            cross = scores[lag:].T @ scores[:-lag]
            middle += (1 - lag / lags) * (cross + cross.T)
    inverse = np.linalg.inv(A)
    return inverse @ middle @ inverse


@pytest.mark.slow
@pytest.mark.parametrize("keep", [0.0, 0.8, 0.95])
def test_deviations_are_those_of_the_exact_covariance(arm, keep):
    samples = samples_of(arm, 6000, keep, 1)
    weights = np.array([2.0, 10.0])
    exact = np.sqrt(np.diagonal(exact_covariance(arm, samples, keep, weights)))
    ratios = []
    for seed in range(12):
        information = sy.Information.from_samples(arm, samples_of(arm, 6000, keep, seed))
        estimate = sy.least_squares(information, weights)
        ratios.append(estimate.standard_error / exact)
    # Each rests on 20 to 200 blocks; their mean square shows the bias.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(ratios), axis=0)), 1.0, atol=0.12)


@pytest.mark.slow
def test_agrees_with_newey_west(arm):
    samples = samples_of(arm, 20000, 0.9, 5)
    estimate = sy.least_squares(sy.Information.from_samples(arm, samples), "joint")
    expected = np.sqrt(np.diagonal(newey_west(arm, samples, estimate.base, estimate.weights, 300)))
    # Newey and West's estimate does not give back what the fit took out of the residuals, and is itself noisy.
    np.testing.assert_allclose(estimate.standard_error, expected, rtol=0.3)
    assert np.median(estimate.standard_error / expected) == pytest.approx(1.0, abs=0.15)


def test_white_noise_needs_no_correction(arm):
    data = [sy.Information.from_samples(arm, samples_of(arm, 8000, 0.0, seed)) for seed in range(8)]
    ratio = [sy.least_squares(one, "joint").standard_error / independent(one) for one in data]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.05)


def test_inflation_is_that_of_the_noise(arm):
    information = sy.Information.from_samples(arm, samples_of(arm, 60000, 0.9, 3))
    found = ParameterCovariance.of(information).correlation
    np.testing.assert_allclose(found.inflation, (1 + 0.9) / (1 - 0.9), rtol=0.3)
    np.testing.assert_allclose(np.sqrt(found.variance), [0.5, 0.1], rtol=0.05)
    np.testing.assert_allclose(found.effective_count, 60000 / found.inflation)
    assert found.settled.all()
    assert "independent" in repr(found)
    assert "<table>" in found._repr_html_()


@pytest.mark.slow
def test_intervals_cover_the_truth(arm):
    truth = arm.base_parameters().values(np.linspace(0.5, 1.5, arm.parameter_count))
    inside, plain = [], []
    for seed in range(50):
        information = sy.Information.from_samples(arm, samples_of(arm, 5000, 0.95, seed))
        estimate = sy.least_squares(information, "joint")
        low, high = estimate.confidence_interval(0.95).T
        inside.append((low <= truth) & (truth <= high))
        plain.append(np.abs(estimate.base - truth) <= 1.96 * independent(information))
    assert 0.90 <= np.mean(inside) <= 0.99
    assert np.mean(plain) < 0.5


def test_batch_sums_are_sums_of_rows(arm):
    mask = np.random.default_rng(1).random((2500, 2)) > 0.3
    samples = samples_of(arm, 2500, 0.5, 2, mask)
    information = sy.Information.from_samples(arm, samples)
    assert len(information.batch_means) == len(BATCH_LENGTHS)
    for length, level in zip(BATCH_LENGTHS, information.batch_means, strict=True):
        for k, (factor, X) in enumerate(zip(level, regressors(arm, samples), strict=True)):
            rows = np.column_stack([X[:, factor.columns], samples.torque[:, k]]) * mask[:, k, None]
            sums = np.add.reduceat(rows, np.arange(0, 2500, length))
            np.testing.assert_allclose(factor.triangle.T @ factor.triangle, sums.T @ sums, rtol=1e-9, atol=1e-7)
            assert factor.count == len(sums)


def test_informations_add_with_their_batch_means(arm, tmp_path):
    samples = samples_of(arm, 4096, 0.9, 4)
    parts = [
        sy.Samples(q=samples.q[r], dq=samples.dq[r], ddq=samples.ddq[r], torque=samples.torque[r])
        for r in (slice(0, 2048), slice(2048, 4096))
    ]
    whole = sy.Information.from_samples(arm, samples)
    total = sy.Information.from_chunks(arm, parts)
    total.save(tmp_path / "information.json")
    for other in (total, sy.Information.load(tmp_path / "information.json"), sy.Information.empty(arm) + total):
        found = sy.least_squares(other, "joint")
        np.testing.assert_allclose(found.standard_error, sy.least_squares(whole, "joint").standard_error, rtol=1e-8)
    without = sy.Information.from_samples(arm, parts[0], batch_means=False)
    assert (total + without).batch_means == ()
    assert ParameterCovariance.of(without).correlation is None
    np.testing.assert_allclose(sy.least_squares(without).standard_error, independent(without), rtol=1e-9)


@pytest.mark.slow
def test_whitened_rows_have_corrected_errors_too(arm):
    count, keep = 20000, 0.9
    mixing = np.linalg.cholesky(np.array([[0.25, 0.04], [0.04, 0.01]]))
    q, dq, ddq = motion(count)
    exact = arm.inverse_dynamics(q, dq, ddq, np.linspace(0.5, 1.5, arm.parameter_count))
    ratios = []
    for seed in range(6):
        noise = colored(np.random.default_rng(seed), q.shape, keep, (1.0, 1.0)) @ mixing.T
        samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=exact + noise)
        information = sy.Information.from_samples(arm, samples, mixing @ mixing.T)
        ratios.append(np.median(sy.least_squares(information).standard_error / independent(information)))
    assert np.mean(ratios) == pytest.approx(np.sqrt((1 + keep) / (1 - keep)), rel=0.1)


def test_correlation_beyond_the_log_is_told(arm):
    q, dq, ddq = motion(3000)
    drift = np.sin(np.arange(3000) / 700.0)[:, None]
    torque = arm.inverse_dynamics(q, dq, ddq, np.ones(arm.parameter_count)) + drift
    information = sy.Information.from_samples(arm, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    found = ParameterCovariance.of(information).correlation
    assert not found.settled.any()


def test_undetermined_stays_infinite(arm):
    q, dq, ddq = (a.copy() for a in motion(3000))
    for array in (q, dq, ddq):
        array[:, 1] = 0.0
    torque = np.random.default_rng(1).normal(size=q.shape)
    information = sy.Information.from_samples(arm, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    loose = information.unidentifiable_mask
    assert loose.any()
    np.testing.assert_array_equal(~np.isfinite(sy.least_squares(information).standard_error), loose)
    covariance = ParameterCovariance.of(information)
    R = information.reduced().R
    assert np.linalg.norm(R @ covariance.unidentifiable) < 1e-6 * np.linalg.norm(R)
    assert covariance.root.shape[1] + covariance.unidentifiable.shape[1] == len(R) == len(covariance.matrix)
    np.testing.assert_array_equal(np.isinf(np.diagonal(covariance.matrix)), loose)


def test_feasible_fits_have_it_too(arm):
    q, dq, ddq = motion(5000)
    body, joint = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.1, 0.1, 0.1, 1.0], [0.5, 0.2]
    torque = arm.inverse_dynamics(q, dq, ddq, np.array(2 * (body + joint)))
    torque += colored(np.random.default_rng(1), torque.shape, 0.9)
    information = sy.Information.from_samples(arm, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    plain, feasible = sy.least_squares(information, "joint"), sy.fit(information, sy.FeasibleSet(arm))
    np.testing.assert_allclose(feasible.standard_error, plain.standard_error, rtol=0.2)


def test_estimates_keep_it_and_files_of_another_format_are_refused(arm, tmp_path):
    information = sy.Information.from_samples(arm, samples_of(arm, 2000, 0.5, 1))
    estimate = sy.least_squares(information)
    estimate.save(tmp_path / "estimate.json")
    loaded = sy.Estimate.load(tmp_path / "estimate.json")
    np.testing.assert_array_equal(loaded.standard_error, estimate.standard_error)
    reach = 1.959964 * estimate.standard_error
    np.testing.assert_allclose(
        loaded.confidence_interval(), estimate.base[:, None] + np.outer(reach, [-1, 1]), rtol=1e-6
    )
    with pytest.raises(sy.InputError, match="between 0 and 1"):
        loaded.confidence_interval(95)
    older = estimate.to_dict() | {"format": "steelyard-estimate-1"}
    with pytest.raises(sy.InputError, match="'steelyard-estimate-1', expected 'steelyard-estimate-3'; identify"):
        sy.Estimate.from_dict(older)
    information.save(tmp_path / "information.json")
    text = (tmp_path / "information.json").read_text().replace("steelyard-information-2", "steelyard-information-1")
    (tmp_path / "information.json").write_text(text)
    with pytest.raises(sy.InputError, match="'steelyard-information-1', expected 'steelyard-information-2'; reduce"):
        sy.Information.load(tmp_path / "information.json")


SWING_TRUTH = np.array([*[0.0] * 5, 0.5, 0.3, 0.0, 0.0, 1.0, 3.0])


@pytest.fixture(scope="module")
def swing():
    """A joint with friction that changes its direction ten times."""
    return sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Coulomb()))


def swung(model, seed=1):
    t = np.arange(8000)[:, None] / RATE
    q, dq, ddq = np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)
    torque = model.inverse_dynamics(q, dq, ddq, SWING_TRUTH)
    torque = torque + 0.02 * np.random.default_rng(seed).normal(size=q.shape)
    return sy.Recording(t=t[:, 0], q=q, torque=torque)


FILTERS = pytest.mark.parametrize(
    "options", [{"torque_cutoff": 5.0}, pytest.param({"decimate": [10]}, marks=pytest.mark.slow)], ids=str
)


@FILTERS
def test_intervals_hold_where_the_regressor_is_filtered_as_the_torques_are(swing, options):
    """Without the regressor's filter, errors are 3 to 17 standard errors."""
    truth, processing = swing.base_parameters().values(SWING_TRUTH), sy.recording.Processing(cutoff=5.0, **options)
    off = []
    for seed in range(12):
        samples = swung(swing, seed).process(processing, swing)
        information = sy.Information.from_samples(swing, samples)
        assert not information.filtered_torque
        estimate = sy.least_squares(information)
        off.append((estimate.base - truth) / estimate.standard_error)
        assert np.all(np.isfinite(estimate.confidence_interval()))
    assert np.abs(off).max() < 3.5
    assert np.sqrt(np.mean(np.square(off))) < 1.4
    # Of another model, though its robot is the same, the regressor was not filtered.
    other = sy.Model(swing.robot)
    biased = sy.Information.from_samples(other, samples)
    assert biased.filtered_torque
    assert np.all(np.isinf(sy.least_squares(biased).confidence_interval()))
    mixed = [samples.rows(0, 100), replace(samples, regressor_model=other)]
    assert sy.Information.from_chunks(swing, mixed).filtered_torque


@pytest.mark.slow
def test_intervals_of_short_logs_are_those_of_few_batches(arm):
    """With the normal quantile and no more, 91 % of the truth would be held."""
    truth = arm.base_parameters().values(np.linspace(0.5, 1.5, arm.parameter_count))
    inside = []
    for seed in range(60):
        information = sy.Information.from_samples(arm, samples_of(arm, 1500, 0.95, seed))
        low, high = sy.least_squares(information, "joint").confidence_interval(0.95).T
        inside.append((low <= truth) & (truth <= high))
    assert 0.93 <= np.mean(inside) <= 0.99


def test_few_batches_widen_intervals_as_student_does(swing):
    samples = swung(swing).process(cutoff=5.0).rows(0, 1500)
    covariance = ParameterCovariance.of(sy.Information.from_samples(swing, samples), weights=None)
    found, [W] = covariance.correlation, regressors(swing, samples)
    [degrees], [length] = found.degrees_of_freedom, found.batch_length
    assert degrees <= -(-1500 // length)  # one for each batch, less what the parameters take
    of_normal = np.sqrt(found.long_run_variance * np.diagonal(np.linalg.inv(W.T @ W)))
    np.testing.assert_allclose(covariance.standard_error * norm.ppf(0.975), of_normal * student.ppf(0.975, degrees))


@FILTERS
def test_no_interval_is_told_of_filtered_torques(swing, options, tmp_path):
    """The model's friction jumps, the torques no longer do: estimates are off by many of their deviations."""
    model, truth, recording = swing, SWING_TRUTH, swung(swing)
    information = sy.Information.from_samples(model, recording.process(cutoff=5.0, trim=0.5, **options))
    estimate = sy.least_squares(information)
    off = np.abs(estimate.base - model.base_parameters().values(truth)) / estimate.standard_error
    assert off.max() > 3.0  # what an interval of noise would miss
    assert np.all(np.isinf(estimate.confidence_interval()))
    assert set(estimate.weak) <= {"ly1"}  # by what noise alone explains; ly1 is zero
    assert any("no interval of a base parameter is given" in remark for remark in estimate.remarks)
    information.save(tmp_path / "information.json")
    again = sy.least_squares(sy.Information.load(tmp_path / "information.json") + sy.Information.empty(model))
    assert np.all(np.isinf(again.confidence_interval()))
    assert np.all(np.isinf(sy.fit(information, sy.FeasibleSet(model)).confidence_interval()))
    plain = sy.least_squares(sy.Information.from_samples(model, recording.process(cutoff=5.0, trim=0.5)))
    assert np.all(np.isfinite(plain.confidence_interval()))


def test_the_cut_of_the_samples_changes_nothing(arm):
    """To the last bit, sums over neighbouring rows included, which lie across the cuts."""
    mask = np.random.default_rng(1).random((9000, 2)) > 0.3
    samples = samples_of(arm, 9000, 0.9, 4, mask)
    cuts = [0, 1, 700, 2047, 2049, 6000, 9000]
    parts = [samples.rows(a, b) for a, b in itertools.pairwise(cuts)]
    for covariance in (None, [[0.3, 0.1], [0.1, 0.2]]):
        whole = sy.Information.from_samples(arm, samples, covariance)
        cut = sy.Information.from_chunks(arm, parts, covariance)
        for a, b in zip(whole.factors, cut.factors, strict=True):
            np.testing.assert_array_equal(a.triangle, b.triangle)
            assert a.count == b.count
        for first, second in zip(whole.batch_means, cut.batch_means, strict=True):
            for a, b in zip(first, second, strict=True):
                np.testing.assert_array_equal(a.triangle, b.triangle)
                assert a.count == b.count


def test_what_a_joint_at_rest_hardly_shows_hides_nothing_of_what_others_show():
    random = np.random.default_rng(3)
    columns = random.normal(size=(500, 5))
    columns[:, 4] = columns[:, 3] * 2.0  # one combination is not shown
    columns[:, 1] *= 1e-17  # as rounding leaves of the acceleration of a joint that stands still
    columns[:, 2] *= 1e-9  # as the noise of its encoder
    triangle = np.linalg.qr(columns, mode="r")
    info = sy.Information.from_factor(triangle, triangle @ np.ones(5), 500.0, 505, list("abcde"))
    deviations = ParameterCovariance.of(info, np.ones(5)).in_deviations()
    for change in ([0.3, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.4, 0.0], [0.1, 0.0, 0.0, 0.0, -0.2]):
        expected = np.linalg.norm(columns @ change)  # in units of the standard deviation of a row, which is 1
        assert np.linalg.norm(deviations @ change) == pytest.approx(expected, rel=1e-6)


def test_independent_errors_add_to_the_diagonal():
    root = np.random.default_rng(5).normal(size=(4, 4))
    covariance = ParameterCovariance.of_matrix(root @ root.T, 4)
    wider = covariance.with_independent_errors([0.0, 2.0, 0.5, 0.0])
    assert wider.matrix == pytest.approx(root @ root.T + np.diag([0.0, 4.0, 0.25, 0.0]), rel=1e-10)
    assert covariance.with_independent_errors(np.zeros(4)) is covariance


def test_an_error_that_is_far_larger_than_noise_leaves_the_others_as_they_are():
    """Rounding of the identity beside 1e24 is larger than one, and its square root was NaN."""
    plain = ParameterCovariance.of_matrix(np.diag([1.0, 4.0, 9.0]), 3)
    random = np.random.default_rng(1)
    turned = replace(plain, root=plain.root @ np.linalg.qr(random.normal(size=(3, 3)))[0])
    change = np.array([[1e12, 3e11], [0.0, 0.0], [0.0, 0.0]])
    found = turned.with_errors(change).standard_error
    assert found[0] == pytest.approx(np.hypot(1e12, 3e11), rel=1e-6)
    assert np.isfinite(found).all()
