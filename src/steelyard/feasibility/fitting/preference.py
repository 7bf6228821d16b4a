"""Which of many equally good answers to return: objectives over the standard parameters."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError

from ..conic import Cone, ConicProblem, solve
from ..feasible_set import FeasibleSet

__all__ = ["Preference", "closest_to_cad", "lightest", "lightest_witness"]

Vector = npt.NDArray[np.float64]

SPREAD_WEIGHT = 1e-3
"""Weight, against the total mass in kg, of the traces of the blocks (moments in kg m², friction): keeps them small."""

FREE_WEIGHT = 1e-6
"""Weight of the squares of all parameters, which settles those that neither data nor conditions tell."""


@dataclass(frozen=True, eq=False)
class Preference:
    """An objective ½ Σ curvature δ² + gradient · δ, and its name.

    Attributes
    ----------
    name : str
    curvature : (n,)
    gradient : (n,)
    """

    name: str
    curvature: Vector
    gradient: Vector

    def value(self, parameters: Vector) -> float:
        """Value of the objective at δ."""
        return float(0.5 * self.curvature @ parameters**2 + self.gradient @ parameters)

    def quadratic(self, matrix: npt.NDArray[np.float64], scale: float) -> tuple[sparse.csc_array, Vector]:
        """P and q in variables x with δ = matrix x, divided by `scale`."""
        sparse_matrix = sparse.csc_array(matrix)
        weighted = sparse_matrix.multiply(self.curvature[:, None] / scale)
        return sparse.csc_array(sparse_matrix.T @ weighted), matrix.T @ self.gradient / scale


def lightest(feasible: FeasibleSet) -> Preference:
    """Least total mass; among equals the most compact (thousandths of kg m² and friction count), then the smallest."""
    gradient = SPREAD_WEIGHT * feasible.trace_row
    gradient[feasible.mass_indices] = 1.0
    return Preference("lightest", np.full(feasible.parameter_count, FREE_WEIGHT), gradient)


def closest_to_cad(feasible: FeasibleSet) -> Preference:
    """Least squared distance from the inertial parameters of CAD, each link measured in its own mass and size.

    The mass counts in units of the CAD mass m, first moments in m r, moments of inertia in m r², where r is the largest
    of the link's radius of gyration about its frame's origin and 1 cm.

    Raises
    ------
    InputError
        If the robot's description has no inertial parameters.
    """
    cad = np.asarray(feasible.model.robot.parameters, dtype=float)
    names = {name: index for index, name in enumerate(feasible.model.parameter_names)}
    curvature = np.full(feasible.parameter_count, FREE_WEIGHT)
    gradient = np.zeros(feasible.parameter_count)
    known = 0
    for link, mass_index in enumerate(feasible.mass_indices):
        indices = [names[f"{symbol}{link + 1}"] for symbol in _INERTIAL]
        values = cad[indices]
        if not np.all(np.isfinite(values)) or cad[mass_index] <= 0:
            continue
        known += 1
        mass = float(cad[mass_index])
        radius = max(0.01, float(np.sqrt(max(values[0] + values[3] + values[5], 0.0) / (2 * mass))))
        scales = mass * np.array([radius**2] * 6 + [radius] * 3 + [1.0])
        curvature[indices] = 2.0 / scales**2
        gradient[indices] = -curvature[indices] * values
    if not known:
        raise InputError(
            'prefer="cad" needs inertial parameters in the robot description, which has none; use prefer="lightest".'
        )
    return Preference("cad", curvature, gradient)


_INERTIAL = ("Lxx", "Lxy", "Lxz", "Lyy", "Lyz", "Lzz", "lx", "ly", "lz", "m")


def lightest_witness(feasible: FeasibleSet, base: Vector, margin: float) -> Vector | None:
    """The lightest parameters with K δ = β and D(δ) - margin 1 ⪰ 0, or None where the solver does not reach them."""
    preference = lightest(feasible)
    directions = feasible.unidentifiable
    particular = feasible.lift @ base
    P, q = preference.quadratic(directions, 1.0)
    q = q + directions.T @ (preference.curvature * particular)
    stack = feasible.stack
    coefficients = stack.coefficients @ sparse.csc_array(directions)
    values = stack.constant + stack.coefficients @ particular - margin * stack.identity
    equations = feasible.equation_matrix @ directions
    # Rows without unknowns are constants, which the caller has found to be positive.
    decided = np.zeros(len(values), dtype=bool)
    decided[: stack.scalar_count] = np.diff(sparse.csr_array(coefficients).indptr)[: stack.scalar_count] == 0
    problem = ConicProblem(
        P=P,
        q=q,
        A=sparse.csc_array(sparse.vstack([sparse.csc_array(equations), -coefficients[~decided]], format="csc")),
        b=np.concatenate([feasible.equation_values - feasible.equation_matrix @ particular, values[~decided]]),
        cones=(
            Cone("zero", len(equations)),
            Cone("nonnegative", stack.scalar_count - int(decided.sum())),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        ),
    )
    solution = solve(problem)
    if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
        return None
    return feasible.project_on_equations(particular + directions @ solution.primal)
