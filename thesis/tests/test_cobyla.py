"""The thesis's search for an excitation, beside the product's."""

import pytest

import steelyard as sy
from steelyard.excitation import SearchOptions
from steelyard_thesis import minimise_with_cobyla

QUICK = {
    "harmonics": 3,
    "period": 5.0,
}


@pytest.mark.slow
def test_cobyla_designs_too_but_not_as_well():
    robot = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.4, 0, "q + pi/2")], name="arm")
    arm = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia()))
    limits = {"lower": [-2.0, -1.5, -1.0], "upper": [2.0, 1.0, 2.0], "velocity": 1.5, "acceleration": [8.0, 9.0, 10.0]}
    ours = sy.design_excitation(arm, limits, search=SearchOptions(starts=2, workers=1), **QUICK)
    search = SearchOptions(starts=2, workers=1, minimiser=minimise_with_cobyla, time_limit=2.0)
    theirs = sy.design_excitation(arm, limits, search=search, **QUICK)
    assert theirs.margins[0].clearance >= 0.0
    assert ours.condition_number < theirs.condition_number
