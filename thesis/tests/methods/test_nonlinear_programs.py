"""Mata 2005 and Farhat 2008: agreement of solvers, priors, steps, and constraints of the set."""

import sys

import numpy as np
import pytest

from steelyard.errors import InputError, MissingExtraError
from steelyard.estimators.fit import fit
from steelyard.feasibility import CenterOfMassSphere, FeasibleSet, LinearBound, TotalMass
from steelyard.regression import least_squares
from steelyard_thesis.methods import Farhat2008, Mata2005, Problem
from steelyard_thesis.methods.link_conditions import Eigenvalues
from steelyard_thesis.methods.nonlinear_program import NonlinearProgram
from steelyard_thesis.methods.starting_point import starting_point


@pytest.mark.parametrize("kind", [Mata2005, Farhat2008])
@pytest.mark.parametrize("solver", ["slsqp", pytest.param("trust-constr", marks=pytest.mark.slow), "ipopt"])
def test_every_solver_finds_the_optimum_of_a_small_problem(free_links, kind, solver):
    if solver == "ipopt":
        pytest.importorskip("cyipopt", reason="cyipopt is not installed")
    model, _, information = free_links(1, seed=9, noise=2.0)
    feasible = FeasibleSet(model, "inertia")
    estimate = kind(solver=solver, iterations=200).fit(information, feasible)
    best = fit(information, feasible)
    assert best.relative_error > 1.00001 * least_squares(information).relative_error
    assert estimate.relative_error == pytest.approx(best.relative_error, rel=1e-6)
    assert estimate.consistency == "inertia"


def test_sylvester_may_end_where_eigenvalues_do_not(free_links):
    """Two eigenvalues vanish at this optimum, where the determinant has no slope: a flaw of the criterion."""
    model, _, information = free_links(1, seed=7, noise=2.0)
    feasible = FeasibleSet(model, "inertia")
    best = fit(information, feasible).relative_error
    assert Mata2005().fit(information, feasible).relative_error == pytest.approx(best, rel=1e-6)
    assert Farhat2008().fit(information, feasible).relative_error > 1.0001 * best


def test_objective_has_both_parts_of_its_equation(random_arm):
    """Thesis (2.69), from the data's own residual and the distance to the prior."""
    model, truth, information = random_arm(2, noise=0.1)
    problem = Problem.of(information, FeasibleSet(model))
    prior = truth.copy()
    prior[3] = np.nan
    base = problem.base_of(prior)
    program = NonlinearProgram(problem, Eigenvalues(), 2.0, 3.0, base)
    point = starting_point(problem)
    K = model.base_parameters().K
    known = ~np.isnan(base)
    assert known.sum() == np.sum(K[:, 3] == 0.0)
    distance = np.sum((K @ point - np.nan_to_num(base))[known] ** 2)
    expected = 2.0 * (problem.squared_residual(point) - problem.residual2) + 3.0 * distance
    found = program.objective(program.to_unknowns(point)) * problem.regression.scale
    assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("kind", [Mata2005, Farhat2008])
def test_a_heavy_prior_decides(free_links, kind):
    model, truth, information = free_links(2, seed=6)
    feasible = FeasibleSet(model, "inertia")
    estimate = kind(prior_weight=1e9).fit(information, feasible, prior=1.1 * truth)
    np.testing.assert_allclose(estimate.base, 1.1 * truth, rtol=1e-3, atol=1e-3)


def test_triangle_inequality_only_where_it_is_asked_for(free_links):
    model, _, information = free_links(3, seed=5)
    feasible = FeasibleSet(model, "full")
    plain = Mata2005().fit(information, feasible)
    asked = Mata2005(triangle_inequality=True).fit(information, feasible)
    assert plain.consistency is None
    assert 'not feasible in the sense of "full"' in plain.remarks[-1]
    assert asked.consistency == "full"
    assert asked.relative_error == pytest.approx(fit(information, feasible).relative_error, rel=1e-6)


def test_two_steps_are_two(free_links):
    model, _, information = free_links(1)
    feasible = FeasibleSet(model, "inertia")
    assert [r[:6] for r in Mata2005().fit(information, feasible).remarks] == ["Step 1", "Step 2"]
    (remark,) = Mata2005(two_steps=False).fit(information, feasible).remarks
    assert remark.startswith("converged after")


@pytest.mark.parametrize("kind", [Mata2005, Farhat2008])
def test_linear_constraints_are_honoured(free_links, kind):
    model, truth, information = free_links(2, seed=7)
    total = 0.8 * (truth[9] + truth[19])
    constraints = [TotalMass(maximum=total), LinearBound("m1", minimum=0.5), LinearBound("Lxx2 + Lyy2", maximum=1.0)]
    feasible = FeasibleSet(model, "inertia", constraints)
    estimate = kind().fit(information, feasible)
    assert estimate.consistency == "inertia"
    assert estimate.relative_error == pytest.approx(fit(information, feasible).relative_error, rel=1e-5)
    assert estimate.parameters[9] + estimate.parameters[19] == pytest.approx(total, rel=1e-4)


@pytest.mark.parametrize("kind", [Mata2005, Farhat2008])
def test_constraints_that_are_matrices_are_refused(free_links, kind):
    model, _, information = free_links(1)
    feasible = FeasibleSet(model, "inertia", [CenterOfMassSphere("link1", center=(0, 0, 0), radius=1.0)])
    with pytest.raises(InputError, match="linear constraints alone"):
        kind().fit(information, feasible)


def test_limit_of_iterations_returns_what_there_is(random_arm):
    model, _, information = random_arm(3, noise=0.3)
    feasible = FeasibleSet(model, "inertia")
    estimate = Mata2005(iterations=3).fit(information, feasible, weights="joint")
    assert estimate.consistency == "inertia"
    assert "not converged after 3 iterations" in estimate.remarks[0]
    start = Problem.of(information, feasible, "joint")
    assert start.squared_residual(estimate.parameters) < start.squared_residual(starting_point(start))


def test_missing_ipopt_is_named(free_links, monkeypatch):
    monkeypatch.setitem(sys.modules, "cyipopt", None)
    model, _, information = free_links(1)
    with pytest.raises(MissingExtraError, match="cyipopt"):
        Farhat2008(solver="ipopt").fit(information, FeasibleSet(model, "inertia"))
