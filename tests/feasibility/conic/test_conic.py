import numpy as np
import pytest
import scipy.optimize
import scipy.sparse as sparse

from steelyard.errors import SolverError
from steelyard.feasibility import Cone, ConicProblem, Outcome, solve
from steelyard.feasibility.lmi import symmetric_to_vector


def problem(P, q, A, b, *cones):
    return ConicProblem(sparse.csc_array(P), np.asarray(q), sparse.csc_array(A), np.asarray(b), cones)


def test_smallest_eigenvalue_as_semidefinite_problem():
    matrix = np.random.default_rng(0).normal(size=(5, 5))
    matrix = matrix + matrix.T
    unit = symmetric_to_vector(np.eye(5))[:, None]
    solution = solve(problem(np.zeros((1, 1)), [-1.0], unit, symmetric_to_vector(matrix), Cone("semidefinite", 5)))
    assert solution.outcome is Outcome.SOLVED
    assert solution.primal[0] == pytest.approx(np.linalg.eigvalsh(matrix)[0], abs=1e-6)


def test_nonnegative_least_squares():
    rng = np.random.default_rng(1)
    M, y = rng.normal(size=(12, 4)), rng.normal(size=12)
    expected, _ = scipy.optimize.nnls(M, y)
    solution = solve(problem(2 * M.T @ M, -2 * M.T @ y, -np.eye(4), np.zeros(4), Cone("nonnegative", 4)))
    np.testing.assert_allclose(solution.primal, expected, atol=1e-6)


def test_equation_and_second_order_cone():
    # The point of the unit disc with x = 0.6 and the largest y.
    A = np.vstack([[1.0, 0.0], [0.0, 0.0], -np.eye(2)])
    cones = (Cone("zero", 1), Cone("second-order", 3))
    solution = solve(problem(np.zeros((2, 2)), [0.0, -1.0], A, [0.6, 1.0, 0.0, 0.0], *cones))
    np.testing.assert_allclose(solution.primal, [0.6, 0.8], atol=1e-6)


def test_infeasible_problem_says_so_with_a_proof():
    A, b = np.array([[-1.0], [1.0]]), np.array([-1.0, 0.0])  # x >= 1 and x <= 0
    solution = solve(problem(np.zeros((1, 1)), [0.0], A, b, Cone("nonnegative", 2)))
    assert solution.outcome is Outcome.INFEASIBLE
    assert solution.dual @ A[:, 0] == pytest.approx(0.0, abs=1e-6)
    assert solution.dual @ b < 0
    with pytest.raises(SolverError, match="could not find x: no point satisfies the constraints"):
        solution.require("find x")


def test_unbounded_problem_says_so():
    solution = solve(problem(np.zeros((1, 1)), [1.0], [[1.0]], [0.0], Cone("nonnegative", 1)))
    assert solution.outcome is Outcome.UNBOUNDED
