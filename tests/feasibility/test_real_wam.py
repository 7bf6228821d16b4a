"""The real WAM: constrained fits against optima found by others, from its reduced regression."""

import csv
import json

import numpy as np
import pytest

from steelyard.conic import find_solver
from steelyard.estimators import EntropicPrior, fit_reduced, l_curve
from steelyard.estimators.fit import fit
from steelyard.feasibility import FeasibleSet, TieBreak, TotalMass, check, lightest_robot, verify_document
from steelyard.regression import Information
from steelyard.robot import Inertia

pytestmark = pytest.mark.data


@pytest.fixture
def require_solver():
    def require(name):
        chosen = find_solver(name)
        if not chosen.installed():
            pytest.skip(f"{chosen.title} is not installed ({chosen.remedy})")

    return require


CASES = [
    ("inertia", False, "paper (semi-physical, no friction sign)", 61648.1),
    ("inertia", True, "correct (semi-physical, fv,fc>=0)", 61700.1),
    ("full", True, "physical (pseudo-inertia, fv,fc>=0)", 62707.1),
]


@pytest.mark.parametrize("prefer", ["lightest", None])
@pytest.mark.parametrize(("consistency", "terms", "key", "squared"), CASES)
def test_fit_equals_the_independent_optimum(real_wam, shared_data, consistency, terms, key, squared, prefer):
    model, reduced = real_wam
    feasible = FeasibleSet(model, consistency, terms=terms)
    fit = fit_reduced(reduced, feasible, prefer)
    published = json.loads((shared_data / "wam7" / "iros2013_independent_optima_clarabel.json").read_text())
    assert published[key]["u"] == pytest.approx(squared, abs=0.1)
    assert fit.squared_residual == pytest.approx(published[key]["u"], rel=1e-3)
    assert not fit.attained
    assert fit.remarks[0].startswith("No optimum below 1000 kg")
    assert feasible.contains(fit.parameters)


def test_lightest_full_answer_weighs_what_the_robot_weighs(real_wam):
    """The datasheet says 27 kg; nothing in the fit knows it."""
    model, reduced = real_wam
    assert fit_reduced(reduced, FeasibleSet(model, "full")).total_mass == pytest.approx(27.0, rel=0.1)


SETS = [("inertia", False), ("inertia", True), ("full", True)]


@pytest.fixture(scope="module")
def cvxpy_optimum(real_wam):
    """The least squared residual below 27 kg, written in CVXPY from the definitions of the matrices."""
    cp = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
    model, reduced = real_wam

    def solve(consistency, terms):
        delta = cp.Variable(84)
        masses = [model.parameter_names.index(f"m{link}") for link in range(1, 8)]
        constraints = [sum(delta[i] for i in masses) <= 27.0]
        for condition in model.conditions(consistency):
            if condition.link is None and not terms:
                continue
            matrix = sum(delta[int(i)] * C for i, C in zip(condition.indices, condition.coefficients, strict=True))
            constraints.append(matrix >> 0 if condition.link else matrix >= 0)
        base = model.base_parameters().K @ delta
        # In units of the residual, around least squares, so that the solver sees small differences.
        root = np.sqrt(reduced.residual2)
        plain = np.linalg.solve(reduced.R, reduced.rho)
        problem = cp.Problem(cp.Minimize(cp.sum_squares(reduced.R / root @ (base - plain))), constraints)
        problem.solve(solver="CLARABEL", tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9)
        assert problem.status in ("optimal", "optimal_inaccurate")
        return reduced.residual2 * (1 + problem.value)

    return solve


@pytest.mark.parametrize(("consistency", "terms"), SETS)
@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
def test_mass_bound_gives_the_exact_optimum(real_wam, cvxpy_optimum, consistency, terms):
    """With default options, whatever the tie-break; by another formulation, to 1e-5."""
    model, reduced = real_wam
    feasible = FeasibleSet(model, consistency, [TotalMass(maximum=27.0)], terms=terms)
    known = TieBreak.closest(np.ones(84), np.ones(84))
    fits = [fit_reduced(reduced, feasible, prefer) for prefer in ("lightest", None, known)]
    assert all(fit.attained and fit.exact and fit.growing_links == () for fit in fits)
    residuals = [fit.squared_residual for fit in fits]
    assert residuals == pytest.approx([cvxpy_optimum(consistency, terms)] * 3, rel=1e-5)
    assert max(fit.optimality_gap for fit in fits) <= 1e-6  # measured; a solver's own word is no measure
    np.testing.assert_allclose(fits[0].base, fits[1].base, atol=1e-6)
    assert fits[0].total_mass <= 27.0


@pytest.mark.parametrize("solver", ["scs", "csdp", "dsdp", "sdpa"])
@pytest.mark.parametrize(("consistency", "terms"), SETS)
def test_other_solvers_agree_below_a_mass_bound(real_wam, require_solver, solver, consistency, terms):
    require_solver(solver)
    model, reduced = real_wam
    feasible = FeasibleSet(model, consistency, [TotalMass(maximum=27.0)], terms=terms)
    expected = fit_reduced(reduced, feasible, None)
    found = fit_reduced(reduced, feasible, None, solver=solver)
    assert feasible.contains(found.parameters)
    assert found.squared_residual == pytest.approx(expected.squared_residual, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["scs", "csdp", "dsdp", "sdpa"])
@pytest.mark.parametrize(("consistency", "terms", "key", "squared"), CASES)
def test_other_solvers_agree_without_a_bound(real_wam, require_solver, solver, consistency, terms, key, squared):
    require_solver(solver)
    if solver == "scs" and consistency == "inertia":
        pytest.skip("a first-order method takes a minute for each of these; it is tried with full consistency")
    model, reduced = real_wam
    feasible = FeasibleSet(model, consistency, terms=terms)
    found = fit_reduced(reduced, feasible, None, solver=solver)
    assert found.squared_residual == pytest.approx(squared, rel=1e-3)
    assert not found.attained
    assert feasible.contains(found.parameters)


def test_masses_at_the_shoulder_may_grow(real_wam):
    """The first three axes meet in a point; a mass there does not move, in whichever of the three links it is."""
    model, reduced = real_wam
    fit = fit_reduced(reduced, FeasibleSet(model, "full"))
    assert fit.growing_links == ("link1", "link2", "link3")
    assert not fit.exact


def test_smallest_mass_of_a_fit(real_wam):
    model, reduced = real_wam
    feasible = FeasibleSet(model, "full", [TotalMass(maximum=27.0)])
    fit = fit_reduced(reduced, feasible)
    free = FeasibleSet(model, "full")
    found = lightest_robot(free, fit.base).total
    assert found.proved <= found.attained <= fit.total_mass * (1 + 1e-6)
    # The optimum lies at the bound because more mass would fit better: hardly less can have these base parameters.
    assert found.attained == pytest.approx(27.0, rel=1e-2)
    names = [f"base {i}" for i in range(57)]
    info = Information.from_factor(reduced.R, reduced.rho, reduced.residual2, reduced.count, names)
    region = lightest_robot(free, fit.base, info=info).total
    assert region.attained < found.proved


def test_prior_from_cad(real_wam, shared_data):
    """The manufacturer's inertial parameters, with an L-curve from the data's end to the prior's."""
    model, reduced = real_wam
    cad = json.loads((shared_data / "wam7" / "wam7_cad.json").read_text())["dyn_parms_com"]
    known = np.full(84, np.nan)
    for link in range(1, 8):
        tensor = [[cad[f"sI_{link}{min(a, b)}{max(a, b)}"] for a in "xyz"] for b in "xyz"]
        com = [cad[f"r_{link}{axis}"] for axis in "xyz"]
        body = Inertia.from_com(mass=cad[f"m_{link}"], com=com, about_com=np.array(tensor)).parameters
        symbols = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")
        for symbol, value in zip(symbols, body, strict=True):
            known[model.parameter_names.index(f"{symbol}{link}")] = value
    names = [f"base {i}" for i in range(57)]
    info = Information.from_factor(reduced.R, reduced.rho, reduced.residual2, reduced.count, names)
    feasible = FeasibleSet(model, "full")
    curve = l_curve(info, feasible, EntropicPrior(known), prior_weights=np.geomspace(1e-3, 1e7, 11))
    assert np.all(np.diff(curve.squared_residuals) > 0)
    assert np.all(np.diff(curve.distances) < 0)
    assert curve.squared_residuals[0] == pytest.approx(62707.15, rel=1e-4)
    masses = curve.parameters[:, feasible.mass_indices].sum(axis=1)
    assert masses[-1] == pytest.approx(sum(cad[f"m_{link}"] for link in range(1, 8)), rel=1e-2)


def test_reduced_regression_gives_the_published_least_squares(real_wam, shared_data):
    model, reduced = real_wam
    with (shared_data / "wam7" / "base_parameters_iros2013.csv").open() as file:
        published = np.array([float(row["beta_ols_rerun_fullprec"]) for row in csv.DictReader(file)])
    np.testing.assert_allclose(np.linalg.solve(reduced.R, reduced.rho), published, rtol=1e-9)
    assert np.sqrt(reduced.residual2 / reduced.norm2) == pytest.approx(0.0561657801, abs=1e-10)
    verdict = check(FeasibleSet(model, "inertia"), base=published)
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()


def test_estimate_from_an_information(real_wam):
    model, reduced = real_wam
    names = [f"base {i}" for i in range(57)]
    info = Information.from_factor(reduced.R, reduced.rho, reduced.residual2, reduced.count, names)
    feasible = FeasibleSet(model, "full")
    estimate = fit(info, feasible)
    assert estimate.relative_error == pytest.approx(np.sqrt(62707.1 / reduced.norm2), rel=1e-3)
    np.testing.assert_allclose(feasible.K @ estimate.parameters, estimate.base, rtol=1e-12)
    assert estimate.consistency == "full"
    assert any(remark.startswith("No optimum below") for remark in estimate.remarks)
    assert verify_document(estimate.certificate)
