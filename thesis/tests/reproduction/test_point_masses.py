"""Section 6.3.1: the regression of the links alone, and what the methods pay."""

import numpy as np
import pytest

import steelyard as sy
from steelyard_thesis.reproduction.section import Context
from steelyard_thesis.reproduction.sections.point_masses import SECTION, links_alone

ROWS = [("-pi/2", 0.0, 0.3, "q"), ("pi/2", 0.1, 0.4, "q"), ("0", 0.5, 0.0, "q")]


def test_links_alone_leave_the_rest_to_the_residual():
    """As if the model had never had friction."""
    random = np.random.default_rng(2)
    robot = sy.Robot.from_dh(ROWS)
    whole, links = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb())), sy.Model(robot)
    q, dq, ddq, torque = random.normal(size=(4, 300, 3))
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque + dq)
    reduced = sy.Information.from_samples(whole, samples).reduced(None)
    joined = sy.Information.from_factor(
        reduced.R, reduced.rho, reduced.residual2, reduced.count, whole.base_parameters().names
    )
    ours = sy.least_squares(links_alone(joined, links))
    direct = sy.least_squares(sy.Information.from_samples(links, samples), weights=None)
    np.testing.assert_allclose(ours.base, direct.base, rtol=1e-9)
    assert ours.relative_error == pytest.approx(direct.relative_error, rel=1e-10)
    assert ours.relative_error > sy.least_squares(joined).relative_error


def paid(result, arm):
    """Weighted error by method."""
    (table,) = result.tables
    return {row[0]: row[5] for row in table.rows if row[1] == arm}, {row[0]: row[7] for row in table.rows}


@pytest.mark.slow
def test_order_of_the_methods_is_that_of_table_6_2():
    result = SECTION.compute(Context())
    errors, verdicts = paid(result, "simulated")
    assert errors["WLS"] < errors["LMI-SDP"] < errors["point-mass (Ayusawa)"]
    assert (verdicts["WLS"], verdicts["LMI-SDP"], verdicts["point-mass (Ayusawa)"]) == (
        "infeasible",
        "feasible",
        "feasible",
    )
    assert result.comparisons == ()  # the recordings are not public


@pytest.mark.data
@pytest.mark.slow
def test_the_real_arm_too(shared_data):
    errors, _ = paid(SECTION.compute(Context(shared_data)), "real (2013)")
    data = np.load(shared_data / "wam7" / "iros2013_reduced_regression.npz", allow_pickle=False)
    links = [k for k, text in enumerate(data["base_expressions"]) if not str(text).startswith(("fv", "fc"))]
    _, squared, *_ = np.linalg.lstsq(data["R1"][:, links], data["rho1"], rcond=None)
    expected = np.sqrt((squared[0] + data["rho2_norm_sqr"]) / data["omega_norm_sqr"])
    assert errors["WLS"] == pytest.approx(100.0 * float(expected), rel=1e-9)
    assert errors["WLS"] < errors["LMI-SDP"] < errors["point-mass (Ayusawa)"]
