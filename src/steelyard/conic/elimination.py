"""Linear equations, eliminated: all their solutions as an affine function of the unknowns that remain."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sparse

__all__ = ["Contradiction", "Elimination", "eliminate"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

SMALLEST_PIVOT = 1e-3
"""A column that stands in one row alone is taken as a pivot if its element is at least this part of the largest in the
row. Substituting it then multiplies errors by at most the inverse, a thousand."""

RANK_TOLERANCE = 1e-11
"""A row counts as dependent on others if the factorisation leaves less than this part of the largest of it, which is
well above rounding errors."""

CONTRADICTION_TOLERANCE = 1e-8
"""A dependent equation contradicts the others if its right side differs from theirs by more than this part of the
largest: more than rounding leaves of consistent equations, less than the last digit of values that users write."""


@dataclass(frozen=True, eq=False)
class Contradiction:
    """The equations E x = f have no solution.

    Attributes
    ----------
    multipliers : (rows,)
        y with Eᵀ y = 0 and fᵀ y = -1.
    """

    multipliers: Vector = field(repr=False)


@dataclass(frozen=True, eq=False)
class Elimination:
    """All solutions of E x = f: x = offset + directions w.

    Attributes
    ----------
    offset : (n,)
    directions : (n, n_w) sparse
    """

    offset: Vector = field(repr=False)
    directions: sparse.csc_array = field(repr=False)
    _equations: sparse.csr_array = field(repr=False)
    _single: tuple[tuple[int, int], ...] = field(repr=False)
    _rest: Indices = field(repr=False)
    _pivots: Indices = field(repr=False)
    _factors: tuple[Matrix, Matrix] = field(repr=False)

    def multipliers(self, gradient: Vector) -> Vector:
        """The y with Eᵀ y = -gradient on the columns that were eliminated.

        Parameters
        ----------
        gradient : (n,)
            Of what is minimised, without the equations.
        """
        y = np.zeros(self._equations.shape[0])
        columns = sparse.csc_array(self._equations)
        for row, column in self._single:
            own = slice(columns.indptr[column], columns.indptr[column + 1])
            rows, values = columns.indices[own], columns.data[own]
            pivot = float(values[rows == row][0])
            y[row] = -(gradient[column] + float(values @ y[rows]) - pivot * y[row]) / pivot
        if len(self._pivots):
            orthogonal, triangle = self._factors
            right = -(gradient + self._equations.T @ y)[self._pivots]
            y[self._rest] = orthogonal @ scipy.linalg.solve_triangular(triangle, right, trans=1)
        return y


def eliminate(E: sparse.csr_array, f: Vector) -> Elimination | Contradiction:
    """Solve for as many unknowns as there are independent equations.

    First those that stand in a single equation, which leaves the others sparse; then the rest by a QR factorisation
    with column pivoting.

    Parameters
    ----------
    E : (rows, n) sparse
    f : (rows,)

    Returns
    -------
    Elimination or Contradiction

    Examples
    --------
    >>> E = sparse.csr_array(np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]]))
    >>> found = eliminate(E, np.array([3.0, 5.0]))
    >>> (E @ found.offset).round(12).tolist(), float(abs(E @ found.directions).max().round(12))
    ([3.0, 5.0], 0.0)
    """
    E = sparse.csr_array(E)
    E.eliminate_zeros()
    count = E.shape[1]
    single = _single_columns(E)
    taken = np.zeros(E.shape[0], dtype=bool)
    solved = np.zeros(count, dtype=bool)
    for row, column in single:
        taken[row] = solved[column] = True
    rest, kept = np.flatnonzero(~taken), np.flatnonzero(~solved)
    # In the remaining rows the single columns do not occur.
    dense = E[rest][:, kept].toarray() if len(rest) else np.zeros((0, len(kept)))
    sizes = np.abs(dense).max(axis=1, initial=0.0)
    units = np.where(sizes > 0, sizes, 1.0)
    orthogonal, triangle, order = _pivoted(dense / units[:, None])
    rank = _rank(triangle)
    projected = orthogonal.T @ (f[rest] / units)
    missed = np.abs(projected[rank:])
    if np.any(missed > CONTRADICTION_TOLERANCE * np.abs(projected).max(initial=0.0)):
        worst = rank + int(np.argmax(missed))
        multipliers = np.zeros(E.shape[0])
        multipliers[rest] = -orthogonal[:, worst] / units / projected[worst]
        return Contradiction(multipliers)

    pivots, others = kept[order[:rank]], kept[order[rank:]]
    top = triangle[:rank, :rank]
    offset = np.zeros(count)
    offset[pivots] = scipy.linalg.solve_triangular(top, projected[:rank]) if rank else 0.0
    inner = -scipy.linalg.solve_triangular(top, triangle[:rank, rank:]) if rank else np.zeros((0, len(others)))
    inner[np.abs(inner) < 1e-15] = 0.0
    free = np.sort(others)
    place = np.zeros(count, dtype=np.intp)
    place[free] = np.arange(len(free))
    inner_row, inner_column = np.nonzero(inner)
    directions = sparse.csr_array(
        sparse.coo_array(
            (
                np.concatenate([np.ones(len(free)), inner[inner_row, inner_column]]),
                (np.concatenate([free, pivots[inner_row]]), np.concatenate([place[free], place[others[inner_column]]])),
            ),
            shape=(count, len(free)),
        )
    )
    directions, offset = _substitute(E, f, single, directions, offset)
    factors = (orthogonal[:, :rank] / units[:, None], top)
    return Elimination(offset, sparse.csc_array(directions), E, tuple(single), rest, pivots, factors)


def _pivoted(matrix: Matrix) -> tuple[Matrix, Matrix, Indices]:
    """Q, R and the order of the columns, also of an empty matrix."""
    if 0 in matrix.shape:
        return np.eye(matrix.shape[0]), np.zeros(matrix.shape), np.arange(matrix.shape[1])
    orthogonal, triangle, order = scipy.linalg.qr(matrix, pivoting=True)
    return np.asarray(orthogonal, float), np.asarray(triangle, float), np.asarray(order, dtype=np.intp)


def _rank(triangle: Matrix) -> int:
    """How many rows of R are not negligible."""
    diagonal = np.abs(np.diag(triangle))
    return int(np.sum(diagonal > RANK_TOLERANCE * diagonal[0])) if len(diagonal) and diagonal[0] > 0 else 0


def _single_columns(E: sparse.csr_array) -> list[tuple[int, int]]:
    """Pivots (row, column); each column is absent from all later rows of the list and from the rows that remain."""
    columns = sparse.csc_array(E)
    remaining = np.ones(E.shape[0], dtype=bool)
    counts = np.diff(columns.indptr).astype(np.intp)
    largest = np.zeros(E.shape[0])
    np.maximum.at(largest, np.repeat(np.arange(E.shape[0]), np.diff(E.indptr)), np.abs(E.data))
    found: list[tuple[int, int]] = []
    waiting = [int(column) for column in np.flatnonzero(counts == 1)]
    while waiting:
        best: dict[int, tuple[float, int]] = {}
        for column in waiting:
            own = slice(columns.indptr[column], columns.indptr[column + 1])
            rows, values = columns.indices[own], np.abs(columns.data[own])
            alive = remaining[rows]
            row, value = int(rows[alive][0]), float(values[alive][0])
            if value >= SMALLEST_PIVOT * largest[row] and value > best.get(row, (0.0, -1))[0]:
                best[row] = (value, column)
        touched: set[int] = set()
        for row, (_, column) in sorted(best.items()):
            found.append((row, column))
            remaining[row] = False
            for other in E.indices[E.indptr[row] : E.indptr[row + 1]]:
                counts[other] -= 1
                touched.add(int(other))
        waiting = sorted(column for column in touched if counts[column] == 1)
    return found


def _substitute(
    E: sparse.csr_array, f: Vector, single: list[tuple[int, int]], directions: sparse.csr_array, offset: Vector
) -> tuple[sparse.csr_array, Vector]:
    """Solve each equation for its single column, from the last to the first, since later ones may stand in earlier."""
    if not single:
        return directions, offset
    # Rows without unknowns of their own group are solved together.
    level = _levels(E, single)
    for depth in range(max(level) + 1):
        rows = np.array([row for (row, _), own in zip(single, level, strict=True) if own == depth], dtype=np.intp)
        columns = np.array([column for (_, column), own in zip(single, level, strict=True) if own == depth])
        part = E[rows]
        pivots = np.array([E[row, column] for row, column in zip(rows, columns, strict=True)])
        offset[columns] = (f[rows] - part @ offset) / pivots
        lifted = sparse.coo_array(sparse.diags_array(-1.0 / pivots) @ (part @ directions))
        directions = sparse.csr_array(
            directions
            + sparse.coo_array((lifted.data, (columns[lifted.coords[0]], lifted.coords[1])), shape=directions.shape)
        )
    return directions, offset


def _levels(E: sparse.csr_array, single: list[tuple[int, int]]) -> list[int]:
    """For each pivot, the length of the longest chain of pivots that must be solved before it."""
    pivot_of = {column: index for index, (_, column) in enumerate(single)}
    level = [0] * len(single)
    for index in range(len(single) - 1, -1, -1):
        row, column = single[index]
        needed = [pivot_of[int(c)] for c in E.indices[E.indptr[row] : E.indptr[row + 1]] if int(c) in pivot_of]
        level[index] = 1 + max((level[other] for other in needed if single[other][1] != column), default=-1)
    return level
