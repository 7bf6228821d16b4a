"""After the motion of trajectory A the estimator's answer is that of the batch fit, and all answers were possible."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.estimators import fitting_problems
from steelyard.identification.wam import simulated_log, true_parameters, wam_model
from steelyard.online import OnlineEstimate

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found() -> tuple[sy.OnlineEstimator, OnlineEstimate, sy.Information]:
    """An estimator that saw one period of trajectory A, processed as a batch is, with an answer each 50 ms."""
    model = wam_model()
    samples = simulated_log(model, "A", 2014, periods=1.5).process(cutoff=4.8)
    assert samples.mask is not None
    estimator = sy.OnlineEstimator(model, least_speed=0.0)
    torque = np.where(samples.mask, samples.torque, np.nan)  # rows that are left out are missing torques here
    for k in range(0, samples.count, 50):
        part = slice(k, k + 50)
        estimator.update(
            np.arange(k, k + 50)[: len(torque[part])] / 1000,
            samples.q[part],
            torque[part],
            samples.dq[part],
            samples.ddq[part],
        )
        answer = estimator.estimate(seconds=0.05)
        assert estimator.feasible_set.contains(answer.parameters)
    estimator.settle()
    return estimator, estimator.estimate(), sy.Information.from_samples(model, samples)


def batch(found: tuple[sy.OnlineEstimator, OnlineEstimate, sy.Information]) -> sy.Estimate:
    estimator, answer, info = found
    return sy.fit(
        info,
        estimator.feasible_set,
        weights=answer.weights,
        prior=answer.prior,
        prior_weight=answer.prior_weight,
    )


def test_the_information_is_that_of_the_batch(found: tuple[sy.OnlineEstimator, OnlineEstimate, sy.Information]) -> None:
    estimator, _, info = found
    for one, other in zip(estimator.information.factors, info.factors, strict=True):
        expected = other.triangle.T @ other.triangle
        assert one.count == other.count
        assert np.abs(one.triangle.T @ one.triangle - expected).max() < 1e-12 * np.abs(expected).max()


def test_the_answer_is_that_of_clarabel_as_far_as_it_is_asked_for(
    found: tuple[sy.OnlineEstimator, OnlineEstimate, sy.Information], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fitting_problems.Fitting, "_searched", lambda *_: None)
    attempts = fitting_problems.ATTEMPTS
    monkeypatch.setattr(fitting_problems, "ATTEMPTS", (fitting_problems.Attempt(accuracy=1e-12), *attempts[1:]))
    base = batch(found).base
    assert np.abs(found[1].base - base).max() < 1e-8 * np.abs(base).max()


def test_it_is_that_of_the_batch_fit(
    found: tuple[sy.OnlineEstimator, OnlineEstimate, sy.Information],
) -> None:
    estimator, answer, info = found
    other = batch(found)
    reduced, prepared = info.reduced(answer.weights), answer.prior.prepare(estimator.feasible_set, answer.prior_weight)
    variance = reduced.residual2 / (reduced.count - info.base_count)

    def objective(base: np.ndarray, parameters: np.ndarray) -> float:
        left = reduced.R @ base - reduced.rho
        fit = 0.5 * (float(left @ left) + reduced.residual2) / variance
        return fit + answer.prior_weight * prepared.distance(parameters)

    assert other.parameters is not None
    own, batches = objective(answer.base, answer.parameters), objective(other.base, other.parameters)
    assert abs(own - batches) < 1e-10 * batches
    assert np.abs(answer.base - other.base).max() < 1e-8 * np.abs(other.base).max()
    torque = np.linalg.norm(reduced.R @ (answer.base - wam_model().base_parameters().values(true_parameters())))
    assert torque < 0.02 * np.linalg.norm(reduced.rho)
