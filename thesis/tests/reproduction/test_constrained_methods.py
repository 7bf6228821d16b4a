"""Section 6.3.2: the regression itself, the optimum by another modelling layer, and methods against the clock."""

import numpy as np
import pytest

from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet
from steelyard.regression import least_squares
from steelyard_thesis.methods import Mata2005
from steelyard_thesis.reproduction.free_links import ROWS, free_links, free_links_problem, random_regression
from steelyard_thesis.reproduction.method_runs import run_method
from steelyard_thesis.reproduction.sections import constrained_methods
from steelyard_thesis.reproduction.sections.constrained_methods import LEAST, METHODS, OURS, scaling

LINKS = (2, 5)


@pytest.fixture(scope="module")
def results():
    return scaling(LINKS)


def test_reduced_regression_is_the_regression():
    W, omega = random_regression(3)
    information, model = free_links_problem(3)
    solution, squared, *_ = np.linalg.lstsq(W, omega, rcond=None)
    estimate = least_squares(information)
    np.testing.assert_allclose(estimate.base, solution, rtol=1e-9, atol=1e-11)
    assert estimate.relative_error == pytest.approx(np.sqrt(squared[0]) / np.linalg.norm(omega), rel=1e-12)
    assert information.base_names == model.parameter_names
    assert (W.shape, ROWS) == ((1000 * 10, 30), 10_000)
    assert W.mean() == pytest.approx(0.0, abs=0.01)
    assert W.std() == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["inertia", "full"])
def test_nobody_is_better_and_the_optimum_is_that_of_cvxpy(results, kind):
    cvxpy = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
    for count in LINKS:
        runs = results[kind][0][count]
        assert set(runs) == {LEAST, OURS, *METHODS[kind]}
        for name, run in runs.items():
            assert run is not None, name
            assert run.relative_error >= runs[LEAST].relative_error * (1.0 - 1e-12)
            if run.feasible:
                assert runs[OURS].relative_error <= run.relative_error * (1.0 + 1e-6), name
        W, omega = random_regression(count)
        delta = cvxpy.Variable(10 * count)
        constraints = [
            sum(delta[int(k)] * C for k, C in zip(c.indices, c.coefficients, strict=True)) >> 0
            for c in free_links(count).conditions(kind)
        ]
        triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
        problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.norm(triangle[:, :-1] @ delta - triangle[:, -1])), constraints)
        problem.solve(solver="CLARABEL")
        least = problem.value / np.linalg.norm(omega)
        assert runs[OURS].relative_error == pytest.approx(least, rel=1e-6)


@pytest.mark.slow
def test_numbers_are_the_same_twice(results):
    again = scaling(LINKS[:1])
    for kind, (runs, verdicts) in again.items():
        before, said = results[kind]
        assert verdicts[LINKS[0]] == said[LINKS[0]]
        for name, run in runs[LINKS[0]].items():
            assert run.relative_error == before[LINKS[0]][name].relative_error
            assert run.feasible == before[LINKS[0]][name].feasible


def test_what_is_too_slow_is_stopped_and_said(monkeypatch):
    monkeypatch.setattr(constrained_methods, "METHODS", {"inertia": {"Mata 2005": Mata2005()}, "full": {}})
    runs, _ = scaling((3, 4), limit=0.0)["inertia"]
    assert [runs[count]["Mata 2005"] for count in (3, 4)] == [None, None]
    assert runs[4][OURS].feasible
    table = constrained_methods._last_table("inertia", 4, runs[4], "infeasible")
    assert table.rows[0][-1] == "infeasible"
    assert table.rows[-1][:2] == ("Mata 2005", "stopped (20 s)")
    assert constrained_methods._excess(runs[4]) == (-np.inf, "nobody")


@pytest.mark.slow
def test_a_run_is_the_method(results):
    information, model = free_links_problem(2)
    feasible = FeasibleSet(model, "inertia")
    run = run_method(fit, information, feasible, repetitions=1)
    assert run.relative_error == fit(information, feasible).relative_error
    assert run.feasible
    assert not run_method(lambda info, _: least_squares(info), information, feasible).feasible
