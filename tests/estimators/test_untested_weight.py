"""How much a prior weighs where no stretch of the data can be held out: no more than the data leave open."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from two_joint_arm import unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.estimators.plausible_fit import allowed_share, tried_prior, untested_weight
from steelyard.feasibility import FeasibleSet
from steelyard.regression import ParameterCovariance
from steelyard.regression.parameter_covariance import ResidualCorrelation

TRUE = unstated_parameters()


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


def moved(model: sy.Model, seconds: float, memory: float = 0.0) -> sy.Samples:
    """An arm that moved, at 500 Hz; noise of the torques lasts."""
    t = np.arange(round(500 * seconds))[:, None] / 500
    pace, other = np.array([3.0, 4.0]), np.array([1.3, 2.2])
    q = 0.5 * (np.sin(pace * t) + np.sin(other * t + 2.0))
    dq = 0.5 * (pace * np.cos(pace * t) + other * np.cos(other * t + 2.0))
    ddq = -0.5 * (pace**2 * np.sin(pace * t) + other**2 * np.sin(other * t + 2.0))
    noise = np.random.default_rng(1).normal(size=q.shape)
    noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], noise, axis=0)
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, TRUE) + 0.3 * noise)


def test_answers_by_sums_alone_are_as_near_to_the_truth_as_noise_lets_them(model: sy.Model, tmp_path: Path) -> None:
    """With all of its weight the prior held them a hundred standard errors away, torques by some per cent."""
    information = sy.Information.from_samples(model, moved(model, 20.0))
    information.save(tmp_path / "day.json")
    answer = sy.identify(model, tmp_path / "day.json").estimate
    away = np.abs(answer.base - model.base_parameters().K @ TRUE)
    assert (away / sy.least_squares(information).standard_error).max() < 5.0
    q, dq, ddq = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 200, 2)) * np.array([1.5, 2.0, 6.0])[:, None, None]
    assert answer.parameters is not None
    found, true = (model.inverse_dynamics(q, dq, ddq, one) for one in (answer.parameters, TRUE))
    assert np.linalg.norm(found - true) < 0.01 * np.linalg.norm(true)


def test_online_answers_lie_where_their_intervals_are(model: sy.Model) -> None:
    samples = moved(model, 20.0)
    estimator = sy.OnlineEstimator(model, rate=500)
    estimator.update(np.arange(samples.count) / 500, samples.q, samples.torque, samples.dq, samples.ddq)
    answer, intervals = estimator.estimate(), estimator.intervals()
    middle, half = intervals.mean(axis=1), 0.5 * np.ptp(intervals, axis=1)
    assert np.all(np.abs(answer.base - middle) < 2.0 * half)
    assert answer.prior_weight < untested_weight(answer.rows)


def test_all_of_it_counts_where_independent_rows_are_few(model: sy.Model) -> None:
    """How uncertain least squares are is not known then."""
    information = sy.Information.from_samples(model, moved(model, 4.0, memory=0.995))
    correlation = ParameterCovariance.of(information).correlation
    assert correlation is not None
    assert correlation.effective_count.sum() < 4 * information.base_count
    tried = tried_prior(information, (), FeasibleSet(model), sy.least_squares(information))
    assert tried.weight == untested_weight(information.count)


def test_all_of_it_counts_where_nothing_is_known_of_how_long_residuals_last(model: sy.Model) -> None:
    """Each row would count for an independent one: with noise that lasts, most intervals of 95 % miss the truth."""
    information = replace(sy.Information.from_samples(model, moved(model, 60.0, memory=0.98)), batch_means=())
    found = sy.least_squares(information)
    away = np.abs(found.base - model.base_parameters().K @ TRUE) / found.standard_error
    assert np.median(away) > 1.96
    assert tried_prior(information, (), FeasibleSet(model), found).weight == untested_weight(information.count)


@pytest.mark.parametrize(
    ("away", "share"),
    [
        (lambda share: 2.0 * share, 1.0),
        (lambda share: 1000.0 * share, 0.001),
        (lambda share: 50.0 * share, 0.01),
        (lambda share: 5000.0 + share, 1.0),  # conditions keep fits away, whatever the prior weighs
        (lambda share: 5000.0 + 30.0 * share, 0.01),
    ],
)
def test_the_largest_part_is_taken_with_which_the_prior_moves_no_more_than_noise(
    away: Callable[[float], float], share: float
) -> None:
    many = np.array([1000.0])
    correlation = ResidualCorrelation(
        ("joint1",), many, many, np.array([1]), np.array([1000]), np.array([True]), many, np.array([1.0])
    )
    assert allowed_share(away, replace(ParameterCovariance.of_matrix(np.eye(2), 2), correlation=correlation)) == share
