"""Descents over free numbers: derivatives, agreement of solvers, and terms."""

import numpy as np
import pytest

from steelyard.feasibility import FeasibleSet
from steelyard.regression import Information
from steelyard_thesis.methods import Nakanishi2008, NakanishiCorrected, Problem, Rucker2022, Ting2006
from steelyard_thesis.methods.factored_fit import FACTORED_SOLVERS, FactoredFit
from steelyard_thesis.methods.parametrisations import CholeskyOfBody, LogCholesky
from steelyard_thesis.methods.starting_point import starting_point
from steelyard_thesis.methods.ting_2006 import relevance_regression


@pytest.mark.parametrize("map_", [CholeskyOfBody(), LogCholesky()], ids=str)
@pytest.mark.parametrize("exponential", [False, True])
def test_derivatives_of_the_objective(random_arm, map_, exponential):
    model, _, information = random_arm(2, noise=0.2)
    problem = Problem.of(information, FeasibleSet(model))
    descent = FactoredFit(problem, map_, problem.rho, exponential)
    theta = descent.to_theta(starting_point(problem))
    random, step = np.random.default_rng(1), 1e-6
    for _ in range(3):
        change = step * random.normal(size=len(theta))
        ahead, behind = theta + change, theta - change
        slope = descent.objective(ahead) - descent.objective(behind)
        assert 2.0 * descent.gradient(theta) @ change == pytest.approx(slope, rel=1e-5)
        bend = descent.gradient(ahead) - descent.gradient(behind)
        scale = np.abs(bend).max()
        np.testing.assert_allclose(2.0 * descent.hessian(theta) @ change, bend, rtol=1e-5, atol=1e-6 * scale)
        residual = descent.residual(ahead) - descent.residual(behind)
        scale = np.abs(residual).max()
        np.testing.assert_allclose(2.0 * descent.jacobian(theta) @ change, residual, rtol=1e-5, atol=1e-6 * scale)


def test_objective_is_the_squared_residual(random_arm):
    model, _, information = random_arm(2, noise=0.2)
    problem = Problem.of(information, FeasibleSet(model), weights=None)
    descent = FactoredFit(problem, LogCholesky(), problem.rho)
    start = starting_point(problem)
    theta = descent.to_theta(start)
    np.testing.assert_allclose(descent.to_parameters(theta), start, rtol=1e-9, atol=1e-12)
    expected = 2.0 * descent.objective(theta) * problem.regression.scale + problem.residual2
    assert problem.squared_residual(start) == pytest.approx(expected, rel=1e-10)
    assert problem.relative_error(start) == pytest.approx(information.relative_error(model.base_parameters().K @ start))


@pytest.mark.parametrize("solver", FACTORED_SOLVERS)
@pytest.mark.parametrize("kind", [Nakanishi2008, NakanishiCorrected, Rucker2022])
def test_solvers_agree(free_links, kind, solver):
    model, _, information = free_links(2, seed=4)
    feasible = FeasibleSet(model)
    first = kind().fit(information, feasible).relative_error
    other = kind(solver=solver, iterations=20000, tolerance=1e-8).fit(information, feasible).relative_error
    assert other == pytest.approx(first, rel=1e-6)


def test_published_answers_end_on_the_boundary_and_are_not_proved(free_links):
    model, _, information = free_links(5, seed=2)
    feasible = FeasibleSet(model, "inertia")
    published = Nakanishi2008().fit(information, feasible)
    corrected = NakanishiCorrected().fit(information, feasible)
    assert feasible.stack.smallest_eigenvalues(published.parameters).min() < 1e-8
    assert feasible.stack.smallest_eigenvalues(corrected.parameters).min() >= 0.999e-6
    assert corrected.consistency == "inertia"
    assert corrected.relative_error == pytest.approx(published.relative_error, rel=1e-6)


def test_relevance_determination_leaves_clean_data_alone_and_shrinks_noise():
    random = np.random.default_rng(0)
    W = random.normal(size=(200, 10))
    truth = np.array([3.0, -2.0, 1.0, 0.5, 4.0, 0, 0, 0, 0, 0])
    for noise, tolerance in ((1e-6, 1e-6), (0.5, 0.2)):
        omega = W @ truth + noise * random.normal(size=200)
        triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
        information = Information.from_factor(
            triangle[:-1, :-1], triangle[:-1, -1], triangle[-1, -1] ** 2, 200, [f"b{k}" for k in range(10)]
        )
        problem = _one_link(information)
        mean, rounds = relevance_regression(problem, 1000, 1e-8)
        plain = np.linalg.lstsq(W, omega)[0]
        np.testing.assert_allclose(mean[:5], truth[:5], atol=tolerance)
        assert np.abs(mean[5:]).sum() < (0.5 if noise > 0.1 else 1.0) * np.abs(plain[5:]).sum()
        assert rounds < 1000


def _one_link(information):
    """A problem of which only the regression is used."""
    from types import SimpleNamespace

    reduced = information.reduced(None)
    base = np.linalg.solve(reduced.R, reduced.rho)
    return SimpleNamespace(
        information=information,
        R=reduced.R,
        rho=reduced.rho,
        norm2=reduced.norm2,
        residual2=reduced.residual2,
        least_squares=base,
    )


def test_ting_approaches_the_bayesian_prediction(free_links):
    """Relevance determination costs residual, as little as it is."""
    model, _, information = free_links(3, seed=1)
    feasible = FeasibleSet(model, "inertia")
    ting, nakanishi = (kind().fit(information, feasible).relative_error for kind in (Ting2006, Nakanishi2008))
    assert nakanishi < ting < 1.01 * nakanishi
    blunt = Ting2006(relevance_iterations=1).fit(information, feasible)
    assert blunt.relative_error != ting


def test_progress_is_told(free_links):
    model, _, information = free_links(1)
    said: list[str] = []
    Ting2006().fit(information, FeasibleSet(model), progress=said.append)
    assert said[0].startswith("relevance determination: ")
    assert said[-1].startswith("iteration ")
