"""The largest margin of a base parameter vector, and what it lacks: the problems behind `check`."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .conic import Cone, ConicProblem, ConicSolution, Outcome, solve
from .feasible_set import FeasibleSet
from .lmi import AffineBlock, AffineStack, vector_to_symmetric
from .proof import InfeasibilityCertificate

__all__ = ["FreeProblem", "fixed_certificate", "largest_margin", "least_violations"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

MARGIN_CAP = 1.0
"""Margins above this are not looked for, so that the problem is bounded."""

TRACE_BOUND = 1e5
"""Bound on the sum of the traces of all blocks, times the largest |β| (at least 1): keeps the solver's set compact."""


@dataclass(frozen=True, eq=False)
class FreeProblem:
    """The blocks at a given β, in the unidentifiable parameters δ_d.

    Attributes
    ----------
    feasible : FeasibleSet
    base : (n_b,)
    particular : (n,)
        P_b β, so that δ = particular + (P_d - P_b K_d) δ_d.
    fixed : dict from index of a block to (d, d)
        Blocks that β alone decides, evaluated.
    free : tuple of int
        Indices of the other blocks.
    stack : AffineStack
        The free blocks as functions of δ_d.
    """

    feasible: FeasibleSet
    base: Vector
    particular: Vector
    fixed: dict[int, Matrix]
    free: tuple[int, ...]
    stack: AffineStack

    @classmethod
    def of(cls, feasible: FeasibleSet, base: Vector) -> "FreeProblem":
        """Substitute β into the blocks (thesis 3.35)."""
        directions = feasible.unidentifiable
        particular = feasible.lift @ base
        fixed: dict[int, Matrix] = {}
        free: list[int] = []
        blocks: list[AffineBlock] = []
        for index, block in enumerate(feasible.blocks):
            substituted = block.substitute(directions, particular)
            if len(substituted.indices):
                free.append(index)
                blocks.append(substituted)
            else:
                fixed[index] = substituted.constant
        return cls(feasible, base, particular, fixed, tuple(free), AffineStack(tuple(blocks), directions.shape[1]))

    def parameters(self, dependent: Vector) -> Vector:
        """δ from δ_d."""
        return self.feasible.project_on_equations(self.particular + self.feasible.unidentifiable @ dependent)

    def scaled(self, scaling: dict[int, Vector]) -> AffineStack:
        """The free blocks multiplied from both sides by diagonal matrices; definiteness does not change."""
        blocks = []
        for index, block in zip(self.free, self.stack.blocks, strict=True):
            both = np.outer(scaling[index], scaling[index])
            coefficients = block.coefficients * both
            blocks.append(AffineBlock(block.name, block.constant * both, block.indices, coefficients, block.kind))
        return AffineStack(tuple(blocks), self.stack.parameter_count)

    def problem(
        self,
        stack: AffineStack,
        slack: sparse.csc_array,
        cost: Vector,
        bounds: Matrix,
        trace_bound: float = TRACE_BOUND,
    ) -> ConicProblem:
        """Minimise costᵀ s subject to D(δ_d) + slack s ⪰ 0, bounds [s, 1] ≥ 0, the equations and the trace bound."""
        feasible = self.feasible
        unknowns, extra = stack.parameter_count, len(cost)
        scale = max(1.0, float(np.abs(self.base).max(initial=0.0)))
        equations = feasible.equation_matrix @ feasible.unidentifiable
        equation_values = feasible.equation_values - feasible.equation_matrix @ self.particular
        trace = (feasible.trace_row @ feasible.unidentifiable)[None]
        trace_constant = float(feasible.trace_row @ self.particular)
        rows = [
            sparse.hstack([sparse.csc_array(equations), sparse.csc_array((len(equations), extra))]),
            sparse.hstack([sparse.csc_array(trace), sparse.csc_array((1, extra))]),
            sparse.hstack([sparse.csc_array((len(bounds), unknowns)), sparse.csc_array(-bounds[:, :-1])]),
            sparse.hstack([-stack.coefficients, -slack]),
        ]
        values = [equation_values, np.array([trace_bound * scale - trace_constant]), bounds[:, -1], stack.constant]
        cones = (
            Cone("zero", len(equations)),
            Cone("nonnegative", 1 + len(bounds) + stack.scalar_count),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        )
        count = unknowns + extra
        return ConicProblem(
            P=sparse.csc_array((count, count)),
            q=np.concatenate([np.zeros(unknowns), cost]),
            A=sparse.csc_array(sparse.vstack(rows, format="csc")),
            b=np.concatenate(values),
            cones=cones,
        )


def largest_margin(
    free: FreeProblem, scaling: dict[int, Vector] | None = None, trace_bound: float = TRACE_BOUND
) -> tuple[float, Vector, InfeasibilityCertificate | None]:
    """Solve max t subject to D(δ) - t 1 ⪰ 0, K δ = β.

    Parameters
    ----------
    free : FreeProblem
    scaling : dict, optional
        Diagonal scalings of the free blocks; the sign of the answer stays, its value then is a relative one.
    trace_bound : float
        Bound on the sum of the traces of the blocks of links and terms, in units of the largest |β| (at least 1).

    Returns
    -------
    float
        The margin t of the solver (unverified).
    (n,)
        δ where it is reached.
    InfeasibilityCertificate or None
        The dual point as a certificate (unverified), where t is negative.
    """
    stack = free.stack if scaling is None else free.scaled(scaling)
    unit = sparse.csc_array(-stack.identity[:, None])
    problem = free.problem(stack, unit, np.array([-1.0]), np.array([[-1.0, MARGIN_CAP]]), trace_bound)
    solution = solve(problem, accuracy=1e-9)
    if solution.outcome is Outcome.INFEASIBLE:
        return -np.inf, free.parameters(np.zeros(stack.parameter_count)), _certificate(free, stack, solution, scaling)
    margin = float(solution.primal[-1])
    parameters = free.parameters(solution.primal[:-1])
    certificate = _certificate(free, stack, solution, scaling) if margin < MARGIN_CAP / 2 else None
    return margin, parameters, certificate


def _certificate(
    free: FreeProblem, stack: AffineStack, solution: ConicSolution, scaling: dict[int, Vector] | None
) -> InfeasibilityCertificate:
    """Z and y of the solution, made exactly semidefinite and normalised."""
    equations = len(free.feasible.equalities)
    start = len(solution.dual) - len(stack.constant)
    multipliers = solution.dual[:equations]
    dual: dict[str, Matrix] = {}
    for index, block, rows in zip(free.free, stack.blocks, stack.slices, strict=True):
        matrix = vector_to_symmetric(solution.dual[start:][rows])
        if scaling is not None:
            matrix = matrix * np.outer(scaling[index], scaling[index])
        values, vectors = np.linalg.eigh(matrix)
        dual[block.name] = (vectors * np.maximum(values, 0.0)) @ vectors.T
    total = sum(float(np.trace(matrix)) for matrix in dual.values())
    total = total if total > 0 else 1.0
    kept = {name: matrix / total for name, matrix in dual.items() if np.trace(matrix) > 0}
    return InfeasibilityCertificate(free.feasible, free.base, kept, multipliers / total)


def fixed_certificate(free: FreeProblem) -> tuple[float, InfeasibilityCertificate | None]:
    """Smallest eigenvalue of the blocks that β alone decides, and its eigenvector as a certificate where negative."""
    smallest, certificate = np.inf, None
    for index, matrix in free.fixed.items():
        values, vectors = np.linalg.eigh(matrix)
        if values[0] < smallest:
            smallest = float(values[0])
            dual = {free.feasible.blocks[index].name: np.outer(vectors[:, 0], vectors[:, 0])}
            multipliers = np.zeros(len(free.feasible.equalities))
            certificate = InfeasibilityCertificate(free.feasible, free.base, dual, multipliers)
    return smallest, certificate if smallest < 0 else None


def least_violations(free: FreeProblem) -> Vector:
    """Solve min Σ s_b subject to D_b(δ) + s_b 1 ⪰ 0, s_b ≥ 0, K δ = β: by how much each block is short.

    Returns
    -------
    (blocks,)
        s_b, in the order of `FeasibleSet.blocks`.
    """
    stack = free.stack
    found = np.zeros(len(free.feasible.blocks))
    for index, matrix in free.fixed.items():
        found[index] = max(0.0, -float(np.linalg.eigvalsh(matrix)[0]))
    if not stack.blocks:
        return found
    count = len(stack.blocks)
    rows, columns, values = [], [], []
    for position, (block, place) in enumerate(zip(stack.blocks, stack.slices, strict=True)):
        diagonal = place.start + np.cumsum(np.arange(1, block.size + 1)) - 1
        rows.append(diagonal)
        columns.append(np.full(block.size, position))
        values.append(np.ones(block.size))
    slack = sparse.csc_array(
        sparse.coo_array(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
            shape=(len(stack.constant), count),
        )
    )
    bounds = np.hstack([np.eye(count), np.zeros((count, 1))])
    solution = solve(free.problem(stack, slack, np.ones(count), bounds))
    if solution.outcome.usable:
        found[list(free.free)] = np.maximum(solution.primal[stack.parameter_count :], 0.0)
    return found
