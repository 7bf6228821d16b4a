"""The least mass of a robot: closed forms, truths of simulated robots, and base parameters of a single robot."""

import numpy as np
import pytest
import scipy.stats

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, TotalMass, lightest_robot
from steelyard.regression import Information
from steelyard.robot import Robot

GOOD = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])
NAMES = [f"b{i}" for i in range(6)]


def test_forearm_needs_mass_for_its_first_moment(two_links):
    """l² ≤ m Lzz about the axis: at least (0.3² + 0.4²) / 0.25 = 1 kg; the upper arm needs none."""
    found = lightest_robot(FeasibleSet(two_links), GOOD).total
    assert found.proved <= 1.0 <= found.attained
    assert found.attained == pytest.approx(1.0, rel=1e-6)
    assert str(found) == "The mass of all links is at least 1 kg."


def test_confidence_region_lets_it_be_lighter(two_links):
    """Where only Lzz2 is uncertain, it may be as large as the region allows."""
    R = np.diag([1e6, 1e6, 10.0, 1e6, 1e6, 1e6])
    info = Information.from_factor(R, R @ GOOD, 0.5, 106, NAMES)
    found = lightest_robot(FeasibleSet(two_links), info=info, confidence=0.9)
    variance = 0.5 / 100
    reach = np.sqrt(variance * scipy.stats.chi2.ppf(0.9, 6)) / 10.0
    assert found.total.attained == pytest.approx(0.25 / (0.25 + reach), rel=1e-4)
    assert "in the 90 % region" in str(found)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))])
def test_no_robot_is_lighter_than_its_least_mass(point_cloud_parameters, seed):
    random = np.random.default_rng(seed)
    table = [(str(random.choice(["-pi/2", "pi/2", "0"])), *random.uniform(0.0, 0.5, 2).tolist(), "q") for _ in range(4)]
    feasible = FeasibleSet(Model(Robot.from_dh(table)))
    bodies = [point_cloud_parameters(random.uniform(0.1, 0.5, 8), random.normal(0.2, 0.1, (8, 3))) for _ in table]
    truth = np.concatenate(bodies)
    base, mass = feasible.K @ truth, float(truth[feasible.mass_indices].sum())
    exact = lightest_robot(feasible, base).total
    assert 0 < exact.proved <= mass
    region = lightest_robot(feasible, base, covariance=np.diag((0.01 * np.abs(base) + 1e-4) ** 2)).total
    assert region.proved < exact.proved


@pytest.mark.parametrize("limit", [{"maximum": 2.0}, {"equal": 2.0}])
def test_single_robot_on_the_boundary_has_its_mass(limit):
    """Moments that need (lx² + ly²) / Lzz = 2 kg, and no more than that: one point mass, and no room to search in."""
    pendulum = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    found = lightest_robot(FeasibleSet(pendulum, constraints=[TotalMass(**limit)]), [0.5, 1.0, 0.0])
    for least in (found.total, *found.links):
        assert least.attained == pytest.approx(2.0, rel=1e-7)
        assert 2.0 * (1 - 1e-6) < least.proved <= 2.0


def test_impossible_base_parameters_have_no_mass(two_links):
    feasible = FeasibleSet(two_links)
    bad = GOOD.copy()
    bad[0] = 0.5
    with pytest.raises(InputError, match="no physically possible robot has these base parameters"):
        lightest_robot(feasible, bad)
    with pytest.raises(InputError, match="neither base= nor info= was given"):
        lightest_robot(feasible)
    info = Information.from_factor(np.eye(6), GOOD, 0.5, 106, NAMES)
    with pytest.raises(InputError, match=r"a probability between 0 and 1, such as 0\.95, got 95"):
        lightest_robot(feasible, info=info, confidence=95)
