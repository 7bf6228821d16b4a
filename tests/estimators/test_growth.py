"""Which masses may grow without end, against what mechanics says of it."""

import numpy as np
import pytest

from steelyard.dynamics import Model
from steelyard.feasibility import FeasibleSet, TotalMass
from steelyard.feasibility.growth import growing_links
from steelyard.robot import Robot


@pytest.mark.parametrize("consistency", ["inertia", "full"])
@pytest.mark.parametrize(
    ("rows", "growing"),
    [
        # The first link of a robot on a floor only turns: a mass on its axis does not show, and may be any.
        ([("0", 0.3, 0.0, "q")], (0,)),
        ([("pi/2", 0.3, 0.0, "q"), ("0", 0.4, 0.0, "q")], (0,)),
        # Axes that meet in a point: a mass there never moves, in either link.
        ([("pi/2", 0.0, 0.0, "q"), ("0", 0.4, 0.0, "q")], (0, 1)),
        ([("-pi/2", 0, 0, "q"), ("pi/2", 0, 0, "q"), ("0", 0, 0, "q")], (0, 1, 2)),
        # Parallel axes apart, and a slide: every kilogram of the second link moves.
        ([("0", 0.3, 0.0, "q"), ("0", 0.4, 0.0, "q")], (0,)),
        ([("0", 0.0, "q", "0"), ("0", 0.4, 0.0, "q")], ()),
    ],
)
@pytest.mark.parametrize("size", [1e-2, 1.0, 1e2])
def test_masses_that_never_move_may_grow(consistency, rows, growing, size):
    scaled = [(alpha, a * size, d if isinstance(d, str) else d * size, theta) for alpha, a, d, theta in rows]
    feasible = FeasibleSet(Model(Robot.from_dh(scaled)), consistency)
    assert growing_links(feasible) == growing


def test_constraints_stop_growth(two_links):
    assert growing_links(FeasibleSet(two_links)) == (0,)
    assert growing_links(FeasibleSet(two_links, constraints=[TotalMass(maximum=3.0)])) == ()
    assert growing_links(FeasibleSet(two_links, constraints=[TotalMass(equal=3.0)])) == ()
    assert growing_links(FeasibleSet(two_links, constraints=[TotalMass(maximum=3.0, links=["upper arm"])])) == ()
    assert growing_links(FeasibleSet(two_links, constraints=[TotalMass(maximum=3.0, links=["forearm"])])) == (0,)


def test_what_the_data_does_not_show_may_grow(two_links):
    """Without Lzz1 + m2, nothing tells the mass of the forearm; without anything of joint 1, either."""
    feasible = FeasibleSet(two_links)
    assert growing_links(feasible, np.eye(6)[:, :1]) == (0, 1)
    assert growing_links(feasible, np.eye(6)[:, 4:5]) == (0,)
