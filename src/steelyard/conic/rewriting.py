"""Rewriting a problem over zero, nonnegative, second-order and semidefinite cones as a semidefinite program.

Equations are eliminated. A second-order cone becomes an arrow matrix. A quadratic objective ½ ‖r(x)‖² becomes ½ u with
the Schur complement [[u, rᵀ], [r, 1]] ⪰ 0 (thesis 3.39, 3.52). Rows and blocks without unknowns are decided here, and a
block whose rows fall into independent groups is split.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from .problem import Cone, ConicProblem, stacked_triangle

__all__ = [
    "Contradiction",
    "Decided",
    "Elimination",
    "Rewritten",
    "Squares",
    "eliminate",
    "rewrite",
    "square_root",
    "squares_of",
]

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
        """The y with Eᵀ y = -gradient, (n,) without the equations, on the columns that were eliminated."""
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
    """Return how many rows of R are not negligible."""
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
    """Return for each pivot the length of the longest chain of pivots that must be solved before it."""
    pivot_of = {column: index for index, (_, column) in enumerate(single)}
    level = [0] * len(single)
    for index in range(len(single) - 1, -1, -1):
        row, column = single[index]
        needed = [pivot_of[int(c)] for c in E.indices[E.indptr[row] : E.indptr[row + 1]] if int(c) in pivot_of]
        level[index] = 1 + max((level[other] for other in needed if single[other][1] != column), default=-1)
    return level


CONSTANT_TOLERANCE = 1e-9
"""A constant that must not be negative may be below zero by this part of the terms that it is the sum of. The
elimination of equations leaves rounding errors in constants."""

CANCELLED = 1e-14
"""Sums below this part of their terms are set to zero: they are rounding errors, which would couple parts of a block
that are independent."""


NEGLIGIBLE = 1e-14
"""Eigenvalues of P below this part of the largest, after its diagonal is scaled to 1, are dropped as rounding
errors."""


@dataclass(frozen=True, eq=False)
class Squares:
    """½ xᵀP x as ½ ‖matrix w + constant‖², up to a constant.

    Attributes
    ----------
    matrix : (k, n_w) sparse
    constant : (k,)
    """

    matrix: sparse.csr_array = field(repr=False)
    constant: Vector = field(repr=False)


def square_root(P: sparse.csc_array) -> sparse.csr_array:
    """G with GᵀG = P, computed for each group of unknowns that P couples; diagonal parts stay diagonal.

    Parameters
    ----------
    P : (n, n) sparse, symmetric, positive semidefinite

    Examples
    --------
    >>> P = sparse.csc_array(np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    >>> G = square_root(P)
    >>> G.shape, bool(abs(G.T @ G - P).max() < 1e-15)
    ((2, 3), True)
    """
    rows, columns, values = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    matrix = sparse.csr_array(P)
    matrix.eliminate_zeros()
    diagonal = matrix.diagonal()
    parts, label = connected_components(matrix, directed=False)
    order = np.argsort(label, kind="stable")
    count = 0
    for members in np.split(order, np.cumsum(np.bincount(label, minlength=parts))[:-1]):
        members = members[diagonal[members] > 0]
        if len(members) == 1:
            rows.append(np.array([count]))
            columns.append(members)
            values.append(np.sqrt(diagonal[members]))
            count += 1
        elif len(members):
            unit = np.sqrt(diagonal[members])
            part = matrix[members][:, members].toarray()
            eigenvalues, vectors = np.linalg.eigh(part / np.outer(unit, unit))
            kept = eigenvalues > NEGLIGIBLE * eigenvalues[-1]
            factor = (np.sqrt(eigenvalues[kept])[:, None] * vectors[:, kept].T) * unit
            row, column = np.nonzero(factor)
            rows.append(count + row)
            columns.append(members[column])
            values.append(factor[row, column])
            count += len(factor)
    places = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(sparse.coo_array((np.concatenate(values), places), shape=(count, P.shape[0])))


def squares_of(P: sparse.csc_array, offset: Vector, directions: sparse.csc_array) -> Squares | None:
    """The squares of ½ xᵀP x with x = offset + directions w; None where they do not depend on w."""
    if not P.count_nonzero():
        return None
    root = square_root(P)
    matrix, constant = sparse.csr_array(root @ directions), root @ offset
    matrix.eliminate_zeros()
    present = np.diff(matrix.indptr) > 0
    matrix, constant = sparse.csr_array(matrix[present]), constant[present]
    used = np.flatnonzero(np.diff(sparse.csc_array(matrix).indptr) > 0)
    if not len(used):
        return None
    if matrix.shape[0] > len(used):
        # A QR factorisation gives fewer squares with the same sum, without squaring the condition number.
        orthogonal, triangle = scipy.linalg.qr(matrix[:, used].toarray(), mode="economic")
        row, column = np.nonzero(triangle)
        places = (row, used[column])
        matrix = sparse.csr_array(
            sparse.coo_array((triangle[row, column], places), shape=(len(triangle), matrix.shape[1]))
        )
        constant = orthogonal.T @ constant
    return Squares(matrix, constant)


def _arrow(diagonal: Indices, border: Indices) -> tuple[int, Indices, Indices, Indices, Vector]:
    """Order of an arrow matrix, and row, column, source and factor of each element.

    Rows `diagonal` stand on its diagonal, rows `border` in its first row and column.
    """
    order = len(diagonal)
    own = np.arange(order)
    row = np.concatenate([own, np.zeros(order - 1, dtype=np.intp)])
    return order, row, np.concatenate([own, own[1:]]), np.concatenate([diagonal, border]), np.ones(2 * order - 1)


@dataclass(frozen=True, eq=False)
class Decided:
    """The answer to a problem that needs no solver.

    Attributes
    ----------
    primal : (n,) or None
        A solution or, if `unbounded`, a direction along which the objective falls without bound.
    dual : (rows,) or None
        A direction that proves that no point satisfies the constraints.
    multipliers : (rows,)
        The dual solution that belongs to `primal`.
    """

    primal: Vector | None = field(default=None, repr=False)
    dual: Vector | None = field(default=None, repr=False)
    unbounded: bool = False
    multipliers: Vector = field(default_factory=lambda: np.zeros(0), repr=False)


@dataclass(frozen=True, eq=False)
class Rewritten:
    """A problem rewritten as minimising qᵀv over nonnegative and semidefinite cones, and the map back."""

    source: ConicProblem = field(repr=False)
    problem: ConicProblem
    _elimination: Elimination = field(repr=False)
    _kept: Indices = field(repr=False)
    _unfolding: sparse.csr_array = field(repr=False)
    _coned: Indices = field(repr=False)
    _equations: Indices = field(repr=False)

    def recover(self, primal: Vector, dual: Vector) -> tuple[Vector, Vector, Vector]:
        """(x, s, z) of the source from a solution of the rewritten problem."""
        source = self.source
        x = self._elimination.offset + self.direction(primal)
        slack = np.zeros(len(source.b))
        slack[self._coned] = (source.b - source.A @ x)[self._coned]
        return x, slack, self._whole_dual(dual, source.P @ x + source.q)

    def direction(self, primal: Vector) -> Vector:
        """A direction of the source from one of the rewritten problem."""
        remaining = np.zeros(self._elimination.directions.shape[1])
        remaining[self._kept] = primal[: len(self._kept)]
        return np.asarray(self._elimination.directions @ remaining, dtype=float)

    def certificate(self, dual: Vector) -> Vector:
        """A proof that the source has no point, from one for the rewritten problem."""
        return self._whole_dual(dual, np.zeros(self.source.A.shape[1]))

    def _whole_dual(self, dual: Vector, gradient: Vector) -> Vector:
        whole = np.zeros(len(self.source.b))
        whole[self._coned] = (self._unfolding.T @ dual)[: len(self._coned)]
        whole[self._equations] = self._elimination.multipliers(gradient + self.source.A.T @ whole)
        return whole


def rewrite(problem: ConicProblem) -> Rewritten | Decided:
    """Rewrite a problem, or answer it where nothing is left to solve.

    Both triangles of P must be given; exponential cones are not supported.
    """
    kinds = np.repeat([cone.kind for cone in problem.cones], [cone.rows for cone in problem.cones])
    equations, coned = np.flatnonzero(kinds == "zero"), np.flatnonzero(kinds != "zero")
    rows = sparse.csr_array(problem.A)
    found = eliminate(sparse.csr_array(rows[equations]), problem.b[equations])
    whole = np.zeros(len(problem.b))
    if isinstance(found, Contradiction):
        whole[equations] = found.multipliers
        return Decided(dual=whole)

    own = rows[coned]
    A = _without_rounding(own, found.directions)
    b = problem.b[coned] - own @ found.offset
    size = np.abs(problem.b[coned]) + abs(own) @ np.abs(found.offset)
    squares = squares_of(problem.P, found.offset, found.directions)
    q = found.directions.T @ problem.q
    layout = _Layout.of(problem.cones, len(coned), squares)
    A, b, size = layout.extended(A, b, size, squares)
    q = np.concatenate([q, [0.5]]) if squares is not None else q
    unfolding, cones, refuted = _settle(layout, A, b, size)
    if refuted is not None:
        whole[coned] = refuted[: len(coned)]
        whole[equations] = found.multipliers(problem.A.T @ whole)
        return Decided(dual=whole)

    unfolded = sparse.csc_array(unfolding @ A)
    used = np.diff(unfolded.indptr) > 0
    if np.any(q[~used] != 0):
        worst = int(np.argmax(np.where(used, 0.0, np.abs(q))))
        return Decided(primal=-np.sign(q[worst]) * found.directions[:, [worst]].toarray()[:, 0], unbounded=True)
    if not np.any(used):
        whole[equations] = found.multipliers(problem.P @ found.offset + problem.q)
        return Decided(primal=found.offset, multipliers=whole)
    kept = np.flatnonzero(used)
    linear = ConicProblem(
        sparse.csc_array((len(kept), len(kept))), q[kept], sparse.csc_array(unfolded[:, kept]), unfolding @ b, cones
    )
    original = kept[kept < found.directions.shape[1]]
    return Rewritten(problem, linear, found, original, unfolding, coned, equations)


def _without_rounding(left: sparse.csr_array, right: sparse.csc_array) -> sparse.csr_array:
    """The product, in which sums that cancel up to rounding are exactly zero."""
    product, terms = sparse.coo_array(left @ right), sparse.csr_array(abs(left) @ abs(right))
    if not product.nnz:
        return sparse.csr_array(product)
    sizes = np.asarray(terms[product.coords[0], product.coords[1]]).ravel()
    kept = np.abs(product.data) > CANCELLED * sizes
    places = (product.coords[0][kept], product.coords[1][kept])
    return sparse.csr_array(sparse.coo_array((product.data[kept], places), shape=product.shape))


@dataclass(frozen=True, eq=False)
class _Layout:
    """Symmetric matrices made of the rows of the cones.

    `matrices` are (order, row, column, source, factor): element (row, column), row ≤ column, is factor times the row
    `source`; `scalars` are rows that must not be negative.
    """

    scalars: Indices
    matrices: tuple[tuple[int, Indices, Indices, Indices, Vector], ...]

    @classmethod
    def of(cls, cones: tuple[Cone, ...], count: int, squares: Squares | None) -> "_Layout":
        """From the cones other than equations, and three more kinds of rows: u, 1, r."""
        scalars: list[Indices] = [np.zeros(0, dtype=np.intp)]
        matrices = []
        start = 0
        for cone in cones:
            if cone.kind == "zero" or not cone.size:
                continue
            rows = np.arange(start, start + cone.rows)
            start += cone.rows
            if cone.kind == "nonnegative" or cone.size == 1:
                scalars.append(rows)
            elif cone.kind == "semidefinite":
                row, column, factor = stacked_triangle(cone.size)
                matrices.append((cone.size, row, column, rows, 1.0 / factor))
            else:
                matrices.append(_arrow(np.full(cone.size, rows[0]), rows[1:]))
        if squares is not None:
            length = len(squares.constant)
            diagonal = np.concatenate([[count], np.full(length, count + 1)])
            matrices.append(_arrow(diagonal, count + 2 + np.arange(length)))
        return cls(np.concatenate(scalars), tuple(matrices))

    def extended(
        self, A: sparse.csr_array, b: Vector, size: Vector, squares: Squares | None
    ) -> tuple[sparse.csr_array, Vector, Vector]:
        """Rows for u, 1 and r below those of the cones, and a column for u beside."""
        if squares is None:
            return A, b, size
        length, width = squares.matrix.shape
        below = sparse.vstack([sparse.csr_array((2, width)), -squares.matrix])
        beside = sparse.coo_array(([-1.0], ([A.shape[0]], [0])), shape=(A.shape[0] + 2 + length, 1))
        whole = sparse.csr_array(sparse.hstack([sparse.vstack([A, below]), beside]))
        values = np.concatenate([[0.0, 1.0], squares.constant])
        return whole, np.concatenate([b, values]), np.concatenate([size, np.abs(values)])


def _settle(
    layout: _Layout, A: sparse.csr_array, b: Vector, size: Vector
) -> tuple[sparse.csr_array, tuple[Cone, ...], Vector | None]:
    """Check constant rows and blocks, and split blocks into independent ones.

    Returns the map from rows to the remaining stacked blocks, their cones, and None; or, as the third, a proof of
    infeasibility over the rows if a constant row or block is not in its cone.
    """
    free = np.diff(A.indptr) > 0
    scalars: list[tuple[Indices, Vector]] = []
    blocks: list[tuple[int, Indices, Indices, Vector]] = []
    for row in layout.scalars:
        if free[row]:
            scalars.append((np.array([row]), np.ones(1)))
        elif b[row] < -CONSTANT_TOLERANCE * size[row]:
            refuted = np.zeros(len(b))
            refuted[row] = 1.0
            return sparse.csr_array((0, len(b))), (), refuted
    for order, row, column, source, factor in layout.matrices:
        present = free[source] | (np.abs(b[source]) > CANCELLED * size[source])
        pattern = sparse.coo_array((np.ones(int(present.sum())), (row[present], column[present])), shape=(order, order))
        parts, label = connected_components(sparse.csr_array(pattern), directed=False)
        for part in range(parts):
            members = np.flatnonzero(label == part)
            own = (label[row] == part) & (label[column] == part)
            if not np.any(free[source[own]]):
                proof = _refute(row[own], column[own], source[own], factor[own], members, b, size)
                if proof is not None:
                    return sparse.csr_array((0, len(b))), (), proof
            elif len(members) == 1:
                scalars.append((source[own], factor[own]))
            else:
                place = np.zeros(order, dtype=np.intp)
                place[members] = np.arange(len(members))
                i, j = place[row[own]], place[column[own]]
                scale = factor[own] * np.where(i == j, 1.0, np.sqrt(2.0))
                blocks.append((len(members), j * (j + 1) // 2 + i, source[own], scale))
    # The diagonal block must be the last: otherwise DSDP writes the blocks of its answer in a wrong order.
    start, rows, columns, values = 0, [], [], []
    cones = [Cone("semidefinite", order) for order, *_ in blocks]
    for cone, (_, within, source, scale) in zip(cones, blocks, strict=True):
        rows.append(start + within)
        columns.append(source)
        values.append(scale)
        start += cone.rows
    for source, factor in scalars:
        rows.append(np.array([start]))
        columns.append(source)
        values.append(factor)
        start += 1
    if scalars:
        cones.append(Cone("nonnegative", len(scalars)))
    none = np.zeros(0, dtype=np.intp)
    places = (np.concatenate([none, *rows]), np.concatenate([none, *columns]))
    data = np.concatenate([np.zeros(0), *values])
    return sparse.csr_array(sparse.coo_array((data, places), shape=(start, len(b)))), tuple(cones), None


def _refute(
    row: Indices, column: Indices, source: Indices, factor: Vector, members: Indices, b: Vector, size: Vector
) -> Vector | None:
    """A proof that a constant block is not positive semidefinite, or None if it is."""
    place = {int(member): k for k, member in enumerate(members)}
    i, j = np.array([place[int(k)] for k in row]), np.array([place[int(k)] for k in column])
    matrix = np.zeros((len(members), len(members)))
    matrix[i, j] = matrix[j, i] = b[source] * factor
    values, vectors = np.linalg.eigh(matrix)
    if values[0] >= -CONSTANT_TOLERANCE * float((size[source] * factor).max()):
        return None
    vector = vectors[:, 0]
    refuted = np.zeros(len(b))
    np.add.at(refuted, source, vector[i] * vector[j] * factor * np.where(i == j, 1.0, 2.0))
    return refuted
