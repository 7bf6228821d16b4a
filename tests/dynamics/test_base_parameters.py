"""Base parameters: the rank against theory, and the map against the regressor, on robots of many kinds."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_questions import mimicking

import steelyard as sy
from steelyard.dynamics.base_parameters import base_parameters_of


def test_planar_two_link_arm_has_the_textbook_parameters():
    """Two links in a vertical plane: the textbook names three inertial and two gravity groups (lx, ly of each link)."""
    robot = sy.Robot.from_dh([(0, 0.7, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0))
    base = sy.Model(robot).base_parameters()
    # Link frames stand at the far ends: about the joint, a body has Lzz + 2 a lx + a² m and lx + a m, and the former
    # less 2 a times the latter is Lzz - a² m.
    expected = {
        "Lzz1": {"Lzz1": 1.0, "m1": -0.49, "m2": -0.49},
        "lx1": {"lx1": 1.0, "m1": 0.7, "m2": 0.7},
        "ly1": {"ly1": 1.0},
        "Lzz2": {"Lzz2": 1.0, "m2": -0.16},
        "lx2": {"lx2": 1.0, "m2": 0.4},
        "ly2": {"ly2": 1.0},
    }
    names = base.parameter_names
    ours = {name: {names[k]: row[k] for k in np.flatnonzero(row)} for name, row in zip(base.names, base.K, strict=True)}
    assert ours == expected


@pytest.mark.parametrize("joints", [2, 3, 4, 5, 6, 7])
def test_general_revolute_arm_has_the_number_of_theory(joints, random):
    """A first joint parallel to gravity leaves its link one parameter, each other has seven (Mayeda et al. 1990)."""
    rows = [(float(random.uniform(0.4, 1.2)), *random.uniform(0.1, 0.6, 2), "q") for _ in range(joints)]
    base = sy.Model(sy.Robot.from_dh(rows)).base_parameters()
    assert base.count == 1 + 7 * (joints - 1)
    assert base.gap > 1e6


@settings(max_examples=settings.default.max_examples // 4)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.0, "pi/2", "-pi/2", 0.3]),
            st.sampled_from([0.0, 0.4, -0.25]),
            st.sampled_from(["revolute", "prismatic"]),
            st.sampled_from([0.0, 0.3]),
        ),
        min_size=1,
        max_size=5,
    ),
    st.sampled_from([(0, 0, -9.81), (0, -9.81, 0), (0, 0, 0), (3.0, -4.0, 5.0)]),
)
def test_the_map_keeps_the_torques(joints, gravity):
    rows = [(a, b, "q", d) if kind == "prismatic" else (a, b, d, "q") for a, b, kind, d in joints]
    robot = sy.Robot.from_dh(rows, gravity=gravity).with_terms(sy.Viscous(), sy.RotorInertia())
    model = sy.Model(robot)
    base = model.base_parameters()
    random = np.random.default_rng(1)
    q, dq, ddq = random.normal(size=(3, 40, robot.dof))
    regressor = model.regressor(q, dq, ddq).reshape(-1, model.parameter_count)
    independent = regressor[:, base.independent]
    np.testing.assert_allclose(independent @ base.K, regressor, atol=1e-9 * np.abs(regressor).max())
    assert np.linalg.matrix_rank(independent, tol=1e-9 * np.linalg.norm(independent)) == base.count
    # Left-most: each dependent column is a combination of independent ones to its left.
    for column, coefficients in zip(base.dependent, base.Kd.T, strict=True):
        assert np.all(base.independent[np.flatnonzero(coefficients)] < column)
    np.testing.assert_array_equal(base.Pb @ base.Pb.T + base.Pd @ base.Pd.T, np.eye(model.parameter_count))
    delta = random.normal(size=model.parameter_count)
    np.testing.assert_allclose(base.values(delta), base.K @ delta)


ROWS = st.lists(
    st.tuples(
        st.sampled_from([0.0, "pi/2", 0.3, -1.01]),
        st.sampled_from([0.0, 0.4, -0.25]),
        st.sampled_from(["revolute", "prismatic"]),
        st.sampled_from([0.0, 0.3]),
    ),
    min_size=2,
    max_size=4,
)


@settings(max_examples=settings.default.max_examples // 4)
@given(
    ROWS, st.sampled_from([(0, 0, -9.81), (0, 0, 0), (3.0, -4.0, 5.0)]), st.integers(0, 999), st.sampled_from("ncmw")
)
@example([(0.3, 0.4, "prismatic", 0.3), (-1.01, 0.4, "revolute", 0.3)], (0, 0, -9.81), 0, "c")
def test_the_rank_is_that_of_the_torques(joints, gravity, seed, kind):
    """Rotors, offsets, coupled motors and mimic joints beside links, which may look like one another."""
    rng = np.random.default_rng(seed)
    rows = [(a, b, "q", d) if kind == "prismatic" else (a, b, d, "q") for a, b, kind, d in joints]
    robot = sy.Robot.from_dh(rows, gravity=gravity)
    if kind in "mw":
        joint = int(rng.integers(1, len(rows)))
        robot = mimicking(robot, joint, int(rng.integers(0, joint)), float(rng.choice([1.0, -1.0, 2.0, 0.7])))
    terms = [sy.RotorInertia(), sy.Offset(), sy.Viscous(), sy.Coulomb()]
    if kind in "cw":
        terms.append(sy.MotorSide(np.eye(robot.dof) + np.triu(rng.choice([0, 0.5, -1.0], (robot.dof,) * 2), 1)))
    model = sy.Model(robot.with_terms(*terms))
    base = model.base_parameters()
    q, dq, ddq = rng.normal(size=(3, 100, robot.dof))
    regressor = model.regressor(q, dq, ddq).reshape(-1, model.parameter_count)
    lengths = np.linalg.norm(regressor, axis=0)
    shown = lengths > 1e-12 * lengths.max()  # others are zero but for rounding
    scaled = regressor[:, shown] / lengths[shown]
    assert base.count == np.linalg.matrix_rank(scaled, tol=1e-10)
    rest = regressor - regressor[:, base.independent] @ base.K
    assert np.abs(rest).max() <= 1e-13 * np.abs(regressor).max()


def test_names_read_well(wam):
    base = wam.base_parameters()
    assert base.expressions[:4] == ("Lyy1 + Iam1 + Lzz2", "Fvj1 + Fvm1", "Fcj1 + Fcm1", "Foj1 - Fom1")
    assert "0.300475*m3" in base.expressions[4]
    assert repr(base).startswith("BaseParameters(76 of 119")


def test_nearly_aligned_axes_count_as_aligned():
    """Angles such as 1.5708 show no more parameters than right ones; what they leak no log could show."""
    exact = [("pi/2", 0.0, 0.3, "q"), ("-pi/2", 0.0, 0.0, "q"), (0.0, 0.2, 0.0, "q")]
    rounded = [(1.5708, 0.0, 0.3, "q"), (-1.5708, 0.0, 0.0, "q"), (0.0, 0.2, 0.0, "q")]
    a, b = (sy.Model(sy.Robot.from_dh(rows)).base_parameters() for rows in (exact, rounded))
    assert a.names == b.names
    np.testing.assert_allclose(a.K, b.K, atol=1e-4)
    assert min(a.gap, b.gap) > 1e9


def test_a_matrix_of_known_rank(random):
    columns = random.normal(size=(200, 4))
    matrix = np.column_stack([columns[:, 0], 2.0 * columns[:, 0], columns[:, 1:], columns @ [1.1, 0.0, -0.25, 3.0]])
    matrix = np.column_stack([matrix, np.zeros(200)])
    base = base_parameters_of(matrix, tuple("abcdefg"))
    assert base.names == ("a", "c", "d", "e")
    assert base.expressions == ("a + 2*b + 1.1*f", "c", "d - 0.25*f", "e + 3*f")
