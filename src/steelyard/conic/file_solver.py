"""Solving a conic problem with an external program: rewrite it, scale it, run the program, check the answer."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import SolverError

from .external_solver import CSDP, DSDP, SDPA, Answer, ExternalSolver, run_program
from .problem import (
    Cone,
    ConicProblem,
    ConicSolution,
    Outcome,
    dual_error,
    gap_error,
    infeasibility_error,
    least_distance,
    primal_error,
    recession_error,
)
from .rewriting import Decided, Rewritten, rewrite
from .scaling import Scaling, equilibrate, scaling_around
from .semidefinite_program import SemidefiniteProgram
from .solver import Solver

__all__ = [
    "CSDP_SOLVER",
    "DSDP_SOLVER",
    "SDPA_SOLVER",
    "infeasibility_problem",
    "recession_problem",
    "solve_with_program",
]

Vector = npt.NDArray[np.float64]

SOLVED_ERROR, ALMOST_ERROR = 2e-5, 1e-3
"""Largest errors of a point that counts as solved, and as almost solved; see `_error`. They are
wider than the accuracy that the programs are asked for, which holds in the units of the rewritten problem."""

GRADIENT_SHARE = 0.02
"""Weight of the error of the gradient for quadratic objectives. They are rewritten as a Schur complement, in which a
program reaches its accuracy in the objective, but only about the square root of it in the gradient."""

PROOF_ERROR = 1e-6
"""Largest error of a direction that counts as a proof that no point exists, or that the objective is unbounded."""

ATTEMPTS: tuple[tuple[float, float | None], ...] = ((1.0, None), (10.0, 1e-4), (100.0, None))
"""The attempts, in this order until the program reports plain success: multiple of the accuracy that is asked for, and
the floor of `scaling_around` or None. With a coarser accuracy a program that stalls may still end with success."""


def solve_with_program(
    program: ExternalSolver, problem: ConicProblem, accuracy: float, iterations: int
) -> ConicSolution:
    """Solve a conic problem through an SDPA file.

    The outcome is decided by errors that are measured here, not by the status of the program alone. If the program
    returns neither a solution nor a proof that there is none, two auxiliary problems, which always have solutions, tell
    whether a point exists and whether the objective is bounded.

    Parameters
    ----------
    program : ExternalSolver
    problem : ConicProblem
        Without exponential cones.
    accuracy : float
        Tolerance that the program is asked for.
    iterations : int

    Returns
    -------
    ConicSolution

    Raises
    ------
    SolverError
        See `run_program`.
    """
    balance = equilibrate(problem)
    balanced = balance.apply(problem.symmetric)
    found = _solve_balanced(program, balanced, accuracy, iterations)
    if found.outcome in (Outcome.ALMOST_SOLVED, Outcome.STOPPED):
        found = _explain(program, balanced, accuracy, iterations, found)
    return balance.undo(found)


def _solve_balanced(program: ExternalSolver, problem: ConicProblem, accuracy: float, iterations: int) -> ConicSolution:
    """Rewrite the problem as a semidefinite program, and run the external program until it succeeds."""
    rewritten = rewrite(problem)
    if isinstance(rewritten, Decided):
        return _decided(program, problem, rewritten)
    linear = rewritten.problem
    balance = _with_unit_cost(linear, equilibrate(linear))
    scaling, best, taken, seconds = balance, None, 0, 0.0
    least = np.inf
    for attempt, (multiple, floor) in enumerate(ATTEMPTS):
        if floor is not None and best is not None and np.isfinite(least):
            around = scaling_around(linear, linear.b - linear.A @ best[1], floor)
            scaling = _with_unit_cost(linear, around.then(equilibrate(around.apply(linear))))
        else:
            scaling = balance
        written = SemidefiniteProgram.from_conic(scaling.apply(linear))
        answer = run_program(program, written, min(multiple * accuracy, 1e-4), iterations, attempt)
        taken, seconds = taken + answer.iterations, seconds + answer.seconds
        primal, dual = scaling.columns * answer.x, scaling.rows * answer.dual / scaling.objective
        proof = _proof(program, problem, rewritten, answer, primal, dual)
        if proof is not None:
            return replace(proof, iterations=taken, seconds=seconds)
        x, slack, z = rewritten.recover(primal, dual)
        error = _error(problem, x, slack, z)
        if best is None or error < least:
            best, least = (_solution(program, problem, x, slack, z, error, answer), primal), error
        if error <= SOLVED_ERROR and (answer.outcome is Outcome.SOLVED or attempt > 0):
            break
    assert best is not None
    return replace(best[0], iterations=taken, seconds=seconds)


def _with_unit_cost(problem: ConicProblem, scaling: Scaling) -> Scaling:
    """The scaling, with an objective whose largest coefficient is 1."""
    largest = float(np.abs(scaling.columns * problem.q).max(initial=0.0))
    return replace(scaling, objective=1.0 / largest if largest > 0 else 1.0)


def _error(problem: ConicProblem, x: Vector, slack: Vector, z: Vector) -> float:
    """Largest of the relative errors: primal, distance from K, gradient (with its weight) and gap."""
    if not all(np.all(np.isfinite(vector)) for vector in (x, slack, z)):
        return float("inf")
    share = GRADIENT_SHARE if problem.P.count_nonzero() else 1.0
    outside = max(0.0, -least_distance(problem.cones, slack)) / (1.0 + float(np.abs(slack).max(initial=0.0)))
    return max(primal_error(problem, x, slack), outside, share * dual_error(problem, x, z), gap_error(problem, x, z))


def _solution(
    program: ExternalSolver, problem: ConicProblem, x: Vector, slack: Vector, z: Vector, error: float, answer: Answer
) -> ConicSolution:
    """A solution whose outcome follows from its error."""
    outcome = Outcome.ALMOST_SOLVED if error <= ALMOST_ERROR else Outcome.STOPPED
    outcome = Outcome.SOLVED if error <= SOLVED_ERROR else outcome
    objective = float(0.5 * x @ (problem.P @ x) + problem.q @ x)
    return ConicSolution(outcome, answer.status, x, slack, z, objective, 0, 0.0, program.title)


def _no_point(program: ExternalSolver, problem: ConicProblem, z: Vector, status: str) -> ConicSolution:
    nothing = np.full(problem.A.shape[1], np.nan)
    slack = np.full(len(problem.b), np.nan)
    return ConicSolution(Outcome.INFEASIBLE, status, nothing, slack, z, float("nan"), 0, 0.0, program.title)


def _no_bound(program: ExternalSolver, problem: ConicProblem, x: Vector, status: str) -> ConicSolution:
    nothing = np.full(len(problem.b), np.nan)
    slack = -(problem.A @ x)
    return ConicSolution(Outcome.UNBOUNDED, status, x, slack, nothing, -float("inf"), 0, 0.0, program.title)


def _decided(program: ExternalSolver, problem: ConicProblem, decided: Decided) -> ConicSolution:
    """The solution of a problem that the rewriting already decided."""
    status = "decided without the program"
    if decided.dual is not None:
        return _no_point(program, problem, decided.dual, status)
    assert decided.primal is not None
    if decided.unbounded:
        return _no_bound(program, problem, decided.primal, status)
    x, z = decided.primal, decided.multipliers
    answer = Answer(Outcome.SOLVED, status, x, z, 0)
    return _solution(program, problem, x, problem.b - problem.A @ x, z, 0.0, answer)


def _proof(
    program: ExternalSolver, problem: ConicProblem, rewritten: Rewritten, answer: Answer, primal: Vector, dual: Vector
) -> ConicSolution | None:
    """The proof of infeasibility or unboundedness that the program returned, if it holds; else None."""
    if answer.outcome is Outcome.INFEASIBLE:
        z = rewritten.certificate(dual)
        if infeasibility_error(problem, z) <= PROOF_ERROR:
            return _no_point(program, problem, z / -float(problem.b @ z), answer.status)
    if answer.outcome is Outcome.UNBOUNDED:
        x = rewritten.direction(primal)
        if recession_error(problem, x) <= PROOF_ERROR:
            return _no_bound(program, problem, x / -float(problem.q @ x), answer.status)
    return None


def _explain(
    program: ExternalSolver, problem: ConicProblem, accuracy: float, iterations: int, found: ConicSolution
) -> ConicSolution:
    """Look for a proof that no solution exists; return what was found before if there is none."""
    steps: tuple[tuple[Callable[[ConicProblem], ConicProblem], bool], ...] = (
        (infeasibility_problem, True),
        (recession_problem, False),
    )
    taken, seconds = found.iterations, found.seconds
    for build, about_points in steps:
        try:
            answer = _solve_balanced(program, build(problem), accuracy, iterations)
        except SolverError:  # this problem is only an additional question
            continue
        taken, seconds = taken + answer.iterations, seconds + answer.seconds
        if not answer.outcome.usable:
            continue
        if about_points:
            z = answer.dual[: len(problem.b)]
            if infeasibility_error(problem, z) <= PROOF_ERROR:
                found = _no_point(program, problem, z / -float(problem.b @ z), found.status)
                break
        elif recession_error(problem, answer.primal) <= PROOF_ERROR:
            x = answer.primal
            found = _no_bound(program, problem, x / -float(problem.q @ x), found.status)
    return replace(found, iterations=taken, seconds=seconds)


def _interior_element(cones: tuple[Cone, ...]) -> Vector:
    """A vector in the interior of the cones, zero for zero cones: ones, first unit vectors, unit matrices."""
    parts = [np.zeros(0)]
    for cone in cones:
        part = np.zeros(cone.rows)
        if cone.kind == "nonnegative":
            part[:] = 1.0
        elif cone.kind == "second-order":
            part[:1] = 1.0
        elif cone.kind == "semidefinite":
            part[np.cumsum(np.arange(1, cone.size + 1)) - 1] = 1.0
        parts.append(part)
    return np.concatenate(parts)


def infeasibility_problem(problem: ConicProblem) -> ConicProblem:
    """Minimise t subject to A x + s = b + t e, s in K, t ≥ -1, with e inside K.

    It always has points. Where its least value is positive, its dual point proves that the problem has none.
    """
    count = problem.A.shape[1]
    inside = _interior_element(problem.cones)
    last = sparse.csc_array(np.concatenate([-inside, [-1.0]])[:, None])
    above = sparse.vstack([problem.A, sparse.csc_array((1, count))])
    return ConicProblem(
        P=sparse.csc_array((count + 1, count + 1)),
        q=np.concatenate([np.zeros(count), [1.0]]),
        A=sparse.csc_array(sparse.hstack([above, last])),
        b=np.concatenate([problem.b, [1.0]]),
        cones=(*problem.cones, Cone("nonnegative", 1)),
    )


def recession_problem(problem: ConicProblem) -> ConicProblem:
    """Minimise qᵀd subject to -A d in K, P d = 0, qᵀd ≥ -1.

    Zero is a point of it. Where its least value is -1, the problem's objective falls without end along d.
    """
    rows, count = problem.A.shape
    curved = sparse.csc_array(problem.P)
    A = sparse.vstack([problem.A, curved, sparse.csc_array(-problem.q[None])])
    return ConicProblem(
        P=sparse.csc_array((count, count)),
        q=problem.q,
        A=sparse.csc_array(A),
        b=np.concatenate([np.zeros(rows + count), [1.0]]),
        cones=(*problem.cones, Cone("zero", count), Cone("nonnegative", 1)),
    )


def _solver(program: ExternalSolver) -> Solver:
    return Solver(
        name=program.title.lower(),
        title=program.title,
        description=program.method,
        run=partial(solve_with_program, program),
        native=frozenset({"nonnegative", "semidefinite"}),
        rewritten=frozenset({"quadratic", "zero", "second-order"}),
        access="SDPA file",
        installed=program.installed,
        version=program.version,
        remedy=program.remedy,
        is_package=False,
    )


CSDP_SOLVER, DSDP_SOLVER, SDPA_SOLVER = (_solver(program) for program in (CSDP, DSDP, SDPA))
"""The external programs as solvers."""
