"""The point of the feasible set that is nearest to an estimate, in standard deviations."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, ConicSolution, Outcome, solve
from steelyard.errors import SolverError

from .feasible_set import FeasibleSet
from .interior import MARGIN_FACTORS

__all__ = ["Nearest", "light_point", "nearest_feasible"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

LOOSE_WEIGHT = 1e-9
"""Weight of the squares of what the distance does not measure, which keeps masses finite."""

FINE = 1e-3
"""Below this squared distance the problem is solved again in units of the distance found."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest feasible parameters.

    Attributes
    ----------
    parameters : (n,)
        Inside the set.
    distance : float
        ‖u‖ of its base parameters β = base + axes u + unknown v.
    coordinates : (k,)
        u.
    shares : (blocks,)
        What each block adds to the squared distance, relative to it; the equations of constraints add the rest to 1.
    """

    parameters: Vector = field(repr=False)
    distance: float
    coordinates: Vector = field(repr=False)
    shares: Vector = field(repr=False)


def nearest_feasible(
    feasible: FeasibleSet, base: Vector, axes: Matrix, unknown: Matrix | None = None, solver: str = "clarabel"
) -> Nearest:
    """Minimise ‖u‖ where some δ of the set has K δ = base + axes u + unknown v.

    Parameters
    ----------
    feasible : FeasibleSet
    base : (n_b,)
    axes : (n_b, k)
        Square root of a covariance, or the unit matrix for the Euclidean distance.
    unknown : (n_b, j), optional
    solver : str

    Raises
    ------
    SolverError
        If there is no such point, or the solver finds none.
    """
    stack = feasible.stack
    free = feasible.unidentifiable
    if unknown is not None:
        free = np.hstack([free, feasible.lift @ unknown])
    directions = np.hstack([feasible.lift @ axes, free])
    reference, k = feasible.lift @ base, axes.shape[1]
    equations = feasible.equation_matrix @ directions

    def solved(margin: float, unit: float) -> ConicSolution:
        values = stack.constant + stack.coefficients @ reference - margin * stack.identity
        weights = np.concatenate([np.full(k, 2.0 / unit), np.full(free.shape[1], LOOSE_WEIGHT)])
        problem = ConicProblem(
            P=sparse.csc_array(sparse.diags_array(weights, format="csc")),
            q=np.zeros(len(weights)),
            A=sparse.csc_array(np.vstack([equations, -(stack.coefficients @ directions)])),
            b=np.concatenate([feasible.equation_values - feasible.equation_matrix @ reference, values]),
            cones=(
                Cone("zero", len(equations)),
                Cone("nonnegative", stack.scalar_count),
                *(Cone("semidefinite", size) for size in stack.matrix_sizes),
            ),
        )
        return solve(problem, solver=solver)

    def packed(solution: ConicSolution, unit: float) -> Nearest | None:
        """The point, where it is inside the set."""
        if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
            return None
        u = solution.primal[:k]
        parameters = feasible.project_on_equations(reference + directions @ solution.primal)
        if not np.all(stack.smallest_eigenvalues(parameters) > 0):
            return None
        pushes = solution.dual[len(equations) :] * (stack.coefficients @ (directions[:, :k] @ u))
        shares = np.array([float(pushes[place].sum()) for place in stack.slices])
        return Nearest(parameters, float(np.linalg.norm(u)), u, shares * unit / (2.0 * float(u @ u) or 1.0))

    for factor in MARGIN_FACTORS:
        solution = solved(factor * feasible.margin, 1.0)
        if solution.outcome is Outcome.INFEASIBLE:
            raise SolverError(
                "no parameters satisfy all conditions, whatever the base parameters are (where the estimate is certain "
                "of them); loosen the constraints, which contradict each other or the estimate."
            )
        found = packed(solution, 1.0)
        if found is None:
            continue
        if found.distance**2 < FINE:
            unit = max(found.distance**2, 1e-6)
            found = packed(solved(factor * feasible.margin, unit), unit) or found
        return found
    raise SolverError(
        "the solver ended outside the feasible set with every margin tried; check that the constraints leave room and "
        f"that units are SI, or give FeasibleSet a larger margin than {feasible.margin:g}."
    )


def light_point(
    feasible: FeasibleSet, base: Vector, axes: Matrix, unknown: Matrix, nearest: Nearest, radius: float, solver: str
) -> Vector:
    """Parameters of the set, of moderate size, with ‖u‖ well below a radius that is larger than the nearest distance.

    The nearest parameters may have masses that are as large as the solver let them be.

    Returns
    -------
    (n,)
        The nearest parameters themselves, where the solver finds nothing better.
    """
    stack, k = feasible.stack, axes.shape[1]
    free = np.hstack([feasible.unidentifiable, feasible.lift @ unknown])
    directions = np.hstack([feasible.lift @ axes, free])
    reference = feasible.lift @ base
    equations = feasible.equation_matrix @ directions
    margin = min(feasible.margin, float(stack.smallest_eigenvalues(nearest.parameters).min(initial=np.inf)))
    ball = np.zeros((k + 1, directions.shape[1]))
    ball[1:, :k] = -np.eye(k)
    problem = ConicProblem(
        P=sparse.csc_array(sparse.diags_array(np.full(directions.shape[1], LOOSE_WEIGHT), format="csc")),
        q=feasible.trace_row @ directions,
        A=sparse.csc_array(np.vstack([equations, -(stack.coefficients @ directions), ball])),
        b=np.concatenate(
            [
                feasible.equation_values - feasible.equation_matrix @ reference,
                stack.constant + stack.coefficients @ reference - 0.5 * margin * stack.identity,
                [0.5 * (nearest.distance + radius)],
                np.zeros(k),
            ]
        ),
        cones=(
            Cone("zero", len(equations)),
            Cone("nonnegative", stack.scalar_count),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
            Cone("second-order", k + 1),
        ),
    )
    solution = solve(problem, solver=solver)
    if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
        return nearest.parameters
    found = feasible.project_on_equations(reference + directions @ solution.primal)
    inside = np.all(stack.smallest_eigenvalues(found) > 0) and np.linalg.norm(solution.primal[:k]) < radius
    return found if inside else nearest.parameters
