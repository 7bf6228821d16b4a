"""The point of the feasible set that is nearest to given parameters, in any metric."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, ConicSolution, Outcome, Rows, solve
from steelyard.errors import SolverError

from .feasible_set import MARGIN_FACTORS, FeasibleSet
from .metric import Metric

__all__ = ["Nearest", "NearestPoint", "light_point", "nearest_in_region"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

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
    feasible_set : FeasibleSet
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
        margin : float
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


def nearest_in_region(
    feasible_set: FeasibleSet, base: Vector, axes: Matrix, unknown: Matrix, solver: str = "clarabel"
) -> Nearest:
    """Minimise ‖u‖ such that some δ of the set has K δ = base + axes u + unknown v.

    Parameters
    ----------
    feasible_set : FeasibleSet
    base : (n_b,)
    axes : (n_b, k)
        Square root of a covariance, or the unit matrix for the Euclidean distance.
    unknown : (n_b, j)
        Directions of the base parameters along which the distance is zero; j may be 0.
    solver : str

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
                "no parameters satisfy all conditions, whatever the base parameters are (where the estimate is certain "
                "of them); loosen the constraints, which contradict each other or the estimate."
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
