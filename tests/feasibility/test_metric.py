"""Corrections in metrics other than the Euclidean one."""

import numpy as np
import pytest

from steelyard.dynamics import Model, Viscous
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, correct
from steelyard.recording import Samples
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot

IMPOSSIBLE = np.array([0.5, 0.1, 0.25, 0.3, 0.4, -0.1])


@pytest.fixture
def random_factor():
    return np.random.default_rng(12).normal(size=(6, 6)) * np.array([1.0, 3.0, 0.1, 10.0, 1.0, 0.3])


def test_given_matrix_agrees_with_descent_over_factors(two_links, random_factor, least_by_descent):
    feasible = FeasibleSet(two_links)
    metric = random_factor.T @ random_factor
    _, expected = least_by_descent(feasible, lambda delta: random_factor @ (feasible.K @ delta - IMPOSSIBLE))
    correction = correct(feasible, base=IMPOSSIBLE, metric=metric)
    assert correction.squared_distance == pytest.approx(expected, rel=1e-5)
    difference = correction.base - IMPOSSIBLE
    assert correction.squared_distance == pytest.approx(difference @ metric @ difference, rel=1e-9)
    assert correction.squared_euclidean_distance == pytest.approx(difference @ difference, rel=1e-9)
    assert correction.metric == "given"
    assert correction.certificate.verify()
    euclidean = correct(feasible, base=IMPOSSIBLE)
    assert euclidean.squared_euclidean_distance == euclidean.squared_distance
    assert euclidean.squared_distance < correction.squared_euclidean_distance


@pytest.mark.slow
def test_standard_parameters_agree_with_descent_over_factors(two_links, least_by_descent):
    feasible = FeasibleSet(two_links)
    rng = np.random.default_rng(13)
    factor, given = rng.normal(size=(22, 22)), rng.normal(size=22)
    _, expected = least_by_descent(feasible, lambda delta: factor @ (delta - given))
    correction = correct(feasible, parameters=given, metric=factor.T @ factor)
    assert correction.squared_distance == pytest.approx(expected, rel=1e-5)


def test_covariance_is_the_inverse_of_a_metric(two_links, random_factor):
    feasible = FeasibleSet(two_links)
    covariance = np.linalg.inv(random_factor.T @ random_factor)
    by_covariance = correct(feasible, base=IMPOSSIBLE, covariance=0.5 * (covariance + covariance.T))
    by_metric = correct(feasible, base=IMPOSSIBLE, metric=random_factor.T @ random_factor)
    np.testing.assert_allclose(by_covariance.base, by_metric.base, atol=1e-5)
    assert by_covariance.squared_distance == pytest.approx(by_metric.squared_distance, rel=1e-6)
    assert by_covariance.metric == "covariance"


def test_unit_matrix_and_diagonal_are_what_they_should_be(two_links, least_by_descent):
    feasible = FeasibleSet(two_links)
    plain = correct(feasible, base=IMPOSSIBLE)
    unit = correct(feasible, base=IMPOSSIBLE, metric=np.eye(6))
    assert unit.squared_distance == pytest.approx(plain.squared_distance, rel=1e-6)
    np.testing.assert_allclose(unit.base, plain.base, atol=1e-5)
    weights = np.array([1.0, 2.0, 0.5, 4.0, 1.0, 3.0])
    _, expected = least_by_descent(feasible, lambda delta: np.sqrt(weights) * (feasible.K @ delta - IMPOSSIBLE))
    diagonal = correct(feasible, base=IMPOSSIBLE, metric=np.diag(weights))
    assert diagonal.squared_distance == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_unit_of_the_metric_does_not_matter(two_links, random_factor, scale):
    feasible = FeasibleSet(two_links)
    metric = random_factor.T @ random_factor
    plain = correct(feasible, base=IMPOSSIBLE, metric=metric)
    scaled = correct(feasible, base=IMPOSSIBLE, metric=scale * metric)
    assert scaled.squared_distance == pytest.approx(scale * plain.squared_distance, rel=1e-6)
    np.testing.assert_allclose(scaled.base, plain.base, atol=1e-5)


class Data:
    """An Information of which only R is known."""

    by_joint = False

    def __init__(self, factor):
        self.factor = factor

    def reduced(self, weights=None):
        assert weights is None
        return type("Reduced", (), {"R": self.factor})()


@pytest.mark.parametrize("spread", [1.0, 1e3, 1e6])
def test_metrics_of_a_wide_spread(two_links, spread):
    """Axes whose weights differ by the square of this; the nearest point on a single active plane is known."""
    rows = np.eye(6) + 0.05 * np.random.default_rng(14).normal(size=(6, 6))
    axes = np.linalg.qr(rows[::-1].T)[0].T[::-1]  # the last is nearly that of the friction which is impossible
    sizes = np.geomspace(1.0, 1.0 / spread, 6)
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, -0.1])
    feasible = FeasibleSet(two_links)
    correction = correct(feasible, base=base, metric=Data(sizes[:, None] * axes))
    inverse = (axes.T / sizes**2) @ axes
    step = inverse[:, 5] / inverse[5, 5] * (0.1 + feasible.margin)
    np.testing.assert_allclose(correction.base, base + step, atol=2e-5)
    assert correction.squared_distance == pytest.approx((0.1 + feasible.margin) ** 2 / inverse[5, 5], rel=1e-4)
    assert correction.metric == "data"


@pytest.fixture(scope="module")
def recorded():
    """A planar arm, its samples with noise, and an estimate that is infeasible."""
    model = Model(
        Robot.from_dh([("0", 0.0, 0.0, "q"), ("0", 0.4, 0.0, "q")], gravity=(0, -9.81, 0)).with_terms(Viscous())
    )
    rng = np.random.default_rng(15)
    truth = np.zeros(len(model.parameter_names))
    for link in range(2):
        truth[11 * link : 11 * link + 11] = [0.002, 0, 0, 0.02, 0, 0.021, 0.05, 0.0, 0.0, 0.5, 0.02]
    q, dq, ddq = rng.normal(size=(3, 60, 2))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + np.array([0.5, 0.05]) * rng.normal(size=(60, 2))
    samples = Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    return model, samples, Information.from_samples(model, samples)


def test_data_as_metric_is_the_rise_of_the_squared_residual(recorded):
    model, samples, information = recorded
    feasible = FeasibleSet(model)
    estimate = least_squares(information, weights="joint")
    correction = correct(feasible, base=estimate.base, metric=information)
    weights = np.asarray(information.joint_weights("joint"))
    columns = model.regressor(samples.q, samples.dq, samples.ddq) @ np.linalg.pinv(feasible.K)

    def squared_residual(base):
        return float(np.sum(((columns @ base - samples.torque) * weights) ** 2))

    rise = squared_residual(correction.base) - squared_residual(estimate.base)
    assert correction.status == "corrected"
    assert correction.squared_distance == pytest.approx(rise, rel=1e-6)
    # Nothing that is feasible costs less: not the nearest in the sense of the ruler, nor any on the way to it.
    euclidean = correct(feasible, base=estimate.base)
    for share in np.linspace(0.0, 1.0, 11):
        other = correction.base + share * (euclidean.base - correction.base)
        assert squared_residual(other) >= squared_residual(correction.base) * (1 - 1e-9)


def test_data_as_metric_of_standard_parameters(recorded):
    model, _, information = recorded
    feasible = FeasibleSet(model)
    estimate = least_squares(information, weights="joint")
    given = feasible.lift @ estimate.base
    by_parameters = correct(feasible, parameters=given, metric=information)
    by_base = correct(feasible, base=estimate.base, metric=information)
    assert by_parameters.squared_distance == pytest.approx(by_base.squared_distance, rel=1e-4)


def test_directions_without_weight_change_least(two_links):
    """Friction has no weight: it goes to the nearest value that is possible, and what is fine stays."""
    feasible = FeasibleSet(two_links)
    base = np.array([1.5, 0.1, 0.25, 0.3, 0.4, -0.1])
    correction = correct(feasible, base=base, metric=np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]))
    np.testing.assert_allclose(correction.base[:5], base[:5], atol=1e-5)
    assert correction.base[5] == pytest.approx(0.0, abs=1e-3)
    assert correction.base[5] > 0
    assert correction.squared_distance == pytest.approx(0.0, abs=1e-9)
    assert correction.squared_euclidean_distance == pytest.approx(0.01, rel=2e-2)
    # The same with axes that are not those of the parameters.
    Q = np.linalg.qr(np.random.default_rng(16).normal(size=(6, 6)))[0]
    singular = (Q * np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])) @ Q.T
    slanted = correct(feasible, base=IMPOSSIBLE, metric=0.5 * (singular + singular.T))
    assert feasible.contains(slanted.parameters)
    assert slanted.squared_euclidean_distance < 100 * correct(feasible, base=IMPOSSIBLE).squared_distance + 1.0


def test_sentence_tells_both_distances(two_links):
    base = [1.5, 0.1, 0.25, 0.3, 0.4, -0.1]
    text = str(correct(FeasibleSet(two_links), base=base, metric=4 * np.eye(6)))
    assert text.startswith('Corrected to be feasible under "full" consistency; squared distance 0.0400')
    assert " in the given metric (Euclidean: 0.0100" in text
    text = str(correct(FeasibleSet(two_links), base=base, covariance=np.eye(6)))
    assert "in the metric of the covariance (Euclidean: 0.0100" in text


def broken(row, column, value):
    matrix = np.eye(6)
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"metric": np.eye(5)}, r"metric must be of shape \(6, 6\), a row for each of the 6 base parameters"),
        ({"metric": np.ones(6)}, "metric must be of shape"),
        ({"metric": broken(1, 2, np.nan)}, "metric must be finite, got nan in row 2, column 3"),
        ({"metric": broken(1, 2, 0.5)}, r"metric must be symmetric, but elements \(2, 3\) and \(3, 2\) are 0.5 and 0"),
        ({"metric": broken(3, 3, -1.0)}, "positive semidefinite, but its diagonal element 4 is -1"),
        ({"metric": np.eye(6) - 0.5}, "positive semidefinite, but its smallest eigenvalue"),
        (
            {"metric": broken(0, 0, 0.0) + 0.1 * (np.eye(6)[::-1] - np.diag(np.diag(np.eye(6)[::-1])))},
            "positive semidefinite, but its diagonal element 1 is 0",
        ),
        ({"metric": np.zeros((6, 6))}, "zero everywhere"),
        ({"metric": "joint"}, "metric must be a .* matrix or an Information, got str"),
        ({"metric": np.eye(6), "covariance": np.eye(6)}, "either metric= or covariance="),
        ({"covariance": np.diag([1.0, 1, 1, 1, 1, 0])}, "covariance must be positive definite, .* element 6 is 0"),
        ({"covariance": np.ones((6, 6))}, "covariance must be positive definite, .* give metric= instead"),
        ({"covariance": np.eye(3)}, "covariance must be of shape"),
    ],
)
def test_metrics_that_are_none(two_links, arguments, words):
    with pytest.raises(InputError, match=words) as caught:
        correct(FeasibleSet(two_links), base=IMPOSSIBLE, **arguments)
    assert "\n" not in str(caught.value)


def test_metric_of_standard_parameters_is_larger(two_links):
    with pytest.raises(InputError, match=r"shape \(22, 22\), a row for each of the 22 standard parameters"):
        correct(FeasibleSet(two_links), parameters=np.zeros(22), metric=np.eye(6))


def test_data_of_another_model_is_refused(two_links, recorded):
    with pytest.raises(InputError, match="metric belongs to another model"):
        correct(FeasibleSet(two_links), base=IMPOSSIBLE, metric=recorded[2])
