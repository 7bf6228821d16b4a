import numpy as np
import pytest

from steelyard.conic import Outcome
from steelyard.dynamics import Model, Viscous
from steelyard.errors import InputError, SolverError
from steelyard.feasibility import CenterOfMassBox, FeasibleSet, TotalMass, check, correct
from steelyard.identification.wam import true_parameters, wam_model
from steelyard.robot import Robot

IMPOSSIBLE = np.array([0.5, 0.1, 0.25, 0.3, 0.4, -0.1])


def test_base_agrees_with_descent_over_factors(two_links, least_by_descent):
    feasible = FeasibleSet(two_links)
    expected, squared = least_by_descent(feasible, lambda delta: feasible.K @ delta - IMPOSSIBLE)
    correction = correct(feasible, base=IMPOSSIBLE)
    assert correction.squared_distance == pytest.approx(squared, rel=1e-5)
    np.testing.assert_allclose(correction.base, feasible.K @ expected, atol=2e-5)
    assert correction.status == "corrected"


def test_standard_agrees_with_descent_over_factors(two_links, least_by_descent):
    feasible = FeasibleSet(two_links)
    given = np.random.default_rng(10).normal(size=22)
    expected, squared = least_by_descent(feasible, lambda delta: delta - given)
    correction = correct(feasible, parameters=given)
    assert correction.squared_distance == pytest.approx(squared, rel=1e-6)
    np.testing.assert_allclose(correction.parameters, expected, atol=1e-4)


def test_answer_is_feasible_and_consistent(two_links):
    feasible = FeasibleSet(two_links)
    correction = correct(feasible, base=IMPOSSIBLE)
    assert correction.certificate.verify()
    np.testing.assert_allclose(feasible.K @ correction.parameters, correction.base, rtol=1e-12)
    assert check(feasible, base=correction.base).feasible is not False
    assert feasible.stack.smallest_eigenvalues(correction.parameters).min() >= 0.5e-6


def test_feasible_vector_comes_back_unchanged(two_links):
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    correction = correct(FeasibleSet(two_links), base=base)
    assert correction.status == "already feasible"
    np.testing.assert_allclose(correction.base, base, rtol=1e-12)


def test_feasible_standard_parameters_come_back_unchanged(two_links, factored):
    delta = factored(np.random.default_rng(11).normal(size=34), 1e-3)
    correction = correct(FeasibleSet(two_links), parameters=delta)
    assert correction.status == "already feasible"
    np.testing.assert_array_equal(correction.parameters, delta)


def test_small_distances_are_exact(two_links):
    # Only friction is impossible, by 1e-4: the distance is that and the margin.
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, -1e-4])
    correction = correct(FeasibleSet(two_links), base=base)
    assert np.sqrt(correction.squared_distance) == pytest.approx(1e-4 + 1e-6, rel=1e-2)


def test_constraints_are_kept(two_links):
    box = CenterOfMassBox("forearm", (-1.0, -1.0, -1.0), (0.2, 1.0, 1.0))
    feasible = FeasibleSet(two_links, constraints=[TotalMass(equal=3.0), box])
    correction = correct(feasible, base=IMPOSSIBLE)
    assert correction.parameters[[9, 20]].sum() == pytest.approx(3.0, rel=1e-9)
    assert correction.parameters[17] <= 0.2 * correction.parameters[20]


def test_contradicting_constraints_are_said(two_links):
    constraints = [TotalMass(maximum=1.0), TotalMass(minimum=2.0)]
    with pytest.raises(SolverError, match="loosen the constraints"):
        correct(FeasibleSet(two_links, constraints=constraints), base=IMPOSSIBLE)


def test_exactly_one_vector_is_needed(two_links):
    with pytest.raises(InputError, match="exactly one"):
        correct(FeasibleSet(two_links))


def test_prints_as_a_sentence(two_links):
    correction = correct(FeasibleSet(two_links), base=[1.5, 0.1, 0.25, 0.3, 0.4, -0.1])
    assert str(correction) == 'Corrected to be feasible under "full" consistency; squared distance 0.0100002.'


@pytest.mark.parametrize("consistency", ["inertia", "full"])
@pytest.mark.parametrize("seed", [0, 7, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 7))])
def test_links_of_50_g_beside_links_of_50_kg(seed, consistency, point_cloud_parameters):
    """Bodies of the density of water, a thousand times heavier or lighter than their neighbours: plainly solved."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    rows = [(str(rng.choice(["0", "pi/2", "-pi/2"])), 0.3, 0.1, "q") for _ in range(count)]
    model = Model(Robot.from_dh(rows).with_terms(Viscous()))
    truth = []
    for link in range(count):
        mass = 0.05 if (link + seed) % 2 else 50.0
        points = (mass / 1000) ** (1 / 3) * (rng.normal(size=(6, 3)) + rng.normal(size=3))
        truth += [*point_cloud_parameters(rng.dirichlet(np.ones(6)) * mass, points), rng.uniform(0, 0.1)]
    feasible = FeasibleSet(model, consistency)
    exact = feasible.K @ np.array(truth)
    base = exact * (1 + 0.3 * rng.normal(size=len(exact))) + 1e-3 * rng.normal(size=len(exact))
    correction = correct(feasible, base=base)
    assert correction.outcome is Outcome.SOLVED
    assert correction.certificate.verify()
    # The parameters that the estimate was disturbed from are possible, so that the nearest are no farther.
    assert correction.squared_distance <= np.sum((exact - base) ** 2) * (1 + 1e-6)


@pytest.mark.parametrize("scale", [1e-4, 1e5])
def test_units_of_mass_do_not_matter(two_links, scale):
    """Everything is linear in the masses; a margin in proportion gives an answer in proportion."""
    plain = correct(FeasibleSet(two_links), base=IMPOSSIBLE)
    scaled = correct(FeasibleSet(two_links, margin=1e-6 * scale), base=scale * IMPOSSIBLE)
    np.testing.assert_allclose(scaled.base, scale * plain.base, atol=1e-4 * scale)
    assert scaled.squared_distance == pytest.approx(scale**2 * plain.squared_distance, rel=1e-4)


@pytest.mark.parametrize("seed", [pytest.param(10, marks=pytest.mark.slow), 26, 52])
def test_base_parameters_of_millions_have_an_answer(seed):
    """The set is a cone, but for a margin of 1e-6, so that distances grow with the parameters."""
    model = wam_model()
    feasible = FeasibleSet(model)
    truth = model.base_parameters().values(true_parameters())
    base = truth + 1e6 * np.random.default_rng(seed).normal(size=len(truth))
    correction = correct(feasible, base=base)
    for matrix in (block.evaluate(correction.parameters) for block in feasible.blocks):
        assert np.linalg.eigvalsh(matrix).min() > 0.0
    small = correct(feasible, base=1e-6 * base)
    assert correction.squared_distance == pytest.approx(1e12 * small.squared_distance, rel=1e-4)
