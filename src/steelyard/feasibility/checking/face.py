"""Which part of each condition can contradict: the face on which every dual point lies, and a point in its middle.

Where mass can be added that no motion shows, as on the axis of the first joint, a condition cannot fail in the
directions of that mass, however large the other parameters are: all dual points vanish there. Restricting every block
D to the complement, Uᵀ D U, leaves a problem whose dual has interior points, which solvers need to be accurate and
exact proofs need to have room (facial reduction: Borwein and Wolkowicz 1981; Permenter and Parrilo 2018).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import scipy.linalg as linalg
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, solve
from steelyard.lmi import AffineStack, symmetric_to_vector

from ..certificates.rational import exact_number
from ..feasible_set import FeasibleSet
from .margin import BlockProblem
from .null_space import polished_pair

__all__ = ["DualFace", "dual_face", "orthogonal"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ZERO_EIGENVALUE = 1e-7
"""Eigenvalues of the point in the middle (traces add to 1) below this count as zero; others are above 1e-5 or so."""


@dataclass(frozen=True, eq=False)
class DualFace:
    """For every block a basis U, such that all dual matrices are U W Uᵀ, and W of a point in the middle.

    Attributes
    ----------
    bases : tuple of (d, r)
        r may be 0 (nothing of the block can contradict) up to d.
    exact_bases : tuple of list of rows of Fraction
        The same in decimal numbers.
    interior : tuple of (r, r)
        W, positive definite.
    multipliers : (equations,)
        Of the equations, beside W.
    unseen : (n,)
        Parameters that can be added without being seen, whose blocks fill the complement of U; zeros where there are
        none.
    """

    bases: tuple[Matrix, ...]
    exact_bases: tuple[list[list[Fraction]], ...]
    interior: tuple[Matrix, ...]
    multipliers: Vector
    unseen: Vector


def dual_face(feasible_set: FeasibleSet) -> DualFace:
    """The face of a feasible set; it depends on the robot and the constraints alone, and is made once."""
    return feasible_set.kept(_dual_face)


def _dual_face(feasible_set: FeasibleSet) -> DualFace:
    whole = [np.eye(block.size) for block in feasible_set.blocks]
    stack = BlockProblem.of(feasible_set, np.zeros(feasible_set.parameter_count), whole).stack
    middle = _middle(feasible_set, stack)
    if middle is None:  # nothing is known of the face: keep all of it
        exact = tuple(_complement(block.size, np.zeros((0, block.size))) for block in feasible_set.blocks)
        none = np.zeros(feasible_set.parameter_count)
        return DualFace(tuple(whole), exact, tuple(whole), np.zeros(len(feasible_set.equalities)), none)
    duals, recession, multipliers = middle
    nulls = [_null_vectors(dual) for dual in duals]
    if any(len(null) for null in nulls):
        polished, added = polished_pair(stack, _unseen(feasible_set), duals, recession)
        finer = [_null_vectors(dual) for dual in polished]
        if [len(null) for null in finer] == [len(null) for null in nulls]:
            duals, nulls, recession = polished, finer, added
    exact_bases = [_complement(len(dual), null) for dual, null in zip(duals, nulls, strict=True)]
    bases = [
        np.array([[float(value) for value in row] for row in exact]).reshape(len(exact), -1) for exact in exact_bases
    ]
    inverses = [np.linalg.pinv(basis) if basis.shape[1] else basis.T for basis in bases]
    interior = tuple(inverse @ dual @ inverse.T for inverse, dual in zip(inverses, duals, strict=True))
    nearest, factors = orthogonal(feasible_set, bases, interior, multipliers)
    # Where the equations themselves are noise, as with axes that are parallel but for a thousandth, this leads astray.
    if _smallest(nearest) > 0.5 * _smallest(interior):
        interior, multipliers = nearest, factors
    unseen = np.zeros(feasible_set.parameter_count)
    if any(len(null) for null in nulls):
        directions = _unseen(feasible_set)
        blocks = np.concatenate([symmetric_to_vector(recession[index]) for index in stack.order])
        steps = np.linalg.lstsq(stack.coefficients @ directions, blocks, rcond=1e-10)[0]
        unseen = feasible_set.unidentifiable @ (directions @ steps)
    return DualFace(tuple(bases), tuple(exact_bases), tuple(interior), multipliers, unseen)


def orthogonal(
    feasible_set: FeasibleSet, bases: Sequence[Matrix], matrices: Sequence[Matrix], multipliers: Vector
) -> tuple[tuple[Matrix, ...], Vector]:
    """The nearest W and multipliers that satisfy the equations of a dual point to rounding.

    A solver satisfies them to its tolerance, relative to the largest numbers in them.
    """
    problem = BlockProblem.of(feasible_set, np.zeros(feasible_set.parameter_count), bases)
    stack = problem.stack
    equations = feasible_set.equation_matrix @ feasible_set.unidentifiable
    matrix = np.vstack([stack.coefficients.toarray(), equations]).T
    matrix /= np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), np.finfo(float).tiny)
    found = np.concatenate([np.zeros(len(stack.constant)), multipliers])
    for place, index in zip(stack.slices, problem.used, strict=True):
        found[place] = symmetric_to_vector(matrices[index])
    for _ in range(2):
        found -= np.linalg.lstsq(matrix, matrix @ found, rcond=1e-9)[0]
    nearest = list(matrices)
    for index, W in zip(problem.used, stack.matrices(found[: len(stack.constant)]), strict=True):
        nearest[index] = W
    return tuple(nearest), found[len(stack.constant) :]


def _smallest(matrices: Sequence[Matrix]) -> float:
    return min((float(np.linalg.eigvalsh(matrix)[0]) for matrix in matrices if len(matrix)), default=0.0)


def _unseen(feasible_set: FeasibleSet) -> Matrix:
    """Directions that neither the motion nor the equations of constraints show, (n_d, ...)."""
    count = feasible_set.unidentifiable.shape[1]
    if not feasible_set.equalities:
        return np.eye(count)
    return np.asarray(linalg.null_space(feasible_set.equation_matrix @ feasible_set.unidentifiable))


def _middle(
    feasible_set: FeasibleSet, stack: AffineStack
) -> tuple[tuple[Matrix, ...], tuple[Matrix, ...], Vector] | None:
    """Maximise s subject to Z_b - s 1 ⪰ 0, Σ tr Z_b = 1, and the equations of a dual point.

    Returns Z_b; the blocks of mass that can be added without showing, where there is any; and the multipliers of the
    constraints' equations. None where the solver fails.
    """
    rows, count = len(stack.constant), stack.parameter_count
    equations = feasible_set.equation_matrix @ feasible_set.unidentifiable
    extra = len(equations)
    A = sparse.vstack(
        [
            sparse.hstack([stack.coefficients.T, sparse.csc_array(equations.T), sparse.csc_array((count, 1))]),
            sparse.hstack([sparse.csc_array(stack.identity[None]), sparse.csc_array((1, extra + 1))]),
            sparse.hstack(
                [-sparse.eye_array(rows), sparse.csc_array((rows, extra)), sparse.csc_array(stack.identity[:, None])]
            ),
        ],
        format="csc",
    )
    unknowns = rows + extra + 1
    cost = np.zeros(unknowns)
    cost[-1] = -1.0
    problem = ConicProblem(
        P=sparse.csc_array((unknowns, unknowns)),
        q=cost,
        A=sparse.csc_array(A),
        b=np.concatenate([np.zeros(count), [1.0], np.zeros(rows)]),
        cones=(
            Cone("zero", count + 1),
            Cone("nonnegative", stack.scalar_count),
            *(Cone("semidefinite", size) for size in stack.matrix_sizes),
        ),
    )
    solution = solve(problem, accuracy=1e-9)
    if not solution.outcome.usable or not np.all(np.isfinite(solution.primal)):
        return None
    start = len(solution.dual) - rows
    return stack.matrices(solution.primal[:rows]), stack.matrices(solution.dual[start:]), solution.primal[rows:-1]


def _null_vectors(dual: Matrix) -> Matrix:
    values, vectors = np.linalg.eigh(dual)
    return np.asarray(vectors[:, values < ZERO_EIGENVALUE].T)


def _complement(size: int, null: Matrix) -> list[list[Fraction]]:
    """Decimal basis of the complement, exactly orthogonal to the null vectors as rounded in reduced echelon form."""
    pivots = np.zeros(0, dtype=np.intp)
    if len(null):
        _, _, order = linalg.qr(null, mode="economic", pivoting=True)
        pivots = np.sort(order[: len(null)])
    others = np.setdiff1d(np.arange(size), pivots)
    rows = np.linalg.solve(null[:, pivots], null[:, others]) if len(null) else np.zeros((0, size))
    basis = [[Fraction(0)] * len(others) for _ in range(size)]
    for column, other in enumerate(others):
        basis[other][column] = Fraction(1)
        for row, pivot in enumerate(pivots):
            basis[pivot][column] = -_short_decimal(float(rows[row, column]))
    return basis


def _short_decimal(value: float) -> Fraction:
    """The shortest decimal within the accuracy of the refinement."""
    for digits in range(10):
        short = round(value, digits)
        if abs(short - value) <= 1e-12 * max(1.0, abs(value)):
            return exact_number(short)
    return exact_number(value)
