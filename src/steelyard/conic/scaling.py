"""Scaling of conic problems: positive diagonal factors of unknowns, rows and objective that improve the conditioning.

A semidefinite block S is scaled by a congruence G S G with a positive diagonal matrix G, so that it stays semidefinite
and each of its rows gets a unit of its own; a second-order or exponential cone gets a single factor.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .problem import Cone, ConicProblem, ConicSolution, stacked_triangle

__all__ = ["Scaling", "diagonal_pairs", "equilibrate", "scaling_around"]

Vector = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

LARGEST_FACTOR = 1e8
"""No factor is larger than this or smaller than its inverse, so that rounding errors are not scaled up to the size of
data."""


@dataclass(frozen=True, eq=False)
class Scaling:
    """x = columns x̂ and ŝ = rows s, elementwise; the objective is multiplied by `objective`.

    Attributes
    ----------
    rows : (rows,)
    columns : (n,)
    """

    rows: Vector = field(repr=False)
    columns: Vector = field(repr=False)
    objective: float = 1.0

    def apply(self, problem: ConicProblem) -> ConicProblem:
        """The problem in the new units."""
        return ConicProblem(
            P=_scaled(problem.P, self.columns, self.objective * self.columns),
            q=self.objective * self.columns * problem.q,
            A=_scaled(problem.A, self.rows, self.columns),
            b=self.rows * problem.b,
            cones=problem.cones,
        )

    def into(self, solution: ConicSolution) -> tuple[Vector, Vector, Vector]:
        """The x, s and z of a solution, in the new units."""
        return (
            solution.primal / self.columns,
            solution.slack * self.rows,
            solution.dual / self.rows * self.objective,
        )

    def undo(self, solution: ConicSolution) -> ConicSolution:
        """The solution in the old units."""
        return replace(
            solution,
            primal=self.columns * solution.primal,
            slack=solution.slack / self.rows,
            dual=self.rows * solution.dual / self.objective,
            objective=solution.objective / self.objective,
        )

    def then(self, following: "Scaling") -> "Scaling":
        """This scaling followed by one of the scaled problem, as a single scaling."""
        return Scaling(
            self.rows * following.rows, self.columns * following.columns, self.objective * following.objective
        )


def _scaled(matrix: sparse.csc_array, left: Vector, right: Vector) -> sparse.csc_array:
    """diag(left) matrix diag(right), sharing the sparsity pattern."""
    counts = np.diff(matrix.indptr)
    data = matrix.data * left[matrix.indices] * np.repeat(right, counts)
    return sparse.csc_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def diagonal_pairs(cones: tuple[Cone, ...]) -> tuple[Indices, Indices, int]:
    """Return for every row the two scale factors whose product scales it.

    A row of a semidefinite block, element (i, j), has the factors of i and j; a row of a zero or nonnegative cone has
    its own factor twice; all rows of another cone share one factor.

    Returns
    -------
    (rows,), (rows,), int
        Indices of the factors, and how many factors there are.
    """
    first: list[Indices] = []
    second: list[Indices] = []
    count = 0
    for cone in cones:
        if cone.kind == "semidefinite":
            row, column, _ = stacked_triangle(cone.size)
            first.append(count + row)
            second.append(count + column)
            count += cone.size
        else:
            single = cone.kind in ("zero", "nonnegative")
            own = np.arange(cone.size) if single else np.zeros(cone.size, dtype=np.intp)
            first.append(count + own)
            second.append(count + own)
            count += cone.size if single else 1
    if not first:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp), 0
    return np.concatenate(first), np.concatenate(second), count


PASSES = 10
"""Passes over the rows and columns; see `equilibrate`."""


def equilibrate(problem: ConicProblem) -> Scaling:
    """Find units in which the largest elements of all rows of [A b] and all columns of [P; A] are near 1.

    Each pass divides rows and columns by the square roots of their largest elements (D. Ruiz, A scaling algorithm to
    equilibrate both rows and columns norms in matrices, 2001), rows only as far as the cones allow. The right side
    b counts like a column, since it has the size of the slack.

    Examples
    --------
    >>> A = sparse.csc_array(np.array([[1e-6], [1e3]]))
    >>> problem = ConicProblem(sparse.csc_array((1, 1)), np.ones(1), A, np.zeros(2), (Cone("nonnegative", 2),))
    >>> abs(equilibrate(problem).apply(problem).A.toarray()).round(1).tolist()
    [[1.0], [1.0]]
    """
    A, P = problem.A, problem.P
    first, second, count = diagonal_pairs(problem.cones)
    magnitudes, right = np.abs(A.data), np.abs(problem.b)
    places = np.repeat(np.arange(A.shape[1]), np.diff(A.indptr))
    curvatures = np.abs(P.data)
    curved = np.repeat(np.arange(P.shape[1]), np.diff(P.indptr))
    of_rows, of_columns = _Largest(A.indices, A.shape[0]), _Largest(places, A.shape[1])
    of_curved, of_curving = _Largest(curved, A.shape[1]), _Largest(P.indices, A.shape[1])
    of_first, of_second = _Largest(first, count), _Largest(second, count)
    factors, columns = np.ones(count), np.ones(A.shape[1])
    for _ in range(PASSES):
        rows = factors[first] * factors[second]
        elements = magnitudes * rows[A.indices] * columns[places]
        row_sizes, column_sizes = np.maximum(rows * right, of_rows(elements)), of_columns(elements)
        if len(curvatures):
            elements = curvatures * columns[P.indices] * columns[curved]
            column_sizes = np.maximum(column_sizes, np.maximum(of_curved(elements), of_curving(elements)))
        sizes = np.maximum(of_first(row_sizes), of_second(row_sizes))
        factors *= np.where(sizes > 0, sizes, 1.0) ** -0.25
        columns *= np.where(column_sizes > 0, column_sizes, 1.0) ** -0.5
    factors = np.clip(factors, LARGEST_FACTOR**-0.5, LARGEST_FACTOR**0.5)
    columns = np.clip(columns, 1 / LARGEST_FACTOR, LARGEST_FACTOR)
    return Scaling(factors[first] * factors[second], columns)


class _Largest:
    """The largest of the numbers, none below zero, that belong to each of some places, time after time.

    Sorted once, they are compared five times as fast as by `numpy.maximum.at`.
    """

    def __init__(self, places: npt.NDArray[np.integer[Any]], count: int) -> None:
        self._order = np.argsort(places, kind="stable")
        ordered = places[self._order]
        self._starts = np.flatnonzero(np.diff(ordered, prepend=-1))
        self._own, self._count = ordered[self._starts], count

    def __call__(self, numbers: Vector) -> Vector:
        found = np.zeros(self._count)
        if len(self._own):
            found[self._own] = np.maximum.reduceat(numbers[self._order], self._starts)
        return found


def scaling_around(problem: ConicProblem, slack: Vector, floor: float) -> Scaling:
    """Units in which the slack of a solution has ones on its diagonal, so that light and heavy links are treated alike.

    Parameters
    ----------
    slack : (rows,)
    floor : float
        Diagonal elements below this part of the largest one are raised to it.

    Returns
    -------
    Scaling
        The factors of the columns make the largest element of each column of A equal to 1.
    """
    first, second, count = diagonal_pairs(problem.cones)
    sizes = np.zeros(count)
    own = first == second
    np.maximum.at(sizes, first[own], np.abs(slack[own]))
    zero = np.concatenate([np.full(cone.rows, cone.kind == "zero") for cone in problem.cones] or [np.zeros(0)])
    smallest = floor * float(sizes.max(initial=0.0))
    factors = np.maximum(sizes, smallest if smallest > 0 else 1.0) ** -0.5
    factors[first[zero.astype(bool)]] = 1.0
    rows = factors[first] * factors[second]
    A = problem.A
    largest = np.zeros(A.shape[1])
    places = np.repeat(np.arange(A.shape[1]), np.diff(A.indptr))
    np.maximum.at(largest, places, np.abs(A.data) * rows[A.indices])
    return Scaling(rows, 1.0 / np.where(largest > 0, largest, 1.0))
