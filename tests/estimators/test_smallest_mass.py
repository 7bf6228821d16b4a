import numpy as np
import pytest
import scipy.stats

from steelyard.errors import InputError
from steelyard.estimators import smallest_total_mass
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Information

GOOD = np.array([1.5, 0.1, 0.25, 0.3, 0.4, 0.1])


def test_forearm_needs_mass_for_its_first_moment(two_links):
    """l² ≤ m Lzz about the axis: at least (0.3² + 0.4²) / 0.25 = 1 kg; the upper arm needs none."""
    found = smallest_total_mass(FeasibleSet(two_links), base=GOOD)
    assert found.mass == pytest.approx(1.0, rel=1e-6)
    assert str(found) == "No robot lighter than 1 kg has these base parameters."
    np.testing.assert_allclose(found.base, GOOD, atol=1e-9)


def test_confidence_region_lets_it_be_lighter(two_links):
    """Where only Lzz2 is uncertain, it may be as large as the region allows."""
    names = [f"b{i}" for i in range(6)]
    R = np.diag([1e6, 1e6, 10.0, 1e6, 1e6, 1e6])
    info = Information.from_factor(R, R @ GOOD, 0.5, 106, names)
    found = smallest_total_mass(FeasibleSet(two_links), information=info, confidence=0.9)
    variance = 0.5 / 100
    reach = np.sqrt(variance * scipy.stats.chi2.ppf(0.9, 6)) / 10.0
    assert found.mass == pytest.approx(0.25 / (0.25 + reach), rel=1e-4)
    assert "within the 0.9 confidence region" in str(found)
    assert smallest_total_mass(FeasibleSet(two_links), information=info).mass == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_no_robot_is_lighter_than_its_smallest_mass(random_arm, seed):
    model, truth, info = random_arm(seed, 4, (0.1, 5.0), (0.1, 0.5), noise=0.05)
    feasible = FeasibleSet(model)
    real = float(truth[feasible.mass_indices].sum())
    exact = smallest_total_mass(feasible, base=feasible.K @ truth).mass
    assert 0 < exact <= real * (1 + 1e-6)
    region = smallest_total_mass(feasible, base=feasible.K @ truth, information=info, confidence=0.99).mass
    assert region <= exact * (1 + 1e-6)


def test_impossible_base_parameters_have_no_mass(two_links):
    feasible = FeasibleSet(two_links)
    bad = GOOD.copy()
    bad[0] = 0.5
    with pytest.raises(InputError, match="no physically possible robot with these base parameters, however heavy"):
        smallest_total_mass(feasible, base=bad)
    with pytest.raises(InputError, match="give at least one"):
        smallest_total_mass(feasible)
    with pytest.raises(InputError, match="needs information"):
        smallest_total_mass(feasible, base=GOOD, confidence=0.95)
    info = Information.from_factor(np.eye(6), GOOD, 0.5, 106, [f"b{i}" for i in range(6)])
    with pytest.raises(InputError, match=r"a probability such as 0\.95, got 95"):
        smallest_total_mass(feasible, information=info, confidence=95)
