import numpy as np
import pytest

from steelyard.errors import InputError, SolverError
from steelyard.estimators import ConstantPullbackPrior, EntropicPrior, EuclideanPrior, LCurve, fit_reduced, l_curve
from steelyard.feasibility import FeasibleSet, TotalMass


@pytest.fixture(scope="module")
def arm(random_arm):
    model, truth, info = random_arm(3, 2, (0.5, 2.0), (0.2, 0.5), noise=0.3, rows=40)
    return FeasibleSet(model), truth * np.random.default_rng(4).uniform(0.98, 1.02, len(truth)), info


@pytest.mark.parametrize(
    "prior",
    [
        *(pytest.param(prior, marks=pytest.mark.slow) for prior in (EuclideanPrior, EntropicPrior)),
        ConstantPullbackPrior,
    ],
)
def test_residual_rises_and_distance_falls_from_end_to_end(arm, prior):
    feasible, known, info = arm
    curve = l_curve(info, feasible, prior(known))
    slack = 1e-6 * curve.squared_residuals[0]
    assert np.all(np.diff(curve.squared_residuals) > -slack)
    assert np.all(np.diff(curve.distances) < 1e-6 * curve.distances[0])
    assert curve.distances[-1] < 1e-2 * curve.distances[0]
    # At its start the prior hardly costs anything beyond physics.
    assert (
        curve.squared_residuals[0]
        < 1.01 * fit_reduced(info.reduced("joint"), feasible, residual_slack=0.0).squared_residual
    )


def test_corner_of_a_curve_with_a_corner():
    """A right angle in logarithms has its corner where it turns."""
    residuals = np.array([1.0, 1.01, 1.02, 1.03, 1.5, 2.2, 3.3, 4.8])
    distances = np.array([1e3, 1e2, 1e1, 1.0, 0.95, 0.9, 0.85, 0.8])
    curve = made(residuals, distances)
    assert curve.corner == 1e3
    assert "corner" in str(curve).splitlines()[4]
    assert made(np.ones(5), np.ones(5)).corner == 1e4


def made(residuals, distances):
    from steelyard.estimators.l_curve import _corner

    weights = 10.0 ** np.arange(len(residuals))
    return LCurve(
        "entropic", weights, residuals, distances, np.zeros((len(residuals), 1)), _corner(residuals, distances)
    )


def test_curve_can_be_printed_and_drawn(arm):
    feasible, known, info = arm
    curve = l_curve(info, feasible, EuclideanPrior(known), weights=None, prior_weights=[1e4, 1.0, 1e2])
    np.testing.assert_array_equal(curve.prior_weights, [1.0, 1e2, 1e4])
    assert len(str(curve).splitlines()) == 4
    assert str(curve).count("corner") == 1
    figure = curve.figure()
    np.testing.assert_array_equal(figure.data[0].y, curve.distances)
    assert figure.data[1].x[0] == curve.squared_residuals[curve.corner_index]
    assert curve._repr_html_().startswith("<pre>")


def test_bad_arguments_are_refused(arm):
    feasible, known, info = arm
    with pytest.raises(InputError, match="at least three positive numbers"):
        l_curve(info, feasible, EuclideanPrior(known), prior_weights=[1.0, -1.0, 2.0])
    with pytest.raises(InputError, match="l_curve needs a prior"):
        l_curve(info, feasible, "cad")
    empty = FeasibleSet(feasible.model, constraints=[TotalMass(maximum=1.0), TotalMass(minimum=2.0)])
    with pytest.raises(SolverError, match="loosen the constraints"):
        l_curve(info, empty, EuclideanPrior(known), prior_weights=[1.0, 2.0, 3.0])
