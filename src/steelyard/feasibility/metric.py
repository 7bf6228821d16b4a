"""Metrics: quadratic forms of differences of parameters, stored as factors so that nothing is squared."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.errors import InputError

from .feasible_set import FeasibleSet

__all__ = ["Metric"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ROUNDING = 1e-10
"""Relative size below which asymmetries, negative eigenvalues and singular values count as rounding errors: matrices
come from products and inverses of users, with a few digits lost."""


@dataclass(frozen=True, eq=False)
class Metric:
    """The squared distance ‖R d‖² of a difference d.

    Attributes
    ----------
    name : str
        ``"Euclidean"``, ``"given"``, ``"covariance"`` or ``"data"``.
    factor : (r, k) or None
        R; None for the Euclidean metric.

    Examples
    --------
    >>> Metric("given", np.array([[2.0, 0.0], [0.0, 1.0]])).squared(np.array([1.0, 3.0]))
    13.0
    """

    name: str
    factor: Matrix | None = field(repr=False)

    @classmethod
    def of(cls, metric: Any, covariance: Any, feasible_set: FeasibleSet, standard: bool) -> "Metric":
        """The metric of the arguments of `correct`.

        Parameters
        ----------
        metric : None, (k, k) or an object with `reduced` such as `Information`
        covariance : None or (k, k)
        feasible_set : FeasibleSet
        standard : bool
            Whether differences are of standard parameters, k = n, rather than of base parameters, k = n_b.

        Raises
        ------
        InputError
            If both are given, or a matrix is not symmetric and positive (semi)definite.
        """
        count = feasible_set.parameter_count if standard else feasible_set.K.shape[0]
        kind = "standard" if standard else "base"
        if metric is not None and covariance is not None:
            raise InputError("give either metric= or covariance=, not both; the metric is the inverse of a covariance.")
        if covariance is not None:
            return cls("covariance", _whitening(_symmetric(covariance, "covariance", count, kind)))
        if metric is None:
            return cls("Euclidean", None)
        if hasattr(metric, "reduced"):
            factor = np.asarray(metric.reduced().R, dtype=float)
            if factor.ndim != 2 or factor.shape[1] != feasible_set.K.shape[0]:
                raise InputError(
                    f"metric belongs to another model: its reduced regression has R of shape {factor.shape}, but this "
                    f"model has {feasible_set.K.shape[0]} base parameters; use the Information of the same model."
                )
            if not np.all(np.isfinite(factor)) or not np.any(factor):
                raise InputError("metric holds no usable samples; give the Information of a recording that moves.")
            return cls("data", factor @ feasible_set.K if standard else factor)
        return cls("given", _root(_symmetric(metric, "metric", count, kind)))

    def squared(self, difference: Vector) -> float:
        """‖R d‖²."""
        seen = difference if self.factor is None else self.factor @ difference
        return float(seen @ seen)

    @property
    def size(self) -> float:
        """Largest length of a column of R: the largest distance of a unit step of one parameter."""
        return 1.0 if self.factor is None else float(np.linalg.norm(self.factor, axis=0).max())

    @property
    def is_diagonal(self) -> bool:
        """Whether the metric has no products of different parameters."""
        if self.factor is None:
            return True
        rows, columns = np.nonzero(self.factor)
        return len(np.unique(rows)) == len(rows) == len(np.unique(columns))

    @property
    def null_space(self) -> Matrix:
        """Orthonormal directions along which the distance is zero, as rows (k - rank, k)."""
        if self.factor is None:
            return np.zeros((0, 0))
        lengths = np.linalg.norm(self.factor, axis=0)
        units = np.where(lengths > 0, lengths, 1.0)
        _, sizes, right = np.linalg.svd(self.factor / units)
        rank = int(np.sum(sizes > ROUNDING * sizes[0]))
        if rank == self.factor.shape[1]:
            return np.zeros((0, rank))
        return np.asarray(np.linalg.qr((right[rank:] / units).T)[0].T, dtype=float)


def _symmetric(given: Any, name: str, count: int, kind: str) -> Matrix:
    """A finite symmetric matrix of that order."""
    try:
        matrix = np.asarray(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name} must be a ({count}, {count}) matrix or an Information, got {type(given).__name__}."
        ) from error
    if matrix.shape != (count, count):
        raise InputError(
            f"{name} must be of shape ({count}, {count}), a row for each of the {count} {kind} parameters, got an "
            f"array of shape {matrix.shape}."
        )
    if not np.all(np.isfinite(matrix)):
        row, column = np.argwhere(~np.isfinite(matrix))[0]
        raise InputError(f"{name} must be finite, got {matrix[row, column]} in row {row + 1}, column {column + 1}.")
    difference = np.abs(matrix - matrix.T)
    if difference.max(initial=0.0) > ROUNDING * np.abs(matrix).max(initial=0.0):
        row, column = np.unravel_index(int(np.argmax(difference)), matrix.shape)
        raise InputError(
            f"{name} must be symmetric, but elements ({row + 1}, {column + 1}) and ({column + 1}, {row + 1}) are "
            f"{matrix[row, column]:.6g} and {matrix[column, row]:.6g}."
        )
    return np.asarray(0.5 * (matrix + matrix.T), dtype=float)


def _eigenvalues(matrix: Matrix, name: str, definite: bool) -> tuple[Vector, Matrix, Vector]:
    """Eigenvalues and eigenvectors of the matrix after its diagonal is scaled to 1, and the units of that scaling."""
    diagonal = np.diag(matrix)
    expected = "positive definite" if definite else "positive semidefinite"
    # If a diagonal element of a semidefinite matrix is zero, so are its row and column.
    absent = diagonal <= 0
    if np.any(diagonal < 0) or np.any(matrix[absent]) or (definite and np.any(absent)):
        worst = int(np.argmin(diagonal))
        raise InputError(f"{name} must be {expected}, but its diagonal element {worst + 1} is {diagonal[worst]:.6g}.")
    units = np.where(absent, 1.0, np.sqrt(diagonal))
    values, vectors = np.linalg.eigh(matrix / np.outer(units, units))
    least = 10 * ROUNDING * ROUNDING if definite else -ROUNDING
    if values[0] < least * values[-1]:
        hint = "; parameters that the data does not determine have no covariance, give metric= instead"
        raise InputError(
            f"{name} must be {expected}, but its smallest eigenvalue is {values[0]:.6g} in units in which its diagonal "
            f"is 1{hint if definite else ''}."
        )
    return values, vectors, units


def _root(matrix: Matrix) -> Matrix:
    """R with RᵀR = M."""
    if not np.any(matrix):
        raise InputError(
            "metric is zero everywhere, so that nothing is near or far; leave it out for the Euclidean one."
        )
    if np.count_nonzero(matrix) == np.count_nonzero(np.diag(matrix)) and np.all(np.diag(matrix) >= 0):
        return np.diag(np.sqrt(np.diag(matrix)))
    values, vectors, units = _eigenvalues(matrix, "metric", False)
    kept = values > ROUNDING * ROUNDING * values[-1]
    return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T * units, dtype=float)


def _whitening(covariance: Matrix) -> Matrix:
    """R with RᵀR = C⁻¹: the inverse of the Cholesky factor."""
    _, _, units = _eigenvalues(covariance, "covariance", True)
    try:
        factor = np.linalg.cholesky(covariance / np.outer(units, units))
    except np.linalg.LinAlgError as error:
        raise InputError(
            "covariance must be positive definite, but it is singular to working accuracy; give metric= instead."
        ) from error
    return np.asarray(scipy.linalg.solve_triangular(factor, np.diag(1.0 / units), lower=True), dtype=float)
