"""A reduced regression, measured around its least squares solution."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.linalg.lapack
import scipy.sparse as sparse

from steelyard.conic import Cone, Rows
from steelyard.feasibility.bounds.confidence_region import reduced_regression
from steelyard.feasibility.cone_program import Part, upper_triangle
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.units import Units
from steelyard.regression import Reduced, column_lengths

__all__ = ["ReducedRegression"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

UNDETERMINED = 1e-9
"""Combinations of base parameters that the data shows by less than this, relative to the one it shows best, count as
unidentifiable."""

WELL_CONDITIONED = 1e-4
"""Reciprocal condition number from which RᵀR may be used; below, the residuals are unknowns of their own."""

NOISE_FREE = 1e-6
"""Part of ‖ω‖² that stands for the squared residual where the data has almost no noise."""

LEAST_SIZE = 1e-10
"""Part of ‖ω‖² below which a squared residual is no longer told exactly; torques that are known to 1e-5 leave that."""

RIDGE = 1e-12
"""Curvature that settles unknowns which neither data nor conditions bound, in units of the scaled objective. It pulls
towards the origin of the program, which therefore may not be plain least squares: where that lies far out, the pull
would decide the answer."""

NEARNESS = 1e-2
"""See `ReducedRegression.middle`."""


@dataclass(frozen=True, eq=False)
class ReducedRegression:
    """‖R β - ρ‖² + outside, which is least at β̂ of least squares.

    Attributes
    ----------
    R : (n_b, n_b) upper triangular
    rho : (n_b,)
        ρ.
    outside : float
        The part of the squared residual that no parameters change.
    base : (n_b,)
        β̂.
    unidentifiable : (n_b, u)
        Directions of β that the data does not show.
    residual2 : float
        Squared residual of β̂.
    norm2 : float
    count : int
    lengths : (n_b,)
        Of the columns of R.
    reciprocal_condition : float
        Of R with columns of length 1, in the 1-norm.
    """

    R: Matrix = field(repr=False)
    rho: Vector = field(repr=False)
    outside: float
    base: Vector = field(repr=False)
    unidentifiable: Matrix = field(repr=False)
    residual2: float
    norm2: float
    count: int
    lengths: Vector = field(repr=False)
    reciprocal_condition: float

    @classmethod
    def of(cls, reduced: Reduced, feasible_set: FeasibleSet) -> "ReducedRegression":
        """Check it against the model of the feasible set.

        Raises
        ------
        InputError
            For data of another model or without usable samples.
        """
        checked = reduced_regression(reduced, None, feasible_set)
        R, rho, residual2, count = checked.R, checked.rho, checked.residual2, feasible_set.K.shape[0]
        if R.shape[0] != count or np.any(np.tril(R, -1)):
            R, rho, lost = _triangular(R, rho)
            residual2 += lost
        outside = residual2
        lengths = column_lengths(R)
        scaled = R / np.where(lengths > 0, lengths, 1.0)
        # A triangular solution where that is safe; rows and columns of what is unidentifiable need singular values.
        reciprocal = float(scipy.linalg.lapack.dtrcon(scaled)[0]) if count else 1.0
        if reciprocal > 1e3 * UNDETERMINED:
            base, unidentifiable = scipy.linalg.solve_triangular(R, rho, check_finite=False), np.zeros((count, 0))
        else:
            left, values, right = np.linalg.svd(scaled)
            shown = values > UNDETERMINED * values.max(initial=0.0)
            scale = np.where(lengths > 0, lengths, 1.0)
            base = (right[shown].T @ ((left[:, shown].T @ rho) / values[shown])) / scale
            unidentifiable = np.linalg.qr(right[~shown].T / scale[:, None])[0]
            error = R @ base - rho
            residual2 += float(error @ error)
        return cls(R, rho, outside, base, unidentifiable, residual2, checked.norm2, checked.count, lengths, reciprocal)

    @property
    def scale(self) -> float:
        """Unit of the squared residual."""
        return max(self.residual2, NOISE_FREE * self.norm2)

    @property
    def tiny(self) -> float:
        """What squared residuals cannot be told apart by."""
        return 1e-6 * self.least_size

    @property
    def least_size(self) -> float:
        """Smaller squared residuals count as this, where differences are taken relative to them."""
        return LEAST_SIZE * self.norm2

    @property
    def variance(self) -> float:
        """Variance of the rows, from the residual of plain least squares; at least 1e-12 of their mean square."""
        freedom = max(self.count - len(self.base), 1)
        return max(self.residual2, self.noise_floor) / freedom

    @property
    def noise_floor(self) -> float:
        """Data with a smaller squared residual counts as free of noise."""
        return 1e-12 * self.norm2

    def squared_residual(self, base: Vector) -> float:
        """‖W β - ω‖²."""
        error = self.residuals(base)
        return self.outside + float(error @ error)

    def residuals(self, base: Vector) -> Vector:
        """R β - ρ, (n_b,)."""
        return np.asarray(self.R @ base - self.rho)

    def middle(self, units: Vector) -> Vector:
        """Base parameters that explain the data nearly as well as β̂ without going far for it, (n_b,).

        Weak excitation puts β̂ far out, where numbers of the size of a robot's parameters are lost to rounding.

        Parameters
        ----------
        units : (n_b,)
            Sizes that are typical of the base parameters; one of each costs `NEARNESS` of the unit of the residual.
        """
        count = len(self.base)
        rows = np.vstack([self.R * (units / np.sqrt(self.scale)), np.sqrt(NEARNESS) * np.eye(count)])
        right = np.concatenate([self.rho / np.sqrt(self.scale), np.zeros(count)])
        orthogonal, triangle = np.linalg.qr(rows)
        return np.asarray(units * scipy.linalg.solve_triangular(triangle, orthogonal.T @ right))

    def sizes(self, feasible_set: FeasibleSet) -> Vector:
        """The value of each standard parameter that alone would explain all torques, (n,); infinite where none does."""
        lengths = np.zeros(feasible_set.parameter_count)
        lengths[np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)] = self.lengths
        dependent = np.asarray(feasible_set.model.base_parameters().dependent, dtype=np.intp)
        if len(dependent):
            lengths[dependent] = column_lengths(self.R @ feasible_set.K[:, dependent])
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt(self.norm2) / lengths)

    def units(self, feasible_set: FeasibleSet) -> Units:
        """Units of which these torques speak."""
        return Units.from_sizes(feasible_set, self.sizes(feasible_set))

    def objective(self, columns: Vector, base: Vector, scale: float, apart: bool = False) -> Part:
        """‖R β - ρ‖² / scale, less a constant; β = base + columns x̂ of the first n_b.

        Parameters
        ----------
        columns : (m,)
            Units of all unknowns.
        base : (n_b,)
            β where x̂ = 0.
        scale : float
            Unit of the squared residual.
        apart : bool
            Whether the residuals are unknowns of their own however well conditioned R is.
        """
        count, size = len(self.base), len(columns)
        root = np.sqrt(scale)
        factor = self.R * (columns[:count] / root)
        offset = self.residuals(base) / root
        if self.reciprocal_condition > WELL_CONDITIONED and not apart:
            P = upper_triangle(2.0 * (factor.T @ factor), size)
            if size > count:
                P = sparse.csc_array(P + sparse.diags_array(np.full(size, RIDGE), format="csc"))
            return Part(P, np.concatenate([2.0 * (factor.T @ offset), np.zeros(size - count)]))
        # y = R columns x̂ / root as unknowns of their own, so that R is never squared.
        weights = np.concatenate([np.full(size, RIDGE), np.full(count, 2.0)])
        P = sparse.csc_array(sparse.diags_array(weights, format="csc"))
        blocks = [sparse.csc_array(factor), sparse.csc_array((count, size - count)), -sparse.eye_array(count)]
        residuals = Rows(sparse.csc_array(sparse.hstack(blocks, format="csc")), np.zeros(count), Cone("zero", count))
        return Part(P, np.concatenate([np.zeros(size), 2.0 * offset]), (residuals,), count)

    def ball(self, columns: Vector, radius: float, offset: Vector | None = None) -> Rows:
        """The rows that keep ‖offset + R columns x̂‖ at most at `radius`, over the first n_b unknowns."""
        count = len(self.base)
        factor = self.R * (columns[:count] / radius)
        rows = np.zeros((count + 1, count))
        rows[1:] = -factor
        right = np.eye(count + 1)[0]
        if offset is not None:
            right[1:] = offset / radius
        return Rows(rows, right, Cone("second-order", count + 1))


def _triangular(R: Matrix, rho: Vector) -> tuple[Matrix, Vector, float]:
    """An upper triangular R with the same RᵀR, its ρ, and the squared residual that is lost."""
    count = R.shape[1]
    rows = np.column_stack([R, rho])
    triangle = np.zeros((count + 1, count + 1))
    reduced = np.linalg.qr(rows, mode="r")
    triangle[: len(reduced)] = reduced
    return triangle[:count, :count], triangle[:count, count], float(triangle[count, count] ** 2)
