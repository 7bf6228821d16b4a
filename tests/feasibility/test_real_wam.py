"""The real WAM: constrained fits against optima found by others, from its reduced regression."""

import csv
import json

import numpy as np
import pytest

from steelyard.feasibility import FeasibleSet, TotalMass, check, fit, fit_reduced
from steelyard.regression import Information

pytestmark = pytest.mark.data

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


def test_mass_bound_makes_it_well_posed(real_wam):
    model, reduced = real_wam
    fits = [
        fit_reduced(
            reduced, FeasibleSet(model, "full", [TotalMass(maximum=27.0)], margin=margin), prefer, tolerance=0.0
        )
        for prefer in ("lightest", None)
        for margin in (1e-6, 1e-7)
    ]
    assert all(fit.attained for fit in fits)
    residuals = [fit.squared_residual for fit in fits]
    assert max(residuals) / min(residuals) - 1 < 1e-5


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
    assert estimate.certificate["parameters"] == estimate.parameters.tolist()
