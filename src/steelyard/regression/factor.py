"""Triangular factors of regressions: exact, of fixed size, and mergeable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Factor",
    "Reduced",
    "column_lengths",
    "combined",
    "inverse_of_triangle",
    "is_well_conditioned",
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


def triangular(rows: Array) -> Array:
    """Return the upper-triangular factor R (c, c) of rows (m, c), its diagonal not negative: ``R'R = rows' rows``."""
    width = rows.shape[1]
    factor = np.zeros((width, width))
    if len(rows):
        reduced = np.linalg.qr(rows, mode="r")
        signs = np.where(np.diagonal(reduced) < 0.0, -1.0, 1.0)
        factor[: len(reduced)] = reduced * signs[:, None]
    return factor


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
        return Factor(
            self.joint, self.columns, triangular(np.vstack([self.triangle, other.triangle])), self.count + other.count
        )

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


def inverse_of_triangle(triangle: Array) -> Array:
    """Return the inverse of an upper triangular matrix with columns of length 1; without full rank a pseudo-inverse."""
    from scipy.linalg import lapack

    if len(triangle) and is_well_conditioned(triangle):
        return np.asarray(lapack.dtrtri(triangle)[0])
    return np.asarray(np.linalg.pinv(triangle, rcond=RANK))


def solve(problem: Reduced) -> Array:
    """Return the base parameters of least squared residual, (n_b,); of least norm where there are several."""
    lengths = column_lengths(problem.R)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    solution = np.linalg.lstsq(problem.R / scale, problem.rho, rcond=RANK)[0]
    return np.asarray(solution / scale)


def unidentifiable_columns(R: Array) -> NDArray[np.bool_]:
    """Tell which unknowns of a triangular problem have no unique value, (n_b,).

    Columns are scaled to length one; an unknown is unidentifiable if its column is missing, or if it takes part in a
    combination that R does not show.
    """
    lengths = column_lengths(R)
    unidentifiable = np.asarray(lengths <= 1e-12 * (lengths.max(initial=0.0) or 1.0))
    if not unidentifiable.any() and is_well_conditioned(R / lengths):
        return unidentifiable
    present = np.flatnonzero(~unidentifiable)
    if len(present):
        _, values, rows = np.linalg.svd(R[:, present] / lengths[present])
        missing = rows[values < RANK * values[0]]
        unidentifiable[present[(np.abs(missing) > 1e-6).any(axis=0)]] = True
    return unidentifiable
