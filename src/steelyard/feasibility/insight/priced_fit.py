"""Least squares under some of the conditions, with what each of them costs at the margin."""

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import SolverError

from ..conic import Cone, ConicProblem, Outcome, solve
from ..constraints import TotalMass
from ..feasible_set import FeasibleSet
from ..lmi import AffineStack
from ..protocols import ReducedLike

__all__ = ["PricedFit", "mass_bound_of", "priced_fit"]

Vector = npt.NDArray[np.float64]

MASS_BOUND = 1000.0
"""Bound on the total mass in kg, where nothing is known of it."""

TRACE_PER_MASS = 100.0
"""Bound on the sum of the traces of all blocks, for each kg of the mass bound."""

RIDGE = 1e-12
"""Curvature that settles unknowns which neither data nor conditions bound."""


@dataclass(frozen=True, eq=False)
class PricedFit:
    """The least squared residual under some of the conditions.

    Attributes
    ----------
    squared_residual : float
    parameters : (n,)
    prices : dict from index of a block to float
        d(squared residual) / dr of the relaxed condition D + r 1 ⪰ 0; at most 0.
    stopped_by_bound : bool
        Whether the residual would fall further with more mass.
    """

    squared_residual: float
    parameters: Vector = field(repr=False)
    prices: dict[int, float] = field(repr=False)
    stopped_by_bound: bool


def mass_bound_of(feasible: FeasibleSet) -> float:
    """A total mass well above what CAD and the constraints tell, in kg."""
    cad = np.asarray(feasible.model.robot.parameters, dtype=float)[feasible.mass_indices]
    known = [float(cad.sum())] if np.all(np.isfinite(cad)) else []
    for constraint in feasible.constraints:
        if isinstance(constraint, TotalMass):
            known += [value for value in (constraint.minimum, constraint.equal) if value is not None]
    return max([MASS_BOUND, *(20.0 * mass for mass in known)])


def priced_fit(
    reduced: ReducedLike, feasible: FeasibleSet, without: Collection[int], mass_bound: float, solver: str
) -> PricedFit:
    """Minimise ‖R K δ - ρ‖² + residual2 under the conditions (thesis 3.53), leaving some of them out.

    Parameters
    ----------
    reduced : Reduced
    feasible : FeasibleSet
    without : collection of int
        Indices of the blocks that are left out. A link without its condition does not count in the mass bound.
    mass_bound : float
        Bound on the total mass, in kg, since the residual may fall for ever as masses grow.
    solver : str

    Raises
    ------
    SolverError
        If no parameters satisfy the conditions.
    """
    kept = [i for i in range(len(feasible.blocks)) if i not in without]
    stack = AffineStack(tuple(feasible.blocks[i] for i in kept), feasible.parameter_count)
    R, rho = np.asarray(reduced.R, dtype=float), np.asarray(reduced.rho, dtype=float)
    scale = max(float(reduced.residual2), 1e-6 * float(reduced.norm2))
    rows, count = len(rho), feasible.parameter_count
    transform = feasible.base_dependent
    regression = np.hstack([R / np.sqrt(scale), np.zeros((rows, count - R.shape[1]))])
    bounds = _bounds(feasible, without, mass_bound)
    equations = feasible.equation_matrix @ transform

    def beside(right: npt.NDArray[np.float64]) -> sparse.csc_array:
        return sparse.csc_array(sparse.hstack([sparse.csc_array((right.shape[0], rows)), sparse.csc_array(right)]))

    coefficients = np.asarray(stack.coefficients @ transform)
    margin = feasible.margin * stack.identity
    solution = solve(
        ConicProblem(
            P=sparse.csc_array(
                sparse.diags_array(np.concatenate([np.full(rows, 2.0), np.full(count, RIDGE)]), format="csc")
            ),
            q=np.zeros(rows + count),
            A=sparse.csc_array(
                sparse.vstack(
                    [
                        sparse.hstack([-sparse.eye_array(rows), sparse.csc_array(regression)]),
                        beside(equations),
                        beside(bounds @ transform),
                        beside(-coefficients),
                    ],
                    format="csc",
                )
            ),
            b=np.concatenate(
                [rho / np.sqrt(scale), feasible.equation_values, np.ones(len(bounds)), stack.constant - margin]
            ),
            cones=(
                Cone("zero", rows + len(equations)),
                Cone("nonnegative", len(bounds) + stack.scalar_count),
                *(Cone("semidefinite", size) for size in stack.matrix_sizes),
            ),
        ),
        solver=solver,
    )
    if solution.outcome is Outcome.INFEASIBLE:
        raise SolverError(
            f"no parameters satisfy all of the {len(kept)} conditions with margin {feasible.margin:g} and a total "
            f"mass below {mass_bound:g} kg; loosen the constraints, which contradict each other, or give a larger "
            "mass_bound."
        )
    solution = solution.require("fit the data within the feasible set")
    parameters = feasible.project_on_equations(transform @ solution.primal[rows:])
    error = R @ (feasible.K @ parameters) - rho
    start = rows + len(equations)
    squared = float(error @ error) + float(reduced.residual2)
    duals = solution.dual[start + len(bounds) :]
    prices = {}
    for index, block, place in zip(kept, stack.blocks, stack.slices, strict=True):
        diagonal = np.cumsum(np.arange(1, block.size + 1)) - 1
        prices[index] = -scale * float(duals[place][diagonal].sum())
    pressed = (bounds @ parameters > 0.99) & (solution.dual[start : start + len(bounds)] > 1e-6 * squared / scale)
    return PricedFit(squared, parameters, prices, bool(np.any(pressed)))


def _bounds(feasible: FeasibleSet, without: Collection[int], mass_bound: float) -> npt.NDArray[np.float64]:
    """Rows over δ that must not exceed 1: the masses together, and the traces together, of what has a condition."""
    mass, trace = np.zeros(feasible.parameter_count), np.zeros(feasible.parameter_count)
    masses = set(feasible.mass_indices.tolist())
    for index, block in enumerate(feasible.blocks):
        if index in without or block.kind == "constraint":
            continue
        np.add.at(trace, block.indices, np.trace(block.coefficients, axis1=1, axis2=2) / (TRACE_PER_MASS * mass_bound))
        for parameter in masses.intersection(block.indices.tolist()):
            mass[parameter] = 1.0 / mass_bound
    return np.array([row for row in (mass, trace) if np.any(row)]).reshape(-1, feasible.parameter_count)
