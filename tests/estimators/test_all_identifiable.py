"""The regression of thesis 6.3.2, against solvers that know nothing of conic programs, and against CVXPY."""

import numpy as np
import pytest
import scipy.optimize

from steelyard.estimators import fit_reduced
from steelyard.feasibility import FeasibleSet

ROW, COLUMN = np.tril_indices(4)


def parameters_of(pseudo_inertias):
    """Inertial parameters from pseudo-inertia matrices, by the definition of moments."""
    found = []
    for P in pseudo_inertias:
        second = P[:3, :3]
        tensor = np.trace(second) * np.eye(3) - second
        found += [*tensor[np.triu_indices(3)], *P[:3, 3], P[3, 3]]
    return np.array(found)


def by_factors(R, rho, links, margin, seed):
    """Least squares over P = L Lᵀ + margin, which is always positive definite (Levenberg-Marquardt)."""

    def factors(x):
        found = np.zeros((links, 4, 4))
        found[:, ROW, COLUMN] = x.reshape(links, 10)
        return found

    def error(x):
        L = factors(x)
        return R @ parameters_of(L @ L.transpose(0, 2, 1) + margin * np.eye(4)) - rho

    def jacobian(x):
        columns = []
        for link, L in enumerate(factors(x)):
            for i, j in zip(ROW, COLUMN, strict=True):
                change = np.zeros((4, 4))
                change[i] = L[:, j]
                step = np.zeros((links, 4, 4))
                step[link] = change + change.T
                columns.append(R @ parameters_of(step))
        return np.column_stack(columns)

    best = np.inf
    for start in range(2):
        x = np.random.default_rng(seed + start).normal(size=10 * links)
        found = scipy.optimize.least_squares(
            error, x, jac=jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=1000
        )
        best = min(best, 2 * found.cost)
    return best


@pytest.mark.slow
@pytest.mark.parametrize("links", [1, 2])
def test_optimum_equals_that_over_cholesky_factors(all_identifiable, links):
    model, reduced, _ = all_identifiable(links, seed=links, rows=200)
    feasible = FeasibleSet(model)
    assert not feasible.contains(np.linalg.solve(reduced.R, reduced.rho))
    fit = fit_reduced(reduced, feasible)
    expected = reduced.residual2 + by_factors(reduced.R, reduced.rho, links, feasible.margin, seed=links)
    assert fit.squared_residual == pytest.approx(expected, rel=1e-7)
    assert fit.statuses == ("Solved",)
    assert fit.exact
    assert fit.attained


@pytest.mark.parametrize("links", [7, pytest.param(40, marks=pytest.mark.slow)])
def test_optimum_equals_that_of_cvxpy(all_identifiable, links):
    cp = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
    model, reduced, (W, omega) = all_identifiable(links, seed=3, rows=25 * links)
    delta = cp.Variable(10 * links)
    constraints = []
    for condition in model.conditions("full"):
        matrix = sum(delta[int(i)] * C for i, C in zip(condition.indices, condition.coefficients, strict=True))
        constraints.append(matrix >> 1e-6 * np.eye(4))
    problem = cp.Problem(cp.Minimize(cp.sum_squares(W @ delta - omega) / reduced.residual2), constraints)
    problem.solve(solver="CLARABEL")
    fit = fit_reduced(reduced, FeasibleSet(model))
    assert fit.squared_residual == pytest.approx(problem.value * reduced.residual2, rel=1e-6)
    np.testing.assert_allclose(fit.parameters, delta.value, atol=2e-3)


def test_feasible_least_squares_need_no_solver(all_identifiable):
    model, reduced, _ = all_identifiable(5, noise=0.0)
    fit = fit_reduced(reduced, FeasibleSet(model))
    assert fit.statuses == ()
    np.testing.assert_allclose(fit.parameters, np.linalg.solve(reduced.R, reduced.rho), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("condition_number", [1e2, pytest.param(1e6, marks=pytest.mark.slow)])
def test_ill_conditioned_data_lose_no_accuracy(all_identifiable, condition_number):
    """Below 1e4 RᵀR is formed, above it is not; a change of variables that keeps the optimum tells the difference."""
    model, reduced, _ = all_identifiable(1, seed=8, rows=100)
    plain = np.linalg.solve(reduced.R, reduced.rho)
    left = np.linalg.qr(np.random.default_rng(1).normal(size=(10, 10)))[0]
    R = left @ np.diag(np.geomspace(1.0, 1.0 / condition_number, 10)) @ left.T
    data = type(reduced)(R, R @ plain, 1e-3, 100, 1e-3 + float(np.sum((R @ plain) ** 2)))
    feasible = FeasibleSet(model)
    fit = fit_reduced(data, feasible)
    expected = 1e-3 + by_factors(R, R @ plain, 1, feasible.margin, seed=2)
    assert fit.squared_residual == pytest.approx(expected, rel=1e-6)
