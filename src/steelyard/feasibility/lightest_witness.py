"""The lightest standard parameters of given base parameters."""

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, Rows, solve

from .feasible_set import FeasibleSet
from .tie_break import lightest

__all__ = ["lightest_witness"]

Vector = npt.NDArray[np.float64]


def lightest_witness(feasible_set: FeasibleSet, base: Vector, margin: float) -> Vector | None:
    """The lightest parameters with K δ = β and D(δ) - margin 1 ⪰ 0, or None where the solver does not reach them."""
    preference = lightest(feasible_set)
    directions = feasible_set.unidentifiable
    particular = feasible_set.lift @ base
    matrix = sparse.csc_array(directions)
    P = sparse.csc_array(matrix.T @ matrix.multiply(preference.curvature[:, None]))
    q = directions.T @ (preference.gradient + preference.curvature * particular)
    equations, blocks = feasible_set.rows(directions, particular, margin)
    # Rows without unknowns are constants, which the caller has found to be positive.
    scalars, count = blocks.cones[0], len(blocks.right)
    kept = np.diff(sparse.csr_array(blocks.matrix).indptr) > 0
    kept[scalars.size :] = True
    left = Cone("nonnegative", scalars.size - count + int(kept.sum()))
    rows = (equations, Rows(sparse.csr_array(blocks.matrix)[kept], blocks.right[kept], left, *blocks.cones[1:]))
    problem = ConicProblem.from_rows(q, rows, P)
    solution = solve(problem)
    if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
        return None
    return feasible_set.project_on_equations(particular + directions @ solution.primal)
