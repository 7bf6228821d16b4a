"""Many affine symmetric matrices stacked as one sparse affine vector, the form that conic solvers use."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone

from .affine import AffineBlock, symmetric_to_vector, vector_to_symmetric

__all__ = ["AffineStack"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AffineStack:
    """Many blocks stacked as one sparse affine vector, 1 x 1 blocks first.

    Attributes
    ----------
    blocks : tuple of AffineBlock
    parameter_count : int

    Examples
    --------
    >>> block = AffineBlock("positive", np.zeros((1, 1)), np.array([1]), np.ones((1, 1, 1)))
    >>> stack = AffineStack((block,), 2)
    >>> (stack.constant + stack.coefficients @ np.array([5.0, 0.25])).tolist()
    [0.25]
    """

    blocks: tuple[AffineBlock, ...]
    parameter_count: int

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Indices of the blocks in the order in which they are stacked."""
        scalars = [i for i, block in enumerate(self.blocks) if block.size == 1]
        return (*scalars, *(i for i, block in enumerate(self.blocks) if block.size > 1))

    @cached_property
    def scalar_count(self) -> int:
        """Number of 1 x 1 blocks."""
        return sum(block.size == 1 for block in self.blocks)

    @cached_property
    def matrix_sizes(self) -> tuple[int, ...]:
        """Sizes of the larger blocks, in the order in which they are stacked."""
        return tuple(self.blocks[i].size for i in self.order[self.scalar_count :])

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """Cones in which the stacked vector lies if all blocks are positive semidefinite."""
        return (Cone("nonnegative", self.scalar_count), *(Cone("semidefinite", size) for size in self.matrix_sizes))

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Rows of each block (in the order of `blocks`) within the stacked vector."""
        found: dict[int, slice] = {}
        start = 0
        for i in self.order:
            stop = start + self.blocks[i].size * (self.blocks[i].size + 1) // 2
            found[i] = slice(start, stop)
            start = stop
        return tuple(found[i] for i in range(len(self.blocks)))

    def stacked(self, part: Callable[[AffineBlock], Matrix]) -> Vector:
        """Stack one symmetric matrix per block into a vector."""
        pieces = [symmetric_to_vector(part(self.blocks[i])) for i in self.order]
        return np.concatenate(pieces) if pieces else np.zeros(0)

    def matrices(self, vector: Vector) -> tuple[Matrix, ...]:
        """The symmetric matrix of each block (in the order of `blocks`) from a stacked vector."""
        return tuple(vector_to_symmetric(vector[rows]) for rows in self.slices)

    @cached_property
    def constant(self) -> Vector:
        """Stacked D₀."""
        return self.stacked(lambda block: block.constant)

    @cached_property
    def identity(self) -> Vector:
        """Stacked unit matrices."""
        return self.stacked(lambda block: np.eye(block.size))

    @cached_property
    def coefficients(self) -> sparse.csc_array:
        """Stacked Dᵢ, one column per parameter."""
        rows, columns, values = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
        for block, place in zip(self.blocks, self.slices, strict=True):
            if not len(block.indices):
                continue
            vectors = symmetric_to_vector(block.coefficients)
            which, row = np.nonzero(vectors)
            rows.append(row + place.start)
            columns.append(block.indices[which])
            values.append(vectors[which, row])
        shape = (len(self.constant), self.parameter_count)
        place_of_values = (np.concatenate(rows), np.concatenate(columns))
        return sparse.csc_array(sparse.coo_array((np.concatenate(values), place_of_values), shape=shape))

    def smallest_eigenvalues(self, parameters: Vector) -> Vector:
        """Smallest eigenvalue of every block, in the order of `blocks`."""
        return np.array([block.smallest_eigenvalue(parameters) for block in self.blocks])

    def all_positive(self, parameters: Vector) -> bool:
        """Whether all blocks are proved positive definite; 1 x 1 blocks may also be zero."""
        values = self.constant + self.coefficients @ parameters
        if not np.all(np.isfinite(values)) or np.any(values[: self.scalar_count] < 0):
            return False
        for size, rows in self._rows_by_size.items():
            matrices = vector_to_symmetric(values[rows])
            traces = np.maximum(np.trace(matrices, axis1=1, axis2=2), 0.0)
            shifts = 2 * (size + 2) * np.finfo(float).eps * traces + np.finfo(float).tiny
            try:
                np.linalg.cholesky(matrices - shifts[:, None, None] * np.eye(size))
            except np.linalg.LinAlgError:
                return False
        return True

    @cached_property
    def _rows_by_size(self) -> dict[int, npt.NDArray[np.intp]]:
        """Rows of the larger blocks within the stacked vector, (blocks, rows) for each size."""
        found: dict[int, list[npt.NDArray[np.intp]]] = {}
        for block, rows in zip(self.blocks, self.slices, strict=True):
            if block.size > 1:
                found.setdefault(block.size, []).append(np.arange(rows.start, rows.stop))
        return {size: np.array(rows) for size, rows in found.items()}
