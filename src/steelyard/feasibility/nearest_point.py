"""Metrics of differences of parameters, and the point of the feasible set that is nearest to given ones in a metric.

Metrics are quadratic forms that are stored as factors, so that nothing is squared.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, ConicSolution, Outcome, Rows, solve
from steelyard.errors import InputError, SolverError
from steelyard.regression.factor import eigenvectors

from .feasible_set import MARGIN_FACTORS, FeasibleSet

__all__ = ["Metric", "Nearest", "NearestPoint", "light_point", "nearest_in_region"]

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
    values, vectors = eigenvectors(matrix / np.outer(units, units))
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


UNIDENTIFIABLE_WEIGHT, LEAST_WEIGHT = 1e-9, 1e-6
"""Weight of the squares of unknowns that do not change the distance, relative to the squared distance. It keeps masses
finite if the infimum is approached at infinity. It is multiplied by the squared distance if that is below 1, but by no
less than the second number."""

FINE = 1e-3
"""If the squared distance, in units of the given parameters, is below this, the problem is solved again in units of the
distance, since the accuracy of a solver is relative to the unit."""

FINEST = 1e-6
"""A refinement reduces the unit by at most this factor, because the distance that was found may be an error of the
solver."""

REFINEMENTS = 3
"""Largest number of refinements. In the Euclidean metric one is enough: distances below 1e-6 of the largest parameter
are rounding errors."""

EUCLIDEAN = Metric("Euclidean", None)


@dataclass(frozen=True, eq=False)
class NearestPoint:
    """Minimise ‖R d‖², where d are the first `measured` of the unknowns x and δ = origin + matrix x is in the set.

    All unknowns are in units of `unit`, and the squared distance in units of that of a step of this size.

    Attributes
    ----------
    origin : (n,)
        δ for x = 0.
    matrix : (n, m)
        Directions in which δ may move. Columns after those of d do not change the distance.
    measured : int
        Length of d.
    metric : Metric
        R.
    unit : float
        Typical size of d.
    solver : str
        As in `steelyard.conic.solve`.
    """

    feasible_set: FeasibleSet
    origin: Vector = field(repr=False)
    matrix: Matrix = field(repr=False)
    measured: int
    metric: Metric
    unit: float
    solver: str

    def squared(self, difference: Vector) -> float:
        """Squared length of d in the units of the problem."""
        return self.metric.squared(difference) / (self.unit * self.metric.size) ** 2

    def parameters(self, solution: ConicSolution) -> Vector:
        """δ of a solution."""
        step = self.unit * solution.primal[: self.matrix.shape[1]]
        return self.feasible_set.project_on_equations(self.origin + self.matrix @ step)

    def search(
        self, margin: float, difference: Callable[[Vector], Vector], inside: Callable[[Vector], bool]
    ) -> tuple[Vector | None, ConicSolution, float, int]:
        """Find the nearest parameters whose blocks keep a margin.

        If the distance is small relative to its unit, the problem is solved again in units of the distance. The finer
        answer is taken if it is inside and nearer.

        Parameters
        ----------
        difference : callable
            Maps δ to d.
        inside : callable
            Tells whether δ counts as inside the set.

        Returns
        -------
        parameters : (n,) or None
            None if the solver has no answer; they need not be inside.
        solution : ConicSolution
            The solution from which they come.
        scale : float
            Number by which the squared distance was divided in it.
        iterations : int
            Iterations of the solver in all problems together.
        """
        scale, solution = 1.0, self.solve(margin, 1.0, 1.0)
        iterations = solution.iterations
        if not solution.usable:
            return None, solution, scale, iterations
        found, finest = self.parameters(solution), 1.0
        for _ in range(1 if self.metric.factor is None else REFINEMENTS):
            distance = self.squared(difference(found))
            if distance >= FINE * finest:
                break
            finest = max(distance, FINEST * finest)
            finer = self.solve(margin, finest, min(1.0, max(distance * self.unit**2, LEAST_WEIGHT)))
            iterations += finer.iterations
            if not finer.usable:
                break
            point = self.parameters(finer)
            if inside(point) and (self.squared(difference(point)) < distance or not inside(found)):
                found, solution, scale = point, finer, finest
        return found, solution, scale, iterations

    def solve(self, margin: float, scale: float, weight: float) -> ConicSolution:
        """Solve with a margin; `scale` divides the squared distance, and `weight` multiplies the other squares."""
        count, measured = self.matrix.shape[1], self.measured
        unmeasured = UNIDENTIFIABLE_WEIGHT * weight / scale
        weights = np.full(count, unmeasured)
        weights[:measured] = 0.0
        conditions = self.feasible_set.rows(self.matrix, self.origin, margin)
        rows = [Rows(part.matrix, part.right / self.unit, *part.cones) for part in conditions]
        factor = None if self.metric.factor is None else self.metric.factor / self.metric.size
        if self.metric.is_diagonal:
            squares = np.ones(measured) if factor is None else np.sum(factor**2, axis=0)
            weights[:measured] = np.where(squares > 0, 2.0 * squares / scale, unmeasured)
        elif factor is not None:
            # R d, and the components of d along which the distance is zero, become unknowns.
            both = np.vstack([factor, self.metric.null_space])
            extra = len(both)
            image = np.hstack([both, np.zeros((extra, count - measured)), -np.eye(extra)])
            rows.insert(0, Rows(image, np.zeros(extra), Cone("zero", extra)))
            tail = np.full(extra, unmeasured)
            tail[: len(factor)] = 2.0 / scale
            weights = np.concatenate([weights, tail])
        P = sparse.csc_array(sparse.diags_array(weights, format="csc"))
        problem = ConicProblem.from_rows(np.zeros(len(weights)), rows, P)
        return solve(problem, solver=self.solver)


@dataclass(frozen=True, eq=False)
class Nearest:
    """The feasible parameters that are nearest to an estimate, in standard deviations.

    Attributes
    ----------
    parameters : (n,)
        Inside the set.
    distance : float
        ‖u‖ of its base parameters β = base + axes u + unknown v.
    shares : (blocks,)
        Share of each block in the squared distance; the equations of constraints have the rest.
    """

    parameters: Vector = field(repr=False)
    distance: float
    shares: Vector = field(repr=False)


def nearest_in_region(feasible_set: FeasibleSet, base: Vector, axes: Matrix, unknown: Matrix, solver: str) -> Nearest:
    """Minimise ‖u‖ such that some δ of the set has K δ = base + axes u + unknown v.

    Parameters
    ----------
    base : (n_b,)
    axes : (n_b, k)
        Square root of a covariance, or the unit matrix for the Euclidean distance.
    unknown : (n_b, j)
        Directions of the base parameters along which the distance is zero; j may be 0.

    Raises
    ------
    SolverError
        If there is no such point, or the solver finds none.
    """
    stack = feasible_set.stack
    lift, k = feasible_set.lift, axes.shape[1]
    matrix = np.hstack([lift @ axes, feasible_set.unidentifiable, lift @ unknown])
    problem = NearestPoint(feasible_set, lift @ base, matrix, k, EUCLIDEAN, 1.0, solver)
    to_distance = np.linalg.pinv(np.hstack([axes, unknown]))[:k] @ feasible_set.K

    def difference(parameters: Vector) -> Vector:
        return np.asarray(to_distance @ (parameters - problem.origin))

    def inside(parameters: Vector) -> bool:
        return bool(np.all(stack.smallest_eigenvalues(parameters) > 0))

    for factor in MARGIN_FACTORS:
        found, solution, scale, _ = problem.search(factor * feasible_set.margin, difference, inside)
        if solution.outcome is Outcome.INFEASIBLE:
            raise SolverError(
                "the solver finds no parameters that satisfy all conditions: the constraints contradict each other, or "
                "base parameters of which the estimate is certain, or it lies so many standard deviations away that "
                "floating point cannot tell; loosen the constraints, or look at the estimate with steelyard check."
            )
        if found is None or not inside(found):
            continue
        u = solution.primal[:k]
        blocks = solution.dual[len(feasible_set.equalities) :]
        pushes = blocks * (stack.coefficients @ (matrix[:, :k] @ u))
        shares = np.array([float(pushes[place].sum()) for place in stack.slices])
        return Nearest(found, float(np.linalg.norm(u)), shares * scale / (2.0 * float(u @ u) or 1.0))
    raise SolverError(
        "the solver ended outside the feasible set with every margin tried; check that the constraints leave room and "
        f"that units are SI, or give FeasibleSet a larger margin than {feasible_set.margin:g}."
    )


def light_point(
    feasible_set: FeasibleSet, base: Vector, axes: Matrix, unknown: Matrix, nearest: Nearest, radius: float, solver: str
) -> Vector:
    """Parameters of moderate size in the set, with ‖u‖ half-way between the nearest distance and a larger radius.

    The nearest parameters themselves may have very large masses.

    Returns
    -------
    (n,)
        The nearest parameters if the solver finds no others.
    """
    stack, k = feasible_set.stack, axes.shape[1]
    free = np.hstack([feasible_set.unidentifiable, feasible_set.lift @ unknown])
    directions = np.hstack([feasible_set.lift @ axes, free])
    reference = feasible_set.lift @ base
    margin = min(feasible_set.margin, float(stack.smallest_eigenvalues(nearest.parameters).min(initial=np.inf)))
    ball = np.zeros((k + 1, directions.shape[1]))
    ball[1:, :k] = -np.eye(k)
    limit = np.concatenate([[0.5 * (nearest.distance + radius)], np.zeros(k)])
    problem = ConicProblem.from_rows(
        feasible_set.trace_row @ directions,
        [*feasible_set.rows(directions, reference, 0.5 * margin), Rows(ball, limit, Cone("second-order", k + 1))],
        sparse.csc_array(sparse.diags_array(np.full(directions.shape[1], UNIDENTIFIABLE_WEIGHT), format="csc")),
    )
    solution = solve(problem, solver=solver)
    if not solution.usable:
        return nearest.parameters
    found = feasible_set.project_on_equations(reference + directions @ solution.primal)
    inside = np.all(stack.smallest_eigenvalues(found) > 0) and np.linalg.norm(solution.primal[:k]) < radius
    return found if inside else nearest.parameters
