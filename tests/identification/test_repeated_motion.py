"""What returns with each period of a motion widens intervals to those of one period; noise that does not, does not."""

import numpy as np
import pytest
from two_joint_arm import LINKS, two_joint_model

import steelyard as sy
from steelyard.identification.repeated_motion import repeated_errors
from steelyard.regression import ParameterCovariance
from steelyard.regression.reduction import residuals

PERIOD, RATE = 1000, 100.0  # rows, Hz


@pytest.fixture(scope="module")
def model():
    return two_joint_model()


@pytest.fixture(scope="module")
def truth(model):
    values = np.full(model.parameter_count, 0.5)
    for columns, link in zip(model.link_columns, LINKS, strict=True):
        values[columns] = link
    return values


def samples_of(model, truth, periods, returning, seed=1, turns=(1.0, 3.0, 5.0), ramp=False, white=0.1):
    """Periods of a motion with noise of 0.1 N·m, of which a part returns in each period."""
    random = np.random.default_rng(seed)
    t = np.arange(periods * PERIOD) / RATE
    w = 2.0 * np.pi * RATE / PERIOD * np.array(turns)
    a, b = random.normal(size=(2, 2, len(turns)))
    phase = t[:, None, None] * w
    q = np.sum(a * np.sin(phase) + b * np.cos(phase), axis=2)
    dq = np.sum(w * (a * np.cos(phase) - b * np.sin(phase)), axis=2)
    ddq = -np.sum(w**2 * (a * np.sin(phase) + b * np.cos(phase)), axis=2)
    if ramp:  # joints that are elsewhere at first
        q[:100] += 0.5
    noise = white * (1.0 - returning) ** 0.5 * random.normal(size=q.shape)
    noise += white * returning**0.5 * np.tile(random.normal(size=(PERIOD, 2)), (periods, 1))
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, truth) + noise, t=t)


def told(model, samples):
    info = sy.Information.from_samples(model, samples)
    plain = sy.least_squares(info)
    left = np.concatenate([part for _, part in residuals(model, samples, plain.base)])
    covariance = ParameterCovariance.of(info, plain.base, plain.weights)
    return covariance, repeated_errors(info, plain, [(samples, left)])


@pytest.mark.parametrize("ramp", [False, True])
def test_four_periods_of_the_same_noise_tell_as_much_as_one(model, truth, ramp):
    samples = samples_of(model, truth, 4, 1.0, ramp=ramp)
    covariance, found = told(model, samples)
    assert found is not None
    assert found.period == pytest.approx(PERIOD / RATE)
    assert found.correlation == pytest.approx([1.0, 1.0], abs=0.01)
    one, nothing = told(model, samples.rows(PERIOD, 2 * PERIOD))
    assert nothing is None
    wider = covariance.with_errors(found.changes).standard_error
    # Each long-run variance is estimated from its own batches, and that of fewer is widened for it.
    assert wider == pytest.approx(one.standard_error, rel=0.35)
    assert np.median(covariance.standard_error / one.standard_error) < 0.6


def test_a_motion_that_does_not_repeat_tells_no_more_in_four_logs(model, truth):
    one = samples_of(model, truth, 1, 1.0, turns=(0.93, 3.14, 5.37))
    info = sum((sy.Information.from_samples(model, one) for _ in range(3)), sy.Information.from_samples(model, one))
    plain = sy.least_squares(info)
    ((_, left),) = residuals(model, one, plain.base)
    found = repeated_errors(info, plain, [(one, left)] * 4)
    wider = ParameterCovariance.of(info, plain.base, plain.weights).with_errors(found.changes).standard_error
    assert found.correlation == pytest.approx([1.0, 1.0], abs=0.01)
    assert wider == pytest.approx(told(model, one)[0].standard_error, rel=0.35)
    other = samples_of(model, truth, 1, 1.0, seed=2, turns=(0.93, 3.14, 5.37))
    assert repeated_errors(info, plain, [(one, left), (other, left)]) is None


@pytest.mark.slow
def test_the_spread_of_many_logs_is_what_is_said(model, truth):
    true = model.base_parameters().values(truth)
    ratios = []
    for seed in range(40):
        samples = samples_of(model, truth, 3, 0.6, seed=seed)
        covariance, found = told(model, samples)
        off = sy.least_squares(sy.Information.from_samples(model, samples)).base - true
        wider = covariance.with_errors(found.changes)
        ratios.append((off / covariance.standard_error, off / wider.standard_error))
    before, after = np.mean(np.array(ratios) ** 2, axis=(0, 2))
    # Of three periods with a correlation of 0.6 the variance is 2.2 times as large; Student's width takes some of it.
    assert before > 1.6
    assert 0.7 < after < 1.15


@pytest.mark.parametrize(
    ("returning", "turns"),
    [(0.0, (1.0, 3.0, 5.0)), (1.0, (0.93, 3.14, 5.37))],
    ids=["noise that does not return", "a motion that does not"],
)
def test_nothing_is_told_without_repetition(model, truth, returning, turns):
    for seed in range(5):
        assert told(model, samples_of(model, truth, 3, returning, seed, turns))[1] is None


def test_the_answer_says_so(model, truth):
    rows = {}
    for returning in (0.0, 0.9):
        samples = samples_of(model, truth, 3, returning)
        table = sy.identify(model, samples).parameters
        assert any("repeats every 10 s" in sentence for sentence in table.sentences) is bool(returning)
        rows[returning] = table["Fvj2"].upper - table["Fvj2"].lower
    assert rows[0.9] > 1.3 * rows[0.0]


def test_what_is_saved_to_compare_robots_knows_it(model, truth):
    samples = samples_of(model, truth, 4, 1.0)
    four, one = (sy.identify(model, some).estimate for some in (samples, samples.rows(PERIOD, 2 * PERIOD)))
    assert four.standard_error == pytest.approx(one.standard_error, rel=0.35)
    np.testing.assert_allclose(np.sqrt(np.diag(four.covariance)), four.standard_error, rtol=1e-9)
