"""Denavit-Hartenberg tables."""

import csv
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.robot import Inertia, Robot

PUMA = [  # alpha, a, d, theta of a Puma 560, standard
    ("pi/2", 0, 0, "q1"),
    (0, 0.4318, 0, "q2"),
    ("-pi/2", 0.0203, 0.15005, "q3"),
    ("pi/2", 0, 0.4318, "q4"),
    ("-pi/2", 0, 0, "q5"),
    (0, 0, 0, "q6"),
]


def turned(axis: str, angle: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return matrix


def shifted(axis: str, distance: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix["xyz".index(axis), 3] = distance
    return matrix


def standard(alpha, a, d, theta):
    return turned("z", theta) @ shifted("z", d) @ shifted("x", a) @ turned("x", alpha)


def modified(alpha, a, d, theta):
    return turned("x", alpha) @ shifted("x", a) @ turned("z", theta) @ shifted("z", d)


numbers = st.floats(-3.0, 3.0)


@given(
    cells=st.tuples(numbers, numbers, numbers, numbers), q=numbers, moving=st.sampled_from([2, 3]), sign=st.booleans()
)
@pytest.mark.parametrize(("convention", "matrix"), [("standard", standard), ("modified", modified)])
def test_one_row_is_the_product_of_its_four_matrices(convention, matrix, cells, q, moving, sign):
    row: list[float | str] = list(cells)
    row[moving] = f"{cells[moving]!r} {'-' if sign else '+'} q"
    values = list(cells)
    values[moving] += -q if sign else q
    (joint,) = Robot.from_dh([row], convention).joints
    assert joint.kind == ("prismatic" if moving == 2 else "revolute")
    assert np.allclose(joint.placement(q), matrix(*values), atol=1e-12)


def test_the_hand_of_a_puma_at_zero_is_where_the_data_sheet_says():
    placement = np.eye(4)
    for joint in Robot.from_dh(PUMA).joints:
        placement = placement @ joint.placement(0.0)
    assert np.allclose(placement[:3, 3], [0.4318 + 0.0203, -0.15005, 0.4318], atol=1e-12)


def test_names_order_and_unknown_inertia():
    robot = Robot.from_dh(PUMA, name="puma", gravity=(0, -9.8, 0))
    assert robot.joint_names == tuple(f"joint{number}" for number in range(1, 7))
    assert robot.link_names == tuple(f"link{number}" for number in range(1, 7))
    assert [joint.parent for joint in robot.joints] == [-1, 0, 1, 2, 3, 4]
    assert robot.gravity.tolist() == [0.0, -9.8, 0.0]
    assert len(robot.parameters) == 60
    assert np.isnan(robot.parameters).all()


def test_the_wam_of_the_thesis_has_exact_placements(thesis_tables):
    with (thesis_tables / "table_4_1_wam_dh_standard.csv").open() as file:
        rows = [row[1:] for row in list(csv.reader(file))[1:]]
    robot = Robot.from_dh(rows)
    for joint in robot.joints:
        for matrix in (joint.before, joint.after):
            assert set(np.unique(matrix[:3, :3])) <= {-1.0, 0.0, 1.0}
    assert robot.joints[2].before[2, 3] == 0.55
    assert robot.joints[3].after[0, 3] == -0.045


@pytest.mark.parametrize(
    ("cell", "constant", "sign"),
    [
        ("q", 0.0, 1),
        ("q1", 0.0, 1),
        ("q_1", 0.0, 1),
        (" q + pi/2 ", math.pi / 2, 1),
        ("pi - q", math.pi, -1),
        ("-(q - 0.5*pi)", math.pi / 2, -1),
        ("2*q/2 - 3", -3.0, 1),
        ("+q + 1e-1", 0.1, 1),
    ],
)
def test_expressions(cell, constant, sign):
    (joint,) = Robot.from_dh([(0, 0, 0, cell)]).joints
    assert np.allclose(joint.placement(0.3), turned("z", constant + sign * 0.3), atol=1e-15)


GOOD = (0, 0, 0, "q")


@pytest.mark.parametrize(
    ("rows", "phrase"),
    [
        ([], "has no rows"),
        ("q", "rows of four cells"),
        ([GOOD, (0, 0, "q")], r"row 2: four cells .* were expected"),
        ([GOOD, "abcd"], r"row 2: four cells"),
        ([(0, 0, 0, 0)], "exactly one of d and theta must hold q, but neither does"),
        ([(0, 0, "q", "q")], "but both do"),
        ([("q", 0, 0, "q")], "only d or theta may hold q, but alpha"),
        ([(0, "q", 0, 0)], "only d or theta may hold q, but a is"),
        ([(0, 0, 0, "2*q")], "coefficient 1 or -1, got 2"),
        ([GOOD, (0, 0, 0, "q1")], "'q1' stands in the row of joint 2"),
        ([(0, 0, 0, "q*q")], "must be a sum of numbers, q and lengths with constant factors"),
        ([(0, 0, 0, "1/q")], "must be a sum of numbers, q and lengths with constant factors"),
        ([(0, 0, 0, "sin(q)")], "only numbers, pi, q"),
        ([(0, 0, 0, "q**1")], "only numbers, pi, q"),
        ([(0, 0, 0, "q + phi")], "'phi' is unknown"),
        ([(0, 0, 0, "__import__('os').getcwd()")], "only numbers, pi, q"),
        ([(0, 0, 0, "q + 1/0")], "divides by zero"),
        ([(0, 0, 0, "q +")], "not a valid expression"),
        ([(0, 0, 0, "(" * 300 + "q" + ")" * 300)], "too long"),
        ([(0, 0, 0, "")], "not a valid expression"),
        ([(math.nan, 0, 0, "q")], "row 1, alpha: a value below 1e\\+15 was expected, got nan"),
        ([(0, 0, 0, "q + 1e999")], "a value below"),
        ([(None, 0, 0, "q")], r"a number or an expression .* was expected, got None"),
        ([(True, 0, 0, "q")], r"a number or an expression .* was expected, got True"),
        ([("True", 0, 0, "q")], "True and False are no numbers"),
    ],
)
def test_broken_tables_are_refused(rows, phrase):
    with pytest.raises(InputError, match=phrase):
        Robot.from_dh(rows)


def test_an_unknown_convention_is_refused():
    with pytest.raises(InputError, match='must be "standard" or "modified", got \'craig\''):
        Robot.from_dh([GOOD], convention="craig")


@pytest.mark.parametrize("gravity", [(0, 0), "down", (0, 0, math.inf), 9.81])
def test_a_broken_gravity_is_refused(gravity):
    with pytest.raises(InputError, match="gravity must be"):
        Robot.from_dh([GOOD], gravity=gravity)


def test_a_locked_row_is_merged_at_its_position():
    rows = [("pi/2", 0.1, 0.3, "q"), ("-pi/2", 0.4, 0.05, "q"), (0.3, 0, "q", 0.2), ("pi/2", 0.2, 0, "q")]
    inertias = {
        f"link{number}": Inertia.from_com(number, (0.1, 0.02 * number, -0.03), np.diag([0.02, 0.03, 0.025]))
        for number in range(1, 5)
    }
    free = Model(Robot.from_dh(rows, inertias=inertias))
    held = Model(Robot.from_dh(rows, inertias=inertias, locked={"joint2": 0.7}))
    assert held.robot.joint_names == ("joint1", "joint3", "joint4")
    assert held.robot.links[0].absorbed == ("link2",)
    q, dq, ddq = np.random.default_rng(3).uniform(-1, 1, (3, 20, 4))
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.7, 0.0, 0.0
    kept = [0, 2, 3]
    expected = free.inverse_dynamics(q, dq, ddq, free.robot.parameters)[:, kept]
    torque = held.inverse_dynamics(q[:, kept], dq[:, kept], ddq[:, kept], held.robot.parameters)
    assert np.abs(torque - expected).max() < 1e-12


def test_what_is_said_of_rows_that_cannot_be_locked():
    rows = [(0, 0.3, 0, "q"), (0, "a2", 0, "q")]
    with pytest.raises(InputError, match='there is no joint "joint3" to lock'):
        Robot.from_dh(rows, locked=["joint3"])
    with pytest.raises(InputError, match='"joint2" is locked, but its length a2 is a symbol; give it a number'):
        Robot.from_dh(rows, locked=["joint2"])
    with pytest.raises(InputError, match="no joint moves"):
        Robot.from_dh([(0, 0.3, 0, "q")], locked=["joint1"])
    # The lengths of a moving row stay symbols, turned with what is locked before it.
    assert Robot.from_dh([("pi/2", 0, 0, "q"), (0, 0, "d2", "q")], locked=["joint1"]).joints[0].before_lengths == {
        "d2": (0.0, -1.0, 0.0)
    }
    unknown = Robot.from_dh(rows, inertias={"link1": Inertia.from_com(1.0, (0, 0, 0), np.eye(3))})
    assert unknown.links[1].inertia is None
