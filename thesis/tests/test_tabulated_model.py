"""A robot that is known by its base parameters alone, against the whole model of the same robot."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics.conditions import body_conditions
from steelyard.errors import InputError
from steelyard_thesis.tabulated_model import TabulatedModel

ROWS = [("-pi/2", 0.0, 0.3, "q"), ("pi/2", 0.1, 0.4, "q"), ("0", 0.5, 0.0, "q")]


@pytest.fixture(scope="module")
def arm():
    return sy.Model(sy.Robot.from_dh(ROWS))


@pytest.fixture(scope="module")
def table(arm):
    """The same arm, from its table of base parameters."""
    base = arm.base_parameters()
    combinations = [
        {
            name: 1.0,
            **{arm.parameter_names[k]: row[k] for k in np.flatnonzero(row) if arm.parameter_names[k] != name},
        }
        for name, row in zip(base.names, base.K, strict=True)
    ]
    return TabulatedModel(arm.robot.link_names, combinations, "arm")


def test_it_has_the_parameters_of_the_whole_model(arm, table):
    assert table.parameter_names == arm.parameter_names
    np.testing.assert_array_equal(table.base_parameters().K, arm.base_parameters().K)
    assert table.base_parameters().expressions == arm.base_parameters().expressions
    assert np.isnan(table.robot.parameters).all()


@pytest.mark.parametrize("consistency", [pytest.param("inertia", marks=pytest.mark.slow), "full"])
def test_verdicts_and_corrections_are_those_of_the_whole_model(arm, table, consistency):
    random = np.random.default_rng(4)
    for _ in range(4):
        base = random.normal(size=table.base_parameters().count)
        ours = sy.check(sy.FeasibleSet(table, consistency), base=base)
        whole = sy.check(sy.FeasibleSet(arm, consistency), base=base)
        assert ours.status == whole.status
        assert ours.certificate.verify()
        near = sy.correct(sy.FeasibleSet(table, consistency), base=base).squared_distance
        expected = sy.correct(sy.FeasibleSet(arm, consistency), base=base).squared_distance
        assert near == pytest.approx(expected, rel=1e-9)


def test_conditions_are_those_of_a_body():
    """Of a unit cube of 3 kg about (1, 2, 3): by the definition of moments."""
    com, mass = np.array([1.0, 2.0, 3.0]), 3.0
    inertia = mass / 6.0 * np.eye(3) + mass * (com @ com * np.eye(3) - np.outer(com, com))
    values = np.array([*inertia[np.triu_indices(3)], *(mass * com), mass])
    (inertial,) = body_conditions(["cube"], [0], "inertia")
    (full,) = body_conditions(["cube"], [0], "full")
    matrix = np.einsum("kij,k->ij", inertial.coefficients, values)
    schur = matrix[:3, :3] - matrix[:3, 3:] @ np.linalg.inv(matrix[3:, 3:]) @ matrix[3:, :3]
    np.testing.assert_allclose(schur, mass / 6.0 * np.eye(3), atol=1e-12)  # about the centre of mass
    pseudo = np.einsum("kij,k->ij", full.coefficients, values)
    second = mass / 12.0 * np.eye(3) + mass * np.outer(com, com)
    np.testing.assert_allclose(pseudo, np.block([[second, mass * com[:, None]], [mass * com, mass]]), atol=1e-12)


def test_bad_tables_are_refused():
    with pytest.raises(InputError, match="name 'm3', which none of its 2 links has"):
        TabulatedModel(["a", "b"], [{"m1": 1.0, "m3": 1.0}])
    for combinations in ([{"m1": 2.0}], [{"m1": 1.0}, {"m2": 1.0, "m1": 1.0}], [{}]):
        with pytest.raises(InputError, match="must begin with a standard parameter of its own"):
            TabulatedModel(["a", "b"], combinations)
    with pytest.raises(InputError, match="consistency must be"):
        TabulatedModel(["a"], [{"m1": 1.0}]).conditions("thesis")
