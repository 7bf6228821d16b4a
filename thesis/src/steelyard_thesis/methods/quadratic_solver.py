"""Solvers of the quadratic program of the point masses."""

from __future__ import annotations

import importlib.util
import inspect
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import ConicProblem, Outcome, find_solver, solve
from steelyard.errors import InputError, MissingExtraError

from .point_mass_program import PointMassProgram

__all__ = ["QuadraticSolution", "find_quadratic_solver", "solve_quadratic"]

Vector = npt.NDArray[np.float64]

PACKAGES = ("osqp", "piqp")
"""Solvers of quadratic programs that are used where they are installed."""

ACCURACY = 1e-9
"""Accuracy of interior-point methods, relative to the squared residual of plain least squares."""

NO_EFFECT = 1e-10
"""Columns that are shorter than this, relative to the longest, are rounding."""

FIRST_ORDER_ACCURACY, FIRST_ORDER_STEPS = 1e-7, 20000
"""Accuracy and limit of the steps of OSQP, a first-order method, which takes many cheap steps."""


@dataclass(frozen=True, eq=False)
class QuadraticSolution:
    """Masses and parameters of terms, in units.

    Attributes
    ----------
    x : (points + others,)
    converged : bool
    status : str
    """

    x: Vector = field(repr=False)
    converged: bool
    status: str


def find_quadratic_solver(name: str) -> str:
    """Check the name of a solver.

    Raises
    ------
    InputError
        If it is unknown.
    """
    if name in ("auto", "nnls", *PACKAGES):
        return name
    try:
        return find_solver(name).name
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}; and auto, nnls, {', '.join(PACKAGES)} for point masses.") from None


def solve_quadratic(program: PointMassProgram, solver: str) -> QuadraticSolution:
    """Solve the quadratic program of the point masses.

    Parameters
    ----------
    program : PointMassProgram
    solver : str
        ``"auto"``, ``"nnls"``, ``"osqp"``, ``"piqp"``, or one of `steelyard.solver_table`.

    Raises
    ------
    InputError
        If ``"nnls"`` is asked for but the set has conditions that are no bounds.
    SolverError
        If there is no point.
    MissingExtraError
        If the solver is not installed.
    """
    if solver == "auto":
        # An active set adds one mass after the other: fast where most masses are zero, not where all have a goal.
        solver = "nnls" if program.has_bounds_alone and not program.has_goal else "clarabel"
    if solver == "nnls":
        return _nonnegative_least_squares(program)
    problem = program.conic()
    if solver == "osqp":
        x, converged, status = _osqp(problem)
    elif solver == "piqp":
        x, converged, status = _piqp(problem)
    else:
        found = solve(problem, accuracy=ACCURACY, solver=solver).require("fit the point masses")
        x, converged, status = found.primal, found.outcome is Outcome.SOLVED, found.status
    start = program.base_count
    return QuadraticSolution(x[start : start + program.scaled.shape[1]], converged, status)


def _nonnegative_least_squares(program: PointMassProgram) -> QuadraticSolution:
    """Active set (Lawson and Hanson, 1974); unknowns without a bound are eliminated first."""
    from scipy.optimize import nnls

    if not program.has_bounds_alone:
        raise InputError(
            'solver="nnls" takes lower bounds alone, but the feasible set has other constraints; use "clarabel".'
        )
    A, b = program.dense()
    lower = program.lower
    free = ~np.isfinite(lower)
    x = np.where(free, 0.0, lower)
    b = b - A @ x
    # What has no effect but rounding stays at its bound; free columns may depend on each other.
    lengths = np.linalg.norm(A, axis=0)
    used = np.flatnonzero(~free & (lengths > NO_EFFECT * lengths.max(initial=0.0)))
    left, values, _ = np.linalg.svd(A[:, free] / np.maximum(lengths[free], 1e-300), full_matrices=False)
    basis = left[:, values > NO_EFFECT * values.max(initial=0.0)]
    bounded, target = A[:, used], b - basis @ (basis.T @ b)
    rows = bounded - basis @ (basis.T @ bounded)
    remaining = np.linalg.norm(rows, axis=0)
    kept = remaining > NO_EFFECT * lengths[used]
    used, rows, remaining = used[kept], rows[:, kept], remaining[kept]
    converged, status = True, "solved"
    try:
        x[used] += nnls(rows / remaining, target, maxiter=10 * len(used))[0] / remaining
    except RuntimeError as error:
        converged, status = False, str(error)
    if free.any():
        shifted = b - A @ (x - np.where(free, 0.0, lower))
        x[free] = np.linalg.lstsq(A[:, free], shifted, rcond=NO_EFFECT)[0]
    return QuadraticSolution(x, converged, status)


def _installed(name: str) -> Any:
    if importlib.util.find_spec(name) is None:
        raise MissingExtraError(f'{name} is not installed; install it with: pip install {name}, or use "clarabel".')
    return importlib.import_module(name)


def _split(problem: ConicProblem) -> int:
    """Number of equations, which come first."""
    return sum(cone.rows for cone in problem.cones if cone.kind == "zero")


def _osqp(problem: ConicProblem) -> tuple[Vector, bool, str]:
    """Alternating directions (Stellato et al. 2020), polished."""
    osqp = _installed("osqp")
    lower = np.full(len(problem.b), -np.inf)
    equations = _split(problem)
    lower[:equations] = problem.b[:equations]
    solver = osqp.OSQP()
    solver.setup(
        P=sparse.csc_matrix(sparse.triu(problem.P, format="csc")),
        q=problem.q,
        A=sparse.csc_matrix(problem.A),
        l=lower,
        u=problem.b,
        verbose=False,
        eps_abs=FIRST_ORDER_ACCURACY,
        eps_rel=FIRST_ORDER_ACCURACY,
        max_iter=FIRST_ORDER_STEPS,
        polishing=True,
    )
    # Version 1 raises an exception where it fails unless it is told not to; earlier versions do not have the option.
    options = {"raise_error": False} if "raise_error" in inspect.signature(solver.solve).parameters else {}
    found = solver.solve(**options)
    x = np.nan_to_num(np.asarray(found.x, dtype=np.float64))
    return x, str(found.info.status) == "solved", str(found.info.status)


def _piqp(problem: ConicProblem) -> tuple[Vector, bool, str]:
    """Proximal interior point (Schwan et al. 2023)."""
    piqp = _installed("piqp")
    equations = _split(problem)
    solver = piqp.SparseSolver()
    solver.settings.verbose = False
    solver.settings.eps_abs = solver.settings.eps_rel = ACCURACY
    A = sparse.csr_matrix(problem.A)
    solver.setup(
        sparse.csc_matrix(problem.symmetric.P),
        problem.q,
        sparse.csc_matrix(A[:equations]),
        problem.b[:equations],
        sparse.csc_matrix(A[equations:]),
        np.full(len(problem.b) - equations, -np.inf),
        problem.b[equations:],
    )
    status = str(solver.solve())
    return np.asarray(solver.result.x), "SOLVED" in status.upper(), status
