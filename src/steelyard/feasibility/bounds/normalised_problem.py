"""Linear objectives over a set in units in which it is round; only the objective changes between problems."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.conic import Cone, ConicProblem, Outcome, Rows
from steelyard.conic.clarabel_solver import RepeatedProblem
from steelyard.lmi import symmetric_to_vector, vector_to_symmetric
from steelyard.once import cached_property
from steelyard.regression.factor import eigenvectors

from .slice import BlockGroup, null_space

__all__ = ["Ball", "DualPoint", "NormalisedProblem", "NormalisedSolution"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


ACCURACY = 1e-10
"""Accuracy of the solver: dual points are used for proofs, whose tightness depends on it."""

ROUGH = 1e-8
"""Accuracy if only the point is used."""


@dataclass(frozen=True, eq=False)
class Ball:
    """‖first + second v‖ ≤ 1 + rate · v.

    Attributes
    ----------
    first : (k,)
    second : (k, q)
    rate : (q,)
    """

    first: Vector
    second: Matrix
    rate: Vector

    def share_inside(self, point: Vector) -> float:
        """The largest share s ≤ 1 with s point in the ball; 0 is in it."""
        step, growth = self.second @ point, float(self.rate @ point)
        if np.linalg.norm(self.first + step) <= 1.0 + growth:
            return 1.0
        # (1 + s growth)² - ‖first + s step‖² = a s² + 2 b s + c
        a, b = growth**2 - float(step @ step), growth - float(self.first @ step)
        c = 1.0 - float(self.first @ self.first)
        root = float(np.sqrt(max(b * b - a * c, 0.0)))
        # Its first zero beyond s = 0, where it is c > 0.
        return min(1.0, c / (root - b)) if root > b else 1.0


@dataclass(frozen=True, eq=False)
class DualPoint:
    """A dual point for an objective of length 1, to the solver's accuracy.

    Attributes
    ----------
    matrices : tuple of (b, d, d)
        Z of the blocks of each group.
    pull : (k,)
        Multiplier of first + second v in the ball.
    value : float
        The dual objective: the least value, if the equations hold.
    """

    matrices: tuple[Matrix, ...] = field(repr=False)
    pull: Vector = field(repr=False)
    value: float


@dataclass(frozen=True, eq=False)
class NormalisedSolution:
    """The answer of the solver for one objective.

    Attributes
    ----------
    point : (q,)
        v.
    """

    outcome: Outcome
    point: Vector = field(repr=False)
    dual: DualPoint


class NormalisedProblem:
    """Minimise c·v subject to 1 + Σ v_j B_j ⪰ 0 for every block, and v in the ball.

    Parameters
    ----------
    groups : tuple of BlockGroup
        With unit matrices as constants.
    unknowns : int
        q.
    solver : str
        As in `steelyard.conic.solve`.
    """

    def __init__(self, groups: tuple[BlockGroup, ...], ball: Ball | None, unknowns: int, solver: str) -> None:
        self.groups = groups
        self.ball = ball
        self.unknowns = unknowns
        self.solver = solver

    @cached_property
    def order(self) -> int:
        """Number of rows of all blocks: the sum of their sizes."""
        return sum(group.size * len(group.indices) for group in self.groups)

    @cached_property
    def coefficients(self) -> Matrix:
        """Stacked B_j, the blocks of each group after those of the one before, (rows, q)."""
        pieces = [symmetric_to_vector(group.coefficients) for group in self.groups]
        stacked = [piece.transpose(0, 2, 1).reshape(-1, self.unknowns) for piece in pieces]
        found = np.vstack([np.zeros((0, self.unknowns)), *stacked])
        found[np.abs(found) < 1e-15] = 0.0
        return found

    @cached_property
    def identity(self) -> Vector:
        """Stacked unit matrices, (rows,)."""
        pieces = [np.tile(symmetric_to_vector(np.eye(group.size)), len(group.indices)) for group in self.groups]
        return np.concatenate([np.zeros(0), *pieces])

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """Cones of the blocks, in the order of the rows."""
        found: list[Cone] = []
        for group in self.groups:
            count = len(group.indices)
            found += [Cone("nonnegative", count)] if group.size == 1 else [Cone("semidefinite", group.size)] * count
        return tuple(found)

    def rounded(self) -> tuple["NormalisedProblem", Matrix]:
        """The same problem in units v = units v' in which it is round around v = 0, and these units."""
        hessian = self.coefficients.T @ self.coefficients
        if self.ball is not None:
            # Of -log((1 + rate·v)² - ‖first + second v‖²), to first order in its own two cones.
            rest = 1.0 - float(self.ball.first @ self.ball.first)
            pull = self.ball.rate - self.ball.second.T @ self.ball.first
            hessian = (
                hessian + 2.0 * self.ball.second.T @ self.ball.second / rest + 4.0 * np.outer(pull, pull) / rest**2
            )
        values, vectors = eigenvectors(hessian)
        units = vectors / np.sqrt(np.maximum(values, 1e-14 * values[-1]))
        groups = tuple(
            BlockGroup(g.size, g.indices, g.constants, np.einsum("qr,bqij->brij", units, g.coefficients))
            for g in self.groups
        )
        ball = self.ball
        if ball is not None:
            ball = Ball(ball.first, ball.second @ units, ball.rate @ units)
        return NormalisedProblem(groups, ball, self.unknowns, self.solver), units

    def on_face(
        self, bases: Sequence[Matrix], lineality: Matrix
    ) -> tuple[Matrix, tuple[tuple[int, ...], ...], "NormalisedProblem"]:
        """The problem with Uᵀ (1 + Σ v_j B_j) U ⪰ 0 for each block, without the directions in which nothing changes.

        Parameters
        ----------
        bases : sequence of (d, r)
            U of each block, in the order of the groups.
        lineality : (q, l)
            Orthonormal basis of the directions v with Uᵀ (Σ v_j B_j) U = 0 for all blocks.

        Returns
        -------
        directions : (q, q - l)
            The unknowns v̂ of the problem: v = directions v̂.
        places : tuple of tuple of int
            The blocks in each of its groups.
        problem : NormalisedProblem
        """
        directions = null_space(lineality.T)
        coefficients = [block for group in self.groups for block in group.coefficients]
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
        ball = self.ball
        if ball is not None:
            ball = Ball(ball.first, ball.second @ directions, ball.rate @ directions)
        places = tuple(tuple(position for position, _ in pieces[size]) for size in sizes)
        return directions, places, NormalisedProblem(groups, ball, directions.shape[1], self.solver)

    def dual_point(self, matrices: Sequence[Matrix], pull: Vector, value: float) -> DualPoint:
        """A dual point of the matrix of each block, in the order of the groups."""
        found, start = [], 0
        for group in self.groups:
            found.append(np.array(matrices[start : start + len(group.indices)]))
            start += len(group.indices)
        return DualPoint(tuple(found), pull, value)

    def split(self, stacked: Vector) -> tuple[Matrix, ...]:
        """Symmetric matrices of each group, from a stacked vector."""
        found, start = [], 0
        for group in self.groups:
            width = group.size * (group.size + 1) // 2
            stop = start + width * len(group.indices)
            found.append(vector_to_symmetric(stacked[start:stop].reshape(-1, width)))
            start = stop
        return tuple(found)

    @cached_property
    def _repeated(self) -> RepeatedProblem:
        """The rows of the ball come last."""
        rows = [Rows(-self.coefficients, self.identity, *self.cones)]
        if self.ball is not None:
            left, right = np.vstack([-self.ball.rate[None], -self.ball.second]), np.append(1.0, self.ball.first)
            rows.append(Rows(left, right, Cone("second-order", len(right))))
        problem = ConicProblem.from_rows(np.zeros(self.unknowns), rows)
        return RepeatedProblem(problem, self.solver, ACCURACY)

    def strain(self, objective: Vector, dual: DualPoint) -> float:
        """The error of a dual point's equations times its size."""
        missing = objective.copy()
        for group, Z in zip(self.groups, dual.matrices, strict=True):
            missing -= np.einsum("bqij,bij->q", group.coefficients, Z)
        if self.ball is not None:
            missing -= self.ball.second.T @ dual.pull
        return float(np.linalg.norm(missing)) * sum(float(np.einsum("bii->", Z)) for Z in dual.matrices)

    @cached_property
    def _rough(self) -> RepeatedProblem:
        return RepeatedProblem(self._repeated.problem, self.solver, ROUGH)

    def pulled_inside(self, point: Vector) -> Vector:
        """The point or, where it is outside, the last one inside on the way to it from the center."""
        if not np.all(np.isfinite(point)):
            return np.zeros(self.unknowns)
        lowest = min([0.0, *(float(np.linalg.eigvalsh(group.change(point)).min()) for group in self.groups)])
        share = 1.0 if lowest > -1.0 else -1.0 / lowest
        if self.ball is not None:
            share = min(share, self.ball.share_inside(point))
        return (1.0 - 1e-9) * share * point

    def least(self, objective: Vector, rough: bool = False) -> NormalisedSolution:
        """Minimise objective · v for an objective of length 1; `rough` uses the lower accuracy."""
        found = (self._rough if rough else self._repeated).solve(objective)
        rows, dual = len(self.identity), found.dual
        value = -float(self._repeated.problem.b @ dual)
        point = DualPoint(self.split(dual[:rows]), dual[rows + 1 :], value)
        return NormalisedSolution(found.outcome, found.primal, point)
