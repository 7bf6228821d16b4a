"""A reduced regression, measured around its least squares solution."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.linalg.lapack
import scipy.sparse as sparse

from steelyard.errors import InputError
from steelyard.regression import column_lengths

from ..conic import Cone
from ..feasible_set import FeasibleSet
from ..protocols import ReducedLike
from .program import Rows, upper_triangle
from .units import Units

__all__ = ["ReducedRegression"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

UNDETERMINED = 1e-9
"""Combinations of base parameters that the data shows by less than this, relative to the one it shows best, count as
undetermined."""

WELL_CONDITIONED = 1e-4
"""Reciprocal condition number from which RᵀR may be used; below, the residuals are unknowns of their own."""

NOISE_FREE = 1e-6
"""Part of ‖ω‖² that stands for the squared residual where the data has almost no noise."""

RIDGE = 1e-12
"""Curvature that settles unknowns which neither data nor conditions bound, in units of the scaled objective."""


@dataclass(frozen=True, eq=False)
class ReducedRegression:
    """‖R β - ρ‖² + residual2 = ‖R (β - β̂)‖² + residual2, with β̂ of least squares.

    Attributes
    ----------
    R : (n_b, n_b) upper triangular
    base : (n_b,)
        β̂.
    undetermined : (n_b, u)
        Directions of β that the data does not show.
    residual2 : float
    norm2 : float
    count : int
    lengths : (n_b,)
        Of the columns of R.
    reciprocal_condition : float
        Of R with columns of length 1, in the 1-norm.
    """

    R: Matrix = field(repr=False)
    base: Vector = field(repr=False)
    undetermined: Matrix = field(repr=False)
    residual2: float
    norm2: float
    count: int
    lengths: Vector = field(repr=False)
    reciprocal_condition: float

    @classmethod
    def of(cls, reduced: ReducedLike, feasible: FeasibleSet) -> "ReducedRegression":
        """Check it against the model of the feasible set.

        Raises
        ------
        InputError
            For data of another model or without usable samples.
        """
        R, rho = np.asarray(reduced.R, dtype=float), np.asarray(reduced.rho, dtype=float)
        count = feasible.K.shape[0]
        if R.ndim != 2 or R.shape[1] != count or rho.shape != (R.shape[0],):
            raise InputError(
                f"the data belongs to another model: its reduced regression has R of shape {R.shape}, but the "
                f"feasible set is of a model with {count} base parameters; use the Information of the same model."
            )
        norm2, residual2 = float(reduced.norm2), float(reduced.residual2)
        if not (np.all(np.isfinite(R)) and np.all(np.isfinite(rho)) and norm2 > 0):
            raise InputError("the data holds no usable samples: its torques are all zero or not finite numbers.")
        if R.shape[0] != count or np.any(np.tril(R, -1)):
            R, rho, lost = _triangular(R, rho)
            residual2 += lost
        lengths = column_lengths(R)
        scaled = R / np.where(lengths > 0, lengths, 1.0)
        # A triangular solution where that is safe; rows and columns of what is undetermined need singular values.
        reciprocal = float(scipy.linalg.lapack.dtrcon(scaled)[0]) if count else 1.0
        if reciprocal > 1e3 * UNDETERMINED:
            base, undetermined = scipy.linalg.solve_triangular(R, rho, check_finite=False), np.zeros((count, 0))
        else:
            left, values, right = np.linalg.svd(scaled)
            shown = values > UNDETERMINED * values.max(initial=0.0)
            scale = np.where(lengths > 0, lengths, 1.0)
            base = (right[shown].T @ ((left[:, shown].T @ rho) / values[shown])) / scale
            undetermined = np.linalg.qr(right[~shown].T / scale[:, None])[0]
            error = R @ base - rho
            residual2 += float(error @ error)
        return cls(R, base, undetermined, residual2, norm2, int(reduced.count), lengths, reciprocal)

    @property
    def scale(self) -> float:
        """Unit of the squared residual."""
        return max(self.residual2, NOISE_FREE * self.norm2)

    @property
    def tiny(self) -> float:
        """What squared residuals cannot be told apart by."""
        return 1e-12 * self.norm2

    @property
    def variance(self) -> float:
        """Variance of the rows, from the residual of plain least squares; at least 1e-12 of their mean square."""
        freedom = max(self.count - len(self.base), 1)
        return max(self.residual2, self.tiny) / freedom

    def squared_residual(self, base: Vector) -> float:
        """‖W β - ω‖²."""
        return self.residual2 + self.excess(base)

    def excess(self, base: Vector) -> float:
        """What β costs over plain least squares."""
        error = self.R @ (base - self.base)
        return float(error @ error)

    def sizes(self, feasible: FeasibleSet) -> Vector:
        """The value of each standard parameter that alone would explain all torques, (n,); infinite where none does."""
        lengths = np.zeros(feasible.parameter_count)
        lengths[np.asarray(feasible.model.base_parameters().independent, dtype=np.intp)] = self.lengths
        dependent = np.asarray(feasible.model.base_parameters().dependent, dtype=np.intp)
        if len(dependent):
            lengths[dependent] = column_lengths(self.R @ feasible.K[:, dependent])
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt(self.norm2) / lengths)

    def units(self, feasible: FeasibleSet) -> Units:
        """Units of which these torques speak."""
        return Units.from_sizes(feasible, self.sizes(feasible))

    def objective(
        self, columns: Vector, shift: Vector | None = None
    ) -> tuple[sparse.csc_array, Vector, tuple[Rows, ...]]:
        """P, q and further rows of ‖R (β - β̂)‖² / scale, less a constant; β - β̂ = shift + columns x̂ of the first n_b.

        Parameters
        ----------
        columns : (m,)
            Units of all unknowns.
        shift : (n_b,), optional
            Zero where absent.
        """
        count, size = len(self.base), len(columns)
        root = np.sqrt(self.scale)
        factor = self.R * (columns[:count] / root)
        offset = np.zeros(count) if shift is None else self.R @ (shift / root)
        if self.reciprocal_condition > WELL_CONDITIONED:
            P = upper_triangle(2.0 * (factor.T @ factor), size)
            if size > count:
                P = sparse.csc_array(P + sparse.diags_array(np.full(size, RIDGE), format="csc"))
            q = np.zeros(size)
            if shift is not None:
                q[:count] = 2.0 * (factor.T @ offset)
            return P, q, ()
        # y = R (β - β̂) / root, less its offset, as unknowns of their own, so that R is never squared.
        weights = np.concatenate([np.full(size, RIDGE), np.full(count, 2.0)])
        P = sparse.csc_array(sparse.diags_array(weights, format="csc"))
        blocks = [sparse.csc_array(factor), sparse.csc_array((count, size - count)), -sparse.eye_array(count)]
        residuals = Rows(sparse.csc_array(sparse.hstack(blocks, format="csc")), np.zeros(count), Cone("zero", count))
        return P, np.concatenate([np.zeros(size), 2.0 * offset]), (residuals,)

    def ball(self, columns: Vector, radius: float) -> Rows:
        """The rows that keep ‖R columns x̂‖ at most at `radius`, over the first n_b unknowns."""
        count, size = len(self.base), len(columns)
        factor = self.R * (columns[:count] / radius)
        rows = np.zeros((count + 1, count))
        rows[1:] = -factor
        matrix = sparse.hstack([sparse.csc_array(rows), sparse.csc_array((count + 1, size - count))], format="csc")
        return Rows(sparse.csc_array(matrix), np.eye(count + 1)[0], Cone("second-order", count + 1))


def _triangular(R: Matrix, rho: Vector) -> tuple[Matrix, Vector, float]:
    """An upper triangular R with the same RᵀR, its ρ, and the squared residual that is lost."""
    count = R.shape[1]
    rows = np.column_stack([R, rho])
    triangle = np.zeros((count + 1, count + 1))
    reduced = np.linalg.qr(rows, mode="r")
    triangle[: len(reduced)] = reduced
    return triangle[:count, :count], triangle[:count, count], float(triangle[count, count] ** 2)
