import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.feasibility import CenterOfMassBox, FeasibleSet, TotalMass, constraints_from_dict


def values(model, constraint, parameters):
    return {block.name: float(block.evaluate(parameters)[0, 0]) for block in constraint.blocks(model)}


def test_box_is_thesis_4_38(two_links):
    delta = np.zeros(22)
    delta[[17, 18, 19, 20]] = 0.2, -0.1, 0.9, 2.0  # lx2 ly2 lz2 m2
    box = CenterOfMassBox("forearm", lower=(-0.1, 0.0, -1.0), upper=(0.05, 0.3, 1.0))
    found = values(two_links, box, delta)
    name = "link 2 (forearm): centre of mass"
    assert found == pytest.approx(
        {
            f"{name} x >= -0.1 m": 0.2 + 0.2,
            f"{name} x <= 0.05 m": 0.1 - 0.2,
            f"{name} y >= 0 m": -0.1,
            f"{name} y <= 0.3 m": 0.6 + 0.1,
            f"{name} z >= -1 m": 0.9 + 2.0,
            f"{name} z <= 1 m": 2.0 - 0.9,
        }
    )


def test_infinite_bounds_are_left_out(two_links):
    box = CenterOfMassBox("forearm", lower=(-np.inf,) * 3, upper=(0.1, np.inf, np.inf))
    assert len(box.blocks(two_links)) == 1


def test_total_mass_of_all_and_of_some(two_links):
    delta = np.zeros(22)
    delta[[9, 20]] = 3.0, 2.0
    assert values(two_links, TotalMass(maximum=27.0, minimum=4.0), delta) == pytest.approx(
        {"total mass <= 27 kg": 22.0, "total mass >= 4 kg": 1.0}
    )
    assert values(two_links, TotalMass(maximum=1.5, links=["forearm"]), delta) == pytest.approx(
        {"mass of forearm <= 1.5 kg": -0.5}
    )


def test_equal_mass_is_an_equation(two_links):
    constraint = TotalMass(equal=5.0)
    assert constraint.blocks(two_links) == ()
    (equation,) = constraint.equalities(two_links)
    assert (equation.indices.tolist(), equation.coefficients.tolist(), equation.value) == ([9, 20], [1.0, 1.0], 5.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TotalMass(), "needs a bound"),
        (lambda: TotalMass(maximum=1.0, minimum=2.0), "minimum 2.0 kg above its maximum 1.0 kg"),
        (lambda: TotalMass(maximum=-1.0), "positive maximum, got -1.0"),
        (lambda: TotalMass(maximum=float("nan")), "finite number of kg as maximum"),
        (lambda: TotalMass(maximum="27"), "finite number of kg as maximum, got '27'"),
        (lambda: TotalMass(equal=1.0, maximum=2.0), "either equal or bounds"),
        (lambda: TotalMass(maximum=1.0, links=[]), "empty list of links"),
        (lambda: CenterOfMassBox("a", (0, 0, 0), (1, -1, 1)), "lower y 0 m above upper y -1 m"),
        (lambda: CenterOfMassBox("a", (0, 0), (1, 1, 1)), "three numbers"),
        (lambda: CenterOfMassBox("a", (0, 0, "left"), (1, 1, 1)), "three numbers"),
        (lambda: constraints_from_dict({"totalmass": {}}), "did you mean 'total_mass'"),
        (lambda: constraints_from_dict({"total_mass": {"maximun": 3.0}}), "did you mean 'maximum'"),
        (lambda: constraints_from_dict({"total_mass": 27.0}), "must be a table"),
        (lambda: constraints_from_dict({"center_of_mass_box": [{"link": "a", "lower": [0, 0, 0]}]}), "lacks 'upper'"),
    ],
)
def test_impossible_constraints_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_unknown_link_suggests_the_closest(two_links):
    with pytest.raises(InputError, match="did you mean 'forearm'"):
        FeasibleSet(two_links, constraints=[CenterOfMassBox("fore_arm", (0, 0, 0), (1, 1, 1))])


def test_section_of_a_robot_file():
    section = {
        "total_mass": {"maximum": 27.0},
        "center_of_mass_box": [{"link": "link1", "lower": [-0.1, -0.1, 0.0], "upper": [0.1, 0.1, 0.5]}],
    }
    expected = (TotalMass(maximum=27.0), CenterOfMassBox("link1", (-0.1, -0.1, 0.0), (0.1, 0.1, 0.5)))
    assert constraints_from_dict(section) == expected
