"""Whether a linear objective is bounded below on a set that goes on without end, and the face on which its proof lies.

Minimise c·v subject to 1 + Σ v_j B_j ⪰ 0 has a finite infimum exactly where some Z ⪰ 0 has <B_j, Z> = c_j. Where the
set goes on in a direction in which c does not change, all those Z are singular, in the same directions: they lie on a
face of the cone, Z = U W Uᵀ. The infimum then is approached without being reached, or not everywhere, and a solver
stalls; on the face it does not (facial reduction: Borwein and Wolkowicz 1981). What Uᵀ (Σ v_j B_j) U does not see is
their lineality space: an objective is bounded where it does not change along that, and unbounded otherwise, even where
it falls more and more slowly, such as with the square root of a mass.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem

from .bounds.normalised_problem import ACCURACY, Ball, DualPoint, NormalisedProblem, RepeatedProblem
from .bounds.slice import BlockGroup, null_space

__all__ = ["MinimalFace", "minimal_face"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ZERO = 1e-5
"""Eigenvalues of the point in the middle of the face (the traces add to the number of rows) below this are zero. Most
are below 1e-8 or above 1e-2; where the guess is wrong, a bound is less sharp, or taken for none, but never wrong."""

LINEALITY = 1e-3
"""Singular values below this are directions that the face does not see; of polished faces they are below 1e-8 or above
1e-2."""

CHANGES = 1e-5
"""An objective of length 1 that changes by more along a lineality direction is not bounded."""

POLISH = 8

ROOM = 1e-9
"""What is added to W, so that it can be mended."""


@dataclass(frozen=True, eq=False)
class MinimalFace:
    """The face of the dual cone on which the proofs lie, for all objectives that do not change in its lineality part.

    Attributes
    ----------
    problem : NormalisedProblem
    bases : tuple of (d, r)
        For each block an orthonormal basis U, such that Z = U W Uᵀ.
    lineality : (q, l)
        Orthonormal basis of the directions v with Uᵀ (Σ v_j B_j) U = 0 for all blocks.
    places : tuple of tuple of int
        Which blocks the groups of `reduced` hold.
    reduced : NormalisedProblem
        The problem with Uᵀ (1 + Σ v_j B_j) U ⪰ 0 alone, in v̂ with v = directions v̂.
    directions : (q, q - l)
    """

    problem: NormalisedProblem = field(repr=False)
    bases: tuple[Matrix, ...] = field(repr=False)
    lineality: Matrix = field(repr=False)
    places: tuple[tuple[int, ...], ...] = field(repr=False)
    reduced: NormalisedProblem = field(repr=False)
    directions: Matrix = field(repr=False)

    def bounds(self, objective: Vector) -> bool:
        """Whether this is the face of an objective (of length 1), so that it is bounded below."""
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
        found, start = [], 0
        for group in self.problem.groups:
            found.append(np.array(flat[start : start + len(group.indices)]))
            start += len(group.indices)
        return DualPoint(tuple(found), pull, value)


def minimal_face(problem: NormalisedProblem, objective: Vector | None = None) -> MinimalFace:
    """The smallest face that holds every Z ⪰ 0 with Σ <B_j, Z> = t c_j, t ≥ 0; without c, those with 0.

    Parameters
    ----------
    problem : NormalisedProblem
    objective : (q,), optional
        c, of length 1. Not bounded, if it changes in the lineality part of the face that is found.
    """
    matrices = problem.split(_middle(problem, objective))
    bases = []
    for group in matrices:
        values, vectors = np.linalg.eigh(group)
        bases += [v[:, e > ZERO] for e, v in zip(values, vectors, strict=True)]
    coefficients = [block for group in problem.groups for block in group.coefficients]
    bases, lineality = _polish(bases, coefficients, problem.ball, problem.unknowns)
    directions = null_space(lineality.T) if lineality.shape[1] else np.eye(problem.unknowns)
    pieces: dict[int, list[tuple[int, Matrix]]] = {}
    for position, (U, B) in enumerate(zip(bases, coefficients, strict=True)):
        if U.shape[1]:
            seen = np.einsum("qr,ia,qij,jb->rab", directions, U, B, U, optimize=True)
            pieces.setdefault(U.shape[1], []).append((position, seen))
    sizes = sorted(pieces)
    groups = tuple(
        BlockGroup(
            size,
            np.array([position for position, _ in pieces[size]], dtype=np.intp),
            np.broadcast_to(np.eye(size), (len(pieces[size]), size, size)),
            np.array([piece for _, piece in pieces[size]]),
        )
        for size in sizes
    )
    ball = problem.ball
    if ball is not None:
        ball = Ball(ball.first, ball.second @ directions, ball.rate @ directions)
    return MinimalFace(
        problem=problem,
        bases=tuple(bases),
        lineality=lineality,
        places=tuple(tuple(position for position, _ in pieces[size]) for size in sizes),
        reduced=NormalisedProblem(groups, ball, directions.shape[1], problem.solver),
        directions=directions,
    )


def _middle(problem: NormalisedProblem, objective: Vector | None) -> Vector:
    """A stacked Z of largest rank with Σ <B_j, Z> = t c_j, from maximising the smallest eigenvalue."""
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
    pieces = [equations, sparse.csc_array(total[None]), share, most, eigenvalues]
    cones = [Cone("zero", count + 1), Cone("nonnegative", 2), *problem.cones]
    if ball is not None:
        pieces.append(
            sparse.hstack([sparse.csc_array((rounds, rows)), -sparse.eye_array(rounds), sparse.csc_array((rounds, 2))])
        )
        cones.append(Cone("second-order", rounds))
    cost = np.zeros(unknowns)
    cost[-1] = -1.0
    right = np.concatenate([np.zeros(count), [1.0, 0.0, 1.0], np.zeros(rows + rounds)])
    conic = ConicProblem(
        P=sparse.csc_array((unknowns, unknowns)),
        q=cost,
        A=sparse.csc_array(sparse.vstack(pieces, format="csc")),
        b=right,
        cones=tuple(cones),
    )
    _, found, _ = RepeatedProblem(conic, "clarabel", ACCURACY).solve(cost)
    return np.where(np.isfinite(found), found, 0.0)[:rows]


def _polish(
    bases: list[Matrix], coefficients: list[Matrix], ball: Ball | None, unknowns: int
) -> tuple[list[Matrix], Matrix]:
    """Turn the bases until what they do not see is zero to rounding, by Newton steps; they, and the lineality space.

    The point in the middle tells the bases to the root of the solver's accuracy only.
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
    """E of every block, such that the bases U + Q E see the lineality directions less."""
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
    # What the other directions can make up for does not count.
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
