"""Thesis 4.5.3 through every solver, each to its own accuracy, and corrections that every solver must find alike."""

import numpy as np
import pytest

from steelyard.conic import Outcome, find_solver
from steelyard.errors import InputError, SolverError
from steelyard.feasibility import FeasibleSet, TotalMass, correct

# Relative differences of the squared distance from Clarabel's; a first-order method is not more accurate.
TOLERANCE = {"clarabel": 0.0, "scs": 1e-4, "csdp": 2e-5, "dsdp": 2e-5, "sdpa": 2e-5}
QUICK = [name if name in ("clarabel", "sdpa") else pytest.param(name, marks=pytest.mark.slow) for name in TOLERANCE]
"""All solvers, of which the fast tests try the default one and one program on a large problem."""


@pytest.fixture(params=list(TOLERANCE))
def solver(request) -> str:
    chosen = find_solver(request.param)
    if not chosen.installed():
        pytest.skip(f"{chosen.title} is not installed ({chosen.remedy})")
    return request.param


@pytest.mark.parametrize("solver", QUICK, indirect=True)
@pytest.mark.parametrize(
    ("consistency", "published"), [pytest.param("inertia", 0.00774, marks=pytest.mark.slow), ("full", 0.01345)]
)
def test_corrected_wls_of_table_4_9(solver, thesis_wam, table_4_9, consistency, published):
    """The distance that the thesis gives (4.5.3), and that of full consistency, to one unit of their last digit."""
    feasible = FeasibleSet(thesis_wam, consistency)
    correction = correct(feasible, base=table_4_9["WLS"], solver=solver)
    assert correction.outcome is Outcome.SOLVED
    assert correction.solver == find_solver(solver).title
    assert correction.squared_distance == pytest.approx(published, abs=1e-5)
    assert correction.certificate.verify()
    reference = correct(feasible, base=table_4_9["WLS"])
    assert correction.squared_distance == pytest.approx(reference.squared_distance, rel=TOLERANCE[solver])
    np.testing.assert_allclose(correction.base, reference.base, atol=2e-3)


def test_small_distances(solver, two_links):
    """Only friction is impossible, by 1e-4: the distance is that and the margin."""
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, -1e-4])
    correction = correct(FeasibleSet(two_links), base=base, solver=solver)
    assert np.sqrt(correction.squared_distance) == pytest.approx(1e-4 + 1e-6, rel=1e-2)


def test_what_is_feasible_stays(solver, two_links):
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
    correction = correct(FeasibleSet(two_links), base=base, solver=solver)
    assert correction.status == "already feasible"
    np.testing.assert_allclose(correction.base, base, rtol=1e-12)


def test_equations_and_contradictions(solver, two_links):

    base = np.array([0.5, 0.1, 0.25, 0.3, 0.4, -0.1])
    correction = correct(FeasibleSet(two_links, constraints=[TotalMass(equal=3.0)]), base=base, solver=solver)
    assert correction.parameters[[9, 20]].sum() == pytest.approx(3.0, rel=1e-9)
    contradiction = [TotalMass(maximum=1.0), TotalMass(minimum=2.0)]
    with pytest.raises(SolverError, match=f"{find_solver(solver).title}.*loosen the constraints"):
        correct(FeasibleSet(two_links, constraints=contradiction), base=base, solver=solver)


def test_metrics(solver, two_links):
    """A metric through every solver: the same point as Clarabel's."""
    rng = np.random.default_rng(3)
    factor = rng.normal(size=(6, 6))
    base = np.array([0.5, 0.1, 0.25, 0.3, 0.4, -0.1])
    feasible = FeasibleSet(two_links)
    reference = correct(feasible, base=base, metric=factor.T @ factor)
    correction = correct(feasible, base=base, metric=factor.T @ factor, solver=solver)
    assert correction.squared_distance == pytest.approx(reference.squared_distance, rel=1e-4)


def test_unknown_solvers_are_said(two_links):
    with pytest.raises(InputError, match=r'no solver .csdq. .*; did you mean "csdp"'):
        correct(FeasibleSet(two_links), base=np.zeros(6), solver="csdq")
