"""The WAM of the thesis and the real one: what their estimates leave possible."""

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.estimators import fit_reduced
from steelyard.feasibility import FeasibleSet, TotalMass, correct, lightest_robot, parameter_intervals
from steelyard.regression import ParameterCovariance

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def fitted(real_wam):
    model, reduced = real_wam
    feasible = FeasibleSet(model, "full")
    return feasible, fit_reduced(reduced, feasible)


def test_the_fit_lies_in_its_own_intervals(fitted):
    feasible, fit = fitted
    found = parameter_intervals(feasible, fit.base)
    names = list(feasible.model.parameter_names)
    for interval in found:
        if interval.name in names:
            value = fit.parameters[names.index(interval.name)]
            assert interval.lower - 1e-9 <= value <= interval.upper + 1e-9, interval.name
    assert found["total mass"].lower <= fit.total_mass * (1 + 1e-9)


def test_masses_are_bounded_though_not_identifiable(fitted):
    """Forearm and wrist of the real WAM: no mass is a base parameter, yet each is known to within a factor of 2.3."""
    feasible, fit = fitted
    found = parameter_intervals(feasible, fit.base, names=["m3", "m4", "m5", "m6", "m7"])
    assert not any(interval.identifiable for interval in found)
    assert all(found[name].bounded and found[name].upper < 2.3 * found[name].lower for name in ("m4", "m5", "m6", "m7"))
    # What the motion does not show may be as heavy as it likes in the shoulder.
    assert found["m3"].upper == np.inf
    for interval in found:
        assert interval.tolerance <= 1e-3 * min(interval.width, interval.attained_lower)
        for parameters in (interval.lower_parameters, interval.upper_parameters):
            if parameters is not None:
                # Robots of hundreds of tonnes are inside to rounding.
                assert feasible.stack.smallest_eigenvalues(parameters).min() >= 0.0
                np.testing.assert_allclose(feasible.K @ parameters, fit.base, atol=1e-8)


def test_lightest_robot_with_the_fit_is_the_fit(fitted):
    """It is chosen as the lightest, and weighs at least what its links weigh at least."""
    feasible, fit = fitted
    found = lightest_robot(feasible, fit.base)
    assert found.total.attained <= fit.total_mass * (1 + 1e-9)
    assert found.total.proved == pytest.approx(fit.total_mass, rel=0.01)
    assert sum(least.proved for least in found.links) <= found.total.attained
    assert feasible.contains(found.parameters)


@pytest.mark.parametrize("consistency", ["inertia", "full"])
def test_corrected_estimate_of_the_thesis(thesis_wam, table_4_9, consistency):
    """119 parameters of which 43 are not identifiable."""
    feasible = FeasibleSet(thesis_wam, consistency, [TotalMass(maximum=60.0)], margin=1e-3)
    correction = correct(feasible, base=table_4_9["WLS"])
    found = parameter_intervals(feasible, correction.base)
    names = list(thesis_wam.parameter_names)
    for interval in found:
        if interval.name in names:
            value = correction.parameters[names.index(interval.name)]
            assert interval.lower - 1e-9 <= value <= interval.upper + 1e-9, interval.name
    assert all(found[f"m{link}"].bounded for link in range(1, 8))
    # Offsets of joint and motor are shown only together, and nothing bounds either.
    assert found["Fom7"].identifiable is False
    assert (found["Fom7"].lower, found["Fom7"].upper) == (-np.inf, np.inf)


def test_region_of_the_real_wam(real_wam):
    """The noise of 397333 samples is far from independent: as if it were, no robot lies within the region."""
    model, reduced = real_wam
    feasible = FeasibleSet(model, "full")
    names = ["m4", "m7", "fc5", "total mass"]
    with pytest.raises(InputError, match=r"17\.\d times as far away as its edge; .* covariance= .* 320 times as large"):
        parameter_intervals(feasible, info=reduced, names=names)
    base = np.linalg.solve(reduced.R, reduced.rho)
    covariance = ParameterCovariance.of_reduced(reduced).matrix
    found = parameter_intervals(feasible, base, covariance=25.0**2 * covariance, names=names)
    wider = parameter_intervals(feasible, base, covariance=40.0**2 * covariance, names=names)
    fit = fit_reduced(reduced, feasible)
    for one, other in zip(found, wider, strict=True):
        assert other.lower <= one.lower + 1e-9
        assert one.upper <= other.upper + 1e-9
    assert fit.parameters[list(model.parameter_names).index("m4")] in found["m4"]
    assert found["total mass"].lower < fit.total_mass
