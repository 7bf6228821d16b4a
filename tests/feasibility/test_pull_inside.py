import numpy as np
import pytest

from steelyard.feasibility import FeasibleSet


def test_point_on_the_line_keeps_half_the_margin(two_links, point_cloud_parameters):
    rng = np.random.default_rng(30)
    inside = np.ones(22)
    inside[:10] = inside[11:21] = point_cloud_parameters(np.ones(8), rng.normal(size=(8, 3)))
    outside = inside.copy()
    outside[10] = -1.0  # friction from 1 to -1: the margin is reached at (1 - ε / 2) / 2
    feasible = FeasibleSet(two_links, margin=1e-3)
    found = feasible.pull_inside(outside, inside)
    assert found[10] == pytest.approx(0.5e-3, abs=1e-8)
    assert feasible.contains(found)
    np.testing.assert_allclose(np.delete(found, 10), np.delete(inside, 10), rtol=1e-12)
