"""The lightest standard parameters of given base parameters."""

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, solve

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
    stack = feasible_set.stack
    coefficients = stack.coefficients @ matrix
    values = stack.constant + stack.coefficients @ particular - margin * stack.identity
    equations = feasible_set.equation_matrix @ directions
    # Rows without unknowns are constants, which the caller has found to be positive.
    decided = np.zeros(len(values), dtype=bool)
    decided[: stack.scalar_count] = np.diff(sparse.csr_array(coefficients).indptr)[: stack.scalar_count] == 0
    problem = ConicProblem(
        P=P,
        q=q,
        A=sparse.csc_array(sparse.vstack([sparse.csc_array(equations), -coefficients[~decided]], format="csc")),
        b=np.concatenate([feasible_set.equation_values - feasible_set.equation_matrix @ particular, values[~decided]]),
        cones=(
            Cone("zero", len(equations)),
            Cone("nonnegative", stack.scalar_count - int(decided.sum())),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        ),
    )
    solution = solve(problem)
    if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
        return None
    return feasible_set.project_on_equations(particular + directions @ solution.primal)
