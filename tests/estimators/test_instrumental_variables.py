"""Instrumental variables, output error, total least squares: closed forms, SciPy, and an arm that Pinocchio moves."""

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize

import steelyard as sy
from steelyard.errors import InputError, SolverError
from steelyard.estimators import total_least_squares
from steelyard.estimators.instrumental_variables import InstrumentedRegression
from steelyard.feasibility import verify_document

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def elbow():
    rows = [("pi/2", 0.0, 0.3, "q"), (0, 0.4, 0, "q")]
    return sy.Model(sy.Robot.from_dh(rows).with_terms(sy.Viscous()))


@pytest.fixture(scope="module")
def noisy(elbow):
    """Samples with noise in velocities and accelerations, the exact ones, and the true parameters."""
    random = np.random.default_rng(5)
    q, dq, ddq = random.normal(size=(3, 4000, 2))
    truth = np.array([0.2, 0, 0, 0.2, 0, 0.2, 0.1, 0.2, 0, 2.0, 0.7] * 2)
    torque = elbow.inverse_dynamics(q, dq, ddq, truth) + 0.1 * random.normal(size=(4000, 2))
    seen = sy.Samples(q=q, dq=dq, ddq=ddq + 0.6 * random.normal(size=ddq.shape), torque=torque)
    return seen, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque), elbow.base_parameters().values(truth)


def rows_of(model, samples):
    return model.regressor(samples.q, samples.dq, samples.ddq) @ model.base_parameters().Pb


def test_regression_is_that_of_the_normal_equations_of_instruments(elbow, noisy):
    seen, exact, _ = noisy
    mask = np.random.default_rng(1).random(seen.q.shape) < 0.8
    exact = sy.Samples(q=exact.q, dq=exact.dq, ddq=exact.ddq, torque=exact.torque, mask=mask)
    X, Z = rows_of(elbow, seen), rows_of(elbow, exact)
    weights = np.array([2.0, 0.5])
    inner = np.einsum("skn,k,sk,skm->nm", Z, weights**2, mask, X)
    expected = np.linalg.solve(inner, np.einsum("skn,k,sk,sk->n", Z, weights**2, mask, seen.torque))
    whole = InstrumentedRegression.of_samples(elbow, seen, exact)
    assert np.allclose(whole.solution(weights), expected, rtol=1e-9, atol=1e-12)
    halves = [
        InstrumentedRegression.of_samples(elbow, seen.rows(*part), exact.rows(*part))
        for part in ((0, 2048), (2048, 4000))
    ]
    assert np.allclose((halves[0] + halves[1]).solution(weights), expected, rtol=1e-9, atol=1e-12)
    information = whole.information(expected)
    assert np.allclose(sy.least_squares(information, weights).base, expected, rtol=1e-8, atol=1e-10)
    left = np.where(mask, seen.torque - np.einsum("skn,n->sk", X, expected), 0.0)
    assert [f.residual2(expected) for f in information.factors] == pytest.approx(np.sum(left**2, axis=0))
    # White errors: the textbook's sandwich (Z'X)^-1 Z'SZ (X'Z)^-1.
    variance = np.sum(left**2, axis=0) / mask.sum(axis=0)
    middle = np.einsum("skn,k,sk,skm->nm", Z, weights**4 * variance, mask, Z)
    textbook = np.sqrt(np.diag(np.linalg.solve(inner, np.linalg.solve(inner, middle).T)))
    told = sy.least_squares(information, weights).standard_error
    assert np.abs(told / textbook - 1.0).max() < 0.35  # batch means estimate it from a few hundred batches


def test_instruments_take_the_bias_away_and_answers_are_proved(elbow, noisy):
    seen, exact, truth = noisy
    feasible_set = sy.FeasibleSet(elbow)
    plain = sy.fit(sy.Information.from_samples(elbow, seen), feasible_set)
    found = sy.instrumental_variables(seen, feasible_set, exact)
    assert np.max(np.abs(plain.base - truth) / plain.standard_error) > 10.0
    assert np.max(np.abs(found.base - truth) / found.standard_error) < 4.0
    assert verify_document(found.certificate).valid
    assert found.method == "feasible instrumental variables"
    assert any("Least squares of the rows as measured differ" in remark for remark in found.remarks)


def test_instruments_that_take_nothing_away_are_told(elbow, noisy):
    measured, exact, _ = noisy
    for motion, sentence in (
        (measured, "hardly more than least squares"),
        (exact, "is that of the instruments (least"),
    ):
        remarks = sy.instrumental_variables(measured, sy.FeasibleSet(elbow), motion).remarks
        assert any(sentence in remark for remark in remarks)


@pytest.mark.slow
def test_iteration_that_does_not_converge_says_so_in_one_sentence_and_keeps_what_was_found(elbow, noisy):
    seen, exact, _ = noisy
    feasible_set = sy.FeasibleSet(elbow)
    calls = []

    def restless(base):
        calls.append(base)
        if len(calls) == 3:
            raise SolverError("joint 2 diverged")
        return sy.Samples(q=exact.q, dq=exact.dq, ddq=exact.ddq * len(calls), torque=exact.torque)

    def impossible(base):
        raise SolverError("joint 1 diverged")

    found = sy.instrumental_variables(seen, feasible_set, impossible, start=exact)
    assert "did not converge: the motion of the first estimate" in found.remarks[-1]
    assert np.allclose(found.base, sy.instrumental_variables(seen, feasible_set, exact).base)
    with pytest.raises(SolverError, match="joint 1 diverged"):
        sy.instrumental_variables(seen, feasible_set, impossible)
    found = sy.instrumental_variables(seen, feasible_set, restless)
    told = [remark for remark in found.remarks if "did not converge" in remark]
    assert len(told) == 1
    assert "joint 2 diverged" in told[0]
    assert verify_document(found.certificate).valid
    with pytest.raises(InputError, match="rows and the samples"):
        sy.instrumental_variables(seen, feasible_set, exact.rows(0, 100))


def test_total_least_squares_are_the_least_change_of_regressor_and_torque(elbow, noisy):
    seen, _, _ = noisy
    info = sy.Information.from_samples(elbow, seen)
    W, omega = rows_of(elbow, seen).reshape(-1, info.base_count), seen.torque.ravel()
    sizes = np.linspace(0.5, 1.5, info.base_count + 1)
    sizes[2] = 0.0

    def change(base):
        return np.sum((omega - W @ base) ** 2) / (sizes[-1] ** 2 + np.sum((sizes[:-1] * base) ** 2))

    start = np.linalg.lstsq(W, omega)[0]
    best = scipy.optimize.minimize(change, start, method="BFGS", options={"gtol": 1e-9}).x
    found = total_least_squares(info, sy.FeasibleSet(elbow), None, noise=sizes)
    assert np.allclose(found.unconstrained_base, best, rtol=1e-4, atol=1e-5)
    assert change(found.unconstrained_base) <= change(best) * (1 + 1e-9)
    assert verify_document(found.certificate).valid


@pytest.mark.slow
def test_closed_loop_without_a_careful_filter():
    """One log of the benchmark, which has a hundred: Pinocchio moves the arm, with 0.1 mrad of noise."""
    pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")
    sys.path.insert(0, str(BENCHMARKS))
    try:
        from estimators import ESTIMATORS, Laboratory
    finally:
        sys.path.remove(str(BENCHMARKS))
    laboratory = Laboratory(duration=4.0)
    samples = laboratory.samples(1)
    off = {}
    for name in ("least squares", "instrumental variables", "output error, torques", "the same, from the reference"):
        estimate = ESTIMATORS[name](laboratory, samples)
        assert verify_document(estimate.certificate).valid
        assert not any("did not converge" in remark for remark in estimate.remarks)
        off[name] = np.abs(estimate.base - laboratory.base) / estimate.standard_error
    assert off.pop("least squares").max() > 3.0
    for name, errors in off.items():
        assert np.mean(errors**2) < 2.0, name
        assert errors.max() < 4.0, name
