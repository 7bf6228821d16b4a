"""The largest margin of the conditions at given base parameters, and the least violations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, Outcome, Rows, solve
from steelyard.lmi import AffineBlock, AffineStack

from .feasible_set import FeasibleSet

__all__ = ["MARGIN_CAP", "TRACE_BOUND", "BlockProblem", "DualPoint", "Margin", "largest_margin", "least_violations"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ROUNDING = 1e-10
"""Coefficients below this part of the largest of their parameter in the block are rounding errors of cancelled
terms."""


@dataclass(frozen=True, eq=False)
class BlockProblem:
    """Blocks Tᵀ D(δ) T with δ = particular + (P_d - P_b K_d) δ_d (thesis 3.35), each with a T of its own.

    Attributes
    ----------
    particular : (n,)
        P_b β or another δ with K δ = β.
    used : tuple of int
        Indices of the blocks whose T has columns; the others are left out.
    stack : AffineStack
        The blocks as functions of δ_d.
    """

    feasible_set: FeasibleSet
    particular: Vector
    used: tuple[int, ...]
    stack: AffineStack

    @classmethod
    def of(
        cls,
        feasible_set: FeasibleSet,
        particular: Vector,
        bases: Sequence[Matrix] | None = None,
        scalings: Sequence[Matrix] | None = None,
    ) -> "BlockProblem":
        """Substitute δ = particular + (P_d - P_b K_d) δ_d into the blocks.

        Parameters
        ----------
        particular : (n,)
            Some δ with the base parameters β, such as P_b β.
        bases : sequence of (d, r), optional
            U; unit matrices, and so the whole blocks, where absent.
        scalings : sequence of (r, r), optional
            C, with T = U C; unit matrices where absent.
        """
        directions = feasible_set.unidentifiable
        used, blocks = [], []
        for index, (block, found) in enumerate(zip(feasible_set.blocks, feasible_set.kept(_moved), strict=True)):
            constant, coefficients = block.evaluate(particular), found.coefficients
            if bases is not None:
                basis = bases[index]
                if not basis.shape[1]:
                    continue
                size = np.abs(coefficients).max(axis=(1, 2), initial=0.0) * float(np.abs(basis).max()) ** 2
                constant, coefficients = (
                    _congruent(constant, basis),
                    _without_rounding(_congruent(coefficients, basis), size),
                )
            used.append(index)
            if scalings is not None:
                constant = _congruent(constant, scalings[index])
                coefficients = _congruent(coefficients, scalings[index])
            blocks.append(AffineBlock(found.name, constant, found.indices, coefficients, found.kind))
        return cls(feasible_set, particular, tuple(used), AffineStack(tuple(blocks), directions.shape[1]))

    def parameters(self, dependent: Vector) -> Vector:
        """δ from δ_d."""
        return self.feasible_set.project_on_equations(self.particular + self.feasible_set.unidentifiable @ dependent)

    def conic(self, slack: sparse.csc_array, cost: Vector, bounds: Matrix, trace_bound: float | None) -> ConicProblem:
        """Minimise costᵀ s subject to blocks + slack s ⪰ 0, bounds [s, 1] ≥ 0, the equations and the trace bound.

        The trace bound limits the sum of the traces of the blocks of links and terms.
        """
        feasible_set, stack = self.feasible_set, self.stack
        unknowns, extra = stack.parameter_count, len(cost)
        equations = feasible_set.equation_matrix @ feasible_set.unidentifiable
        equation_values = feasible_set.equation_values - feasible_set.equation_matrix @ self.particular
        trace, constant = np.zeros((0, unknowns)), np.zeros(0)
        if trace_bound is not None:
            trace, constant = np.zeros((1, unknowns)), np.array([trace_bound])
            diagonals = stack.identity.copy()
            for block, rows in zip(stack.blocks, stack.slices, strict=True):
                if block.kind == "constraint":
                    diagonals[rows] = 0.0
            trace[0] = stack.coefficients.T @ diagonals
            constant[0] -= diagonals @ stack.constant
        bounding = sparse.vstack(
            [
                sparse.hstack([sparse.csc_array(trace), sparse.csc_array((len(trace), extra))]),
                sparse.hstack([sparse.csc_array((len(bounds), unknowns)), sparse.csc_array(-bounds[:, :-1])]),
            ]
        )
        most = np.concatenate([constant, bounds[:, -1]])
        return ConicProblem.from_rows(
            np.concatenate([np.zeros(unknowns), cost]),
            [
                Rows(equations, equation_values, Cone("zero", len(equations))),
                Rows(sparse.csc_array(bounding), most, Cone("nonnegative", len(most))),
                Rows(sparse.csc_array(sparse.hstack([-stack.coefficients, -slack])), stack.constant, *stack.cones),
            ],
        )


def _moved(feasible_set: FeasibleSet) -> tuple[AffineBlock, ...]:
    """Return the blocks as functions of δ_d, whatever the base parameters."""
    found = [block.substitute(feasible_set.unidentifiable) for block in feasible_set.blocks]
    sizes = [np.abs(block.coefficients).max(axis=(1, 2), initial=0.0) for block in found]
    return tuple(
        replace(block, coefficients=_without_rounding(block.coefficients, size))
        for block, size in zip(found, sizes, strict=True)
    )


def _without_rounding(coefficients: Matrix, sizes: Vector) -> Matrix:
    """Leave out rounding errors of cancelled terms, which a solver would multiply by large numbers."""
    return np.where(np.abs(coefficients) <= ROUNDING * sizes[:, None, None], 0.0, coefficients)


def _congruent(matrices: Matrix, transform: Matrix) -> Matrix:
    if transform.shape == (1, 1):
        return np.asarray(matrices * transform[0, 0] ** 2)
    product = transform.T @ matrices @ transform
    return np.asarray((product + product.swapaxes(-1, -2)) / 2)


MARGIN_CAP = 1.0
"""Largest margin that is searched for, so that the problem is bounded."""

TRACE_BOUND = 1e5
"""Bound on the sum of the traces of all blocks, relative to the largest |β| (at least 1), which keeps the set compact.
A larger one would cost digits of small margins."""


@dataclass(frozen=True, eq=False)
class DualPoint:
    """W of every block (r, r) on the face, and the multipliers of the equations, in floating point."""

    matrices: tuple[Matrix, ...]
    multipliers: Vector


@dataclass(frozen=True, eq=False)
class Margin:
    """Answer of `largest_margin`, unverified.

    Attributes
    ----------
    value : float
        t; -inf if the equations of constraints contradict β.
    parameters : (n,)
        δ with this margin.
    point : DualPoint
        The dual point, with respect to the given bases.
    """

    value: float
    parameters: Vector
    point: DualPoint


def largest_margin(
    feasible_set: FeasibleSet,
    base: Vector,
    bases: Sequence[Matrix] | None = None,
    scalings: Sequence[Matrix] | None = None,
    trace_bound: float | None = None,
    accuracy: float = 1e-10,
) -> Margin:
    """Solve max t subject to C_bᵀ U_bᵀ D_b(δ) U_b C_b - t 1 ⪰ 0, K δ = β, t ≤ 1.

    Parameters
    ----------
    base : (n_b,)
    bases : sequence of (d, r), optional
        U_b; unit matrices, and so the whole blocks, where absent.
    scalings : sequence of (r, r), optional
        C_b, invertible; the sign of t does not depend on them. Unit matrices where absent.
    trace_bound : float, optional
        Bound on the sum of the traces of the scaled blocks of links and terms, which keeps the set compact. It is not
        needed on the face of the dual points.
    accuracy : float
        Of the solver.
    """
    problem = BlockProblem.of(feasible_set, feasible_set.lift @ base, bases, scalings)
    stack = problem.stack
    unit = sparse.csc_array(-stack.identity[:, None])
    cap = np.array([[-1.0, MARGIN_CAP]])
    solution = solve(problem.conic(unit, np.array([-1.0]), cap, trace_bound), accuracy=accuracy)
    start = len(solution.dual) - len(stack.constant)
    matrices = dict(zip(problem.used, stack.matrices(solution.dual[start:]), strict=True))
    if scalings is not None:
        matrices = {b: scalings[b] @ own @ scalings[b].T for b, own in matrices.items()}
    point = DualPoint(
        tuple(matrices.get(b, np.zeros((0, 0))) for b in range(len(feasible_set.blocks))),
        -solution.dual[: len(feasible_set.equalities)],
    )
    if solution.outcome is Outcome.INFEASIBLE:
        return Margin(-np.inf, problem.parameters(np.zeros(stack.parameter_count)), point)
    return Margin(float(solution.primal[-1]), problem.parameters(solution.primal[:-1]), point)


def least_violations(feasible_set: FeasibleSet, base: Vector) -> Vector:
    """Solve min Σ s_b subject to D_b(δ) + s_b 1 ⪰ 0, s_b ≥ 0, K δ = β: the least violations of the blocks.

    Returns
    -------
    (blocks,)
        s_b, in the order of `FeasibleSet.blocks`.
    """
    problem = BlockProblem.of(feasible_set, feasible_set.lift @ base)
    stack, count = problem.stack, len(feasible_set.blocks)
    rows, columns = [], []
    for position, (block, place) in enumerate(zip(stack.blocks, stack.slices, strict=True)):
        rows.append(place.start + np.cumsum(np.arange(1, block.size + 1)) - 1)
        columns.append(np.full(block.size, position))
    places = (np.concatenate(rows), np.concatenate(columns))
    slack = sparse.csc_array(sparse.coo_array((np.ones(len(places[0])), places), shape=(len(stack.constant), count)))
    bounds = np.hstack([np.eye(count), np.zeros((count, 1))])
    trace_bound = TRACE_BOUND * max(1.0, float(np.abs(base).max(initial=0.0)))
    solution = solve(problem.conic(slack, np.ones(count), bounds, trace_bound))
    if not solution.usable:
        return np.zeros(count)
    return np.asarray(np.maximum(solution.primal[stack.parameter_count :], 0.0))
