"""Errors of a solution of a conic problem, measured in the same way for every solver."""

import numpy as np
import numpy.typing as npt

from .problem import Cone, ConicProblem

__all__ = [
    "dual_error",
    "gap_error",
    "infeasibility_error",
    "least_distance",
    "optimality_error",
    "primal_error",
    "recession_error",
]

Vector = npt.NDArray[np.float64]


def _largest(*vectors: Vector) -> float:
    return max(float(np.abs(vector).max(initial=0.0)) for vector in vectors)


def primal_error(problem: ConicProblem, primal: Vector, slack: Vector) -> float:
    """Largest element of A x + s - b, relative to the largest of the three (at least 1)."""
    left = problem.A @ primal
    return _largest(left + slack - problem.b) / (1.0 + _largest(left, slack, problem.b))


def dual_error(problem: ConicProblem, primal: Vector, dual: Vector) -> float:
    """Largest element of P x + q + Aᵀz, relative to the largest of the three (at least 1)."""
    curvature, pull = problem.P @ primal, problem.A.T @ dual
    return _largest(curvature + problem.q + pull) / (1.0 + _largest(curvature, problem.q, pull))


def gap_error(problem: ConicProblem, primal: Vector, dual: Vector) -> float:
    """Difference between the objectives of x and z, relative to the larger of them (at least 1)."""
    quadratic = float(primal @ (problem.P @ primal))
    above = 0.5 * quadratic + float(problem.q @ primal)
    below = -0.5 * quadratic - float(problem.b @ dual)
    return abs(above - below) / (1.0 + max(abs(above), abs(below)))


def optimality_error(problem: ConicProblem, primal: Vector, slack: Vector, dual: Vector) -> float:
    """Largest of the relative errors of a point: primal, dual, and the gap between both objectives.

    Whether s lies in K and z in its dual cone is not checked.

    Parameters
    ----------
    problem : ConicProblem
        Both triangles of P must be given, as in `ConicProblem.symmetric`.
    primal : (n,)
    slack, dual : (rows,)

    Returns
    -------
    float
        Infinite where an element is not finite.
    """
    if not all(np.all(np.isfinite(vector)) for vector in (primal, slack, dual)):
        return float("inf")
    errors = (primal_error(problem, primal, slack), dual_error(problem, primal, dual), gap_error(problem, primal, dual))
    return max(errors)


def infeasibility_error(problem: ConicProblem, dual: Vector) -> float:
    """Error of z as a proof that no point exists: the largest element of Aᵀz, after z is scaled such that bᵀz = -1.

    Returns
    -------
    float
        Infinite where bᵀz is not negative.
    """
    if not np.all(np.isfinite(dual)):
        return float("inf")
    value = float(problem.b @ dual)
    return _largest(problem.A.T @ dual) / -value if value < 0 else float("inf")


def recession_error(problem: ConicProblem, direction: Vector) -> float:
    """Error of d as a proof that the objective is unbounded, which needs -A d in K and P d = 0, scaled to qᵀd = -1.

    Returns
    -------
    float
        Infinite where qᵀd is not negative.
    """
    if not np.all(np.isfinite(direction)):
        return float("inf")
    value = float(problem.q @ direction)
    if value >= 0:
        return float("inf")
    outside = -least_distance(problem.cones, -(problem.A @ direction))
    return max(outside, _largest(problem.P @ direction)) / -value


def least_distance(cones: tuple[Cone, ...], vector: Vector) -> float:
    """Signed distance of a vector from the boundary of the product of the cones: positive inside, negative outside.

    For a semidefinite cone it is the smallest eigenvalue, for a zero cone minus the largest element. Exponential cones
    are left out. The result is minus infinity if an element is not finite.
    """
    if not np.all(np.isfinite(vector)):
        return -float("inf")
    least, start = float("inf"), 0
    for cone in cones:
        part = vector[start : start + cone.rows]
        start += cone.rows
        if not cone.size:
            continue
        if cone.kind == "zero":
            depth = -float(np.abs(part).max())
        elif cone.kind == "nonnegative":
            depth = float(part.min())
        elif cone.kind == "second-order":
            depth = float(part[0] - np.linalg.norm(part[1:]))
        elif cone.kind == "semidefinite":
            matrix = np.zeros((cone.size, cone.size))
            column, row = np.tril_indices(cone.size)
            matrix[column, row] = part * np.where(row == column, 1.0, np.sqrt(0.5))
            depth = float(np.linalg.eigvalsh(matrix)[0])
        else:
            continue
        least = min(least, depth)
    return least
