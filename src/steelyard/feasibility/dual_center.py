"""Newton's method for the analytic center of the dual points, which finds a feasible point or a proof of none.

The function v(W) - Σ log det W_b, with v(W) = Σ <D_b(δ), W_b> for dual points W, has a minimum exactly where the base
parameters are strictly feasible: there W_b⁻¹ = D_b(δ) for the analytic center δ of its fibre. Otherwise it falls
without bound, and v becomes negative. The function is self-concordant, so that steps do not depend on units, even if
some links are much smaller than others (Nesterov and Nemirovskii 1994; on such dual steps, Benson, Ye and Zhang 2000).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg as linalg

from steelyard.conic import Cone, ConicProblem, Rows, solve
from steelyard.lmi import AffineStack, symmetric_to_vector, vector_to_symmetric

from .feasible_set import FeasibleSet
from .margin import BlockProblem, DualPoint

__all__ = ["Center", "Fibre", "LocalMetric", "center", "line_minimum"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


class Fibre:
    """The blocks Uᵀ D(δ) U for all δ with K δ = β and the equations of constraints: origin + columns x.

    Parameters
    ----------
    origin : (n,)
        A δ of the fibre; rounding errors are small if it is close to the solution.
    bases : tuple of (d, r)
        Bases of the face of the dual points.
    """

    def __init__(self, feasible_set: FeasibleSet, origin: Vector, bases: tuple[Matrix, ...]) -> None:
        problem = BlockProblem.of(feasible_set, origin, bases)
        stack = problem.stack
        self.feasible_set, self.bases, self.stack, self.used = feasible_set, bases, stack, problem.used
        self._equations = feasible_set.equation_matrix @ feasible_set.unidentifiable
        directions: Matrix = np.eye(stack.parameter_count)
        self.origin = origin
        if len(self._equations):
            values = feasible_set.equation_values - feasible_set.equation_matrix @ origin
            self.origin = origin + feasible_set.unidentifiable @ np.linalg.lstsq(self._equations, values)[0]
            directions = linalg.null_space(self._equations)
        # Directions that change no block are left out.
        columns = stack.coefficients @ directions
        lengths = np.linalg.norm(columns, axis=0)
        seen = lengths > 0
        directions, columns = directions[:, seen] / lengths[seen], columns[:, seen] / lengths[seen]
        rank, steps = 0, np.zeros((len(directions), 0))
        if columns.shape[1]:
            _, triangle, order = linalg.qr(columns, mode="economic", pivoting=True)
            sizes = np.abs(np.diag(triangle))
            rank = int(np.sum(sizes > 1e-10 * sizes.max(initial=0.0)))
            steps = directions[:, order[:rank]]
        self.directions = feasible_set.unidentifiable @ steps
        self.columns = stack.coefficients @ steps

    def blocks(self, parameters: Vector) -> tuple[Matrix, ...]:
        """Uᵀ D(δ) U of the blocks that are used."""
        found = []
        for index in self.used:
            basis = self.bases[index]
            found.append(basis.T @ self.feasible_set.blocks[index].evaluate(parameters) @ basis)
        return tuple(found)

    def matrices(self, point: DualPoint) -> tuple[Matrix, ...]:
        """W of the blocks that are used."""
        return tuple(point.matrices[index] for index in self.used)

    def point(self, matrices: Sequence[Matrix]) -> DualPoint:
        """The dual point of W of the blocks that are used, with the multipliers of the equations that belong to it."""
        full: list[Matrix] = [np.zeros((0, 0))] * len(self.feasible_set.blocks)
        vector = np.zeros(self.columns.shape[0])
        for index, place, matrix in zip(self.used, self.stack.slices, matrices, strict=True):
            full[index] = matrix
            vector[place] = symmetric_to_vector(matrix)
        multipliers = np.zeros(len(self._equations))
        if len(self._equations):
            multipliers = np.linalg.lstsq(self._equations.T, -(self.stack.coefficients.T @ vector))[0]
        return DualPoint(tuple(full), np.asarray(multipliers))

    def metric(self, matrices: Sequence[Matrix]) -> "LocalMetric":
        """The metric in which a dual point W = R Rᵀ is the unit matrix.

        Raises
        ------
        numpy.linalg.LinAlgError
            If a matrix is not positive definite.
        """
        roots = tuple(np.asarray(np.linalg.cholesky(matrix), dtype=float) for matrix in matrices)
        scaled = np.zeros_like(self.columns)
        for root, place in zip(roots, self.stack.slices, strict=True):
            scaled[place] = symmetric_to_vector(root.T @ vector_to_symmetric(self.columns[place].T) @ root).T
        lengths = np.maximum(np.linalg.norm(scaled, axis=0), np.finfo(float).tiny)
        Q, triangle = np.linalg.qr(scaled / lengths)
        return LocalMetric(self.stack, roots, Q, triangle, lengths)


@dataclass(frozen=True, eq=False)
class LocalMetric:
    """Blocks Rᵀ D R and dual matrices R⁻¹ W R⁻ᵀ, where W = R Rᵀ is a dual point.

    Attributes
    ----------
    stack : AffineStack
        Sizes and places of the blocks.
    roots : tuple of (r, r)
        R, lower triangular.
    Q : (rows, k)
        Orthonormal basis of the blocks along the fibre; dual points are orthogonal to it.
    triangle, lengths : (k, k), (k,)
        Q triangle = scaled columns / lengths.
    """

    stack: AffineStack
    roots: tuple[Matrix, ...]
    Q: Matrix
    triangle: Matrix
    lengths: Vector

    def stacked(self, blocks: Sequence[Matrix]) -> Vector:
        """Rᵀ D R, stacked."""
        vector = np.zeros(len(self.Q))
        for root, block, place in zip(self.roots, blocks, self.stack.slices, strict=True):
            vector[place] = symmetric_to_vector(root.T @ block @ root)
        return vector

    def along(self, coordinates: Vector) -> Vector:
        """Coordinates with respect to the columns of the fibre, from those with respect to Q."""
        if not len(coordinates):
            return coordinates
        return np.asarray(linalg.solve_triangular(self.triangle, coordinates) / self.lengths)

    def across(self, vector: Vector) -> Vector:
        """The part of a vector that is orthogonal to the fibre, to rounding."""
        for _ in range(2):
            vector = vector - self.Q @ (self.Q.T @ vector)
        return vector

    def expanded(self, vector: Vector) -> tuple[Matrix, ...]:
        """R M Rᵀ of the matrices M that are stacked in a vector."""
        found = []
        for root, matrix in zip(self.roots, self.stack.matrices(vector), strict=True):
            product = root @ matrix @ root.T
            found.append((product + product.T) / 2)
        return tuple(found)

    def largest_margin(self, constant: Vector, cap: float, accuracy: float) -> tuple[float, Vector, Vector]:
        """Solve max t subject to constant + Q q - t 1 ⪰ 0, t ≤ cap.

        Returns t, q, and the part of the dual vector that is orthogonal to the fibre.
        """
        count = self.Q.shape[1]
        cost = np.append(np.zeros(count), -1.0)
        capped = Rows(-cost[None], np.array([cap]), Cone("nonnegative", 1))
        blocks = Rows(np.column_stack([-self.Q, self.stack.identity]), constant, *self.stack.cones)
        problem = ConicProblem.from_rows(cost, (capped, blocks))
        solution = solve(problem, accuracy=accuracy)
        if not solution.usable:
            return -np.inf, np.zeros(count), self.across(solution.dual[1:])
        return float(solution.primal[-1]), solution.primal[:-1], self.across(solution.dual[1:])


CLEARLY_INSIDE = 1e-3
"""A step whose scaled blocks have eigenvalues above this has found a feasible point: far enough inside for rounding."""

LARGEST = 1e60
"""Dual points grow without bound if the base parameters lie exactly on the boundary; the iterations end at this
size."""


@dataclass(frozen=True, eq=False)
class Center:
    """The last point of the iterations.

    Attributes
    ----------
    matrices : tuple of (r, r)
        W, positive definite.
    parameters : (n,)
        The best δ that belongs to it; if `feasible`, its blocks are positive definite on the face.
    value : float
        v; if it is negative, W proves infeasibility up to rounding.
    """

    matrices: tuple[Matrix, ...]
    parameters: Vector
    feasible: bool
    value: float


def center(fibre: Fibre, matrices: tuple[Matrix, ...], iterations: int) -> Center | None:
    """Iterate from a dual point inside the cone; None if rounding errors lead out of it.

    Parameters
    ----------
    fibre : Fibre
    matrices : tuple of (r, r)
        W at the start.
    iterations : int
        Largest number of Newton steps.
    """
    parameters = fibre.origin
    value, inside = np.inf, False
    for _ in range(iterations):
        if not all(np.all(np.abs(matrix) < LARGEST) for matrix in matrices):
            return None
        try:
            metric = fibre.metric(matrices)
        except np.linalg.LinAlgError:
            return None
        scaled = metric.stacked(fibre.blocks(parameters))
        unit = fibre.stack.identity
        value = float(unit @ scaled)
        if value < 0:
            break
        target = unit - scaled
        step = metric.across(target)
        parameters = parameters + fibre.directions @ metric.along(metric.Q.T @ target)
        eigenvalues = np.concatenate([np.linalg.eigvalsh(change) for change in fibre.stack.matrices(step)])
        if eigenvalues.max(initial=0.0) < 1 - CLEARLY_INSIDE:
            inside = True
            break
        # The slope of v is the product of the step with any block of the fibre, such as unit - step.
        slope = float(step @ unit - step @ step)
        length = line_minimum(slope, eigenvalues, value)
        matrices = tuple(
            matrix + length * change for matrix, change in zip(matrices, metric.expanded(step), strict=True)
        )
    return Center(matrices, parameters, inside, value)


def line_minimum(slope: float, eigenvalues: Vector, value: float) -> float:
    """The minimum of a·slope - Σ log(1 + a e) over a > 0 by Newton's method; a long step if there is none.

    This is a barrier along a step, with the eigenvalues e of the step in the metric of the point where it begins.

    Parameters
    ----------
    slope : float
        Of the linear part of the function.
    eigenvalues : (k,)
    value : float
        Of the linear part at the beginning; a step without a minimum goes to where that part is minus this.
    """
    smallest = float(eigenvalues.min(initial=0.0))
    limit = -1.0 / smallest if smallest < 0 else np.inf
    if slope < 0 and not np.isfinite(limit):
        return 2.0 * value / -slope
    length = 1.0 / (1.0 + float(np.linalg.norm(eigenvalues)))
    for _ in range(60):
        terms = eigenvalues / (1.0 + length * eigenvalues)
        first, second = slope - float(terms.sum()), float(terms @ terms)
        if second == 0.0:  # nothing changes along this step
            break
        new = length - first / second
        if new <= 0:
            new = 0.5 * length
        elif new >= 0.99 * limit:
            new = 0.5 * (length + 0.99 * limit)
        if abs(new - length) <= 1e-4 * length:
            break
        length = new
    return float(length)
