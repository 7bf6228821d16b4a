"""Díaz-Rodríguez 2010 and Gautier 2013: reductions, feasibility with proofs, and the prior in the null space."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard_thesis.methods import DiazRodriguez2010, Gautier2013
from steelyard_thesis.methods.gautier_2013 import degrees_of_infeasibility
from steelyard_thesis.methods.method import Problem

PLANAR = [(0, 1.0, 0, "q"), (0, 0.8, 0, "q")]


@pytest.fixture(scope="module")
def planar():
    return sy.Model(sy.Robot.from_dh(PLANAR, gravity=(0, -9.81, 0)).with_terms(sy.Viscous()))


@pytest.fixture(scope="module")
def truth(planar):
    one = [0.02, 0.0, 0.0, 0.4, 0.0, 0.4, -0.5, 0.0, 0.0, 1.5, 0.2]
    return np.array([*one, *one])


def information(model, truth, noise, seed=3, count=80):
    random = np.random.default_rng(seed)
    joints = len(model.robot.joint_names)
    q, dq, ddq = random.normal(size=(3, count, joints))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + noise * random.normal(size=(count, joints))
    return sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))


@pytest.fixture(scope="module")
def reducible(planar, truth):
    """Noisy data whose plain least squares are infeasible, but not those of some reduced model."""
    for seed in range(200):
        info = information(planar, truth, 4.0, seed)
        if sy.check(sy.FeasibleSet(planar), base=sy.least_squares(info).base).feasible is False:
            path = DiazRodriguez2010().path(info, sy.FeasibleSet(planar), distances=False)
            if any(step.feasible for step in path):
                return info
    raise AssertionError("no such data")


@pytest.mark.slow
def test_path_says_what_check_and_correct_say(planar, reducible):
    feasible = sy.FeasibleSet(planar)
    path = DiazRodriguez2010().path(reducible, feasible)
    assert [step.excluded_count for step in path] == list(range(planar.base_parameters().count))
    assert not path[0].feasible
    assert np.all(np.diff([step.relative_error for step in path]) >= -1e-12)
    for step in path:
        assert sy.check(feasible, base=step.base).feasible == step.feasible
        assert reducible.relative_error(step.base) == step.relative_error
        nearest = sy.correct(feasible, base=step.base)
        assert step.distance == (0.0 if step.feasible else np.sqrt(nearest.squared_distance))


@pytest.mark.slow
def test_estimate_is_the_first_feasible_reduction(planar, reducible):
    feasible = sy.FeasibleSet(planar)
    path = DiazRodriguez2010().path(reducible, feasible, distances=False)
    first = next(step for step in path if step.feasible)
    estimate = DiazRodriguez2010().fit(reducible, feasible)
    np.testing.assert_array_equal(estimate.base, first.base)
    assert estimate.consistency == "full"
    np.testing.assert_allclose(planar.base_parameters().K @ estimate.parameters, estimate.base, atol=1e-9)
    assert all(name in estimate.remarks[0] for name in first.excluded)
    # Nothing that is reduced fits better than the feasible optimum.
    best = sy.fit(reducible, feasible, weights=None, residual_slack=0.0)
    assert best.relative_error <= estimate.relative_error * (1.0 + 1e-6)


def test_grid_search_finds_only_what_is_feasible(planar, truth):
    feasible = sy.FeasibleSet(planar)
    info = information(planar, truth, 0.0)
    estimate = DiazRodriguez2010(feasibility="search", levels=2, budget=200_000).fit(info, feasible)
    if estimate.parameters is not None:
        assert sy.check(feasible, parameters=estimate.parameters).feasible
        np.testing.assert_allclose(planar.base_parameters().K @ estimate.parameters, estimate.base, atol=1e-9)
    else:
        assert "proves nothing" in estimate.remarks[-1]


def test_grid_search_on_a_pendulum_is_complete():
    """Seven dependent parameters with three values each: 2187 points, of which one is feasible for a plain body."""
    model = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)))
    names = model.base_parameters().names
    info = sy.Information.from_factor(10 * np.eye(3), [5.0, 2.0, 0.0], 1.0, 100, names)
    feasible = sy.FeasibleSet(model)
    estimate = DiazRodriguez2010(feasibility="search").fit(info, feasible)
    assert estimate.consistency == "full"
    assert sy.check(feasible, parameters=estimate.parameters).feasible
    np.testing.assert_allclose(estimate.base, [0.5, 0.2, 0.0])
    nothing = sy.Information.from_factor(10 * np.eye(3), [-5.0, 2.0, 0.0], 1.0, 100, names)
    estimate = DiazRodriguez2010(feasibility="search", most_removed=1).fit(nothing, feasible)
    assert estimate.parameters is None
    assert estimate.remarks[-1] == (
        "None of the 2187 points of the grid is feasible; that proves nothing of what is between."
    )


def test_no_reduction_may_be_feasible(planar, truth):
    """With a negative moment of inertia that the data shows well, no reduction helps before it is gone."""
    info = information(planar, -truth, 1e-3)
    estimate = DiazRodriguez2010(most_removed=3).fit(info, sy.FeasibleSet(planar))
    assert estimate.parameters is None
    assert estimate.consistency is None
    np.testing.assert_allclose(estimate.base, sy.least_squares(info).base, rtol=1e-9)
    assert estimate.remarks == ("No reduced model, with up to 3 base parameters taken out, has a feasible estimate.",)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"feasibility": "sdp"}, '"exact" or "search"'), ({"levels": 1}, "levels must"), ({"budget": 0}, "budget must")],
)
def test_bad_settings_of_diaz_rodriguez(settings, message):
    with pytest.raises(InputError, match=message):
        DiazRodriguez2010(**settings)


def test_gautier_is_the_closest_to_the_prior_of_all_least_squares_solutions(planar, truth):
    """With all parameters kept: K δ = β of least squares, and δ - δ̂ has no part in the null space of K."""
    info = information(planar, truth, 0.5)
    prior = truth * 1.1 + 0.01
    estimate = Gautier2013(largest_ratio=np.inf).fit(info, sy.FeasibleSet(planar), prior=prior)
    K = planar.base_parameters().K
    base = sy.least_squares(info).base
    np.testing.assert_allclose(K @ estimate.parameters, base, atol=1e-9)
    np.testing.assert_allclose(estimate.parameters, prior + np.linalg.pinv(K) @ (base - K @ prior), atol=1e-9)


def test_gautier_relative_keeps_zeros_and_moves_least_in_relative_terms(planar, truth):
    info = information(planar, truth, 0.5)
    estimate = Gautier2013(largest_ratio=np.inf, closest="relative").fit(info, sy.FeasibleSet(planar), prior=truth)
    np.testing.assert_array_equal(estimate.parameters[truth == 0.0], 0.0)
    change = (estimate.parameters - truth)[truth != 0.0] / truth[truth != 0.0]
    matrix = (Problem.of(info, sy.FeasibleSet(planar)).matrix * truth)[:, truth != 0.0]
    error = Problem.of(info, sy.FeasibleSet(planar)).rho - matrix.sum(axis=1)
    np.testing.assert_allclose(change, np.linalg.lstsq(matrix, error, rcond=1e-10)[0], atol=1e-8)


def test_gautier_stops_where_the_deviations_are_alike(planar, truth):
    info = information(planar, truth, 1.0)
    problem = Problem.of(info, sy.FeasibleSet(planar))
    counts = []
    for ratio in (3.0, 10.0, 30.0, np.inf):
        elimination = Gautier2013(largest_ratio=ratio).essential(problem)
        deviations = elimination.relative_standard_deviation
        assert deviations.max() <= ratio * deviations.min()
        counts.append(len(elimination.kept))
    assert counts == sorted(counts)
    assert counts[0] < counts[-1] == planar.base_parameters().count


def test_gautier_recovers_a_prior_that_is_true(planar, truth):
    info = information(planar, truth, 0.0)
    estimate = Gautier2013().fit(info, sy.FeasibleSet(planar), prior=truth)
    np.testing.assert_allclose(estimate.parameters, truth, atol=1e-9)
    assert estimate.consistency == "full"


def test_degrees_of_infeasibility_make_cholesky_succeed(planar, truth):
    feasible = sy.FeasibleSet(planar)
    assert degrees_of_infeasibility(feasible, truth) == {}
    bad = truth.copy()
    bad[[3, 20]] = -0.3, 0.01
    degrees = degrees_of_infeasibility(feasible, bad)
    assert degrees
    for block in feasible.blocks:
        amount = degrees.get(block.name, 0.0)
        matrix = block.evaluate(bad)
        np.linalg.cholesky(matrix + (amount * (1 + 1e-6) + 1e-12) * np.eye(block.size))
        if amount:
            with pytest.raises(np.linalg.LinAlgError):
                np.linalg.cholesky(matrix + 0.999 * amount * np.eye(block.size))


def test_bad_settings_of_gautier(planar, truth):
    with pytest.raises(InputError, match="largest_ratio must be above 1"):
        Gautier2013(largest_ratio=1.0)
    with pytest.raises(InputError, match="needs a prior"):
        Gautier2013(closest="relative").fit(information(planar, truth, 0.5), sy.FeasibleSet(planar))


@pytest.mark.data
def test_reductions_of_the_real_wam(real_wam):
    """All 57 reductions are refuted with proofs; the first steps cost next to nothing (as thesis figure 6.4)."""
    model, info = real_wam
    feasible = sy.FeasibleSet(model, "inertia")
    path = DiazRodriguez2010().path(info, feasible, distances=False)
    assert path[0].relative_error == pytest.approx(0.0561657801, abs=1e-10)
    assert path[20].relative_error < 1.005 * path[0].relative_error
    for step in path[::8]:
        verdict = sy.check(feasible, base=step.base)
        assert verdict.feasible == step.feasible
        assert verdict.certificate.verify()
