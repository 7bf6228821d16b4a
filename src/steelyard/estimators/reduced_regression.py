"""A reduced regression with its least-squares solution, as part of the objective of a fit."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.linalg.lapack
import scipy.sparse as sparse

from steelyard.conic import Cone, Rows
from steelyard.feasibility.cone_program import Part, upper_triangle
from steelyard.feasibility.feasible_set import FeasibleSet, reduced_regression
from steelyard.feasibility.units import Units
from steelyard.regression import Reduced, column_lengths

__all__ = ["ReducedRegression"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

UNIDENTIFIABLE = 1e-9
"""Singular values of R (columns scaled to length 1) below this part of the largest belong to combinations of base
parameters that count as unidentifiable; they are of the size of the rounding errors of a regressor."""

WELL_CONDITIONED = 1e-4
"""Reciprocal condition number above which the objective may use RᵀR; below it, the residuals become unknowns, so that R
is not squared. On 100 random fits either form alone finds the optima within 1e-6, with as many iterations to 3 %; RᵀR
makes the smaller problems."""

NOISE_FREE = 1e-6
"""The unit of the squared residual is at least this part of ‖ω‖², since data of a simulation without noise has none."""

LEAST_SIZE = 1e-10
"""Differences between squared residuals are told relative to at least this part of ‖ω‖²: torques that are known to 1e-5
leave a residual of that size."""

RIDGE = 1e-12
"""Curvature, in units of the scaled objective, that makes unknowns unique which neither data nor conditions determine.
It pulls towards the origin of the program, which therefore must not be the least-squares solution: where that lies far
out, the pull would decide the answer. On 100 random fits 1e-9 leaves 8 with gaps up to 3e-3; with 0 the solver needs 10
% more iterations."""

NEARNESS = 1e-2
"""Cost of a step of one unit in `ReducedRegression.ridge`, as a part of the unit of the squared residual. Anything
from 1e-6 to 1 serves as well (100 random fits: the same gaps); 0 would be the least-squares solution itself."""


@dataclass(frozen=True, eq=False)
class ReducedRegression:
    """The squared residual ‖R β - ρ‖² + outside, and its minimum, the least-squares solution β̂.

    Attributes
    ----------
    R : (n_b, n_b) upper triangular
    rho : (n_b,)
        ρ.
    outside : float
        The part of the squared residual that does not depend on the parameters.
    base : (n_b,)
        β̂.
    unidentifiable : (n_b, u)
        Orthonormal directions of β that the data does not determine.
    residual2 : float
        Squared residual of β̂.
    lengths : (n_b,)
        Lengths of the columns of R.
    reciprocal_condition : float
        Reciprocal condition number of R with columns scaled to length 1, in the 1-norm.
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
        """Check a reduced regression against the model of the feasible set, and solve it.

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
        # Solving with the triangle is safe for a well-conditioned R; else singular values tell what is identifiable.
        reciprocal = float(scipy.linalg.lapack.dtrcon(scaled)[0]) if count else 1.0
        if reciprocal > 1e3 * UNIDENTIFIABLE:
            base, unidentifiable = scipy.linalg.solve_triangular(R, rho, check_finite=False), np.zeros((count, 0))
        else:
            left, values, right = np.linalg.svd(scaled)
            shown = values > UNIDENTIFIABLE * values.max(initial=0.0)
            scale = np.where(lengths > 0, lengths, 1.0)
            base = (right[shown].T @ ((left[:, shown].T @ rho) / values[shown])) / scale
            unidentifiable = np.linalg.qr(right[~shown].T / scale[:, None])[0]
            error = R @ base - rho
            residual2 += float(error @ error)
        return cls(R, rho, outside, base, unidentifiable, residual2, checked.norm2, checked.count, lengths, reciprocal)

    @property
    def scale(self) -> float:
        """Unit of the squared residual in programs."""
        return max(self.residual2, NOISE_FREE * self.norm2)

    @property
    def tiny(self) -> float:
        """Differences between squared residuals below this are rounding errors."""
        return 1e-6 * self.least_size

    @property
    def least_size(self) -> float:
        """Smallest unit of differences between squared residuals."""
        return LEAST_SIZE * self.norm2

    @property
    def variance(self) -> float:
        """Variance of the rows, from the residual of plain least squares; at least 1e-12 of their mean square."""
        freedom = max(self.count - len(self.base), 1)
        return max(self.residual2, self.noise_floor) / freedom

    @property
    def noise_floor(self) -> float:
        """Squared residual below which data counts as free of noise."""
        return 1e-12 * self.norm2

    def squared_residual(self, base: Vector) -> float:
        """‖W β - ω‖²."""
        error = self.residuals(base)
        return self.outside + float(error @ error)

    def residuals(self, base: Vector) -> Vector:
        """R β - ρ, (n_b,)."""
        return np.asarray(self.R @ base - self.rho)

    def ridge(self, units: Vector) -> Vector:
        """Base parameters of moderate size that explain the data nearly as well as β̂, (n_b,).

        With weak excitation β̂ may be so large that numbers of the size of real parameters are lost to rounding. The
        units (n_b,) are typical sizes; a step of one unit costs `NEARNESS` of the unit of the residual.
        """
        count = len(self.base)
        rows = np.vstack([self.R * (units / np.sqrt(self.scale)), np.sqrt(NEARNESS) * np.eye(count)])
        right = np.concatenate([self.rho / np.sqrt(self.scale), np.zeros(count)])
        orthogonal, triangle = np.linalg.qr(rows)
        return np.asarray(units * scipy.linalg.solve_triangular(triangle, orthogonal.T @ right))

    def sizes(self, feasible_set: FeasibleSet) -> Vector:
        """The size of each standard parameter that alone would cause torques as large as the measured ones, (n,)."""
        lengths = np.zeros(feasible_set.parameter_count)
        lengths[np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)] = self.lengths
        dependent = np.asarray(feasible_set.model.base_parameters().dependent, dtype=np.intp)
        if len(dependent):
            lengths[dependent] = column_lengths(self.R @ feasible_set.K[:, dependent])
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt(self.norm2) / lengths)

    def units(self, feasible_set: FeasibleSet) -> Units:
        """Units of the parameters, from the size of the measured torques."""
        return Units.from_sizes(feasible_set, self.sizes(feasible_set))

    def objective(self, columns: Vector, base: Vector, scale: float, apart: bool = False) -> Part:
        """‖R β - ρ‖² / scale up to a constant, with β = base + columns x̂ over the first n_b unknowns.

        Parameters
        ----------
        columns : (m,)
            Units of all unknowns.
        base : (n_b,)
            β where x̂ = 0.
        scale : float
            Unit of the squared residual.
        apart : bool
            Whether the residuals become unknowns even if R is well conditioned.
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
        # The residuals y = R columns x̂ / root become unknowns, so that R is not squared.
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
    """An upper triangular R with the same RᵀR, its ρ, and the squared residual of the rows that drop out."""
    count = R.shape[1]
    rows = np.column_stack([R, rho])
    triangle = np.zeros((count + 1, count + 1))
    reduced = np.linalg.qr(rows, mode="r")
    triangle[: len(reduced)] = reduced
    return triangle[:count, :count], triangle[:count, count], float(triangle[count, count] ** 2)
