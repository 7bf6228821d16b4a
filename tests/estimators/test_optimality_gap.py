"""The gap that a fit measures: small where the answer is the optimum, and never smaller than the truth."""

import numpy as np
import pytest
from random_fits import least_by_cvxpy, random_fit, squared_residual

from steelyard.estimators import EntropicPrior, fit_reduced
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.dual_bound import ConvexProblem, Multipliers
from steelyard.lmi import symmetric_to_vector
from steelyard.regression import Estimate

SEEDS = (4, 8, 15, 24, 31)
"""Of which 8, 15, 24 and 31 ended up to 7e-4 above the optimum, or the peer far above it, while a pull towards plain
least squares decided the answer: joints that hardly move, and condition numbers of 1e8."""


def check(seed):
    problem = random_fit(seed)
    found = fit_reduced(problem.reduced, problem.feasible, **problem.options)
    assert problem.feasible.contains(found.parameters)
    told = any("not proved to be the least" in remark for remark in found.remarks)
    assert told == (found.optimality_gap > 1e-6)
    peer = least_by_cvxpy(problem)
    if peer is not None and found.attained:
        least = squared_residual(problem, peer)
        assert found.best_squared_residual <= least * (1 + 1e-5)
    if found.exact:
        assert squared_residual(problem, found.parameters) <= found.best_squared_residual * (1 + 2e-6)
    return found


@pytest.mark.parametrize("seed", [pytest.param(s, marks=pytest.mark.slow if s != 31 else ()) for s in SEEDS])
def test_no_fit_lies_above_what_another_formulation_finds(seed):
    assert check(seed).optimality_gap <= 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("first", range(100, 150, 10))
def test_random_fits_end_with_a_small_gap_or_say_so(first):
    gaps = [check(seed).optimality_gap for seed in range(first, first + 10)]
    assert np.sum(np.array(gaps) <= 1e-6) >= 9


@pytest.fixture
def data(reduced_regression):
    random = np.random.default_rng(12)
    R = np.triu(random.normal(size=(6, 6))) + 3 * np.eye(6)
    rho = R @ np.array([0.5, 0.1, 0.25, 0.3, 0.4, 0.05])
    return reduced_regression(R, rho, 2.0, 1000, 2.0 + float(rho @ rho))


def least_squares_problem(feasible, data, point):
    """‖R K δ - ρ‖² + residual2 as it looks from a point."""
    root = data.R @ feasible.K
    error = root @ point - data.rho
    return ConvexProblem(
        feasible_set=feasible,
        point=point,
        directions=np.eye(len(point)),
        units=np.ones(len(point)),
        value=float(error @ error) + data.residual2,
        gradient=2 * root.T @ error,
        root=root,
        rows=np.zeros((0, len(point))),
        slack=np.zeros(0),
        size=data.residual2,
    )


@pytest.mark.slow
def test_no_multipliers_give_a_bound_above_the_least_residual(two_links, data, least_by_descent):
    """Whatever a solver returns, also from points that are not feasible: weak duality."""
    feasible = FeasibleSet(two_links, margin=1e-9)
    optimum, squared = least_by_descent(feasible, lambda delta: data.R @ (feasible.K @ delta) - data.rho)
    random = np.random.default_rng(3)
    bounds = []
    for scale in (0.0, 1e-6, 1e-2, 1.0, 1e3):
        point = optimum + random.normal(size=22) * min(scale, 1.0)
        blocks = [f @ f.T * scale for f in (random.normal(size=(b.size, b.size)) for b in feasible.blocks)]
        stacked = np.concatenate([symmetric_to_vector(blocks[i]) for i in feasible.stack.order])
        bounds.append(least_squares_problem(feasible, data, point).lower_bound(Multipliers(stacked, np.zeros(0))))
    assert max(bounds) <= (squared + data.residual2) * (1 + 1e-9)
    assert np.all(np.isfinite(bounds))


def test_a_point_that_is_not_the_optimum_has_a_gap(two_links, data):
    """The bound is that of the problem, not of the point: what the point costs too much is the gap."""
    feasible = FeasibleSet(two_links)
    best = fit_reduced(data, feasible, None, residual_slack=0.0)
    assert best.optimality_gap <= 1e-6
    spent = fit_reduced(data, feasible, residual_slack=1e-2)
    assert not spent.exact
    assert spent.optimality_gap <= 1e-6
    assert spent.squared_residual > best.squared_residual * (1 + 0.9e-2)
    assert spent.tie_break_gap <= 1e-3


def test_the_margin_costs_next_to_nothing(two_links, data):
    """A distance from the boundary that would cost more than a millionth of the residual is lessened."""
    fits = [fit_reduced(data, FeasibleSet(two_links, margin=margin), None) for margin in (1e-9, 1e-2)]
    assert all(found.optimality_gap <= 1e-6 for found in fits)
    assert fits[1].squared_residual <= fits[0].squared_residual * (1 + 2e-6)


def test_gap_with_an_entropic_prior(two_links, data, point_cloud_parameters):
    random = np.random.default_rng(14)
    known = np.full(22, np.nan)
    for link in range(2):
        known[11 * link : 11 * link + 10] = point_cloud_parameters(np.full(8, 0.5), 0.2 * random.normal(size=(8, 3)))
    for weight in (0.1, 30.0):
        found = fit_reduced(data, FeasibleSet(two_links), prior=EntropicPrior(known), prior_weight=weight)
        assert found.optimality_gap <= 1e-6


def test_estimate_carries_the_gap_to_the_disk(tmp_path):
    problem = random_fit(16)
    estimate = fit(problem.info, problem.feasible, problem.weights)
    assert 0.0 <= estimate.optimality_gap <= 1e-6
    estimate.save(tmp_path / "estimate.json")
    assert Estimate.load(tmp_path / "estimate.json").optimality_gap == estimate.optimality_gap
