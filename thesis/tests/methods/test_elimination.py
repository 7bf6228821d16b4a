"""Backward elimination against numpy.linalg.lstsq on the reduced columns."""

import numpy as np
import pytest

from steelyard.dynamics import Coulomb, Model, Viscous
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Information
from steelyard.robot import Robot
from steelyard_thesis.methods.elimination import Elimination
from steelyard_thesis.methods.method import Problem


@pytest.fixture(scope="module")
def model():
    rows = [("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.0, "q"), ("pi/2", 0.3, 0.0, "q")]
    return Model(Robot.from_dh(rows, name="arm").with_terms(Viscous(), Coulomb()))


def regression(model, condition, seed=4, rows=300):
    """W and ω with singular values down to 1 / condition, and the Problem of them."""
    random = np.random.default_rng(seed)
    count = model.base_parameters().count
    left = np.linalg.qr(random.normal(size=(rows, count)))[0]
    right = np.linalg.qr(random.normal(size=(count, count)))[0]
    W = left @ np.diag(np.geomspace(1.0, 1.0 / condition, count)) @ right
    omega = W @ random.normal(size=count) + 0.01 * random.normal(size=rows)
    triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
    information = Information.from_factor(
        triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2), rows, model.base_parameters().names
    )
    return W, omega, Problem.of(information, FeasibleSet(model))


def expected(W, omega, kept):
    """Base parameters, squared residual and relative standard deviations of a regression on some columns."""
    solution, residual, _, _ = np.linalg.lstsq(W[:, kept], omega)
    variance = residual[0] / (len(omega) - len(kept))
    deviations = np.sqrt(variance * np.diag(np.linalg.inv(W[:, kept].T @ W[:, kept])))
    return solution, residual[0], deviations / np.abs(solution)


@pytest.mark.parametrize("condition", [10.0, 1e4])
def test_every_reduction_is_least_squares_of_the_columns_left(model, condition):
    W, omega, problem = regression(model, condition)
    elimination = Elimination(problem)
    while True:
        kept = elimination.kept
        solution, residual, deviations = expected(W, omega, kept)
        np.testing.assert_allclose(elimination.base[kept], solution, rtol=1e-9 * condition, atol=1e-11 * condition)
        np.testing.assert_array_equal(np.delete(elimination.base, kept), 0.0)
        np.testing.assert_allclose(elimination.squared_residual, residual, rtol=1e-9)
        np.testing.assert_allclose(elimination.relative_standard_deviation, deviations, rtol=1e-7 * condition)
        if len(kept) == 1:
            break
        worst = int(kept[np.argmax(deviations)])
        assert elimination.remove_weakest() == worst


def test_any_parameter_can_be_removed(model):
    W, omega, problem = regression(model, 10.0)
    elimination = Elimination(problem)
    for position in (0, 5, len(elimination.kept) - 3):
        elimination.remove(position)
    solution, residual, _ = expected(W, omega, elimination.kept)
    np.testing.assert_allclose(elimination.base[elimination.kept], solution, rtol=1e-9)
    np.testing.assert_allclose(elimination.squared_residual, residual, rtol=1e-10)
    assert sorted([*elimination.kept, *elimination.removed]) == list(range(W.shape[1]))


def test_what_the_data_does_not_determine_goes_first(model):
    W, omega, _ = regression(model, 10.0)
    W[:, 3] = 2.0 * W[:, 7]
    W[:, 5] = 0.0
    triangle = np.linalg.qr(np.column_stack([W, omega]), mode="r")
    information = Information.from_factor(
        triangle[:-1, :-1], triangle[:-1, -1], float(triangle[-1, -1] ** 2), 300, model.base_parameters().names
    )
    elimination = Elimination(Problem.of(information, FeasibleSet(model)))
    assert set(elimination.removed) in ({3, 5}, {5, 7})
    solution, residual, _ = expected(W, omega, elimination.kept)
    np.testing.assert_allclose(elimination.base[elimination.kept], solution, rtol=1e-8)
    np.testing.assert_allclose(elimination.squared_residual, residual, rtol=1e-9)
