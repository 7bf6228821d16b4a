"""Robots of one to seven links, with links up to a thousand times heavier than others."""

import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.feasibility import FeasibleSet, check, correct
from steelyard.robot import Robot


def random_robot(rng, count):
    rows = [
        (str(rng.choice(["-pi/2", "pi/2", "0"])), float(rng.uniform(0, 0.5)), float(rng.uniform(0, 0.5)), "q")
        for _ in range(count)
    ]
    return Model(Robot.from_dh(rows).with_terms(Viscous(), Coulomb()))


@pytest.mark.parametrize("consistency", ["inertia", "full"])
@pytest.mark.parametrize("count", [2, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 3, 4, 5, 6, 7))])
def test_real_robots_are_feasible_and_verdicts_agree_with_corrections(count, consistency, point_cloud_parameters):
    rng = np.random.default_rng(100 + count)
    model = random_robot(rng, count)
    feasible = FeasibleSet(model, consistency)
    for _ in range(3):
        delta = []
        for _ in range(count):
            masses = 10.0 ** rng.uniform(-1.5, 1.5) * rng.uniform(0.1, 1.0, 8)
            delta += [*point_cloud_parameters(masses, 10.0 ** rng.uniform(-1.5, 0) * rng.normal(size=(8, 3)))]
            delta += [*rng.uniform(0.01, 1.0, 2)]
        base = feasible.K @ np.array(delta)
        verdict = check(feasible, base=base)
        assert verdict.feasible is True
        np.testing.assert_allclose(feasible.K @ verdict.parameters, base, rtol=1e-9, atol=1e-11 * np.abs(base).max())
        assert correct(feasible, base=base).squared_distance <= 1e-12 * float(base @ base)

        disturbed = base + 0.3 * np.abs(base).max() * rng.normal(size=len(base))
        verdict = check(feasible, base=disturbed)
        correction = correct(feasible, base=disturbed)
        assert verdict.certificate.verify()
        assert feasible.contains(correction.parameters)
        assert verdict.feasible == (correction.squared_distance <= 1e-9 * float(disturbed @ disturbed))
