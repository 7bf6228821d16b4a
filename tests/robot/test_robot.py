"""The robot as a tree of joints, its parameters and its terms."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.robot import Condition, Inertia, Joint, Link, Robot, Term, TermParameter


class Drag(Term):
    kind = "drag"
    parameters = (
        TermParameter("Fd", "N·m·s/rad", "N·s/m", "drag", nonnegative=True),
        TermParameter("Fe", "N·m", "N", "bias", nonnegative=False),
    )

    def columns(self, k, q, dq, ddq, algebra):
        return ({k: dq[k]}, {k: 1.0})

    def nominal(self, joint):
        return (joint.damping, np.nan)

    def check(self, robot):
        if robot.dof > 2:
            raise InputError("drag is for small robots")


def make(name: str, parent: int, coordinate: int, **options) -> Joint:
    return Joint(name, "revolute", parent, np.eye(4), np.eye(4), coordinate, **options)


JOINTS = (
    make("a", -1, 0, damping=0.5),
    make("b", 0, 0, mimics="a", multiplier=-2.0, offset=0.1),
    make("c", 0, 1),
)
BODY = Inertia.from_com(2.0, (0.1, 0.0, 0.0), np.diag([1.0, 2.0, 2.5]))
LINKS = (Link("A", BODY), Link("B"), Link("C"))


@pytest.fixture
def robot() -> Robot:
    return Robot("tree", JOINTS, LINKS)


def test_coordinates_are_those_of_the_driving_joints(robot):
    assert robot.dof == 2
    assert robot.joint_names == ("a", "c")
    assert robot.driving_joints == (0, 2)
    assert robot.link_names == ("A", "B", "C")


def test_a_robot_in_the_place_of_its_model_is_told(robot):
    with pytest.raises(AttributeError, match="a Robot has no attribute 'base_parameters'; its dynamics are those of"):
        robot.base_parameters()
    assert not hasattr(robot, "_nothing")


def test_terms_stand_after_the_link_of_each_driving_joint(robot):
    weighed = robot.with_terms(Drag())
    ten = ["Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m"]
    expected = [
        *(f"{symbol}1" for symbol in ten),
        "Fd1",
        "Fe1",
        *(f"{symbol}2" for symbol in ten),
        *(f"{symbol}3" for symbol in ten),
        "Fd3",
        "Fe3",
    ]
    assert list(weighed.parameter_names) == expected
    assert weighed.link_starts == (0, 12, 22)
    assert robot.terms == ()


def test_parameters_hold_what_the_description_knows(robot):
    weighed = robot.with_terms(Drag())
    values = dict(zip(weighed.parameter_names, weighed.parameters, strict=True))
    assert values["m1"] == 2.0
    assert values["lx1"] == 0.2
    assert values["Lzz1"] == pytest.approx(2.5 + 2.0 * 0.1**2)
    assert values["Fd1"] == 0.5
    unknown = [name for name, value in values.items() if np.isnan(value)]
    assert unknown == [name for name in weighed.parameter_names if name[-1] in "23" or name == "Fe1"]


def test_terms_replace_the_terms_before(robot):
    assert robot.with_terms(Drag()).with_terms().parameter_names == robot.parameter_names


def test_a_term_may_refuse_the_robot(robot):
    larger = Robot("larger", (*JOINTS, make("d", 2, 2)), (*LINKS, Link("D")))
    with pytest.raises(InputError, match="small robots"):
        larger.with_terms(Drag())


def test_a_symbol_can_be_used_once_only(robot):
    with pytest.raises(InputError, match='parameter "Fd"'):
        robot.with_terms(Drag(), Drag())


def test_default_conditions_are_those_of_nonnegative_symbols():
    (condition,) = Drag().conditions()
    assert isinstance(condition, Condition)
    assert (condition.name, condition.size) == ("Fd >= 0", 1)
    assert condition.constant.tolist() == [[0.0]]
    assert {symbol: matrix.tolist() for symbol, matrix in condition.coefficients.items()} == {"Fd": [[1.0]]}


def test_it_prints_its_joints(robot):
    text = repr(robot)
    assert text.splitlines()[0] == "Robot 'tree': 2 coordinates, 3 links on 'base', gravity (0, 0, -9.81) m/s²"
    assert "b  revolute (mimics a)  A -> B" in text
    assert "2 kg" in text


def test_html_escapes_names():
    robot = Robot("<b>", (make("<i>", -1, 0),), (Link("x&y"),))
    page = robot._repr_html_()
    assert "&lt;i&gt;" in page
    assert "x&amp;y" in page
    assert "<i>" not in page


def test_mimic_value_enters_the_placement():
    placement = JOINTS[1].placement(0.3)
    angle = -2.0 * 0.3 + 0.1
    assert placement[:2, :2] == pytest.approx(
        np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    )


def test_frame_of_an_unknown_link(robot):
    assert robot.frame("B")[0] == 1
    assert robot.frame("base")[0] == -1
    with pytest.raises(InputError, match='no link "bse"; did you mean "base"'):
        robot.frame("bse")


@pytest.mark.parametrize(
    ("joints", "links", "phrase"),
    [
        ((), (), "no moving joint"),
        (JOINTS[:1], LINKS, "got 1 joints and 3 links"),
        ((make("a", 0, 0),), LINKS[:1], "its parent must be -1"),
        ((make("a", -1, 1),), LINKS[:1], "must have coordinate 0"),
        ((make("a", -1, 0, multiplier=2.0),), LINKS[:1], "multiplier 1 and offset 0"),
        ((make("a", -1, 0), make("b", 0, 0, mimics="x")), LINKS[:2], "is no driving joint of coordinate 0"),
        ((make("a", -1, 0), make("a", 0, 1)), LINKS[:2], 'joint name "a" is used twice'),
        ((make("a", -1, 0), make("b", 0, 1)), (LINKS[0], LINKS[0]), 'link name "A" is used twice'),
    ],
)
def test_parts_that_do_not_fit_are_refused(joints, links, phrase):
    with pytest.raises(InputError, match=phrase):
        Robot("broken", joints, links)


def test_a_changed_copy_is_checked_too(robot):
    with pytest.raises(InputError, match="gravity"):
        replace(robot, gravity=np.array([np.nan, 0, 0]))
