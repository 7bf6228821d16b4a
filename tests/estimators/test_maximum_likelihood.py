"""Maximum likelihood: generalised least squares of the noise that is found, its errors, gaps, logs, and `identify`."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.signal import lfilter

import steelyard as sy
from steelyard.errors import InputError
from steelyard.estimators import ESTIMATORS, likelihood_information, maximum_likelihood
from steelyard.estimators.maximum_likelihood import likelihood_parts
from steelyard.regression import residual_covariance

BODY = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])


@pytest.fixture(scope="module")
def model():
    return sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))


def samples_of(model, random, count, coefficient=0.8, missing=()):
    t = np.arange(count) / 100
    w = np.array([3.0, 4.1])
    q, dq, ddq = np.sin(w * t[:, None]), w * np.cos(w * t[:, None]), -(w**2) * np.sin(w * t[:, None])
    root = np.array([[0.3, 0.0], [0.1, 0.1]])
    noise = lfilter([1.0], [1.0, -coefficient], random.normal(size=(count + 200, 2)) @ root.T, axis=0)[200:]
    torque = model.inverse_dynamics(q, dq, ddq, np.concatenate([BODY, BODY])) + noise
    mask = np.ones(q.shape, dtype=bool)
    mask[list(missing), 0] = False
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t, mask=mask if missing else None)


@pytest.fixture(scope="module")
def found(model):
    """A log, what was made of it, and generalised least squares with the whole covariance of its rows."""
    samples = samples_of(model, np.random.default_rng(1), 600)
    information = likelihood_information(model, samples, order=1)
    # Of first order at each joint: the covariance of all rows by the formula of its stationary state.
    a, b = (float(r[0]) for r in information.noise.reflections)
    blocks = [[np.empty(0)] * 2, [np.empty(0)] * 2]
    lags = np.arange(600)
    for i, first in enumerate((a, b)):
        for j, second in enumerate((a, b)):
            shared = information.noise.covariance[i, j] / (1.0 - first * second)
            blocks[i][j] = shared * toeplitz(first**lags, second**lags)
    root = cholesky(np.block(blocks), lower=True)
    regressor = np.asarray(model.regressor(samples.q, samples.dq, samples.ddq)) @ model.base_parameters().Pb
    rows = solve_triangular(root, np.concatenate([regressor[:, 0], regressor[:, 1]]), lower=True)
    target = solve_triangular(root, np.concatenate([samples.torque[:, 0], samples.torque[:, 1]]), lower=True)
    return samples, information, rows, target


def test_least_squares_of_whitened_rows_are_generalised_least_squares(found):
    _, information, rows, target = found
    expected = np.linalg.lstsq(rows, target)[0]
    error = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    estimate = sy.least_squares(information)
    assert np.all(np.abs(estimate.base - expected) < 0.01 * error)
    plain = sy.least_squares(sy.Information.from_samples(sy.Model(found_robot()), found[0])).base
    assert np.any(np.abs(plain - expected) > error)
    assert estimate.method == "maximum likelihood"
    assert np.allclose(estimate.standard_error, error, rtol=0.25)
    assert information.converged
    assert abs(information.noise.correlation[0, 1] - 0.3 * 0.1 / (0.3 * np.hypot(0.1, 0.1))) < 0.1
    whole, parts = likelihood_parts(sy.Model(found_robot()), found[0], order=1)
    assert sum(part.count for part in parts) == whole.count == 1200
    assert np.allclose(np.sum([[f.count for f in part.measured] for part in parts], axis=0), 600)


def found_robot():
    return sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0))


def test_white_noise_has_no_order_and_the_same_estimate(model):
    samples = samples_of(model, np.random.default_rng(2), 600, 0.0)
    information = likelihood_information(model, samples, order="bic")
    assert information.noise.orders == (0, 0)
    plain = sy.least_squares(sy.Information.from_samples(model, samples))
    covariance = residual_covariance(model, samples, plain)
    known = sy.least_squares(sy.Information.from_samples(model, samples, covariance))
    assert np.allclose(sy.least_squares(information).base, known.base, rtol=0, atol=0.01 * known.standard_error.max())


def test_logs_and_gaps_are_stretches_of_their_own(model):
    random = np.random.default_rng(3)
    logs = [samples_of(model, random, 300), samples_of(model, random, 300, missing=range(100, 108))]
    apart = likelihood_information(model, logs, order=1)
    joined = sy.Samples.joined([one.rows(0, one.count) for one in logs])  # whose stamps go back
    assert np.allclose(likelihood_information(model, joined, order=1).factors[0].triangle, apart.factors[0].triangle)
    assert apart.count == 1192
    again = likelihood_information(model, lambda: iter(logs), order=1)
    assert np.array_equal(again.factors[0].triangle, apart.factors[0].triangle)
    # Exact torques have noise of rounding, which is no reason to fail.
    q, dq, ddq = logs[0].q, logs[0].dq, logs[0].ddq
    exact = sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, np.concatenate([BODY, BODY])))
    base = sy.least_squares(likelihood_information(model, exact)).base
    assert np.allclose(base, model.base_parameters().values(np.concatenate([BODY, BODY])), atol=1e-7)


def test_logs_of_different_noise_are_whitened_each_by_its_own_and_add(model, tmp_path):
    """Against least squares of all rows with the whole covariance of both logs, by the formula of white noise."""
    quiet, loud = (samples_of(model, np.random.default_rng(k), 400, 0.0) for k in (4, 5))
    louder = np.array([[3.0, 0.4], [-0.2, 5.0]])
    noise = np.random.default_rng(6).normal(size=loud.q.shape) @ louder.T
    loud = sy.Samples(q=loud.q, dq=loud.dq, ddq=loud.ddq, torque=loud.torque + noise, t=loud.t)
    apart = [likelihood_information(model, one, order=0) for one in (quiet, loud)]
    both = apart[0] + apart[1]
    rows, targets = [], []
    for one, information in zip((quiet, loud), apart, strict=True):
        root = np.linalg.cholesky(information.noise.covariance)
        regressor = np.asarray(model.regressor(one.q, one.dq, one.ddq)) @ model.base_parameters().Pb
        rows.append(np.linalg.solve(root, regressor))
        targets.append(np.linalg.solve(root, one.torque[:, :, None]))
    rows, targets = (np.concatenate(part).reshape(1600, -1) for part in (rows, targets))
    expected = np.linalg.lstsq(rows, targets[:, 0])[0]
    error = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    feasible_set = sy.FeasibleSet(model)
    estimate = maximum_likelihood(both, feasible_set)
    assert np.allclose(sy.least_squares(both).base, expected, rtol=0, atol=1e-6 * error.max())
    assert np.allclose(estimate.standard_error, error, rtol=0.3)
    assert feasible_set.contains(estimate.parameters)
    # One noise for both is far from the least variance; the log that is quiet tells nearly all.
    one_noise = likelihood_information(model, [quiet, loud], order=0)
    assert np.all(maximum_likelihood(one_noise, feasible_set).standard_error > 1.5 * error)
    assert np.allclose(both.covariance, 0.5 * (apart[0].covariance + apart[1].covariance))
    both.save(tmp_path / "both.json")
    again = maximum_likelihood(sy.Information.load(tmp_path / "both.json"), feasible_set)
    assert np.allclose(again.base, estimate.base)


def test_whitened_rows_and_others_do_not_add():
    """With one joint both have one factor, so that nothing but the covariance tells them apart."""
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    random = np.random.default_rng(1)
    q, dq, ddq, torque = random.normal(size=(4, 100, 1))
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    plain = sy.Information.from_samples(model, samples)
    whitened = likelihood_information(model, samples, order=0)
    with pytest.raises(InputError, match="Only one of two Informations was whitened"):
        plain + whitened
    assert (sy.Information.empty(model) + whitened).covariance is not None


def test_the_estimate_is_feasible_and_plain_rows_are_refused(model, found):
    samples, information, _, _ = found
    feasible_set = sy.FeasibleSet(model)
    estimate = maximum_likelihood(information, feasible_set)
    assert feasible_set.contains(estimate.parameters)
    assert estimate.method == "feasible maximum likelihood"
    assert ESTIMATORS.get("maximum_likelihood") is maximum_likelihood
    with pytest.raises(InputError, match="needs rows whitened by the noise"):
        maximum_likelihood(sy.Information.from_samples(model, samples), feasible_set)
    with pytest.raises(InputError, match='order must be "aic"'):
        likelihood_information(model, samples, order="best")
    with pytest.raises(InputError, match="there are no samples"):
        likelihood_information(model, [])


def test_rows_that_err_where_whitening_looks_are_told(model, found):
    samples, information, _, _ = found
    assert not any("noise does not explain" in remark for remark in information.remarks)
    # Torques of slow noise and an error of the model that is seen in single steps alone.
    steps = 0.3 * np.sign(samples.dq) * (np.abs(samples.dq) < 1.0)
    wrong = sy.Samples(q=samples.q, dq=samples.dq, ddq=samples.ddq, torque=samples.torque + steps, t=samples.t)
    coulomb = sy.Model(found_robot().with_terms(sy.Coulomb()))
    slow = 3.0 * np.cumsum(np.random.default_rng(7).normal(size=samples.q.shape), axis=0) / 25.0
    lasting = sy.Samples(q=wrong.q, dq=wrong.dq, ddq=wrong.ddq, torque=wrong.torque + slow, t=wrong.t)
    told = [likelihood_information(coulomb, one).remarks for one in (wrong, lasting)]
    assert any("noise does not explain" in remark for remarks in told for remark in remarks)


@pytest.mark.slow
def test_identify_takes_it_by_name(model, found):
    robot = found_robot().with_terms()
    result = sy.identify(sy.Model(robot), found[0], estimator="maximum_likelihood")
    assert result.estimate.method == "feasible maximum likelihood"
    assert any(remark.startswith("Maximum likelihood: noise of order") for remark in result.estimate.remarks)
    plain = sy.identify(sy.Model(robot), found[0])
    assert np.median(result.unconstrained.standard_error / plain.unconstrained.standard_error) < 0.8


@pytest.mark.slow
def test_the_variance_is_that_of_the_bound_and_intervals_hold(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import likelihood

    monkeypatch.setattr(sys, "argv", ["likelihood.py", "--seeds", "16", "--noises", "autoregressive"])
    likelihood.main()
    line = next(one for one in capsys.readouterr().out.splitlines() if "maximum likelihood" in one)
    mean = float(line.split("mean ")[1].split(",")[0])
    inside = float(line.split("hold ")[1].split(" %")[0])
    assert mean < 1.15  # 1.05 with 200 seeds; the least squares of this noise have 3.5
    assert 91.0 < inside < 98.0
