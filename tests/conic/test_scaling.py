import numpy as np
import pytest

from steelyard.conic import Cone, Outcome, solve
from steelyard.conic.problem import optimality_error
from steelyard.conic.scaling import Scaling, equilibrate, scaling_around
from steelyard.lmi import symmetric_to_vector, vector_to_symmetric


@pytest.fixture
def mixed(conic):
    """A problem with all kinds of cones, elements from 1e-5 to 1e5."""
    rng = np.random.default_rng(3)
    cones = (Cone("zero", 1), Cone("nonnegative", 3), Cone("second-order", 4), Cone("semidefinite", 3),
             Cone("exponential", 3))  # fmt: skip
    rows = sum(cone.rows for cone in cones)
    A = rng.normal(size=(rows, 4)) * 10.0 ** rng.integers(-5, 6, size=(rows, 4))
    return conic(np.diag([1e4, 0.0, 1e-4, 1.0]), rng.normal(size=4), A, rng.normal(size=rows), *cones)


def test_equilibrated_rows_and_columns_are_near_one(conic):
    rng = np.random.default_rng(4)
    units = 10.0 ** rng.integers(-3, 4, size=6)
    F = [(m + m.T) * np.outer(units, units) for m in rng.normal(size=(5, 6, 6))]
    A = np.array([symmetric_to_vector(f) for f in F]).T * 10.0 ** rng.integers(-4, 5, size=5)
    problem = conic(None, np.ones(5), A, np.zeros(21), Cone("semidefinite", 6))
    scaled = abs(equilibrate(problem).apply(problem).A.toarray())
    np.testing.assert_allclose(scaled.max(axis=0), 1.0, rtol=0.1)
    largest = vector_to_symmetric(scaled.max(axis=1)).max(axis=0)
    assert largest.min() > 0.3
    assert largest.max() < 1.1


def test_cones_are_kept(mixed):
    """A congruence keeps matrices semidefinite; second-order and exponential cones have one factor."""
    scaling = equilibrate(mixed)
    square, exponential = scaling.rows[4:8], scaling.rows[14:]
    assert np.ptp(square) == 0.0
    assert np.ptp(exponential) == 0.0
    diagonal = np.sqrt(scaling.rows[[8, 10, 13]])
    expected = np.outer(diagonal, diagonal)[np.tril_indices(3)]
    np.testing.assert_allclose(scaling.rows[8:14], expected, rtol=1e-12)
    assert np.all(scaling.rows > 0)
    assert np.all(scaling.columns > 0)


def test_scaling_and_back(mixed):
    scaling = equilibrate(mixed)
    scaled = scaling.apply(mixed)
    rng = np.random.default_rng(5)
    x, z = rng.normal(size=4), rng.normal(size=len(mixed.b))
    np.testing.assert_allclose(scaled.A @ (x / scaling.columns), scaling.rows * (mixed.A @ x), rtol=1e-10)
    np.testing.assert_allclose(scaled.P @ (x / scaling.columns), scaling.columns * (mixed.P @ x), rtol=1e-10)
    np.testing.assert_allclose(scaled.A.T @ (z / scaling.rows), scaling.columns * (mixed.A.T @ z), rtol=1e-8)


def test_solution_comes_back_in_the_old_units(conic):
    problem = conic(None, [1.0, 1e4], [[-1e-4, 0.0], [0.0, -1e5]], [-1.0, -2.0], Cone("nonnegative", 2))
    solution = solve(problem)
    assert solution.outcome is Outcome.SOLVED
    np.testing.assert_allclose(solution.primal, [1e4, 2e-5], rtol=1e-5)
    np.testing.assert_allclose(solution.dual, [1e4, 0.1], rtol=1e-6)
    assert optimality_error(problem, solution.primal, solution.slack, solution.dual) < 1e-7


def test_empty_rows_columns_and_problems(conic):
    problem = conic(None, [0.0, 1.0], [[0.0, 0.0], [0.0, 5.0]], [0.0, 0.0], Cone("nonnegative", 2))
    scaling = equilibrate(problem)
    assert scaling.rows[0] == scaling.columns[0] == 1.0
    nothing = conic(None, [], np.zeros((0, 0)), [])
    assert equilibrate(nothing).rows.shape == (0,)


def test_what_is_zero_but_for_rounding_is_not_blown_up(conic):
    problem = conic(None, [0.0, 1.0], [[1e-17, 0.0], [0.0, 5.0]], [0.0, 0.0], Cone("nonnegative", 2))
    scaling = equilibrate(problem)
    assert scaling.rows.max() <= 1e8
    assert scaling.columns.max() <= 1e8


def test_units_around_a_point_give_it_ones_on_the_diagonal(conic):
    slack = np.concatenate([[7.0], [1e4, 1e-2], symmetric_to_vector(np.diag([1e6, 1.0, 1e-12]))])
    cones = (Cone("zero", 1), Cone("nonnegative", 2), Cone("semidefinite", 3))
    problem = conic(None, [0.0], np.ones((9, 1)), np.zeros(9), *cones)
    scaling = scaling_around(problem, slack, 1e-10)
    scaled = scaling.rows * slack
    np.testing.assert_allclose(scaled[1:3], 1.0)
    np.testing.assert_allclose(np.diag(vector_to_symmetric(scaled[3:])), [1.0, 1.0, 1e-8], rtol=1e-6)
    assert scaling.rows[0] == 1.0


def test_two_scalings_one_after_the_other():
    first = Scaling(np.array([2.0]), np.array([3.0]), 0.5)
    both = first.then(Scaling(np.array([5.0]), np.array([7.0]), 4.0))
    assert (both.rows[0], both.columns[0], both.objective) == (10.0, 21.0, 2.0)


@pytest.mark.parametrize("spread", [1e2, 1e4, 1e6])
def test_light_links_beside_heavy_ones(conic, spread):
    """Three blocks of very different sizes, nearest points known block by block: plainly solved."""
    rng = np.random.default_rng(6)
    rows, b, expected = [], [], 0.0
    for size in (1.0, spread**0.5, spread):
        matrix = rng.normal(size=(3, 3))
        matrix = size * (matrix + matrix.T)
        expected += (np.minimum(np.linalg.eigvalsh(matrix), 0) ** 2).sum() / size**2
        rows.append(size)
        b.append(symmetric_to_vector(matrix))
    # Unknowns are the differences, each weighted with its own size.
    P = np.diag(np.repeat([2.0 / size**2 for size in rows], 6))
    problem = conic(P, np.zeros(18), -np.eye(18), np.concatenate(b), *[Cone("semidefinite", 3)] * 3)
    solution = solve(problem)
    assert solution.status == "Solved"
    assert solution.objective == pytest.approx(expected, rel=1e-6)
