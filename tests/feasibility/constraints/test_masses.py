import numpy as np
import pytest

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, MeasuredMass, TotalMass, check
from steelyard.robot import Robot


def values(model, constraint, parameters):
    return {block.name: float(block.evaluate(parameters)[0, 0]) for block in constraint.blocks(model)}


def test_total_mass_of_all_and_of_some(two_links):
    delta = np.zeros(22)
    delta[[9, 20]] = 3.0, 2.0
    assert values(two_links, TotalMass(maximum=27.0, minimum=4.0), delta) == pytest.approx(
        {"total mass <= 27 kg": 22.0, "total mass >= 4 kg": 1.0}
    )
    assert values(two_links, TotalMass(maximum=1.5, links=["forearm"]), delta) == pytest.approx(
        {"mass of forearm <= 1.5 kg": -0.5}
    )


@pytest.mark.parametrize("constraint", [TotalMass(equal=5.0), TotalMass(minimum=5.0, maximum=5), MeasuredMass(5)])
def test_exact_mass_is_an_equation(two_links, constraint):
    assert constraint.blocks(two_links) == ()
    (equation,) = constraint.equalities(two_links)
    assert (equation.indices.tolist(), equation.coefficients.tolist(), equation.value) == ([9, 20], [1.0, 1.0], 5.0)


def test_weighed_link_lies_within_its_deviations(two_links):
    delta = np.zeros(22)
    delta[20] = 2.45
    weighed = MeasuredMass(2.4, "forearm", standard_deviation=0.01, deviations=2)
    assert values(two_links, weighed, delta) == pytest.approx(
        {"weighed mass of forearm <= 2.42 kg": -0.03, "weighed mass of forearm >= 2.38 kg": 0.07}
    )
    assert weighed.equalities(two_links) == ()


def test_uncertain_mass_has_no_lower_limit_below_zero(two_links):
    (block,) = MeasuredMass(0.1, ["upper arm"], standard_deviation=0.05).blocks(two_links)
    assert block.name == "weighed mass of upper arm <= 0.25 kg"


def test_a_link_named_twice_is_weighed_once(two_links):
    (equation,) = MeasuredMass(2.0, ["forearm", "forearm"]).equalities(two_links)
    assert equation.indices.tolist() == [20]


def test_weighed_mass_decides_what_moves_alike():
    """A pendulum of 2 kg with l = 1 kg m has its centre of mass at 0.5 m, so Lzz is above 0.5 kg m²."""
    model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    feasible = FeasibleSet(model, constraints=[MeasuredMass(2.0)])
    assert check(feasible, base=[0.5001, 1.0, 0.0]).feasible is True
    verdict = check(feasible, base=[0.4999, 1.0, 0.0])
    assert verdict.status == "infeasible"
    assert verdict.certificate.verify()


def test_prints_what_was_given():
    assert repr(TotalMass(equal=3.0, links="a")) == "TotalMass(equal=3.0, links=('a',))"
    assert repr(MeasuredMass(3)) == "MeasuredMass(3.0)"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TotalMass(), "needs a bound"),
        (lambda: TotalMass(maximum=1.0, minimum=2.0), "minimum 2.0 kg above its maximum 1.0 kg"),
        (lambda: TotalMass(maximum=-1.0), "positive maximum, got -1.0"),
        (lambda: TotalMass(maximum=float("nan")), "finite number of kg as maximum"),
        (lambda: TotalMass(maximum="27"), "finite number of kg as maximum, got '27'"),
        (lambda: TotalMass(maximum=True), "finite number of kg as maximum, got True"),
        (lambda: TotalMass(equal=1.0, maximum=2.0), "either equal or bounds"),
        (lambda: TotalMass(maximum=1.0, links=[]), "empty list of links"),
        (lambda: TotalMass(maximum=1.0, links=[3]), "names of links"),
        (lambda: MeasuredMass(0), "value of MeasuredMass must be a positive number of kg, got 0"),
        (lambda: MeasuredMass("2"), "value of MeasuredMass must be a positive number of kg, got '2'"),
        (lambda: MeasuredMass(2, standard_deviation=-1), "at least 0 kg"),
        (lambda: MeasuredMass(2, deviations=0), "deviations of MeasuredMass must be a positive number, got 0"),
        (lambda: MeasuredMass(2, links=4), "names of links as links, got 4"),
    ],
)
def test_impossible_masses_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("make", [lambda: TotalMass(maximum=1, links="fore_arm"), lambda: MeasuredMass(1, "fore_arm")])
def test_unknown_link_suggests_the_closest(two_links, make):
    with pytest.raises(InputError, match='did you mean "forearm"'):
        FeasibleSet(two_links, constraints=[make()])
