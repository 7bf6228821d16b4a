"""Intervals of confidence regions, against closed forms and nonlinear programming."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from scipy.linalg import matmul_toeplitz
from scipy.signal import lfilter

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, FeasibleSet, lightest_robot, parameter_intervals
from steelyard.recording import Samples
from steelyard.regression import Information, ParameterCovariance
from steelyard.robot import Robot

# The arm of two parallel axes shows a = Lzz1 + m2 and b = Lzz2, lx2, ly2: (lx2² + ly2²) / b ≤ m2 ≤ a.
ARM = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
SQUARE = 0.25


@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_one_uncertain_parameter(two_links, confidence):
    """The region is an interval of b, by the normal distribution."""
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 0.02**2
    found = parameter_intervals(
        FeasibleSet(two_links), ARM, covariance=covariance, confidence=confidence, names=["m2", "Lzz2", "cx2", "lx2"]
    )
    half = 0.02 * scipy.stats.norm.ppf(0.5 + confidence / 2)
    assert (found["m2"].lower, found["m2"].upper) == pytest.approx((SQUARE / (0.25 + half), 1.5), rel=1e-6)
    assert (found["Lzz2"].lower, found["Lzz2"].upper) == pytest.approx((0.25 - half, 0.25 + half), rel=1e-6)
    assert (found["cx2"].lower, found["cx2"].upper) == pytest.approx(
        (0.3 / 1.5, 0.3 * (0.25 + half) / SQUARE), rel=1e-6
    )
    assert found["lx2"].identifiable
    assert found.confidence == confidence


@pytest.mark.parametrize("consistency", ["full", pytest.param("inertia", marks=pytest.mark.slow)])
def test_whole_region_agrees_with_nonlinear_programming(two_links, consistency):
    """The least m2 is that of (lx² + ly²) / b over the ellipsoid, the largest that of a, both with friction ≥ 0."""
    rng = np.random.default_rng(21)
    factor = 0.03 * rng.normal(size=(6, 6))
    covariance = factor @ factor.T
    found = parameter_intervals(FeasibleSet(two_links, consistency), ARM, covariance=covariance, names=["m2", "Fvj1"])
    radius = np.sqrt(scipy.stats.chi2.ppf(0.95, 6))

    def base(u):
        return ARM + factor @ u

    # The friction of both joints must not be negative.
    conditions = [
        {"type": "ineq", "fun": lambda u: radius**2 - u @ u},
        {"type": "ineq", "fun": lambda u: base(u)[[1, 5]]},
        {"type": "ineq", "fun": lambda u: base(u)[0] * base(u)[2] - base(u)[3] ** 2 - base(u)[4] ** 2},
    ]

    def least(objective):
        runs = [
            scipy.optimize.minimize(
                objective, start, constraints=conditions, method="SLSQP", options={"ftol": 1e-14, "maxiter": 500}
            )
            for start in (np.zeros(6), 0.1 * rng.normal(size=6))
        ]
        return min(run.fun for run in runs if run.success)

    expected = least(lambda u: (base(u)[3] ** 2 + base(u)[4] ** 2) / base(u)[2])
    assert found["m2"].lower == pytest.approx(expected, rel=1e-5)
    assert found["m2"].upper == pytest.approx(-least(lambda u: -base(u)[0]), rel=1e-5)
    assert found["Fvj1"].lower == pytest.approx(max(0.0, least(lambda u: base(u)[1])), abs=1e-6)
    assert found["Fvj1"].upper == pytest.approx(-least(lambda u: -base(u)[1]), rel=1e-5)


def test_infeasible_estimate_with_a_region_that_reaches_the_set(two_links):
    """b = -0.01 ± 0.05 is impossible, but b may be up to 0.11."""
    base = np.array([1.5, 0.1, -0.01, 0.1, 0.0, 0.1])
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 0.05**2
    found = parameter_intervals(FeasibleSet(two_links), base, covariance=covariance, names=["m2", "Lzz2"])
    most = -0.01 + 0.05 * scipy.stats.norm.ppf(0.975)
    assert (found["m2"].lower, found["m2"].upper) == pytest.approx((0.01 / most, 1.5), rel=1e-5)
    assert (found["Lzz2"].lower, found["Lzz2"].upper) == pytest.approx((0.01 / 1.5, most), rel=1e-5)
    # b ≥ 0.01 / 1.5 is (0.01 + 0.01 / 1.5) / 0.05 standard deviations away.
    assert found.distance == pytest.approx((0.01 + 0.01 / 1.5) / 0.05 / scipy.stats.norm.ppf(0.975), rel=1e-3)
    assert "The estimate itself is infeasible" in str(found)


def test_region_that_does_not_reach_the_set(two_links):
    base = np.array([1.5, 0.1, -1.0, 0.0, 0.0, 0.1])
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 0.1**2
    feasible = FeasibleSet(two_links)
    with pytest.raises(
        InputError, match=r"95 % region .* 5.1 times as far away .* covariance= .* least 27 times as large"
    ):
        parameter_intervals(feasible, base, covariance=covariance)
    wider = parameter_intervals(feasible, base, covariance=5.2**2 * covariance, names=["Lzz2"])["Lzz2"]
    assert wider.upper == pytest.approx(-1.0 + 0.52 * scipy.stats.norm.ppf(0.975), rel=1e-5)


@pytest.fixture
def data(two_links):
    """A regression with known noise, of the arm above."""
    rng = np.random.default_rng(22)
    W = rng.normal(size=(500, 6))
    torque = W @ ARM + 0.05 * rng.normal(size=500)
    base = np.linalg.lstsq(W, torque)[0]
    error = torque - W @ base
    Q, R = np.linalg.qr(W)
    names = [f"base {i}" for i in range(6)]
    info = Information.from_factor(R, Q.T @ torque, float(error @ error), 500, names)
    return info, base, float(error @ error) / 494 * np.linalg.inv(W.T @ W)


def test_data_gives_the_covariance_of_least_squares(two_links, data):
    info, base, covariance = data
    feasible = FeasibleSet(two_links)
    names = ["m2", "cx2", "total mass"]
    by_data = parameter_intervals(feasible, info=info, names=names)
    by_covariance = parameter_intervals(feasible, base, covariance=covariance, names=names)
    np.testing.assert_allclose(by_data.base, base, rtol=1e-9)
    for one, other in zip(by_data, by_covariance, strict=True):
        assert (one.lower, one.upper) == pytest.approx((other.lower, other.upper), rel=1e-5)
    assert by_data["m2"].lower < SQUARE / 0.25 < by_data["m2"].upper
    tight = parameter_intervals(feasible, info=info, names=["m2"], confidence=0.5)["m2"]
    assert by_data["m2"].lower < tight.lower < tight.upper < by_data["m2"].upper


def test_regions_reckon_with_noise_that_lasts():
    """A pendulum under first-order autoregressive noise: its mass as with the exact covariance of least squares."""
    model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    t = np.arange(20000)[:, None] / 500
    q, dq, ddq = np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)
    truth = np.array([0, 0, 0, 0, 0, 0.5, 0.8, 0.1, 0, 1.6])
    noise = 0.1 * np.random.default_rng(3).normal(size=t.shape)
    keep = 0.95
    torque = model.inverse_dynamics(q, dq, ddq, truth) + lfilter([np.sqrt(1 - keep**2)], [1, -keep], noise, axis=0)
    info = Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    W = model.regressor(q, dq, ddq)[:, 0][:, model.base_parameters().independent]
    inverse = np.linalg.inv(W.T @ W)
    spread = np.column_stack([matmul_toeplitz(keep ** np.arange(len(t)), column) for column in W.T])
    exact = 0.1**2 * inverse @ (W.T @ spread) @ inverse
    feasible = FeasibleSet(model)
    found = parameter_intervals(feasible, info=info, names=["Lzz1", "m1"])
    expected = parameter_intervals(feasible, found.base, covariance=exact, names=["Lzz1", "m1"])
    assert found["Lzz1"].upper - found["Lzz1"].lower == pytest.approx(
        expected["Lzz1"].upper - expected["Lzz1"].lower, rel=0.3
    )
    by_object = parameter_intervals(feasible, found.base, covariance=ParameterCovariance.of(info), names=["m1"])
    assert by_object["m1"].lower == pytest.approx(found["m1"].lower, rel=1e-6)


def test_no_region_is_told_of_filtered_torques(two_links, data):
    info, _, _ = data
    filtered = replace(info, filtered_torque=True)
    with pytest.raises(InputError, match="torques of this data were filtered"):
        parameter_intervals(FeasibleSet(two_links), info=filtered)


def test_what_the_data_does_not_determine_is_left_to_physics(two_links, reduced_regression):
    """Without any data of a, nothing bounds m2 from above; of b alone, (lx² + ly²) / b stays."""
    R = np.diag([0.0, 1e4, 1e4, 1e4, 1e4, 1e4])
    reduced = reduced_regression(R, R @ ARM, 1e-6, 1006, 1.0)
    found = parameter_intervals(FeasibleSet(two_links), info=reduced, names=["m2", "Lzz1"])
    assert found["m2"].upper == np.inf
    assert found["m2"].lower == pytest.approx(SQUARE / 0.25, rel=1e-3)
    assert found["Lzz1"].upper == np.inf


@pytest.mark.slow
def test_attained_ends_lie_in_the_region_and_in_the_set(two_links, data):
    info, base, covariance = data
    feasible = FeasibleSet(two_links)
    radius = scipy.stats.chi2.ppf(0.95, 6)
    for interval in parameter_intervals(feasible, info=info):
        for parameters in (interval.lower_parameters, interval.upper_parameters):
            if parameters is not None:
                change = feasible.K @ parameters - base
                assert feasible.contains(parameters)
                assert change @ np.linalg.solve(covariance, change) <= radius * (1 + 1e-6)


@pytest.mark.parametrize("error", [0.046, 0.049, 0.05, 0.053, 0.057, 0.07])
def test_centre_of_mass_of_a_link_that_may_be_massless_is_open(two_links, error):
    """Where m2 may vanish, its centre of mass may be anywhere, on every processor."""
    base = np.array([1.5, 0.1, 0.05, 0.02, 0.0, 0.1])
    found = parameter_intervals(FeasibleSet(two_links), base, covariance=error**2 * np.eye(6), names=["m2", "cx2"])
    assert found["m2"].lower == pytest.approx(0.0, abs=1e-6)
    assert (found["cx2"].lower, found["cx2"].upper) == (-np.inf, np.inf)


def test_a_box_bounds_the_centre_of_mass_of_a_link_that_may_be_massless(two_links):
    base = np.array([1.5, 0.1, 0.05, 0.02, 0.0, 0.1])
    feasible = FeasibleSet(two_links, constraints=[CenterOfMassBox("forearm", [-3.0, -0.2, -0.2], [2.0, 0.2, 0.2])])
    found = parameter_intervals(feasible, base, covariance=0.05**2 * np.eye(6), names=["m2", "cx2"])
    assert found["m2"].lower == pytest.approx(0.0, abs=1e-6)
    assert (found["cx2"].lower, found["cx2"].upper) == pytest.approx((-3.0, 2.0), rel=1e-4)


@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_lightest_arm(two_links, consistency):
    feasible = FeasibleSet(two_links, consistency)
    found = lightest_robot(feasible, ARM)
    assert found.total.proved == pytest.approx(1.0, rel=1e-6)
    assert found.total.attained == pytest.approx(1.0, rel=1e-6)
    assert [least.attained for least in found.links] == pytest.approx([0.0, 1.0], abs=1e-6)
    assert feasible.contains(found.parameters)
    np.testing.assert_allclose(feasible.K @ found.parameters, ARM, atol=1e-9)
    assert str(found).startswith("The lightest robot with these base parameters weighs 1 kg")
    assert "forearm" in found._repr_html_()
    assert found.to_dict()["total"]["attained"] == found.total.attained


def test_lightest_arm_of_a_region(two_links):
    covariance = np.zeros((6, 6))
    covariance[2, 2] = 0.02**2
    found = lightest_robot(FeasibleSet(two_links), ARM, covariance=covariance)
    expected = SQUARE / (0.25 + 0.02 * scipy.stats.norm.ppf(0.975))
    assert found.total.attained == pytest.approx(expected, rel=1e-5)
    assert "95 % region" in found.sentences()[0]
