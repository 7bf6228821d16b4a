"""The real WAM's reduced regression as an Information: least squares and constrained fits as published."""

import json

import numpy as np
import pytest

import steelyard as sy

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def real(shared_data):
    """The 84-parameter model (links, viscous and Coulomb friction) and the reduced data of the real arm."""
    rows = json.loads((shared_data / "wam7" / "dh.json").read_text())["rows"]
    model = sy.Model(sy.Robot.from_dh(rows, name="wam").with_terms(sy.Viscous(), sy.Coulomb()))
    data = np.load(shared_data / "wam7" / "iros2013_reduced_regression.npz")
    base = model.base_parameters()
    assert base.count == len(data["base_expressions"]) == 57
    information = sy.Information.from_factor(
        data["R1"], data["rho1"], float(data["rho2_norm_sqr"]), int(data["n_rows"]), base.names
    )
    return model, information


def squared_residual(information, base):
    problem = information.reduced(None)
    return float(np.sum((problem.R @ base - problem.rho) ** 2) + problem.residual2)


@pytest.mark.parametrize(
    ("consistency", "terms", "published"),
    [("inertia", False, 61648.1), ("inertia", True, 61700.1), ("full", True, 62707.1)],
)
def test_constrained_fits_are_the_independent_optima(real, consistency, terms, published):
    model, information = real
    estimate = sy.fit(information, sy.FeasibleSet(model, consistency, terms=terms), weights=None)
    assert squared_residual(information, estimate.base) == pytest.approx(published, rel=1e-3)
    assert any("No optimum below" in remark for remark in estimate.remarks)
    np.testing.assert_allclose(model.base_parameters().K @ estimate.parameters, estimate.base, atol=1e-9)


def test_least_squares_and_relative_error(real):
    _, information = real
    estimate = sy.least_squares(information)
    assert estimate.relative_error == pytest.approx(0.0561657801, abs=1e-10)
    assert squared_residual(information, estimate.base) == pytest.approx(59172.924155077424, rel=1e-12)
