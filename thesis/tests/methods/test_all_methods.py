"""Every method over every problem: what it claims is proved, and no error is below the global optimum."""

import dataclasses

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, TotalMass, check
from steelyard.regression import Estimate
from steelyard_thesis.methods import (
    METHODS,
    Farhat2008,
    Mata2005,
    Method,
    Nakanishi2008,
    NakanishiCorrected,
    Rucker2022,
    Ting2006,
)

IDS = [method.__name__ for method in METHODS]
NONLINEAR = (Mata2005, Ting2006, Farhat2008, Nakanishi2008, NakanishiCorrected, Rucker2022)
SEARCHES = {Mata2005, NakanishiCorrected, Rucker2022}
"""Methods that find the optimum itself where there is one, in the consistency that they know."""


@pytest.fixture(params=METHODS, ids=IDS)
def method(request):
    return request.param()


def optimum(information, feasible):
    """The least relative error of all: nothing spent on a preference."""
    return fit(information, feasible, weights=None, prefer=None, residual_slack=0.0).relative_error


def assert_sound(estimate, information, feasible, best):
    """The claims of an estimate, checked from outside."""
    assert isinstance(estimate, Estimate)
    assert estimate.relative_error == pytest.approx(information.relative_error(estimate.base), rel=1e-12)
    if estimate.parameters is not None:
        K = feasible.model.base_parameters().K
        scale = np.abs(K) @ np.abs(estimate.parameters) + 1e-9
        assert np.all(np.abs(K @ estimate.parameters - estimate.base) <= 1e-9 * scale)
    if estimate.consistency is not None:
        assert estimate.consistency == feasible.consistency
        verdict = check(feasible, parameters=estimate.parameters)
        assert verdict.feasible
        assert bool(verdict.certificate.verify())
        assert estimate.relative_error >= best * (1 - 1e-6)


def test_interface(method):
    assert isinstance(method, Method)
    assert method.name
    assert any(year in method.source for year in map(str, range(1990, 2030)))
    assert dataclasses.is_dataclass(method)
    with pytest.raises(dataclasses.FrozenInstanceError):
        method.name = "another"


def test_names_differ():
    assert len({method.name for method in METHODS}) == len(METHODS)


@pytest.mark.parametrize("consistency", ["inertia", "full"])
@pytest.mark.parametrize("links", [1, 2, pytest.param(5, marks=pytest.mark.slow)])
def test_free_links_with_noise(method, free_links, links, consistency):
    model, _, information = free_links(links, seed=links)
    feasible = FeasibleSet(model, consistency)
    assert_sound(method.fit(information, feasible), information, feasible, optimum(information, feasible))


@pytest.mark.parametrize("weights", [None, pytest.param("joint", marks=pytest.mark.slow)])
def test_an_arm_with_noise(method, random_arm, weights):
    model, _, information = random_arm(3, seed=2, noise=0.2)
    feasible = FeasibleSet(model, "inertia")
    estimate = method.fit(information, feasible, weights=weights)
    assert_sound(estimate, information, feasible, optimum(information, feasible))
    assert (estimate.weights is None) == (weights is None)
    assert estimate.joint_relative_error.shape == (3,)


@pytest.mark.parametrize("kind", NONLINEAR)
@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_data_without_noise_is_recovered(kind, random_arm, consistency):
    model, truth, information = random_arm(2, seed=11)
    estimate = kind().fit(information, FeasibleSet(model, consistency))
    base = model.base_parameters().values(truth)
    np.testing.assert_allclose(estimate.base, base, rtol=2e-4, atol=2e-4 * np.abs(base).max())
    assert estimate.relative_error < 1e-4
    if consistency == "inertia" or kind in (NakanishiCorrected, Rucker2022):
        assert estimate.consistency == consistency


@pytest.mark.parametrize("kind", NONLINEAR)
@pytest.mark.parametrize("links", [1, 3])
def test_free_links_without_noise_are_recovered(kind, free_links, links):
    model, truth, information = free_links(links, seed=20 + links, noise=0.0)
    estimate = kind().fit(information, FeasibleSet(model))
    np.testing.assert_allclose(estimate.parameters, truth, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("kind", sorted(SEARCHES, key=lambda kind: kind.__name__))
@pytest.mark.parametrize("links", [1, 3, *(pytest.param(count, marks=pytest.mark.slow) for count in (2, 4, 5))])
def test_the_good_ones_find_the_optimum(kind, free_links, links):
    model, _, information = free_links(links, seed=30 + links)
    consistency = "inertia" if kind is Mata2005 else "full"
    feasible = FeasibleSet(model, consistency)
    estimate = kind().fit(information, feasible)
    assert estimate.consistency == consistency
    assert estimate.relative_error == pytest.approx(optimum(information, feasible), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(SEARCHES, key=lambda kind: kind.__name__))
def test_forty_links(kind, free_links):
    model, _, information = free_links(40, seed=40, rows=2000)
    feasible = FeasibleSet(model, "inertia" if kind is Mata2005 else "full")
    estimate = kind().fit(information, feasible)
    assert_sound(estimate, information, feasible, optimum(information, feasible))
    assert estimate.relative_error == pytest.approx(optimum(information, feasible), rel=1e-5)


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_the_real_wam(method, real_wam, consistency):
    """Masses grow without end there; a bound makes the optimum one that is attained, and a lower bound for others."""
    model, information = real_wam
    feasible = FeasibleSet(model, consistency)
    estimate = method.fit(information, feasible)
    bound = 0.0
    if estimate.consistency is not None:
        mass = float(estimate.parameters[feasible.mass_indices].sum())
        bounded = FeasibleSet(model, consistency, [TotalMass(maximum=1.01 * mass + 1.0)])
        bound = optimum(information, bounded)
    assert_sound(estimate, information, feasible, bound)


def test_same_numbers_twice(method, free_links):
    model, _, information = free_links(2, seed=9)
    feasible = FeasibleSet(model)
    first, second = (method.fit(information, feasible) for _ in range(2))
    np.testing.assert_array_equal(first.base, second.base)


def test_a_prior_of_wrong_size_is_refused(method, free_links):
    model, _, information = free_links(1)
    with pytest.raises(InputError, match="prior must hold the model's 10 standard parameters"):
        method.fit(information, FeasibleSet(model), prior=np.ones(3))


def test_data_of_another_model_is_refused(method, free_links):
    model, _, _ = free_links(1)
    _, _, information = free_links(2)
    with pytest.raises(InputError, match="another model"):
        method.fit(information, FeasibleSet(model))


def test_a_partly_known_prior_will_do(method, free_links):
    model, truth, information = free_links(2, seed=3)
    prior = truth.copy()
    prior[[4, 17]] = np.nan
    feasible = FeasibleSet(model)
    assert_sound(method.fit(information, feasible, prior=prior), information, feasible, optimum(information, feasible))


@pytest.mark.parametrize("kind", NONLINEAR)
@pytest.mark.parametrize(
    ("setting", "value"), [("iterations", 0), ("tolerance", -1.0), ("tolerance", float("nan")), ("solver", "magic")]
)
def test_impossible_settings_are_refused(kind, setting, value):
    with pytest.raises(InputError, match=f"{setting} of {kind.__name__} must be"):
        kind(**{setting: value})


@pytest.mark.parametrize("kind", [Ting2006, Nakanishi2008, NakanishiCorrected, Rucker2022])
def test_maps_refuse_constraints(kind, free_links):
    model, _, information = free_links(1)
    with pytest.raises(InputError, match="also has TotalMass"):
        kind().fit(information, FeasibleSet(model, constraints=[TotalMass(maximum=5.0)]))


class Joined:
    """Free links with a condition on two parameters, as a term of a user may have it."""

    def __init__(self, model):
        self.model = model

    def __getattr__(self, name):
        return getattr(self.model, name)

    def conditions(self, consistency):
        first = self.model.conditions(consistency)[0]
        sum_ = dataclasses.replace(
            first,
            name="sum of a term",
            kind="term",
            link=None,
            joint="joint1",
            constant=np.zeros((1, 1)),
            indices=np.array([3, 4]),
            coefficients=np.ones((2, 1, 1)),
        )
        return (*self.model.conditions(consistency), sum_)


def test_conditions_on_several_parameters(free_links):
    """Programs take them up, maps refuse them."""
    model, _, information = free_links(1, seed=7, noise=2.0)
    feasible = FeasibleSet(Joined(model), "inertia")
    assert Mata2005().fit(information, feasible).relative_error == pytest.approx(
        optimum(information, feasible), rel=1e-6
    )
    with pytest.raises(InputError, match="'sum of a term' is a condition on several parameters"):
        Nakanishi2008().fit(information, feasible)
