"""Intervals of profile likelihood: their ends against CVXPY, and how often they hold the truth."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from simulated_arm import simulated_arm

import steelyard as sy
from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, FeasibleSet, SymmetricLink, TotalMass
from steelyard.feasibility.bounds.profile_intervals import profile_intervals
from steelyard.feasibility.bounds.quantities import quantities
from steelyard.regression import ParameterCovariance

LINKS = ("link1", "link2", "link3")
BOUNDED = [TotalMass(maximum=40.0), *(CenterOfMassBox(link, [-0.5] * 3, [0.5] * 3) for link in LINKS)]


def intervals(arm, constraints=BOUNDED, names=None, confidence=0.95):
    feasible_set = FeasibleSet(arm.model, constraints=constraints)
    base = sy.least_squares(arm.information).base
    covariance = ParameterCovariance.of(arm.information, base)
    asked = quantities(feasible_set, names)
    inside = sy.fit(arm.information, feasible_set).parameters
    return asked, profile_intervals(feasible_set, base, covariance, asked, inside, confidence), covariance, feasible_set


def limit(found, covariance):
    """χ² at the ends, for noise whose size so many rows tell beside what feasible parameters leave: Fisher's F."""
    return found.chi_squared + 3.8415 * (1.0 + found.chi_squared / np.sum(covariance.correlation.independent_degrees))


def ends_by_cvxpy(feasible_set, covariance, base, chi_squared, quantity):
    """Least and largest value of a linear quantity, in a formulation of its own."""
    cp = pytest.importorskip("cvxpy")
    delta = cp.Variable(feasible_set.parameter_count)
    conditions = []
    for block in feasible_set.blocks:
        matrix = block.constant + sum(delta[int(i)] * c for i, c in zip(block.indices, block.coefficients, strict=True))
        conditions.append(matrix >> 0 if block.size > 1 else matrix >= 0)
    inverse = np.linalg.pinv(covariance.root, rcond=1e-12)
    conditions.append(cp.norm(inverse @ (feasible_set.K @ delta - base)) <= np.sqrt(chi_squared))
    values = []
    for sense in (cp.Minimize, cp.Maximize):
        problem = cp.Problem(sense(quantity.row @ delta), conditions)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that its last digits may be off
            problem.solve(solver="CLARABEL")
        values.append(float(problem.value))
    return values


@pytest.mark.slow
def test_ends_are_those_of_cvxpy() -> None:
    arm = simulated_arm(6)
    names = ["m2", "m3", "Lzz2", "lx3", "Lxy3", "Fvj1", "Fcj3", "total mass"]
    asked, found, covariance, feasible_set = intervals(arm, names=names)
    base = sy.least_squares(arm.information).base
    for quantity, lower, upper in zip(asked, found.lower, found.upper, strict=True):
        low, high = ends_by_cvxpy(feasible_set, covariance, base, limit(found, covariance), quantity)
        width = high - low
        assert low - 0.01 * width <= lower <= low + 0.01 * width, quantity.name
        assert high - 0.01 * width <= upper <= high + 0.01 * width, quantity.name


@pytest.mark.slow
def test_center_of_mass_against_bisection() -> None:
    arm = simulated_arm(6)
    asked, found, covariance, feasible_set = intervals(arm, names=["cx3", "cz2"])
    base = sy.least_squares(arm.information).base
    for quantity, lower, upper in zip(asked, found.lower, found.upper, strict=True):
        for end, sign in ((lower, -1.0), (upper, 1.0)):
            low, high = -0.5, 0.5
            for _ in range(12):
                middle = 0.5 * (low + high)
                shifted = replace(quantity, row=sign * (quantity.row - sign * middle * quantity.mass), mass=None)
                _, most = ends_by_cvxpy(feasible_set, covariance, base, limit(found, covariance), shifted)
                low, high = (middle, high) if most > 0 else (low, middle)
            assert sign * end == pytest.approx(low, abs=0.015 * (upper - lower) + 1e-3), quantity.name


def test_end_of_a_center_of_mass_whose_link_may_be_heavy() -> None:
    """At the end the link has a fifth of the mass that it has in the center of the region."""
    arm = simulated_arm(6)
    (quantity,), found, covariance, feasible_set = intervals(arm, names=["cz2"])
    base = sy.least_squares(arm.information).base
    reached, allowed = found.upper[0] - 0.06 * (found.upper[0] - found.lower[0]), found.upper[0] + 0.02
    for place, is_inside in ((reached, True), (allowed, False)):
        shifted = replace(quantity, row=quantity.row - place * quantity.mass, mass=None)
        _, most = ends_by_cvxpy(feasible_set, covariance, base, limit(found, covariance), shifted)
        assert (most > 0.0) == is_inside


def test_well_determined_parameters_have_the_interval_of_least_squares() -> None:
    """Where physics confines nothing, the interval is 1.96 standard errors on either side (Cramér and Rao)."""
    arm = simulated_arm(7, seconds=30.0)
    asked, found, covariance, _ = intervals(arm, names=["Fvj1", "Fcj1", "Foj2", "Fvj3"])
    error = np.array([np.linalg.norm(q.row @ np.linalg.pinv(arm.feasible_set.K) @ covariance.root) for q in asked])
    half = 0.5 * (found.upper - found.lower)
    assert np.all(half > 0.99 * 1.96 * error)
    assert np.all(half < 1.3 * 1.96 * error)


def test_what_nothing_bounds_is_infinite() -> None:
    arm = simulated_arm(8)
    _, found, _, _ = intervals(arm, constraints=[], names=["m1", "m3", "total mass"])
    assert found.upper[0] == found.upper[2] == np.inf  # the first link turns about a vertical axis
    assert found.lower[0] >= 0.0
    assert np.isfinite(found.upper[1])


def test_ends_beside_what_nothing_bounds() -> None:
    """A pendulum tells J = Lzz and its first moments alone, and has a mass between l² / J and infinity.

    So its centre of mass lies between the axis and J / l, where a hammer has its centre of percussion.
    """
    model = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)))
    truth = sy.Inertia.from_com(2.0, np.array([0.25, 0.0, 0.0]), np.diag([0.01, 0.1, 0.1])).parameters
    first, second = 0.5, 0.1 + 2.0 * 0.25**2
    t = np.arange(0.0, 10.0, 0.01)[:, None]
    q, dq, ddq = np.sin(2 * t) + 0.5 * t, 2 * np.cos(2 * t) + 0.5, -4 * np.sin(2 * t)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + 1e-4 * np.random.default_rng(1).standard_normal(t.shape)
    information = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    feasible_set, base = FeasibleSet(model), sy.least_squares(information).base
    asked = quantities(feasible_set)
    found = profile_intervals(feasible_set, base, ParameterCovariance.of(information, base), asked, truth)
    ends = {q.name: (low, high) for q, low, high in zip(asked, found.lower, found.upper, strict=True)}
    for name in ("Lxz1", "Lyz1", "lz1", "cz1"):
        assert ends[name] == (-np.inf, np.inf)
    assert ends["m1"] == (pytest.approx(first**2 / second, rel=0.01), np.inf)
    assert ends["cx1"] == (pytest.approx(0.0, abs=0.01), pytest.approx(second / first, rel=0.02))


def test_equations_hold_at_the_ends() -> None:
    arm = simulated_arm(9)
    constraints = [*BOUNDED, SymmetricLink("link3", "xy")]
    _, found, _, _ = intervals(arm, constraints, ["lz3", "Lxz3", "Lyz3", "m3"])
    np.testing.assert_allclose(found.lower[:3], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.upper[:3], 0.0, atol=1e-9)
    assert found.lower[3] < found.upper[3]


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    inside = []
    for seed in range(60):
        arm = simulated_arm(100 + seed, size=(0.2, 0.5, 0.8)[seed % 3])
        asked, found, _, _ = intervals(arm)
        values = np.array([q.row @ arm.truth / (1.0 if q.mass is None else q.mass @ arm.truth) for q in asked])
        inside.append((found.lower <= values) & (values <= found.upper))
    assert np.mean(inside) >= 0.93  # of a nominal 95 %: the noise lasts for some of the 1000 samples
    assert np.mean(inside, axis=0).min() > 0.8


@pytest.mark.slow
def test_intervals_of_short_logs_hold_the_truth() -> None:
    """Where physics contradicts least squares of 1.5 s, what feasible parameters leave shows that noise is larger.

    With noise as large as least squares alone leave, 92 % of them hold the truth.
    """
    inside = []
    for seed in range(60):
        arm = simulated_arm(400 + seed, seconds=1.5, size=0.5, noise=0.5)
        base = sy.least_squares(arm.information).base
        covariance = ParameterCovariance.of(arm.information, base)
        feasible_set = FeasibleSet(arm.model, constraints=BOUNDED)
        asked = quantities(feasible_set)
        found = profile_intervals(feasible_set, base, covariance, asked, arm.truth)
        if found.chi_squared > 0.3 * sum(covariance.correlation.independent_degrees):
            values = np.array([q.row @ arm.truth / (1.0 if q.mass is None else q.mass @ arm.truth) for q in asked])
            inside.append((found.lower <= values + 1e-9) & (values - 1e-9 <= found.upper))
    assert len(inside) >= 20
    assert np.mean(inside) >= 0.95


def test_torques_of_another_sign_and_hardly_any_noise_have_intervals() -> None:
    """No feasible parameters are near: χ² is 1e18, of which a double does not resolve the quantile.

    They are the feasible parameters that CVXPY finds nearest, beside which a width of the quantile is nothing. Where
    squared distances agree to 1e-5, places agree to its square root.
    """
    cp = pytest.importorskip("cvxpy")
    arm = simulated_arm(6)
    feasible_set = FeasibleSet(arm.model, constraints=BOUNDED)
    base = sy.least_squares(arm.information).base
    covariance = ParameterCovariance.of(arm.information, base)
    small = replace(covariance, root=1e-7 * covariance.root, correlation=None)
    asked = quantities(feasible_set, ["m2", "Lzz2", "Fvj1", "total mass"])
    found = profile_intervals(feasible_set, -base, small, asked, arm.truth)
    delta = cp.Variable(feasible_set.parameter_count)
    conditions = []
    for block in feasible_set.blocks:
        matrix = block.constant + sum(delta[int(i)] * c for i, c in zip(block.indices, block.coefficients, strict=True))
        conditions.append(matrix >> 0 if block.size > 1 else matrix >= 0)
    distance = cp.norm(np.linalg.pinv(covariance.root, rcond=1e-12) @ (feasible_set.K @ delta + base))
    cp.Problem(cp.Minimize(distance), conditions).solve(solver="CLARABEL")
    assert found.chi_squared == pytest.approx((1e7 * distance.value) ** 2, rel=1e-5)
    assert found.chi_squared > 1e17
    nearest = np.array([quantity.row @ delta.value for quantity in asked])
    np.testing.assert_allclose(np.array([found.lower, found.upper]), [nearest, nearest], rtol=3e-3, atol=1e-6)


def test_filtered_torques_have_no_interval() -> None:
    arm = simulated_arm(10)
    base = sy.least_squares(arm.information).base
    covariance = replace(ParameterCovariance.of(arm.information, base), filtered_torque=True)
    with pytest.raises(InputError, match="were filtered"):
        profile_intervals(arm.feasible_set, base, covariance, quantities(arm.feasible_set), arm.truth)
    with pytest.raises(InputError, match="inside the feasible set"):
        profile_intervals(
            arm.feasible_set, base, replace(covariance, filtered_torque=False), quantities(arm.feasible_set), -arm.truth
        )
