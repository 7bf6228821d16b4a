"""The nearest physically possible parameters."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError, SolverError

from .conic import Cone, ConicProblem, ConicSolution, Outcome, solve
from .feasible_set import FeasibleSet
from .fitting import MARGIN_FACTORS, pull_inside
from .proof import FeasibilityCertificate

__all__ = ["Correction", "correct"]

Vector = npt.NDArray[np.float64]

UNIDENTIFIABLE_WEIGHT = 1e-9
"""Weight of |δ_d|² against the squared distance: keeps masses finite where the infimum is at infinity."""

FINE = 1e-3
"""Below this squared distance the problem is solved again in units of the distance found."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Answer of `correct`.

    Attributes
    ----------
    base : (n_b,)
        Feasible base parameters K δ.
    parameters : (n,)
        Feasible standard parameters δ.
    squared_distance : float
        ‖β - K δ‖², or ‖δ̂ - δ‖² where standard parameters were given.
    status : str
        ``"already feasible"`` where nothing had to change, or ``"corrected"``.
    certificate : FeasibilityCertificate
    iterations : int
        Of the solver.
    """

    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)
    squared_distance: float
    status: str
    certificate: FeasibilityCertificate = field(repr=False)
    iterations: int

    def __str__(self) -> str:
        kind = self.certificate.feasible_set.consistency
        if self.status == "already feasible":
            return f'Already feasible under "{kind}" consistency; nothing changed.'
        return f'Corrected to be feasible under "{kind}" consistency; squared distance {self.squared_distance:.6g}.'


def correct(
    feasible: FeasibleSet, base: npt.ArrayLike | None = None, parameters: npt.ArrayLike | None = None
) -> Correction:
    """The feasible parameters closest to given ones (thesis 3.40, 3.56), at least `feasible.margin` within the set.

    Parameters
    ----------
    feasible : FeasibleSet
    base : (n_b,), optional
        Base parameters β; the distance is ‖β - K δ‖.
    parameters : (n,), optional
        Standard parameters, instead; the distance is ‖δ̂ - δ‖.

    Returns
    -------
    Correction
        Every block at its parameters is proved positive definite.

    Raises
    ------
    InputError
        If not exactly one of `base` and `parameters` is given, or it does not fit the model.
    SolverError
        If the set is empty or the solver finds no point of it.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> correction = correct(FeasibleSet(model), base=[-0.6, 0.0, 0.0])
    >>> print(correction)
    Corrected to be feasible under "full" consistency; squared distance 0.36...
    """
    if (base is None) == (parameters is None):
        raise InputError("correct takes either base= or parameters=; give exactly one of them.")
    if parameters is not None:
        given = feasible.as_parameters(parameters)
        origin, matrix, measured = given, np.eye(feasible.parameter_count), feasible.parameter_count
        coefficients = feasible.stack.coefficients
    else:
        given = feasible.as_base(base if base is not None else ())
        origin, matrix, measured = feasible.lift @ given, feasible.base_dependent, len(given)
        coefficients = feasible.stacked_base_dependent

    problem = _Nearest(feasible, origin, coefficients, matrix, measured)
    outside: Vector | None = None
    for factor in MARGIN_FACTORS:
        solution = problem.solve(factor * feasible.margin, 1.0)
        if solution.outcome is Outcome.INFEASIBLE and feasible.constraints:
            raise SolverError(
                f"no parameters satisfy all of the {len(feasible.blocks)} conditions with margin {feasible.margin:g} "
                f"(Clarabel: {solution.status}); loosen the constraints, which contradict each other."
            )
        if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
            continue
        found, iterations = problem.parameters(solution), solution.iterations
        distance = _squared_distance(feasible, found, given, parameters is not None)
        if distance < FINE:
            solution = problem.solve(factor * feasible.margin, max(distance, 1e-6))
            iterations += solution.iterations
            finer = problem.parameters(solution) if solution.outcome.usable else found
            nearer = _squared_distance(feasible, finer, given, parameters is not None) < distance
            if feasible.contains(finer) and (nearer or not feasible.contains(found)):
                found = finer
        unchanged = origin if parameters is not None else found - feasible.lift @ (feasible.K @ found - given)
        if distance < FINE and problem.keeps_margin(unchanged):
            found, status = unchanged, "already feasible"
        else:
            status = "corrected"
        if not feasible.contains(found):
            outside = found if outside is None else outside
        else:
            if outside is not None and status == "corrected":
                found = pull_inside(feasible, outside, found)
            corrected = feasible.K @ found
            return Correction(
                base=corrected,
                parameters=found,
                squared_distance=_squared_distance(feasible, found, given, parameters is not None),
                status=status,
                certificate=FeasibilityCertificate(feasible, corrected, found),
                iterations=iterations,
            )
    raise SolverError(
        "Clarabel ended outside the feasible set with every margin tried; check that the constraints leave room and "
        f"that units are SI, or give FeasibleSet a larger margin than {feasible.margin:g}."
    )


def _squared_distance(feasible: FeasibleSet, found: Vector, given: Vector, standard: bool) -> float:
    difference = (found if standard else feasible.K @ found) - given
    return float(difference @ difference)


@dataclass(frozen=True, eq=False)
class _Nearest:
    """Minimise the squared norm of the first `measured` unknowns x, where δ = origin + matrix x is in the set."""

    feasible: FeasibleSet
    origin: Vector
    coefficients: sparse.csc_array
    matrix: npt.NDArray[np.float64]
    measured: int

    def parameters(self, solution: ConicSolution) -> Vector:
        """δ of a solution."""
        return self.feasible.project_on_equations(self.origin + self.matrix @ solution.primal)

    def solve(self, margin: float, unit: float) -> ConicSolution:
        """Solve with this margin; the squared norm is divided by `unit`."""
        feasible, stack = self.feasible, self.feasible.stack
        count = self.matrix.shape[1]
        weights = np.full(count, UNIDENTIFIABLE_WEIGHT)
        weights[: self.measured] = 2.0 / unit
        equations = feasible.equation_matrix @ self.matrix
        values = stack.constant + stack.coefficients @ self.origin - margin * stack.identity
        problem = ConicProblem(
            P=sparse.csc_array(sparse.diags_array(weights, format="csc")),
            q=np.zeros(count),
            A=sparse.csc_array(sparse.vstack([sparse.csc_array(equations), -self.coefficients], format="csc")),
            b=np.concatenate([feasible.equation_values - feasible.equation_matrix @ self.origin, values]),
            cones=(
                Cone("zero", len(equations)),
                Cone("nonnegative", stack.scalar_count),
                *(Cone("semidefinite", size) for size in stack.matrix_sizes),
            ),
        )
        return solve(problem)

    def keeps_margin(self, parameters: Vector) -> bool:
        """Whether δ is in the set with at least half the margin, so that nothing need be changed."""
        eigenvalues = self.feasible.stack.smallest_eigenvalues(parameters)
        return bool(np.all(eigenvalues >= 0.5 * self.feasible.margin)) and self.feasible.contains(parameters)
