"""Bounds on linear combinations and confidence intervals."""

import numpy as np
import pytest

from steelyard.dynamics import Model, Viscous
from steelyard.errors import InputError
from steelyard.feasibility import ConfidenceInterval, FeasibleSet, LinearBound, check, confidence_intervals
from steelyard.lmi import variables
from steelyard.regression import Information, least_squares
from steelyard.robot import Robot


@pytest.fixture(scope="module")
def arm():
    rows = [("-pi/2", 0.0, 0.3, "q"), ("0", 0.5123, 0.1, "q"), ("pi/2", 0.2, 0.0, "q")]
    return Model(Robot.from_dh(rows).with_terms(Viscous()))


@pytest.fixture
def estimate(arm):
    rng = np.random.default_rng(1)
    base = arm.base_parameters()
    count = base.count
    factor = np.triu(rng.normal(size=(count, count))) + 3 * np.eye(count)
    return least_squares(Information.from_factor(factor, factor @ rng.normal(size=count), 0.5, 400, base.expressions))


def values(model, constraint, parameters):
    return {block.name: float(block.evaluate(parameters)[0, 0]) for block in constraint.blocks(model)}


def test_text_mapping_and_expression_say_the_same(two_links):
    m1, m2 = variables("m1 m2")
    delta = np.zeros(22)
    delta[[9, 20]] = 3.0, 2.0
    for given in ("m1 - 2*m2 + 1", {"m1": 1.0, "m2": -2.0}, m1 - 2 * m2 + 1):
        bound = LinearBound(given, minimum=-0.5, maximum=4.0)
        constant = 0.0 if isinstance(given, dict) else 1.0
        found = list(values(two_links, bound, delta).values())
        assert found == pytest.approx([3 - 4 + constant + 0.5, 4 - (3 - 4 + constant)])


def test_names_and_units_of_the_blocks(two_links):
    def first(*arguments, **options):
        block = LinearBound(*arguments, **options).blocks(two_links)[0]
        return block.name, block.unit, block.kind

    assert first("m1 + m2", maximum=3.5) == ("m1 + m2 <= 3.5 kg", "kg", "constraint")
    assert first("lx1 - lz2", minimum=0) == ("lx1 - lz2 >= 0 kg m", "kg m", "constraint")
    assert first("Lyy1", minimum=0.1)[1] == "kg m²"
    assert first("Lyy1 + m2", minimum=0.1) == ("Lyy1 + m2 >= 0.1", "", "constraint")
    assert first("Fvj1", minimum=0.1, unit="N m s") == ("Fvj1 >= 0.1 N m s", "N m s", "constraint")
    assert first("Fvj1", minimum=0.1)[1] == ""


def test_base_parameters_by_number_and_by_expression(arm):
    base = arm.base_parameters()
    delta = np.random.default_rng(2).normal(size=arm.parameter_count)
    beta = base.K @ delta
    rough = 0
    for i, text in enumerate(base.expressions):
        for given in (f"beta{i + 1}", text, f" {text} "):
            (block,) = LinearBound(given, minimum=0.0).blocks(arm)
            np.testing.assert_allclose(block.evaluate(delta), beta[i], rtol=1e-14)
        rough += text.count("0.26245129")  # 0.5123², of which the text has 8 digits only
    assert rough > 0


def test_equal_bounds_are_an_equation(two_links):
    for bound in (LinearBound("m2 + 1", equal=3.0), LinearBound("m2 + 1", minimum=3, maximum=3.0)):
        assert bound.blocks(two_links) == ()
        (equation,) = bound.equalities(two_links)
        assert (equation.indices.tolist(), equation.coefficients.tolist(), equation.value) == ([20], [1.0], 2.0)


def test_infinite_bounds_are_none(two_links):
    assert len(LinearBound("m1", minimum=1.0, maximum=np.inf).blocks(two_links)) == 1
    with pytest.raises(InputError, match="needs a finite bound"):
        LinearBound("m1", minimum=-np.inf)


def test_bound_changes_the_verdict(two_links):
    base = [3.0, 0.1, 0.8, 0.3, 0.1, 0.1]
    assert check(FeasibleSet(two_links), base=base).feasible is True
    # beta1 = Lzz1 + m2 = 3 with Lzz1 > 0 leaves m2 < 3 kg.
    assert check(FeasibleSet(two_links, constraints=[LinearBound("m2", minimum=2.99)]), base=base).feasible is True
    verdict = check(FeasibleSet(two_links, constraints=[LinearBound("m2", minimum=3.01)]), base=base)
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()


def test_intervals_hold_the_estimate_within_their_deviations(arm, estimate):
    intervals = confidence_intervals(estimate, deviations=2.0)
    assert len(intervals) == arm.base_parameters().count
    base = arm.base_parameters()
    delta = np.zeros(arm.parameter_count)
    for i, interval in enumerate(intervals):
        sigma = estimate.standard_error[i]
        for shift, inside in ((0.0, True), (1.99, True), (-1.99, True), (2.01, False), (-2.01, False)):
            delta[base.independent] = estimate.base
            delta[base.independent[i]] += shift * sigma
            smallest = min(block.smallest_eigenvalue(delta) for block in interval.blocks(arm))
            assert (smallest > 0) == inside
    assert intervals[0].blocks(arm)[0].name.startswith(f"confidence interval of {base.expressions[0]} >= ")


def test_combinations_without_covariance_are_the_widest(estimate):
    sigma = estimate.standard_error
    (interval,) = confidence_intervals(estimate, combinations=["beta1 - 2*beta3"])
    assert interval.value == pytest.approx(estimate.base[0] - 2 * estimate.base[2])
    assert interval.standard_deviation == pytest.approx(sigma[0] + 2 * sigma[2])


def test_combinations_with_covariance(estimate):
    rng = np.random.default_rng(3)
    count = len(estimate.base)
    factor = rng.normal(size=(count, count))
    covariance = factor @ factor.T
    (interval,) = confidence_intervals(estimate, combinations=["beta1 - 2*beta3"], covariance=covariance)
    samples = rng.multivariate_normal(np.zeros(count), covariance, 200000)
    assert interval.standard_deviation == pytest.approx(np.std(samples[:, 0] - 2 * samples[:, 2]), rel=0.02)


def test_combinations_by_leading_name_and_by_expression(estimate):
    by_number, by_name, by_expression = confidence_intervals(
        estimate, combinations=["beta2", {estimate.base_names[1]: 1.0}, estimate.base_expressions[1]]
    )
    assert by_number == by_name == by_expression


def test_what_the_data_says_nothing_of_is_left_out(estimate):
    deviations = estimate.standard_error.copy()
    deviations[3] = np.inf
    object.__setattr__(estimate, "standard_error", deviations)
    assert len(confidence_intervals(estimate)) == len(estimate.base) - 1
    assert confidence_intervals(estimate, combinations=["beta4 + beta1"]) == ()
    assert len(confidence_intervals(estimate, combinations=["beta2 + beta1"])) == 1


def test_exact_value_is_an_equation(two_links):
    interval = ConfidenceInterval("m1 + m2", 3.0, 0.0)
    assert interval.blocks(two_links) == ()
    assert interval.equalities(two_links)[0].value == 3.0


def test_estimate_of_another_robot_is_refused(estimate):
    other = Model(Robot.from_dh([("0", 0.3, 0.0, "q"), ("pi/2", 0.0, 0.0, "q")]))
    with pytest.raises(InputError, match="another robot"):
        FeasibleSet(other, constraints=list(confidence_intervals(estimate)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda model: LinearBound("m1"), "needs a finite bound"),
        (lambda model: LinearBound("m1", minimum=2.0, maximum=1.0), "minimum 2 above its maximum 1"),
        (lambda model: LinearBound("m1", minimum=np.inf), "minimum inf above"),
        (lambda model: LinearBound("m1", minimum="2"), "minimum of LinearBound of m1 must be a number, got '2'"),
        (lambda model: LinearBound("m1", minimum=np.nan), "must be a number, got nan"),
        (lambda model: LinearBound("m1", equal=np.inf), "must be a number, got inf"),
        (lambda model: LinearBound("m1", equal=1, maximum=2), "either equal or bounds"),
        (lambda model: LinearBound("m1*m2", equal=1), r"expression of LinearBound 'm1\*m2' is not linear"),
        (lambda model: LinearBound("3 - 2", equal=1), "depends on no parameter"),
        (lambda model: LinearBound(3, equal=1), "a combination of parameters such as 'Lyy1 \\+ Iam1', got 3"),
        (lambda model: LinearBound("m1", equal=1, unit=3), "unit of LinearBound of m1 must be a text"),
        (lambda model: LinearBound("Lyy3 + m1", equal=1).equalities(model), "no parameter of the model; did you mean"),
        (lambda model: LinearBound("beta7", equal=1).equalities(model), "base parameters: beta1 to beta6"),
        (lambda model: LinearBound("beta0", equal=1).equalities(model), "base parameters: beta1 to beta6"),
        (lambda model: LinearBound("beta3 - Lzz2", minimum=1).blocks(model), "does not depend on any parameter"),
        (lambda model: ConfidenceInterval("m1", 1.0, -0.1), "at least 0, got -0.1"),
        (lambda model: ConfidenceInterval("m1", "a", 0.1), "value of ConfidenceInterval of m1 must be a number"),
        (lambda model: ConfidenceInterval("m1", 1.0, np.inf), "must be a number of at least 0, got inf"),
        (lambda model: ConfidenceInterval("m1", 1.0, 0.1, 0), "must be a positive number, got 0"),
    ],
)
def test_impossible_bounds_are_refused(two_links, make, message):
    with pytest.raises(InputError, match=message):
        make(two_links)


def test_wrong_combinations_are_refused(estimate):
    with pytest.raises(InputError, match="'m9', which is no base parameter of the estimate"):
        confidence_intervals(estimate, combinations=["m9 + beta1"])
    with pytest.raises(InputError, match="covariance must be finite, of shape"):
        confidence_intervals(estimate, covariance=np.eye(2))
