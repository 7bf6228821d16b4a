"""Facial reduction: the face of the dual cone on which proofs lie if a set is unbounded (Borwein and Wolkowicz 1981).

The minimum of c·v subject to 1 + Σ v_j B_j ⪰ 0 is finite exactly if some Z ⪰ 0 has <B_j, Z> = c_j. If the set is
unbounded in a direction along which c does not change, all those Z are singular with a common null space: they lie on a
face of the cone, Z = U W Uᵀ. The infimum may then be approached without being attained, and a solver stalls; on the
face it does not. The directions v with Uᵀ (Σ v_j B_j) U = 0 are the lineality space of the problem on the face. An
objective is bounded if it is constant along that space, and unbounded otherwise, even if it falls only with the square
root of a mass. `MinimalFace` is this face for the objectives of a slice.

`DualFace` is the face for c = 0, on which every proof of infeasibility lies. If mass can be added that no motion shows,
as on the axis of the first joint, a condition cannot fail in the directions of that mass, however large the other
parameters are. Restricting every block D to the complement, Uᵀ D U, leaves a problem whose dual has interior points.
Solvers need these for accuracy, and exact proofs need them for rounding (Permenter and Parrilo 2018).

Both start from a dual point of greatest rank, whose null spaces a solver finds to the square root of its accuracy only.
They differ in how these are refined to rounding. Exact proofs need the null spaces themselves, which the equation
D Z = 0 determines if Z + D is definite (`polished_pair`). Bounds need bases with Uᵀ (Σ v_j B_j) U = 0 on the lineality
space, also if Z + D is singular, as for an objective that falls with the square root of a mass (`_polish`). Neither
method works for the other: in the second case D Z = 0 does not determine the null spaces, and in the first turning the
bases may stop at the square root of rounding, which is too coarse for exact proofs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import scipy.linalg as linalg
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, Rows, solve
from steelyard.conic.clarabel_solver import RepeatedProblem
from steelyard.lmi import AffineStack, symmetric_to_vector, vector_to_symmetric

from .certificates.rational import exact_number
from .feasible_set import FeasibleSet
from .margin import BlockProblem

if TYPE_CHECKING:
    from .bounds.normalised_problem import Ball, DualPoint, NormalisedProblem

__all__ = ["DualFace", "MinimalFace", "dual_face", "minimal_face", "orthogonal", "polished_pair"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ZERO_EIGENVALUE = 1e-7
"""Eigenvalues of the dual point of greatest rank (whose traces add up to 1) below this count as zero; others are above
1e-5 or so."""


@dataclass(frozen=True, eq=False)
class DualFace:
    """For every block a basis U such that all dual matrices are U W Uᵀ, and W of a point in the interior of the face.

    Attributes
    ----------
    bases : tuple of (d, r)
        r is between 0 (the block takes part in no contradiction) and d.
    exact_bases : tuple of list of rows of Fraction
        The bases in decimal numbers.
    interior : tuple of (r, r)
        W, positive definite.
    multipliers : (equations,)
        Multipliers of the equations that belong to W.
    recession : (n,)
        Unidentifiable parameters that can be added without bound, and whose blocks are positive definite on the
        complement of U; zeros if there are none.
    """

    bases: tuple[Matrix, ...]
    exact_bases: tuple[list[list[Fraction]], ...]
    interior: tuple[Matrix, ...]
    multipliers: Vector
    recession: Vector


def dual_face(feasible_set: FeasibleSet) -> DualFace:
    """The face of a feasible set, computed once: it depends on the robot and the constraints alone."""
    return feasible_set.kept(_dual_face)


def _dual_face(feasible_set: FeasibleSet) -> DualFace:
    whole = [np.eye(block.size) for block in feasible_set.blocks]
    stack = BlockProblem.of(feasible_set, np.zeros(feasible_set.parameter_count)).stack
    middle = _dual_point_of_greatest_rank(feasible_set, stack)
    if middle is None:  # nothing is known about the face: take the whole cone
        exact = tuple(_complement(block.size, np.zeros((0, block.size))) for block in feasible_set.blocks)
        none = np.zeros(feasible_set.parameter_count)
        return DualFace(tuple(whole), exact, tuple(whole), np.zeros(len(feasible_set.equalities)), none)
    duals, recession, multipliers = middle
    nulls = [_null_vectors(dual) for dual in duals]
    if any(len(null) for null in nulls):
        polished, added = polished_pair(stack, _unidentifiable(feasible_set), duals, recession)
        finer = [_null_vectors(dual) for dual in polished]
        if [len(null) for null in finer] == [len(null) for null in nulls]:
            duals, nulls, recession = polished, finer, added
    exact_bases = [_complement(len(dual), null) for dual, null in zip(duals, nulls, strict=True)]
    bases = [
        np.array([[float(value) for value in row] for row in exact]).reshape(len(exact), -1) for exact in exact_bases
    ]
    # Most blocks are 1 x 1, and need no linear algebra: the basis of one is 1, or empty.
    inverses = [np.linalg.pinv(basis) if len(basis) > 1 and basis.shape[1] else basis.T for basis in bases]
    interior = tuple(inverse @ dual @ inverse.T for inverse, dual in zip(inverses, duals, strict=True))
    nearest, factors = orthogonal(feasible_set, bases, interior, multipliers)
    # If the equations hold rounding errors, as for axes that are nearly parallel, the projection may leave the cone.
    if _smallest(nearest) > 0.5 * _smallest(interior):
        interior, multipliers = nearest, factors
    growth = np.zeros(feasible_set.parameter_count)
    if any(len(null) for null in nulls):
        directions = _unidentifiable(feasible_set)
        blocks = np.concatenate([symmetric_to_vector(recession[index]) for index in stack.order])
        steps = np.linalg.lstsq(stack.coefficients @ directions, blocks, rcond=1e-10)[0]
        growth = feasible_set.unidentifiable @ (directions @ steps)
    return DualFace(tuple(bases), tuple(exact_bases), tuple(interior), multipliers, growth)


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
    left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
    shown = sizes > 1e-9 * sizes.max(initial=0.0)
    inverse = right[shown].T / sizes[shown]
    for _ in range(2):
        found -= inverse @ (left[:, shown].T @ (matrix @ found))
    nearest = list(matrices)
    for index, W in zip(problem.used, stack.matrices(found[: len(stack.constant)]), strict=True):
        nearest[index] = W
    return tuple(nearest), found[len(stack.constant) :]


def _smallest(matrices: Sequence[Matrix]) -> float:
    least = [matrix[0, 0] if len(matrix) == 1 else np.linalg.eigvalsh(matrix)[0] for matrix in matrices if len(matrix)]
    return float(min(least, default=0.0))


def _unidentifiable(feasible_set: FeasibleSet) -> Matrix:
    """Directions of unidentifiable parameters that the equations of constraints leave free, (n_d, ...)."""
    count = feasible_set.unidentifiable.shape[1]
    if not feasible_set.equalities:
        return np.eye(count)
    return np.asarray(linalg.null_space(feasible_set.equation_matrix @ feasible_set.unidentifiable))


def _dual_point_of_greatest_rank(
    feasible_set: FeasibleSet, stack: AffineStack
) -> tuple[tuple[Matrix, ...], tuple[Matrix, ...], Vector] | None:
    """Maximise s subject to Z_b - s 1 ⪰ 0, Σ tr Z_b = 1, and the equations of a dual point.

    Returns Z_b; the blocks of a direction along which the set is unbounded, zero if there is none; and the multipliers
    of the constraints' equations. None if the solver fails.
    """
    rows, count = len(stack.constant), stack.parameter_count
    equations = feasible_set.equation_matrix @ feasible_set.unidentifiable
    extra = len(equations)
    dual_equations = sparse.vstack(
        [
            sparse.hstack([stack.coefficients.T, sparse.csc_array(equations.T), sparse.csc_array((count, 1))]),
            sparse.hstack([sparse.csc_array(stack.identity[None]), sparse.csc_array((1, extra + 1))]),
        ]
    )
    eigenvalues = sparse.hstack(
        [-sparse.eye_array(rows), sparse.csc_array((rows, extra)), sparse.csc_array(stack.identity[:, None])]
    )
    cost = np.zeros(rows + extra + 1)
    cost[-1] = -1.0
    problem = ConicProblem.from_rows(
        cost,
        [
            Rows(sparse.csc_array(dual_equations), np.append(np.zeros(count), 1.0), Cone("zero", count + 1)),
            Rows(sparse.csc_array(eigenvalues), np.zeros(rows), *stack.cones),
        ],
    )
    solution = solve(problem, accuracy=1e-9)
    if not solution.usable:
        return None
    start = len(solution.dual) - rows
    return stack.matrices(solution.primal[:rows]), stack.matrices(solution.dual[start:]), solution.primal[rows:-1]


def _null_vectors(dual: Matrix) -> Matrix:
    if len(dual) == 1:
        return np.ones((1 if dual[0, 0] < ZERO_EIGENVALUE else 0, 1))
    values, vectors = np.linalg.eigh(dual)
    return np.asarray(vectors[:, values < ZERO_EIGENVALUE].T)


def _complement(size: int, null: Matrix) -> list[list[Fraction]]:
    """Decimal basis that is exactly orthogonal to the null vectors, after these are rounded in reduced echelon form."""
    if size == 1:
        return [[]] if len(null) else [[Fraction(1)]]
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


PAIR_STEPS, CONVERGED, DIVERGED = 8, 1e-14, 1e6
"""Largest number of Newton steps, and sizes of D Z, relative to D and Z, at which they end with success and without."""


def polished_pair(
    stack: AffineStack, unidentifiable: Matrix, duals: tuple[Matrix, ...], recession: tuple[Matrix, ...]
) -> tuple[tuple[Matrix, ...], tuple[Matrix, ...]]:
    """Refine dual matrices Z_b such that their null spaces are right to rounding, by Newton's method on D_b Z_b = 0.

    D is a combination of the blocks of unidentifiable parameters, and Z is orthogonal to all of these. A solver leaves
    D Z at about its tolerance, so that null vectors are accurate to the square root of it. If Z + D is definite, the
    equation determines the null spaces: for changes with δD Z + D δZ = 0 the product <δD, δZ>, which is zero, would be
    negative unless the null spaces stay the same. What the equation does not determine is changed by the least amount.

    Parameters
    ----------
    stack : AffineStack
        Blocks in the parameters that the motion does not show.
    unidentifiable : (n_d, ...)
        Directions that the equations of constraints leave free.
    duals, recession : tuple of (d, d)
        Z and D of a solver.

    Returns
    -------
    duals, recession : tuple of (d, d)
        Unchanged if the method does not converge.
    """
    columns = stack.coefficients @ unidentifiable
    lengths = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, lengths > 0] / lengths[lengths > 0], full_matrices=True)
    rank = int(np.sum(singular > 1e-10 * singular.max(initial=0.0)))
    values = [np.concatenate([symmetric_to_vector(m[index]) for index in stack.order]) for m in (recession, duals)]
    point = np.concatenate([left[:, :rank].T @ values[0], left[:, rank:].T @ values[1]])
    scale = float(np.linalg.norm(point))
    if scale == 0.0:
        return duals, recession
    directions = [vector_to_symmetric(left[rows].T) for rows in stack.slices]
    best = np.inf
    for _ in range(PAIR_STEPS):
        D, Z = stack.matrices(left[:, :rank] @ point[:rank]), stack.matrices(left[:, rank:] @ point[rank:])
        residual = np.concatenate([(d @ z).ravel() for d, z in zip(D, Z, strict=True)])
        error = float(np.linalg.norm(residual))
        if not error < DIVERGED * scale:
            break
        if error <= CONVERGED * scale:
            return Z, D
        if error > 0.5 * best and error <= 1e-11 * scale:
            return Z, D
        best = min(best, error)
        jacobian = np.concatenate(
            [
                np.concatenate([M[:rank] @ z, d @ M[rank:]]).reshape(len(point), -1)
                for M, d, z in zip(directions, D, Z, strict=True)
            ],
            axis=1,
        ).T
        # LAPACK's gelsd, the default, does not converge on some of these matrices.
        point = point - linalg.lstsq(jacobian, residual, cond=1e-9, lapack_driver="gelsy")[0]
    return duals, recession


ZERO = 1e-5
"""Eigenvalues of the dual point of greatest rank (whose traces add up to the number of rows) below this count as zero.
Most are below 1e-8 or above 1e-2. If the guess is wrong, a bound is less tight or is not found, but it is never
wrong."""

LINEALITY = 1e-3
"""Singular values below this belong to the lineality space; for refined bases they are below 1e-8 or above 1e-2."""

CHANGES = 1e-5
"""An objective of length 1 that changes by more than this along the lineality space is unbounded."""

POLISH = 8
"""Largest number of Newton steps when bases are refined."""

GREATEST_RANK_ACCURACY = 1e-10
"""Accuracy of the solver for the dual point of greatest rank, from which the bases come."""

ROOM = 1e-9
"""Multiple of the unit matrix that is added to W, so that mending can change all its eigenvalues."""


@dataclass(frozen=True, eq=False)
class MinimalFace:
    """The face of the dual cone that holds the proofs for all objectives that are constant along its lineality space.

    Attributes
    ----------
    bases : tuple of (d, r)
        For each block an orthonormal basis U, such that Z = U W Uᵀ.
    lineality : (q, l)
        Orthonormal basis of the directions v with Uᵀ (Σ v_j B_j) U = 0 for all blocks.
    places : tuple of tuple of int
        The blocks in each group of `reduced`.
    reduced : NormalisedProblem
        The problem with Uᵀ (1 + Σ v_j B_j) U ⪰ 0 instead, in v̂ with v = directions v̂.
    directions : (q, q - l)
    """

    problem: NormalisedProblem = field(repr=False)
    bases: tuple[Matrix, ...] = field(repr=False)
    lineality: Matrix = field(repr=False)
    places: tuple[tuple[int, ...], ...] = field(repr=False)
    reduced: NormalisedProblem = field(repr=False)
    directions: Matrix = field(repr=False)

    def bounds(self, objective: Vector) -> bool:
        """Whether an objective of length 1 is constant along the lineality space, so that it is bounded below."""
        return float(np.linalg.norm(self.lineality.T @ objective)) < CHANGES

    def least(self, objective: Vector) -> DualPoint:
        """Minimise an objective of length 1 on the face; the dual point is one of the whole problem."""
        flat, value = [np.zeros((len(U), len(U))) for U in self.bases], 0.0
        pull = np.zeros(0 if self.problem.ball is None else len(self.problem.ball.first))
        if self.reduced.unknowns:
            dual = self.reduced.least(self.directions.T @ objective).dual
            value, pull = dual.value, dual.pull
            for positions, matrices in zip(self.places, dual.matrices, strict=True):
                for position, W in zip(positions, matrices, strict=True):
                    U = self.bases[position]
                    flat[position] = U @ (W + ROOM * np.eye(len(W))) @ U.T
        return self.problem.dual_point(flat, pull, value)


def minimal_face(problem: NormalisedProblem, objective: Vector | None = None) -> MinimalFace:
    """The smallest face that holds every Z ⪰ 0 with Σ <B_j, Z> = t c_j, t ≥ 0; without c, those with 0.

    The objective (q,) is c, of length 1. It is unbounded if it is not constant along the lineality space of the face
    that is found.
    """
    matrices = problem.split(_proof_of_greatest_rank(problem, objective))
    bases = []
    for group in matrices:
        values, vectors = np.linalg.eigh(group)
        bases += [v[:, e > ZERO] for e, v in zip(values, vectors, strict=True)]
    coefficients = [block for group in problem.groups for block in group.coefficients]
    bases, lineality = _polish(bases, coefficients, problem.ball, problem.unknowns)
    directions, places, reduced = problem.on_face(bases, lineality)
    return MinimalFace(problem, tuple(bases), lineality, places, reduced, directions)


def _proof_of_greatest_rank(problem: NormalisedProblem, objective: Vector | None) -> Vector:
    """A stacked Z of greatest rank with Σ <B_j, Z> = t c_j, found by maximising its smallest eigenvalue."""
    rows, count = problem.coefficients.shape
    ball = problem.ball
    rounds = 0 if ball is None else 1 + len(ball.first)
    columns = [sparse.csc_array(problem.coefficients.T)]
    weights = [problem.identity / max(problem.order, 1)]
    if ball is not None:
        columns.append(sparse.csc_array(np.hstack([ball.rate[:, None], ball.second.T])))
        weights.append(np.concatenate([np.ones(1), np.zeros(rounds - 1)]))
    unknowns = rows + rounds + 2  # Z, the dual of the ball, t, and the smallest eigenvalue
    target = np.zeros(count) if objective is None else objective
    equations = sparse.hstack([*columns, -sparse.csc_array(target[:, None]), sparse.csc_array((count, 1))])
    total = np.concatenate([*weights, [1.0, 0.0]])
    if objective is None:
        total[-2] = 0.0
    share = sparse.csc_array(([-1.0, 1.0], ([0, 0], [unknowns - 2, unknowns - 1])), shape=(1, unknowns))
    most = sparse.csc_array(([1.0], ([0], [unknowns - 2])), shape=(1, unknowns))
    eigenvalues = sparse.hstack(
        [-sparse.eye_array(rows), sparse.csc_array((rows, rounds + 1)), sparse.csc_array(problem.identity[:, None])]
    )
    pieces = [
        Rows(
            sparse.csc_array(sparse.vstack([equations, sparse.csc_array(total[None])])),
            np.append(np.zeros(count), 1.0),
            Cone("zero", count + 1),
        ),
        Rows(sparse.csc_array(sparse.vstack([share, most])), np.array([0.0, 1.0]), Cone("nonnegative", 2)),
        Rows(sparse.csc_array(eigenvalues), np.zeros(rows), *problem.cones),
    ]
    if ball is not None:
        round_rows = sparse.hstack(
            [sparse.csc_array((rounds, rows)), -sparse.eye_array(rounds), sparse.csc_array((rounds, 2))]
        )
        pieces.append(Rows(sparse.csc_array(round_rows), np.zeros(rounds), Cone("second-order", rounds)))
    cost = np.zeros(unknowns)
    cost[-1] = -1.0
    conic = ConicProblem.from_rows(cost, pieces)
    found = RepeatedProblem(conic, "clarabel", GREATEST_RANK_ACCURACY).solve(cost).primal
    return np.where(np.isfinite(found), found, 0.0)[:rows]


def _polish(
    bases: list[Matrix], coefficients: list[Matrix], ball: Ball | None, unknowns: int
) -> tuple[list[Matrix], Matrix]:
    """Refine the bases by Newton steps until Uᵀ (Σ v_j B_j) U vanishes on the lineality space; return both.

    The solver finds the bases to the square root of its accuracy only.
    """
    shapes = [U.shape for U in bases]
    complements = [
        np.linalg.svd(U)[0][:, r:] if 0 < r < d else np.zeros((d, 0)) for U, (d, r) in zip(bases, shapes, strict=True)
    ]
    lineality = np.zeros((unknowns, 0))
    for _ in range(POLISH):
        seen = [
            np.einsum("ia,qij,jb->qab", U, B, U, optimize=True).reshape(unknowns, -1)
            for U, B in zip(bases, coefficients, strict=True)
        ]
        if ball is not None:
            seen.append(np.hstack([ball.rate[:, None], ball.second.T]))
        stacked = np.hstack([np.zeros((unknowns, 0)), *seen])
        left, values, right = np.linalg.svd(stacked, full_matrices=True)
        rank = int(np.sum(values > LINEALITY * values.max(initial=1.0)))
        lineality, known = left[:, rank:], right[:rank]
        missing = lineality.T @ stacked
        if not lineality.shape[1] or float(np.abs(missing).max(initial=0.0)) < 1e-14:
            break
        step = _turn(bases, complements, coefficients, lineality, known, missing)
        bases = [np.linalg.qr(U + Q @ E)[0] if E.size else U for U, Q, E in zip(bases, complements, step, strict=True)]
    return bases, lineality


def _turn(
    bases: list[Matrix],
    complements: list[Matrix],
    coefficients: list[Matrix],
    lineality: Matrix,
    known: Matrix,
    missing: Matrix,
) -> list[Matrix]:
    """E of every block such that the bases U + Q E reduce Uᵀ (Σ v_j B_j) U on the lineality space."""
    width = missing.shape[1]
    columns, start = [], 0
    for U, Q, B in zip(bases, complements, coefficients, strict=True):
        r, s = U.shape[1], Q.shape[1]
        if s:
            across = np.einsum("ql,ia,qij,jb->lab", lineality, Q, B, U, optimize=True)
            # The change of Uᵀ B U is Eᵀ (Qᵀ B U) and its transpose.
            change = np.zeros((lineality.shape[1], s, r, r, r))
            for a in range(r):
                change[:, :, a, a, :] += across
                change[:, :, a, :, a] += across
            piece = np.zeros((lineality.shape[1], s * r, width))
            piece[:, :, start : start + r * r] = change.reshape(lineality.shape[1], s * r, r * r)
            columns.append(piece)
        start += r * r
    if not columns:
        return [np.zeros((Q.shape[1], U.shape[1])) for U, Q in zip(bases, complements, strict=True)]
    jacobian = np.concatenate(columns, axis=1)
    # Changes along the other directions do not count: a change of the lineality space makes up for them.
    jacobian = jacobian - (jacobian @ known.T) @ known
    missing = missing - (missing @ known.T) @ known
    weights = np.linalg.lstsq(jacobian.transpose(0, 2, 1).reshape(-1, jacobian.shape[1]), -missing.ravel(), rcond=1e-8)[
        0
    ]
    found, start = [], 0
    for U, Q in zip(bases, complements, strict=True):
        size = U.shape[1] * Q.shape[1]
        found.append(weights[start : start + size].reshape(Q.shape[1], U.shape[1]))
        start += size
    return found
