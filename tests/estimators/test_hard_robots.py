"""Links of grams beside links of kilograms, of centimetres beside metres: solvers shall have no trouble."""

import pytest

from steelyard.estimators import fit_reduced
from steelyard.feasibility import FeasibilityCertificate, FeasibleSet, TotalMass

FAMILIES = {
    "masses to 1e3, lengths to 10": ((0.05, 50.0), (0.05, 0.5)),
    "masses to 1e3, lengths to 100": ((0.05, 50.0), (0.05, 5.0)),
    "grams": ((1e-3, 1e-2), (0.05, 0.15)),
    "tens of micrograms to tens of milligrams": ((1e-8, 1e-5), (0.01, 0.03)),
}


def worst_status(make, family, consistency, bounded, seeds, links):
    masses, lengths = FAMILIES[family]
    solved = 0
    for seed in seeds:
        model, truth, info = make(seed, links[seed % len(links)], masses, lengths, noise=0.1)
        total = float(truth[FeasibleSet(model).mass_indices].sum())
        feasible = FeasibleSet(model, consistency, [TotalMass(maximum=1.1 * total)] if bounded else [])
        fit = fit_reduced(info.reduced("joint"), feasible)
        assert FeasibilityCertificate(feasible, fit.base, fit.parameters).verify()
        solved += set(fit.statuses) <= {"Solved"}
    return solved


@pytest.mark.parametrize("bounded", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("family", FAMILIES)
def test_solver_is_content(random_arm, family, bounded):
    assert worst_status(random_arm, family, "full", bounded, range(1), links=(4,)) == 1


@pytest.mark.slow
@pytest.mark.parametrize(("bounded", "consistency"), [(False, "full"), (True, "inertia")])
@pytest.mark.parametrize("family", FAMILIES)
def test_solver_is_content_with_up_to_twenty_links(random_arm, family, bounded, consistency):
    """A plain "Solved" of every problem in at least 9 of 10 fits."""
    assert worst_status(random_arm, family, consistency, bounded, range(10), links=(1, 3, 7, 12, 20)) >= 9
