"""A slice of the feasible set: the parameters that an estimate, or its confidence region, leaves possible.

δ = reference + M u + N d, with ‖u‖ ≤ 1 and any d. The columns of M span the confidence region of the base parameters
(there are none where the base parameters are given as a point), those of N are the directions that the motion does
not show.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineBlock
from steelyard.once import cached_property

from ..feasible_set import FeasibleSet

__all__ = ["BlockGroup", "Slice"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ROUNDING = 1e-12
"""Numbers below this part of the largest of their kind count as rounding errors."""


@dataclass(frozen=True, eq=False)
class BlockGroup:
    """All blocks of one size, as functions of the coordinates w.

    Attributes
    ----------
    size : int
        d.
    indices : (b,)
        Indices of these blocks in the feasible set.
    constants : (b, d, d)
    coefficients : (b, q, d, d)
    """

    size: int
    indices: npt.NDArray[np.intp]
    constants: Matrix = field(repr=False)
    coefficients: Matrix = field(repr=False)

    def evaluate(self, coordinates: Vector) -> Matrix:
        """All blocks at w, (b, d, d)."""
        return np.asarray(self.constants + np.einsum("q,bqij->bij", coordinates, self.coefficients))

    def change(self, step: Vector) -> Matrix:
        """Linear part at a step, (b, d, d)."""
        return np.asarray(np.einsum("q,bqij->bij", step, self.coefficients))


@dataclass(frozen=True, eq=False)
class Slice:
    """Parameters δ = reference + M u + N d that satisfy the equations of the set, ‖u‖ ≤ 1.

    Attributes
    ----------
    reference : (n,)
    region : (n, k)
        M; k is 0 where the base parameters are a point.
    unidentifiable : (n, p)
        N.
    """

    feasible_set: FeasibleSet
    reference: Vector = field(repr=False)
    region: Matrix = field(repr=False)
    unidentifiable: Matrix = field(repr=False)

    @classmethod
    def of(
        cls, feasible_set: FeasibleSet, base: Vector, spread: Matrix | None = None, unknown: Matrix | None = None
    ) -> "Slice":
        """The slice of β = base + spread u + unknown v, with ‖u‖ ≤ 1 and any v.

        Parameters
        ----------
        base : (n_b,)
        spread : (n_b, k), optional
            Half axes of the confidence region.
        unknown : (n_b, j), optional
            Directions of the base parameters that are not bounded at all.
        """
        reference = feasible_set.lift @ base
        region = feasible_set.lift @ (np.zeros((len(base), 0)) if spread is None else spread)
        unidentifiable = feasible_set.unidentifiable
        if unknown is not None:
            unidentifiable = np.hstack([unidentifiable, feasible_set.lift @ unknown])
        if feasible_set.equalities:
            reference, region, unidentifiable = _within_equations(feasible_set, reference, region, unidentifiable)
        return cls(feasible_set, reference, region, unidentifiable)

    @cached_property
    def directions(self) -> Matrix:
        """[M N], (n, k + p)."""
        return np.hstack([self.region, self.unidentifiable])

    @cached_property
    def _stacked(self) -> Matrix:
        """Coefficients of all blocks in (u, d)."""
        return np.asarray(self.feasible_set.stack.coefficients @ self.directions)

    @cached_property
    def unconstrained(self) -> Matrix:
        """Directions of d that change no block at all, (p, l), orthonormal: nothing bounds them."""
        stacked = self._stacked[:, self.region.shape[1] :]
        return null_space(stacked)

    @cached_property
    def bounded_basis(self) -> Matrix:
        """Orthonormal basis of the remaining directions of (u, d), (k + p, q), which defines the coordinates w."""
        k, p = self.region.shape[1], self.unidentifiable.shape[1]
        others = null_space(self.unconstrained.T)
        basis = np.zeros((k + p, k + others.shape[1]))
        basis[:k, :k] = np.eye(k)
        basis[k:, k:] = others
        return basis

    @cached_property
    def groups(self) -> tuple[BlockGroup, ...]:
        """The blocks that vary over the slice, grouped by size, as functions of w."""
        return grouped(self.feasible_set.blocks, self.directions @ self.bounded_basis, self.reference)

    def parameters(self, coordinates: Vector) -> Vector:
        """δ at w."""
        return np.asarray(self.reference + self.directions @ (self.bounded_basis @ coordinates))

    def coordinates(self, parameters: Vector) -> Vector:
        """W of parameters in the slice."""
        stacked = np.linalg.lstsq(self.directions, parameters - self.reference)[0]
        return np.asarray(self.bounded_basis.T @ stacked)

    def is_constrained(self, row: Vector) -> bool:
        """Return whether a combination c·δ is constant along all unconstrained directions."""
        along = (row @ self.unidentifiable) @ self.unconstrained
        size = float(np.abs(row).max(initial=0.0) * np.abs(self.unidentifiable).max(initial=0.0))
        return bool(np.all(np.abs(along) <= 1e-9 * size))

    def is_identifiable(self, row: Vector) -> bool:
        """Return whether a combination c·δ has the same value in the whole slice."""
        along = row @ self.directions
        size = np.abs(row) @ np.abs(self.directions)
        return bool(np.all(np.abs(along) <= ROUNDING * size))


def grouped(blocks: Sequence[AffineBlock], directions: Matrix, reference: Vector) -> tuple[BlockGroup, ...]:
    """The blocks that depend on w, grouped by size, as functions of w with δ = reference + directions w."""
    found: dict[int, list[tuple[int, Matrix, Matrix]]] = {}
    for index, block in enumerate(blocks):
        rows = directions[block.indices]
        coefficients = np.einsum("cq,cij->qij", rows, block.coefficients)
        largest = np.abs(rows).max(initial=0.0) * np.abs(block.coefficients).max(initial=0.0)
        if np.all(np.abs(coefficients) <= ROUNDING * largest):
            continue
        found.setdefault(block.size, []).append((index, block.evaluate(reference), coefficients))
    return tuple(
        BlockGroup(
            size,
            np.array([index for index, _, _ in items], dtype=np.intp),
            np.array([constant for _, constant, _ in items]),
            np.array([coefficients for _, _, coefficients in items]),
        )
        for size, items in sorted(found.items())
    )


def null_space(matrix: Matrix) -> Matrix:
    """Orthonormal basis of the null space of a matrix, (columns, l), after its columns are scaled to length 1."""
    count = matrix.shape[1]
    if not matrix.size:
        return np.eye(count)
    lengths = np.linalg.norm(matrix, axis=0)
    lengths[lengths <= ROUNDING * lengths.max(initial=0.0)] = 0.0
    scale = np.where(lengths > 0, lengths, 1.0)
    _, values, rows = np.linalg.svd(np.where(lengths > 0, matrix / scale, 0.0), full_matrices=True)
    rank = int(np.sum(values > 1e-10 * values.max(initial=0.0)))
    vectors = rows[rank:].T / scale[:, None]
    return np.asarray(np.linalg.qr(vectors)[0]) if vectors.shape[1] else np.zeros((count, 0))


def _within_equations(
    feasible_set: FeasibleSet, reference: Vector, region: Matrix, unidentifiable: Matrix
) -> tuple[Vector, Matrix, Matrix]:
    """The part of a slice in which the equations of the constraints hold."""
    left, values = feasible_set.equation_matrix, feasible_set.equation_values
    across = left @ unidentifiable
    inverse = np.linalg.pinv(across, rcond=1e-10)
    # Equations that unidentifiable parameters cannot satisfy restrict the region itself.
    rest = np.eye(len(values)) - across @ inverse
    wall, missing = rest @ (left @ region), rest @ (values - left @ reference)
    inside = null_space(wall)
    if inside.shape[1] < region.shape[1]:
        shift = np.linalg.pinv(wall, rcond=1e-10) @ missing
        reference = reference + region @ shift
        region = region @ inside * np.sqrt(max(0.0, 1.0 - float(shift @ shift)))
    reference = reference + unidentifiable @ (inverse @ (values - left @ reference))
    region = region - unidentifiable @ (inverse @ (left @ region))
    return reference, region, unidentifiable @ null_space(across)
