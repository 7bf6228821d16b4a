"""Robots of several links: samples of the same motion, another modelling of the problem, and many random robots."""

import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Offset, Viscous
from steelyard.feasibility import FeasibleSet, TotalMass, parameter_intervals
from steelyard.robot import Robot


def robot_of(rng, count):
    rows = [
        (
            str(rng.choice(["-pi/2", "pi/2", "0"])),
            float(rng.choice([0.0, 0.05, 0.3])),
            float(rng.choice([0.0, 0.4])),
            "q",
        )
        for _ in range(count)
    ]
    return Model(Robot.from_dh(rows).with_terms(Viscous(), Coulomb(), Offset()))


def parameters_of(model, rng, spread, point_cloud_parameters):
    """Bodies of eight points each, with masses that differ by 10 to the spread between links."""
    found = []
    for _ in model.robot.link_names:
        masses = 10.0 ** rng.uniform(-spread / 2, spread / 2) * rng.uniform(0.1, 1.0, 8)
        points = 10.0 ** rng.uniform(-1.5, -0.3) * rng.normal(size=(8, 3))
        found += [*point_cloud_parameters(masses, points), *rng.uniform(0.01, 1.0, 2), rng.normal()]
    return np.array(found)


def value_of(model, name, parameters):
    """The quantity of that name."""
    names = list(model.parameter_names)
    if name in names:
        return parameters[names.index(name)]
    masses = [parameters[names.index(f"m{i + 1}")] for i in range(len(model.robot.link_names))]
    if name == "total mass":
        return sum(masses)
    return parameters[names.index(f"l{name[1:]}")] / masses[int(name[2:]) - 1]


def lines(feasible, rng):
    """Random directions in which the base parameters stay, of all sizes."""
    directions = feasible.unidentifiable
    while True:
        yield directions @ (rng.normal(size=directions.shape[1]) * 10.0 ** rng.uniform(-3, 0, directions.shape[1]))


def length_inside(feasible, point, line):
    """How far a line from a point stays in the set, to a few percent; at most 1."""
    length = 1.0
    while length > 1e-9 and not feasible.contains(point + length * line):
        length *= 0.8
    return length if length > 1e-9 else 0.0


@pytest.mark.slow
@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_samples_lie_within(consistency, point_cloud_parameters):
    """Hit and run: from a point of the set along a random line to another one."""
    rng = np.random.default_rng(31)
    model = robot_of(rng, 3)
    point = parameters_of(model, rng, 1.0, point_cloud_parameters)
    feasible = FeasibleSet(model, consistency, [TotalMass(maximum=3 * value_of(model, "total mass", point))])
    found = parameter_intervals(feasible, feasible.K @ point)
    for _, line in zip(range(150), lines(feasible, rng), strict=False):
        point = point + rng.uniform(-length_inside(feasible, point, -line), length_inside(feasible, point, line)) * line
        for interval in found:
            value = value_of(model, interval.name, point)
            slack = 1e-9 * max(1.0, abs(value))
            assert interval.lower - slack <= value <= interval.upper + slack, interval.name


@pytest.mark.parametrize("consistency", ["full", pytest.param("inertia", marks=pytest.mark.slow)])
def test_agrees_with_another_modelling(consistency, point_cloud_parameters):
    """The same bounds from CVXPY, in standard parameters, unscaled."""
    cvxpy = pytest.importorskip("cvxpy", reason="needs CVXPY (pip install cvxpy)")
    rng = np.random.default_rng(32)
    model = robot_of(rng, 3)
    truth = parameters_of(model, rng, 0.0, point_cloud_parameters)
    feasible = FeasibleSet(model, consistency, [TotalMass(maximum=2 * value_of(model, "total mass", truth))])
    base = feasible.K @ truth
    names = ["m1", "m2", "m3", "ly2", "Lxx3", "Lzz1", "lz3", "total mass"]
    found = parameter_intervals(feasible, base, names=names)
    delta = cvxpy.Variable(len(truth))
    conditions = [feasible.K @ delta == base]
    for block in feasible.blocks:
        terms = [delta[int(i)] * D for i, D in zip(block.indices, block.coefficients, strict=True)]
        matrix = block.constant + sum(terms[1:], terms[0])
        conditions.append(matrix >> 0 if block.size > 1 else matrix >= 0)
    index = list(model.parameter_names).index
    weights = cvxpy.Parameter(len(truth))
    problem = cvxpy.Problem(cvxpy.Minimize(weights @ delta), conditions)  # which CVXPY translates once
    for name in names:
        weights.value = np.zeros(len(truth))
        weights.value[[index(f"m{i}") for i in (1, 2, 3)] if name == "total mass" else index(name)] = 1.0
        low = problem.solve(solver=cvxpy.CLARABEL)
        weights.value = -weights.value
        high = -problem.solve(solver=cvxpy.CLARABEL)
        if not np.isfinite(low) or abs(low) > 1e3:
            low = -np.inf
        if not np.isfinite(high) or abs(high) > 1e3:
            high = np.inf
        assert (found[name].lower, found[name].upper) == pytest.approx((low, high), rel=1e-3, abs=2e-4), name


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(s, marks=pytest.mark.slow) for s in range(4, 8))])
def test_truth_lies_within_and_ends_are_attained(seed, point_cloud_parameters):
    check_a_robot(seed, 1 + seed % 4, point_cloud_parameters)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 116))
def test_truth_lies_within_and_ends_are_attained_by_larger_robots(seed, point_cloud_parameters):
    check_a_robot(seed, 1 + seed % 8, point_cloud_parameters)


def check_a_robot(seed, count, point_cloud_parameters):
    """Links up to a million times heavier than others; with and without a bound on the mass."""
    rng = np.random.default_rng(seed)
    model = robot_of(rng, count)
    truth = parameters_of(model, rng, float(rng.choice([0, 3, 6])), point_cloud_parameters)
    total = value_of(model, "total mass", truth)
    constraints = [TotalMass(maximum=2 * total)] if rng.random() < 0.5 else []
    feasible = FeasibleSet(model, str(rng.choice(["full", "inertia"])), constraints)
    base = feasible.K @ truth
    found = parameter_intervals(feasible, base)
    size = float(np.abs(truth).max())
    gaps = []
    for interval in found:
        value = value_of(model, interval.name, truth)
        slack = 1e-9 * max(abs(value), 1e-3 * size)
        assert interval.lower - slack <= value <= interval.upper + slack, interval.name
        if interval.bounded and not interval.identifiable:
            gaps.append(interval.tolerance / interval.width)
        for parameters, end in (
            (interval.lower_parameters, interval.attained_lower),
            (interval.upper_parameters, interval.attained_upper),
        ):
            if parameters is not None:
                assert np.all(feasible.stack.smallest_eigenvalues(parameters) > -1e-12 * np.abs(parameters).max())
                np.testing.assert_allclose(feasible.K @ parameters, base, atol=1e-9 * np.abs(parameters).max())
                assert end == pytest.approx(value_of(model, interval.name, parameters), rel=1e-9, abs=1e-9 * size)
    # What is proved is nearly attained, save for ends that are approached slowly as masses grow.
    assert not gaps or np.median(gaps) < 1e-3
    if constraints:
        assert found["total mass"].upper == pytest.approx(2 * total, rel=1e-5)
