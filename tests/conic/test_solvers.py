"""Every solver with problems whose answers are known in closed form."""

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from steelyard.conic import Cone, ConicProblem, Outcome, SemidefiniteProgram, solve
from steelyard.conic.problem import (
    dual_error,
    infeasibility_error,
    least_distance,
    optimality_error,
    recession_error,
)
from steelyard.errors import InputError, SolverError
from steelyard.lmi import symmetric_to_vector

# What the solvers promise: errors of interior-point methods and of a first-order one are of this size.
TOLERANCE = {"clarabel": 1e-7, "scs": 1e-5, "csdp": 1e-6, "dsdp": 1e-6, "sdpa": 3e-6}


def symmetric(rng, size):
    matrix = rng.normal(size=(size, size))
    return matrix + matrix.T


def check_optimal(problem, solution, tolerance):
    assert solution.outcome is Outcome.SOLVED, solution.status
    error = optimality_error(problem, solution.primal, solution.slack, solution.dual)
    # The gradient of a quadratic objective, as a Schur complement, to the square root.
    assert error < (1e-4 if problem.P.count_nonzero() else 10 * tolerance)
    assert least_distance(problem.cones, problem.b - problem.A @ solution.primal) > -1e-5


def test_smallest_eigenvalue(solver, conic):
    for size in (1, 2, 5, 9):
        matrix = symmetric(np.random.default_rng(size), size)
        unit = symmetric_to_vector(np.eye(size))
        problem = conic(None, [-1.0], unit, symmetric_to_vector(matrix), Cone("semidefinite", size))
        solution = solve(problem, solver=solver)
        check_optimal(problem, solution, TOLERANCE[solver])
        assert solution.objective == pytest.approx(-np.linalg.eigvalsh(matrix)[0], abs=TOLERANCE[solver])


def test_sum_of_largest_eigenvalues(solver):
    """Minimise k t + tr Z subject to t 1 + Z ⪰ A, Z ⪰ 0: the sum of the k largest eigenvalues (Ky Fan)."""
    rng, size, k = np.random.default_rng(3), 4, 2
    matrix = symmetric(rng, size)
    pairs = [(i, j) for i in range(size) for j in range(i, size)]
    blocks = [[matrix, np.zeros((size, size))], [np.eye(size), np.zeros((size, size))]]
    for i, j in pairs:
        unit = np.zeros((size, size))
        unit[i, j] = unit[j, i] = 1.0
        blocks.append([unit, unit])
    program = SemidefiniteProgram.from_matrices([k, *(float(i == j) for i, j in pairs)], blocks)
    expected = np.linalg.eigvalsh(matrix)[-k:].sum()
    assert program.solve(solver=solver).objective == pytest.approx(expected, abs=10 * TOLERANCE[solver])


def test_nonnegative_least_squares(solver, conic):
    rng = np.random.default_rng(1)
    M, y = rng.normal(size=(12, 4)), rng.normal(size=12)
    expected, norm = scipy.optimize.nnls(M, y)
    problem = conic(2 * M.T @ M, -2 * M.T @ y, -np.eye(4), np.zeros(4), Cone("nonnegative", 4))
    solution = solve(problem, solver=solver)
    check_optimal(problem, solution, TOLERANCE[solver])
    np.testing.assert_allclose(solution.primal, expected, atol=2e-4)
    assert solution.objective + y @ y == pytest.approx(norm**2, rel=10 * TOLERANCE[solver])


def test_nearest_semidefinite_matrix(solver, conic):
    """In the Frobenius norm: the negative eigenvalues set to zero (Higham 1988)."""
    matrix = symmetric(np.random.default_rng(2), 4)
    values, vectors = np.linalg.eigh(matrix)
    expected = (vectors * np.maximum(values, 0)) @ vectors.T
    given = symmetric_to_vector(matrix)
    problem = conic(2 * np.eye(10), -2 * given, -np.eye(10), np.zeros(10), Cone("semidefinite", 4))
    solution = solve(problem, solver=solver)
    check_optimal(problem, solution, TOLERANCE[solver])
    np.testing.assert_allclose(solution.primal, symmetric_to_vector(expected), atol=2e-4)
    assert solution.objective + given @ given == pytest.approx((np.minimum(values, 0) ** 2).sum(), rel=1e-5)


def test_equation_and_second_order_cone(solver, conic):
    # The point of the unit disc with x = 0.6 and the largest y.
    A = np.vstack([[1.0, 0.0], [0.0, 0.0], -np.eye(2)])
    problem = conic(None, [0.0, -1.0], A, [0.6, 1.0, 0.0, 0.0], Cone("zero", 1), Cone("second-order", 3))
    solution = solve(problem, solver=solver)
    check_optimal(problem, solution, TOLERANCE[solver])
    np.testing.assert_allclose(solution.primal, [0.6, 0.8], atol=1e-5)


def test_equality_constrained_least_squares(solver, conic):
    """The KKT system of a quadratic programme without inequalities."""
    rng = np.random.default_rng(4)
    M, E = rng.normal(size=(8, 6)), rng.normal(size=(2, 6))
    y, f = rng.normal(size=8), rng.normal(size=2)
    system = np.block([[M.T @ M, E.T], [E, np.zeros((2, 2))]])
    expected = np.linalg.solve(system, np.concatenate([M.T @ y, f]))
    # In the variables (residual, x), as fits are written.
    A = np.vstack([np.hstack([-np.eye(8), M]), np.hstack([np.zeros((2, 8)), E])])
    P = np.diag([1.0] * 8 + [0.0] * 6)
    problem = conic(P, np.zeros(14), A, np.concatenate([y, f]), Cone("zero", 10))
    solution = solve(problem, solver=solver)
    check_optimal(problem, solution, TOLERANCE[solver])
    np.testing.assert_allclose(solution.primal[8:], expected[:6], atol=3e-4)
    np.testing.assert_allclose(solution.dual[8:], expected[6:], atol=3e-3)


def test_trust_region(solver, conic):
    """Minimise a quadratic within a ball: (P + λ 1) x = -q with |x| the radius."""
    rng = np.random.default_rng(6)
    M, q, radius = rng.normal(size=(3, 3)), rng.normal(size=3), 0.2
    P = M.T @ M
    multiplier = scipy.optimize.brentq(
        lambda m: np.linalg.norm(np.linalg.solve(P + m * np.eye(3), q)) - radius, 1e-9, 1e4
    )
    expected = -np.linalg.solve(P + multiplier * np.eye(3), q)
    A = np.vstack([np.zeros((1, 3)), -np.eye(3)])
    problem = conic(P, q, A, [radius, 0, 0, 0], Cone("second-order", 4))
    solution = solve(problem, solver=solver)
    check_optimal(problem, solution, TOLERANCE[solver])
    np.testing.assert_allclose(solution.primal, expected, atol=1e-4)


def test_upper_triangle_of_the_objective_is_enough(solver, conic):
    P = np.array([[2.0, 1.0], [1.0, 2.0]])
    problem = conic(np.triu(P), [-1.0, 0.0], -np.eye(2), [5.0, 5.0], Cone("nonnegative", 2))
    solution = solve(problem, solver=solver)
    np.testing.assert_allclose(solution.primal, np.linalg.solve(P, [1.0, 0.0]), atol=2e-4)
    assert solution.objective == pytest.approx(-0.5 * 2 / 3, abs=1e-5)


def test_linear_programme(solver, conic):
    rng = np.random.default_rng(7)
    A = np.vstack([rng.normal(size=(9, 3)), -np.eye(3), np.eye(3)])
    b = np.concatenate([rng.uniform(0.5, 1, 9), 10 * np.ones(6)])
    q = rng.normal(size=3)
    expected = scipy.optimize.linprog(q, A, b, bounds=(None, None))
    problem = conic(None, q, A, b, Cone("nonnegative", 15))
    solution = solve(problem, solver=solver)
    check_optimal(problem, solution, TOLERANCE[solver])
    assert solution.objective == pytest.approx(expected.fun, abs=10 * TOLERANCE[solver])
    np.testing.assert_allclose(solution.dual, -expected.ineqlin.marginals, atol=1e-3)


def test_lyapunov_inequality(solver):
    """Minimise tr X subject to X ⪰ 0 and AᵀX + X A + Q ⪯ 0, A stable: the solution of the Lyapunov equation."""
    rng = np.random.default_rng(8)
    A = rng.normal(size=(3, 3)) - 4 * np.eye(3)
    expected = scipy.linalg.solve_continuous_lyapunov(A.T, -np.eye(3))
    cost, blocks = [], [[np.zeros((3, 3)), np.eye(3)]]
    for i in range(3):
        for j in range(i, 3):
            unit = np.zeros((3, 3))
            unit[i, j] = unit[j, i] = 1.0
            cost.append(float(i == j))
            blocks.append([unit, -(A.T @ unit + unit @ A)])
    solution = SemidefiniteProgram.from_matrices(cost, blocks).solve(solver=solver)
    assert solution.objective == pytest.approx(np.trace(expected), rel=1e-5)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_sizes_that_differ(solver, conic, scale):
    """Diagonal congruences and units of the unknowns change nothing."""
    rng = np.random.default_rng(9)
    matrix = symmetric(rng, 3) - 5 * np.eye(3)
    units = np.array([scale, 1.0, 1.0 / scale])
    both = np.outer(units, units)
    # Minimise x with S (x 1 + M) S ⪰ 0.
    unit, given = symmetric_to_vector(np.eye(3) * both), symmetric_to_vector(matrix * both)
    problem = conic(None, [1.0], -unit, given, Cone("semidefinite", 3))
    solution = solve(problem, solver=solver)
    assert solution.outcome is Outcome.SOLVED
    assert solution.objective == pytest.approx(-np.linalg.eigvalsh(matrix)[0], rel=1e-5)


def infeasible(conic):
    yield conic(None, [0.0], [[-1.0], [1.0]], [-1.0, 0.0], Cone("nonnegative", 2))  # x >= 1 and x <= 0
    yield conic(None, [1.0, 0.0], [[1, 1], [1, 1.0], [-1, 0]], [1.0, 2.0, 5.0], Cone("zero", 2), Cone("nonnegative", 1))
    # [[x, 1], [1, -x]] is never semidefinite.
    A, b = np.array([[-1.0], [0.0], [1.0]]), np.array([0.0, np.sqrt(2.0), 0.0])
    yield conic(np.eye(1), [1.0], A, b, Cone("semidefinite", 2))
    # A constant: -1 >= 0, beside something to solve.
    yield conic(None, [1.0], [[-1.0], [0.0]], [0.0, -1.0], Cone("nonnegative", 2))
    # A constant block of a matrix, and a ball that a line misses.
    yield conic(
        None,
        [1.0],
        [[-1.0], [0], [0], [0]],
        [0.0, 1.0, np.sqrt(8.0), 1.0],
        Cone("nonnegative", 1),
        Cone("semidefinite", 2),
    )
    A = np.vstack([[[1.0, 0.0]], np.zeros((1, 2)), -np.eye(2)])
    yield conic(None, [0.0, 1.0], A, [3.0, 1.0, 0, 0], Cone("zero", 1), Cone("second-order", 3))


@pytest.mark.parametrize("index", range(6))
def test_infeasible_problems_say_so_with_a_proof(solver, conic, index):
    problem = list(infeasible(conic))[index]
    solution = solve(problem, solver=solver)
    assert solution.outcome is Outcome.INFEASIBLE, solution.status
    # Aᵀz = 0 and bᵀz < 0 with z in the dual cone.
    assert infeasibility_error(problem, solution.dual) < 1e-5
    size = -problem.b @ solution.dual
    dual_cones = tuple(cone for cone in problem.cones if cone.kind != "zero")
    rest = solution.dual[sum(cone.rows for cone in problem.cones if cone.kind == "zero") :]
    assert least_distance(dual_cones, rest / size) > -1e-5
    with pytest.raises(SolverError, match="could not find x: no point satisfies the constraints"):
        solution.require("find x")


def unbounded(conic):
    yield conic(None, [1.0], [[1.0]], [0.0], Cone("nonnegative", 1))
    yield conic(None, [1.0, 0.0], [[0.0, 1.0]], [1.0], Cone("nonnegative", 1))  # x is free of any constraint
    # Minimise -x subject to [[1, y], [y, x]] ⪰ 0.
    A = np.array([[0.0, 0.0], [0.0, -np.sqrt(2.0)], [-1.0, 0.0]])
    yield conic(np.diag([0.0, 1.0]), [-1.0, 0.0], A, [1.0, 0.0, 0.0], Cone("semidefinite", 2))
    yield conic(None, [0.0, -1.0], [[1.0, -1.0], [-1.0, 0.0]], [0.0, 0.0], Cone("zero", 1), Cone("nonnegative", 1))


@pytest.mark.parametrize("index", range(4))
def test_unbounded_problems_say_so(solver, conic, index):
    problem = list(unbounded(conic))[index]
    solution = solve(problem, solver=solver)
    assert solution.outcome is Outcome.UNBOUNDED, solution.status
    assert recession_error(problem, solution.primal) < 1e-5


def test_problems_without_anything_to_solve(solver, conic):
    nothing = solve(conic(None, [], np.zeros((2, 0)), [1.0, 0.0], Cone("nonnegative", 2)), solver=solver)
    assert nothing.outcome is Outcome.SOLVED
    assert nothing.primal.shape == (0,)
    fixed = solve(conic(None, [1.0, 1.0], np.eye(2), [3.0, 4.0], Cone("zero", 2)), solver=solver)
    np.testing.assert_allclose(fixed.primal, [3.0, 4.0], atol=1e-6)
    np.testing.assert_allclose(fixed.dual, [-1.0, -1.0], atol=1e-6)
    free = solve(conic(np.eye(2), [-1.0, -2.0], np.zeros((0, 2)), []), solver=solver)
    np.testing.assert_allclose(free.primal, [1.0, 2.0], atol=1e-3)


def test_empty_cones_and_unused_variables(solver, conic):
    A = np.array([[-1.0, 0.0], [-1.0, 0.0]])
    cones = (Cone("zero", 0), Cone("nonnegative", 1), Cone("semidefinite", 0), Cone("second-order", 1))
    solution = solve(conic(None, [1.0, 0.0], A, [-2.0, -3.0], *cones), solver=solver)
    assert solution.outcome is Outcome.SOLVED
    assert solution.primal[0] == pytest.approx(3.0, abs=1e-5)


def test_random_problems_agree_with_another_modeller(solver, conic):
    """Random objective, equations, bounds and two matrices, against CVXPY's own path through its solver."""
    cvxpy = pytest.importorskip("cvxpy", reason="CVXPY is not installed")
    for seed in range(3):
        rng = np.random.default_rng(seed)
        count = 5
        F = [symmetric(rng, 3) for _ in range(count)]
        G = [symmetric(rng, 4) for _ in range(count)]
        E = rng.normal(size=(1, count))
        inside = rng.normal(size=count)
        constants = [
            np.eye(d) * rng.uniform(0.1, 2) - sum(v * m for v, m in zip(inside, matrices, strict=True))
            for d, matrices in ((3, F), (4, G))
        ]
        M, y = rng.normal(size=(4, count)), rng.normal(size=4)
        A = np.vstack(
            [
                E,
                np.eye(count),
                -np.array([symmetric_to_vector(f) for f in F]).T,
                -np.array([symmetric_to_vector(g) for g in G]).T,
            ]
        )
        b = np.concatenate([E @ inside, inside + 1.0, *(symmetric_to_vector(c) for c in constants)])
        cones = (Cone("zero", 1), Cone("nonnegative", count), Cone("semidefinite", 3), Cone("semidefinite", 4))
        problem = conic(2 * M.T @ M, -2 * M.T @ y, A, b, *cones)

        x = cvxpy.Variable(count)
        constraints = [E @ x == E @ inside, x <= inside + 1.0]
        for constant, matrices in zip(constants, (F, G), strict=True):
            constraints.append(constant + sum(x[k] * matrices[k] for k in range(count)) >> 0)
        reference = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(M @ x - y)), constraints)
        expected = reference.solve(solver=cvxpy.CLARABEL)
        solution = solve(problem, solver=solver)
        check_optimal(problem, solution, TOLERANCE[solver])
        assert solution.objective + y @ y == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize("name", ["clarabel", "scs"])
def test_exponential_cone(name, conic):
    """The largest entropy on the simplex is log n; with a mean prescribed it is that of a Boltzmann distribution."""
    if name == "scs":
        pytest.importorskip("scs", reason="SCS is not installed")
    levels, mean = np.array([0.0, 1.0, 2.0]), 0.6
    # Variables (p, t) with t_i <= -p_i log p_i: (t_i, p_i, 1) in the cone.
    A = [[1, 1, 1, 0, 0, 0], [*levels, 0, 0, 0]]
    b = [1.0, mean]
    for i in range(3):
        rows = np.zeros((3, 6))
        rows[0, 3 + i], rows[1, i] = -1.0, -1.0
        A += rows.tolist()
        b += [0.0, 0.0, 1.0]
    problem = conic(None, [0, 0, 0, -1, -1, -1], A, b, Cone("zero", 2), *[Cone("exponential", 3)] * 3)

    def boltzmann(slope):
        weights = np.exp(-slope * levels)
        return weights / weights.sum()

    slope = scipy.optimize.brentq(lambda s: boltzmann(s) @ levels - mean, -10, 10)
    solution = solve(problem, solver=name)
    assert solution.outcome is Outcome.SOLVED
    np.testing.assert_allclose(solution.primal[:3], boltzmann(slope), atol=1e-5)
    assert dual_error(problem, solution.primal, solution.dual) < 1e-6


@pytest.mark.parametrize("name", ["csdp", "dsdp", "sdpa"])
def test_exponential_cone_is_refused(name, conic):
    problem = conic(None, [0, 0, 1], -np.eye(3), np.zeros(3), Cone("exponential", 3))
    with pytest.raises(InputError, match='does not take the exponential cone; use solver="clarabel" or solver="scs"'):
        solve(problem, solver=name)


@pytest.mark.parametrize(
    ("P", "q", "A", "b", "cones", "words"),
    [
        (np.eye(2), [1.0], [[1.0]], [1.0], [("nonnegative", 1)], r"P of shape \(1, 1\)"),
        (np.eye(1), [1.0], [[1.0, 2.0]], [1.0], [("nonnegative", 1)], r"A of shape \(1, 1\)"),
        (np.eye(1), [1.0], [[1.0]], [1.0], [("semidefinite", 2)], "1 rows together, got .* and 3"),
        (np.eye(1), [np.nan], [[1.0]], [1.0], [("nonnegative", 1)], "q of a conic problem must be finite"),
        (np.eye(1), [1.0], [[np.inf]], [1.0], [("nonnegative", 1)], "A of a conic problem must be finite"),
    ],
)
def test_problems_that_do_not_fit_together(P, q, A, b, cones, words):
    with pytest.raises(InputError, match=words):
        ConicProblem(P, np.array(q), np.array(A), np.array(b), tuple(Cone(*cone) for cone in cones))


@pytest.mark.parametrize(("kind", "size"), [("exponential", 4), ("psd", 3), ("zero", -1)])
def test_cones_that_do_not_exist(kind, size):
    with pytest.raises(InputError):
        Cone(kind, size)
