"""Triangular factors of regressions: exact, of fixed size, and mergeable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import in_threads

from .householder import householder

__all__ = [
    "Factor",
    "Reduced",
    "column_lengths",
    "combined",
    "eigenvectors",
    "extended",
    "is_well_conditioned",
    "most_held",
    "solve",
    "triangular",
    "unidentifiable_columns",
]

Array = NDArray[np.float64]

LARGEST = 1e30
"""Largest number in a saved regression or estimate, so that sums of squares stay finite."""

RANK = 1e-9
"""Combinations of unknowns that a regression shows by less than this, relative to the best, count as not shown; where
nothing is shown, rounding leaves about 1e-13."""


PIECE = 32768
"""Rows of a long matrix that one thread reduces; fixed, so that the result does not depend on the number of threads."""

STEP = 16
"""Widest block on the diagonal that is inverted, at most `products_code.WIDEST`. From 8 to 24 the time is the same
within a tenth."""

FEW_NUMBERS = 25000
"""Numbers in rows below which QR is as fast: measured with 8 to 77 columns, 20000 to 32000. What products cost by
themselves, some 0.1 ms, is the cost of 200 to 3000 rows by QR."""

FEW_ROWS = 3072
"""Rows from which on QR takes three to five times as long for each, measured with 8 to 60 columns between 3000 and 6000
rows: a column is no longer in the processor's nearest cache, of which 32 kB hold 4096 numbers."""

FEWEST_SHARE = 4
"""The first preconditioner takes one row of so many or more."""

LARGEST_GROWTH = 128.0
"""Growth of rounding errors by an inverse on the diagonal that is accepted. Errors were those of QR in blocks in all
trials, with 2000 up to ten times and with 1e4 a hundred times those. 32 takes a third longer at a condition of 1e7."""

WORST_SQUARE = 256.0
"""Growth of rounding errors by the Cholesky factor that is accepted. Rows of one kind have 5 to 50."""

ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""Least diagonal of a preconditioner, relative to its column."""

FEWEST_HELD, HELD_NUMBERS = 2048, 2**22
"""Rows that are held at least before they are reduced together, and numbers otherwise: 32 MB."""


def most_held(rows: int, width: int) -> int:
    """Return how many rows of so many numbers each are held: `rows`, or as many as `HELD_NUMBERS` allow."""
    return max(FEWEST_HELD, min(rows, HELD_NUMBERS // max(width, 1)))


def triangular(*pieces: Array) -> Array:
    """Return the upper-triangular factor R (c, c) of rows (m_i, c), its diagonal not negative: ``R'R = rows' rows``.

    Many rows are reduced by products, see `extended`, and very many in pieces by several threads, as many as BLAS may
    use. The result is the same, to the last bit, however many there are.
    """
    if _is_quick(sum(map(len, pieces)), pieces[0].shape[1]):
        return householder(*pieces)
    rows = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
    if len(rows) < 2 * PIECE:
        return _of_rows(rows)
    starts = range(0, len(rows) - PIECE + 1, PIECE)
    parts = [rows[start : start + PIECE] for start in starts[:-1]] + [rows[starts[-1] :]]
    return householder(*in_threads(_of_rows, parts))


def extended(triangle: Array, *pieces: Array) -> Array:
    """Return the triangular factor of a triangle R (c, c), its diagonal not negative, and of further rows together.

    It is that of Householder's QR up to rounding, in less than half of its time where rows are many. With the rows A
    and the Cholesky factor C of ``1 + B'B``, where ``B = A / R``, it is ``C R``. So R is a preconditioner: unlike in
    the normal equations, what is squared is the condition number of C alone, and that is small unless the rows show
    what no row before them has shown. Then, and wherever else a bound on rounding does not hold, QR reduces them.

    Parameters
    ----------
    triangle : ndarray
    pieces : ndarray
        (m_i, c) each.

    References
    ----------
    Y. Yamamoto, Y. Nakatsukasa, Y. Yanagisawa, T. Fukaya, Roundoff error analysis of the CholeskyQR2 algorithm, ETNA
    44, 2015, pages 306-326. Their preconditioner is the factor of a first pass over the same rows.
    """
    width = len(triangle)
    if not pieces:
        return triangle
    if not triangle.any():
        return triangular(*pieces)
    if _is_quick(sum(map(len, pieces)), width):
        return householder(triangle, *pieces)
    present = _not_empty(triangle, pieces)
    if len(present) < width:
        # The row of a missing column need not be zero.
        part = extended(householder(triangle[:, present]), *(rows[:, present] for rows in pieces))
        return _widened(part, present, width)
    factor = _by_products(triangle, 1.0, pieces)
    return householder(triangle, _of_rows(np.concatenate(pieces))) if factor is None else factor


def _of_rows(rows: Array) -> Array:
    """Return the factor of rows: that of some of them, evenly spread, `extended` by all others."""
    count, width = rows.shape
    stride = 0 if _is_quick(count, width) else count // (4 * width)
    if stride < FEWEST_SHARE:
        return _in_blocks(rows)
    # Neighbours that were combined are four or eight rows, which say different things: an odd stride meets all of them.
    stride -= 1 - stride % 2
    first = householder(rows[::stride])
    present = _not_empty(first, [rows])
    if len(present) < width:
        return _widened(_of_rows(rows[:, present]), present, width)
    factor = _by_products(first, 1.0 / np.sqrt(stride), [rows], stride)
    return _in_blocks(rows) if factor is None else factor


def _is_quick(count: int, width: int) -> bool:
    """Tell whether QR reduces so many rows of so many columns as fast as products do."""
    return count < FEW_ROWS and count * width < FEW_NUMBERS


def _in_blocks(rows: Array) -> Array:
    """Return the factor of rows by Householder's QR, of so many at a time that they stay in the cache."""
    size = max(min(FEW_NUMBERS // max(rows.shape[1], 1), FEW_ROWS), rows.shape[1], 1)
    factor = householder(rows[:size])
    for start in range(size, len(rows), size):
        factor = householder(factor, rows[start : start + size])
    return factor


def _not_empty(triangle: Array, pieces: Sequence[Array]) -> NDArray[np.intp]:
    """Return the columns that are not zero throughout, in the triangle and in all pieces."""
    present = np.asarray(triangle.any(axis=0))
    for j in np.flatnonzero(~present):
        present[j] = any(rows[:, j].any() for rows in pieces)
    return np.flatnonzero(present)


def _widened(part: Array, present: NDArray[np.intp], width: int) -> Array:
    whole = np.zeros((width, width))
    whole[np.ix_(present, present)] = part
    return whole


def _by_products(triangle: Array, share: float, pieces: Sequence[Array], spared: int = 0) -> Array | None:
    """Compute the factor of a triangle and of rows by products; None where QR would be more exact.

    The preconditioner is the triangle divided by `share`, so that it is about the factor of all rows. The first of
    `spared` neighbouring rows is left out each time.
    """
    from scipy.linalg import lapack

    from .products_code import Division  # only where rows are many

    preconditioner, square = triangle / share, np.diag(np.full(len(triangle), share * share))
    given = [(np.ascontiguousarray(rows), spared) for rows in pieces]
    with np.errstate(all="ignore"):  # what is not finite has QR
        for _ in range(2):
            sizes = np.abs(preconditioner).max(axis=0)
            if not sizes.all():
                return None
            # QR knows a diagonal no better than to the rounding errors of its column.
            least = ROUNDING * sizes
            raised = np.diagonal(preconditioner) < least
            np.fill_diagonal(preconditioner, np.maximum(np.diagonal(preconditioner), least))
            division = Division(preconditioner, sizes, STEP, LARGEST_GROWTH)
            if not division.is_finite:
                return None
            if not square.any():  # rows of that size change nothing, and keep what no row shows from being singular
                given.append((np.ascontiguousarray(np.diag(least)[raised]), 0))
            for rows, left_out in given:
                division.add_products(square, rows, left_out)
            if not np.all(np.isfinite(square)):
                return None
            root, failed = lapack.dpotrf(square, lower=0)
            if failed:
                return None
            inverse = lapack.dtrtri(root)[0]
            # Longest columns of the root and of its inverse: their product is below the condition number, and at least
            # its 1/c. Rounding errors grow with its square.
            growth = np.diagonal(square).max() * np.einsum("ij,ij->i", inverse, inverse).max()
            factor = np.asarray(root @ preconditioner)
            if growth < WORST_SQUARE:
                return factor
            # Where rows are of unlike kinds, what was found is a better preconditioner than some of them.
            preconditioner, square, given = factor, np.zeros_like(square), [(triangle, 0), *given]
    return None


@dataclass(frozen=True, eq=False)
class Factor:
    """The triangular factor of ``[W omega]`` for the rows of one joint (or of all joints together).

    Attributes
    ----------
    joint : int or None
        None where the rows of all the joints are in it.
    columns : ndarray of int
        The c base parameters on which the rows depend.
    triangle : ndarray
        (c + 1, c + 1), upper triangular; the last column belongs to the regressand.
    count : int
        Number of rows that went in.
    """

    joint: int | None
    columns: NDArray[np.intp]
    triangle: Array
    count: int

    def __add__(self, other: Factor) -> Factor:
        return Factor(self.joint, self.columns, triangular(self.triangle, other.triangle), self.count + other.count)

    def changed(self, change: Array, columns: NDArray[np.intp]) -> Factor:
        """Return the factor for base parameters (n_c,) by which these are ``change @ others``, (n_b, n_c).

        Parameters
        ----------
        change : ndarray
        columns : ndarray of int
            Those of the others on which the rows depend.
        """
        rows = self.triangle[:, :-1] @ change[np.ix_(self.columns, columns)]
        return Factor(self.joint, columns, triangular(np.column_stack([rows, self.triangle[:, -1]])), self.count)

    @property
    def norm2(self) -> float:
        """Squared norm of the regressand."""
        return float(np.sum(self.triangle[:, -1] ** 2))

    def residual2(self, base: Array) -> float:
        """Return the squared norm of ``omega - W beta`` over the rows of this factor, for base parameters (n_b,)."""
        difference = self.triangle[:, :-1] @ base[self.columns] - self.triangle[:, -1]
        return float(difference @ difference)

    def residuals2(self, bases: Array) -> Array:
        """Return the same for many base parameters (k, n_b), (k,)."""
        differences = bases[:, self.columns] @ self.triangle[:, :-1].T - self.triangle[:, -1]
        return np.asarray(np.einsum("ki,ki->k", differences, differences))

    def prediction2(self, base: Array) -> float:
        """Return the squared norm of ``W beta`` over the rows of this factor, for base parameters (n_b,)."""
        predicted = self.triangle[:, :-1] @ base[self.columns]
        return float(predicted @ predicted)


def combined(factors: Sequence[Factor], weights: Array, width: int) -> Array:
    """Return the triangular factor (width + 1, width + 1) of the weighted rows of all factors together."""
    first = factors[0] if factors else None
    if len(factors) == 1 and first is not None and np.array_equal(first.columns, np.arange(width)):
        return np.asarray(weights[0] * first.triangle)
    stacked = np.zeros((sum(len(f.triangle) for f in factors), width + 1))
    row = 0
    for factor, weight in zip(factors, weights, strict=True):
        size = len(factor.triangle)
        stacked[row : row + size, [*factor.columns, width]] = weight * factor.triangle
        row += size
    return triangular(stacked)


@dataclass(frozen=True, eq=False)
class Reduced:
    """A least-squares problem over all the base parameters: ``|R beta - rho|² + residual2``  (thesis eq. 3.48).

    Attributes
    ----------
    R : ndarray
        (n_b, n_b), upper triangular.
    rho : ndarray
        (n_b,).
    residual2 : float
        The part of the squared residual that no parameters remove.
    count : int
        Number of rows.
    norm2 : float
        Squared norm of the (weighted) regressand.
    """

    R: Array
    rho: Array
    residual2: float
    count: int
    norm2: float


def column_lengths(matrix: Array) -> Array:
    """Return the Euclidean lengths of the columns."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->j", matrix, matrix)))


def is_well_conditioned(triangle: Array) -> bool:
    """Tell whether an upper triangular matrix may be solved with as it is: its condition is far from `RANK` in size."""
    from scipy.linalg import lapack

    if not len(triangle):
        return True
    return bool(np.all(np.isfinite(triangle))) and float(lapack.dtrcon(triangle)[0]) > 1e3 * RANK


def eigenvectors(matrix: Array) -> tuple[Array, Array]:
    """Return the eigenvalues, ascending, and the orthonormal eigenvectors of a symmetric matrix.

    LAPACK divides the problem, and fails on about one well-conditioned matrix in thirty thousand whose eigenvalues
    stand in clusters, on some processors only. Such a matrix is given to another of its methods.

    Parameters
    ----------
    matrix : ndarray
        (n, n), symmetric.

    Returns
    -------
    values : ndarray
        (n,).
    vectors : ndarray
        (n, n), one in each column.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix holds a number that is not finite, or neither method succeeds.

    Examples
    --------
    >>> values, vectors = eigenvectors(np.array([[2.0, 1.0], [1.0, 2.0]]))
    >>> values.round(12).tolist(), np.abs(vectors).round(4).tolist()
    ([1.0, 3.0], [[0.7071, 0.7071], [0.7071, 0.7071]])
    """
    try:
        values, vectors = np.linalg.eigh(matrix)
    except np.linalg.LinAlgError:
        if not np.all(np.isfinite(matrix)):
            raise
        from scipy.linalg import eigh

        values, vectors = eigh(matrix, driver="ev")
    return values, vectors


def solve(problem: Reduced) -> Array:
    """Return the base parameters of least squared residual, (n_b,); of least norm where there are several.

    What has no column is exactly 0: by rounding it would be friction of -1e-12, which no robot has.
    """
    from scipy.linalg import lapack

    lengths = column_lengths(problem.R)
    present = ~_missing(lengths)
    solution = np.zeros(len(lengths))
    scaled = problem.R[:, present] / lengths[present]
    is_triangle = scaled.shape == problem.R.shape == 2 * lengths.shape and not np.tril(scaled, -1).any()
    if is_triangle and is_well_conditioned(scaled):  # a tenth of the time that singular values take
        return np.asarray(lapack.dtrtrs(scaled, problem.rho)[0] / lengths)
    solution[present] = np.linalg.lstsq(scaled, problem.rho, rcond=RANK)[0] / lengths[present]
    return solution


def _missing(lengths: Array) -> NDArray[np.bool_]:
    return np.asarray(lengths <= 1e-12 * (lengths.max(initial=0.0) or 1.0))


def unidentifiable_columns(R: Array) -> NDArray[np.bool_]:
    """Tell which unknowns of a triangular problem have no unique value, (n_b,).

    Columns are scaled to length one; an unknown is unidentifiable if its column is missing, or if it takes part in a
    combination that R does not show.
    """
    lengths = column_lengths(R)
    unidentifiable = _missing(lengths)
    if not unidentifiable.any() and is_well_conditioned(R / lengths):
        return unidentifiable
    present = np.flatnonzero(~unidentifiable)
    if len(present):
        _, values, rows = np.linalg.svd(R[:, present] / lengths[present])
        missing = rows[values < RANK * values[0]]
        unidentifiable[present[(np.abs(missing) > 1e-6).any(axis=0)]] = True
    return unidentifiable
