"""The largest margin of a base parameter vector, and what it lacks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Outcome, solve

from ..feasible_set import FeasibleSet
from .block_problem import BlockProblem
from .dual_point import DualPoint

__all__ = ["MARGIN_CAP", "TRACE_BOUND", "Margin", "largest_margin", "least_violations"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

MARGIN_CAP = 1.0
"""Margins above this are not looked for, so that the problem is bounded."""

TRACE_BOUND = 1e5
"""Bound on the sum of the traces of all blocks, times the largest |β| (at least 1): keeps the solver's set compact."""


@dataclass(frozen=True, eq=False)
class Margin:
    """Answer of `largest_margin`, unverified.

    Attributes
    ----------
    value : float
        t; -inf where the equations of constraints contradict β.
    parameters : (n,)
        δ where it is reached.
    point : DualPoint
        The dual point, on the bases that were given.
    """

    value: float
    parameters: Vector
    point: DualPoint


def largest_margin(
    feasible: FeasibleSet,
    base: Vector,
    bases: Sequence[Matrix],
    scalings: Sequence[Matrix] | None = None,
    trace_bound: float | None = None,
    accuracy: float = 1e-10,
) -> Margin:
    """Solve max t subject to C_bᵀ U_bᵀ D_b(δ) U_b C_b - t 1 ⪰ 0, K δ = β, t ≤ 1.

    Parameters
    ----------
    feasible : FeasibleSet
    base : (n_b,)
    bases : sequence of (d, r)
        U_b; unit matrices for the whole blocks.
    scalings : sequence of (r, r), optional
        C_b, invertible: the sign of t does not depend on them.
    trace_bound : float, optional
        Bound on the sum of the traces of the scaled blocks of links and terms, which keeps the set compact; not
        needed on the face of the dual points.
    accuracy : float
        Of the solver.
    """
    if scalings is None:
        scalings = [np.eye(U.shape[1]) for U in bases]
    problem = BlockProblem.of(feasible, feasible.lift @ base, bases, scalings)
    stack = problem.stack
    unit = sparse.csc_array(-stack.identity[:, None])
    cap = np.array([[-1.0, MARGIN_CAP]])
    solution = solve(problem.conic(unit, np.array([-1.0]), cap, trace_bound), accuracy=accuracy)
    start = len(solution.dual) - len(stack.constant)
    matrices = dict(zip(problem.used, stack.matrices(solution.dual[start:]), strict=True))
    point = DualPoint(
        tuple(C @ matrices[b] @ C.T if b in matrices else np.zeros((0, 0)) for b, C in enumerate(scalings)),
        -solution.dual[: len(feasible.equalities)],
    )
    if solution.outcome is Outcome.INFEASIBLE:
        return Margin(-np.inf, problem.parameters(np.zeros(stack.parameter_count)), point)
    return Margin(float(solution.primal[-1]), problem.parameters(solution.primal[:-1]), point)


def least_violations(feasible: FeasibleSet, base: Vector) -> Vector:
    """Solve min Σ s_b subject to D_b(δ) + s_b 1 ⪰ 0, s_b ≥ 0, K δ = β: by how much each block is short.

    Returns
    -------
    (blocks,)
        s_b, in the order of `FeasibleSet.blocks`.
    """
    problem = BlockProblem.of(feasible, feasible.lift @ base, [np.eye(block.size) for block in feasible.blocks])
    stack, count = problem.stack, len(feasible.blocks)
    rows, columns = [], []
    for position, (block, place) in enumerate(zip(stack.blocks, stack.slices, strict=True)):
        rows.append(place.start + np.cumsum(np.arange(1, block.size + 1)) - 1)
        columns.append(np.full(block.size, position))
    places = (np.concatenate(rows), np.concatenate(columns))
    slack = sparse.csc_array(sparse.coo_array((np.ones(len(places[0])), places), shape=(len(stack.constant), count)))
    bounds = np.hstack([np.eye(count), np.zeros((count, 1))])
    trace_bound = TRACE_BOUND * max(1.0, float(np.abs(base).max(initial=0.0)))
    solution = solve(problem.conic(slack, np.ones(count), bounds, trace_bound))
    if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
        return np.zeros(count)
    return np.asarray(np.maximum(solution.primal[stack.parameter_count :], 0.0))
