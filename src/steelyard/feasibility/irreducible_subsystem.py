"""Irreducible infeasible subsystems: smallest sets of conditions that no parameters satisfy together."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.conic import Cone, ConicProblem, Rows, solve
from steelyard.files import tell
from steelyard.files.arguments import all_listed
from steelyard.lmi import AffineStack, symmetric_to_vector

from .feasible_set import FeasibleSet

__all__ = ["IrreducibleInfeasibleSubsystem", "irreducible_infeasible_subsystems", "separation"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

CLEAR = 1e-7
"""A contradiction counts if it exceeds this part of the largest number in it, ten times the accuracy of a solver."""

TAKES_PART = 1e-6
"""Smallest share of a condition that takes part in a contradiction; smaller ones are errors of the solver."""

MOST = 50
"""Largest number of subsystems that are searched for."""


@dataclass(frozen=True, eq=False)
class IrreducibleInfeasibleSubsystem:
    """Conditions that no parameters with these base parameters satisfy together, although any proper subset can hold.

    For every robot that satisfies them, direction · β is at least `threshold`; for these base parameters it is `value`,
    which is less.

    Attributes
    ----------
    conditions : tuple of str
        Names of the blocks and equations.
    shares : tuple of float
        Traces of their dual matrices, which add up to 1, largest first; nan for equations.
    direction : (n_b,)
        Scaled such that the largest absolute value of its elements is 1.
    value : float
    threshold : float
    blocks : tuple of int
        Indices of the blocks.
    """

    conditions: tuple[str, ...]
    shares: tuple[float, ...]
    direction: Vector = field(repr=False)
    value: float
    threshold: float
    blocks: tuple[int, ...] = field(repr=False)

    def __str__(self) -> str:
        if len(self.conditions) == 1:
            return f"{self.conditions[0]} cannot hold by itself"
        return f"{all_listed(self.conditions)} cannot hold together"


@dataclass(frozen=True, eq=False)
class Separation:
    """Dual matrices of some blocks, whose inner product with D(δ) is negative for all δ with K δ = β.

    Attributes
    ----------
    matrices : dict from index of a block to (d, d)
    multipliers : dict from index of an equation to float
    """

    matrices: dict[int, Matrix]
    multipliers: dict[int, float]


def separation(feasible_set: FeasibleSet, base: Vector, blocks: list[int], equations: list[int]) -> Separation | None:
    """A proof that no δ with K δ = β satisfies the given conditions; None if there is no clear one.

    Minimise Σ <D_b(δ), Z_b> over Z_b ⪰ 0 with traces that add up to 1, and for which the sum is the same for all δ with
    this β.
    """
    if not blocks:
        return None
    particular = feasible_set.lift @ base
    stack = AffineStack(tuple(feasible_set.blocks[i] for i in blocks), feasible_set.parameter_count)
    rows = np.asarray(stack.coefficients @ feasible_set.unidentifiable)
    values = stack.constant + stack.coefficients @ particular
    left = feasible_set.equation_matrix[equations] @ feasible_set.unidentifiable
    missing = feasible_set.equation_matrix[equations] @ particular - feasible_set.equation_values[equations]
    count = len(values)
    # Each block is scaled to 1, which changes the shares but not the sign.
    units = np.ones(count)
    for block, place in zip(stack.blocks, stack.slices, strict=True):
        size = max(float(np.abs(values[place]).max(initial=0.0)), float(np.abs(block.constant).max(initial=0.0)))
        units[place] = 1.0 / size if size > 1e-9 else 1.0
    problem = ConicProblem.from_rows(
        np.concatenate([units * values, missing]),
        [
            Rows(np.hstack([(units[:, None] * rows).T, left.T]), np.zeros(rows.shape[1]), Cone("zero", rows.shape[1])),
            Rows(stack.identity[None], np.ones(1), Cone("zero", 1)),
            Rows(-np.eye(count), np.zeros(count), *stack.cones),
        ],
    )
    solution = solve(problem, accuracy=1e-9)
    if not solution.usable or solution.objective > -CLEAR:
        return None
    dual = stack.matrices(units * solution.primal[:count])
    total = sum(float(np.trace(Z)) for Z in dual) or 1.0
    return Separation(
        {i: Z / total for i, Z in zip(blocks, dual, strict=True)},
        dict(zip(equations, (solution.primal[count:] / total).tolist(), strict=True)),
    )


def irreducible_infeasible_subsystems(
    feasible_set: FeasibleSet, base: Vector
) -> tuple[IrreducibleInfeasibleSubsystem, ...]:
    """Disjoint irreducible infeasible subsystems, such that the conditions outside them can hold together.

    Each is found by removing one condition after the other as long as the remaining ones are contradictory.
    """
    blocks = list(range(len(feasible_set.blocks)))
    equations = list(range(len(feasible_set.equalities)))
    found: list[IrreducibleInfeasibleSubsystem] = []
    # A condition that β alone violates is a subsystem of its own.
    for index in _violated_alone(feasible_set, base):
        reason = separation(feasible_set, base, [index], [])
        if reason is not None:
            found.append(_subsystem(feasible_set, base, reason))
            blocks.remove(index)
    while len(found) < MOST:
        reason = separation(feasible_set, base, blocks, equations)
        if reason is None:
            break
        reason = _smallest(feasible_set, base, reason)
        found.append(_subsystem(feasible_set, base, reason))
        blocks = [i for i in blocks if i not in reason.matrices]
    return tuple(found)


def _violated_alone(feasible_set: FeasibleSet, base: Vector) -> list[int]:
    particular = feasible_set.lift @ base
    found = []
    for index, block in enumerate(feasible_set.blocks):
        substituted = block.substitute(feasible_set.unidentifiable, particular)
        if not len(substituted.indices) and np.linalg.eigvalsh(substituted.constant)[0] < 0:
            found.append(index)
    return found


def _smallest(feasible_set: FeasibleSet, base: Vector, reason: Separation) -> Separation:
    """Remove conditions, those with the smallest share first, as long as the others are still contradictory."""
    reason = _taking_part(reason)
    tried: set[tuple[str, int]] = set()
    while True:
        order = sorted(reason.matrices, key=lambda i: float(np.trace(reason.matrices[i])))
        candidates = [("equation", i) for i in reason.multipliers] + [("block", i) for i in order]
        left = [candidate for candidate in candidates if candidate not in tried]
        tell("leaving out one condition after the other", len(tried), len(tried) + len(left), "conditions")
        if not left:
            return reason
        kind, index = left[0]
        tried.add((kind, index))
        blocks = [i for i in reason.matrices if (kind, i) != ("block", index)]
        equations = [i for i in reason.multipliers if (kind, i) != ("equation", index)]
        smaller = separation(feasible_set, base, sorted(blocks), sorted(equations))
        if smaller is not None:
            reason = _taking_part(smaller)


def _taking_part(reason: Separation) -> Separation:
    largest = max((abs(value) for value in reason.multipliers.values()), default=0.0)
    return Separation(
        {i: Z for i, Z in reason.matrices.items() if np.trace(Z) > TAKES_PART},
        {i: value for i, value in reason.multipliers.items() if abs(value) > TAKES_PART * max(largest, 1e-3)},
    )


def _subsystem(feasible_set: FeasibleSet, base: Vector, reason: Separation) -> IrreducibleInfeasibleSubsystem:
    gradient, constant = np.zeros(feasible_set.parameter_count), 0.0
    for index, Z in reason.matrices.items():
        block = feasible_set.blocks[index]
        np.add.at(gradient, block.indices, symmetric_to_vector(block.coefficients) @ symmetric_to_vector(Z))
        constant += float(np.sum(block.constant * Z))
    for index, multiplier in reason.multipliers.items():
        gradient += multiplier * feasible_set.equation_matrix[index]
        constant -= multiplier * float(feasible_set.equation_values[index])
    direction = feasible_set.lift.T @ gradient
    size = float(np.abs(direction).max(initial=0.0)) or 1.0
    direction = np.where(np.abs(direction) < 1e-9 * size, 0.0, direction / size)
    order = sorted(reason.matrices, key=lambda i: -float(np.trace(reason.matrices[i])))
    names = [feasible_set.blocks[i].name for i in order] + [feasible_set.equalities[i].name for i in reason.multipliers]
    total = sum(float(np.trace(Z)) for Z in reason.matrices.values()) or 1.0
    shares = [float(np.trace(reason.matrices[i])) / total for i in order] + [float("nan")] * len(reason.multipliers)
    return IrreducibleInfeasibleSubsystem(
        tuple(names),
        tuple(shares),
        direction,
        float(direction @ base),
        -constant / size,
        tuple(sorted(reason.matrices)),
    )
