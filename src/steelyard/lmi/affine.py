"""Affine symmetric matrices, the blocks that linear matrix inequalities are made of, and stacks of them for solvers."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, stacked_triangle
from steelyard.errors import InputError
from steelyard.once import cached_property

__all__ = ["AffineBlock", "AffineStack", "is_positive_definite", "symmetric_to_vector", "vector_to_symmetric"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


def symmetric_to_vector(matrix: Matrix) -> Vector:
    """Stack the upper triangle of symmetric matrices by columns, off-diagonal elements times √2.

    The scaling makes the dot product of two vectors the trace inner product of the two matrices.

    Parameters
    ----------
    matrix : (..., d, d)
        Symmetric matrices.

    Returns
    -------
    (..., d (d + 1) / 2)

    Examples
    --------
    >>> symmetric_to_vector(np.array([[1.0, 2.0], [2.0, 3.0]])).round(4).tolist()
    [1.0, 2.8284, 3.0]
    """
    row, column, scale = stacked_triangle(matrix.shape[-1])
    return np.asarray(matrix[..., row, column] * scale, dtype=float)


def vector_to_symmetric(vector: Vector) -> Matrix:
    """Undo `symmetric_to_vector`.

    Examples
    --------
    >>> vector_to_symmetric(np.array([1.0, 2 * 2**0.5, 3.0])).round(12).tolist()
    [[1.0, 2.0], [2.0, 3.0]]
    """
    count = vector.shape[-1]
    size = round((np.sqrt(8 * count + 1) - 1) / 2)
    row, column, scale = stacked_triangle(size)
    matrix = np.zeros((*vector.shape[:-1], size, size))
    matrix[..., row, column] = vector / scale
    matrix[..., column, row] = vector / scale
    return matrix


def is_positive_definite(matrix: Matrix) -> bool:
    """Return whether a symmetric matrix is positive definite, proved by a Cholesky factorisation in floating point.

    A bound of the rounding errors of the factorisation is subtracted from the matrix first, so that success is a proof
    for the matrix as stored (S. M. Rump, Verification of positive definiteness, BIT 46, 2006).

    Parameters
    ----------
    matrix : (d, d)

    Examples
    --------
    >>> is_positive_definite(np.eye(3)), is_positive_definite(np.ones((2, 2)))
    (True, False)
    """
    if not np.all(np.isfinite(matrix)):
        return False
    size = matrix.shape[0]
    shift = 2 * (size + 2) * np.finfo(float).eps * max(float(np.trace(matrix)), 0.0) + np.finfo(float).tiny
    try:
        np.linalg.cholesky(matrix - shift * np.eye(size))
    except np.linalg.LinAlgError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class AffineBlock:
    """A symmetric matrix that is affine in a parameter vector, D(δ) = D₀ + Σ Dᵢ δᵢ (thesis 3.22).

    Attributes
    ----------
    name : str
        The condition in words, such as ``"link 4 (forearm): inertia"``.
    constant : (d, d)
        D₀.
    indices : (c,)
        Indices of the parameters on which the block depends.
    coefficients : (c, d, d)
        Dᵢ of those parameters.
    kind : str
        ``"link"``, ``"term"`` or ``"constraint"``.
    unit : str
        Unit of the value of a 1 x 1 block; empty if the elements have different units.
    link, joint : str or None
        The link to whose body, or the joint to whose term, the condition belongs.

    Examples
    --------
    >>> block = AffineBlock("example", np.zeros((1, 1)), np.array([1]), np.ones((1, 1, 1)))
    >>> block.evaluate(np.array([5.0, 0.25])).tolist(), block.smallest_eigenvalue(np.array([5.0, 0.25]))
    ([[0.25]], 0.25)
    >>> block
    AffineBlock('example', 1 x 1, of 1 parameter)
    """

    name: str
    constant: Matrix
    indices: npt.NDArray[np.intp]
    coefficients: Matrix
    kind: str = "link"
    unit: str = ""
    link: str | None = None
    joint: str | None = None

    def __post_init__(self) -> None:
        size, count = self.size, len(self.indices)
        if self.constant.shape != (size, size) or self.coefficients.shape != (count, size, size):
            raise InputError(
                f"block {self.name!r} has a constant of shape {self.constant.shape} and coefficients of shape "
                f"{self.coefficients.shape} for {count} parameters; expected (d, d) and ({count}, d, d)."
            )
        if size == 1:
            return
        both = np.concatenate([self.constant[None], self.coefficients])
        if not np.array_equal(both, both.transpose(0, 2, 1)):
            raise InputError(f"block {self.name!r} is not symmetric; give D₀ and every Dᵢ as symmetric matrices.")

    def __repr__(self) -> str:
        plural = "" if len(self.indices) == 1 else "s"
        return f"AffineBlock({self.name!r}, {self.size} x {self.size}, of {len(self.indices)} parameter{plural})"

    @property
    def size(self) -> int:
        """Number of rows d."""
        return len(self.constant)

    def evaluate(self, parameters: Vector) -> Matrix:
        """D(δ), of shape (d, d)."""
        products = parameters[self.indices] @ self._rows
        return np.asarray(self.constant + products.reshape(self.constant.shape))

    @property
    def _rows(self) -> Matrix:
        """The coefficients as rows, (c, d²); NumPy's `tensordot` takes five times as long for so few."""
        return self.coefficients.reshape(len(self.indices), self.size**2)

    def smallest_eigenvalue(self, parameters: Vector) -> float:
        """Smallest eigenvalue of D(δ)."""
        return float(np.linalg.eigvalsh(self.evaluate(parameters))[0])

    def substitute(self, matrix: Matrix, offset: Vector | None = None) -> "AffineBlock":
        """Return the same block in variables x, where δ = matrix x + offset.

        With matrix = [P_b, P_d - P_b K_d] the variables are (β, δ_d): the base-dependent space (thesis 3.13, 3.32).

        Parameters
        ----------
        matrix : (n, m)
        offset : (n,), optional
            Zero by default.

        Examples
        --------
        >>> block = AffineBlock("total", np.zeros((1, 1)), np.array([0, 1]), np.ones((2, 1, 1)))
        >>> block.substitute(np.array([[1.0, -1.0], [0.0, 1.0]])).indices.tolist()
        [0]
        """
        rows = matrix[self.indices]
        constant = self.constant if offset is None else self.evaluate(offset)
        used = np.flatnonzero(np.any(rows != 0, axis=0))
        coefficients = (rows[:, used].T @ self._rows).reshape(len(used), *self.constant.shape)
        kept = np.any(coefficients != 0, axis=(1, 2))
        return replace(self, constant=constant, indices=used[kept], coefficients=coefficients[kept])


@dataclass(frozen=True, eq=False)
class AffineStack:
    """Many blocks stacked as one sparse affine vector, the form that conic solvers use; 1 x 1 blocks come first.

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
        scalars, larger = self.order[: self.scalar_count], self.order[self.scalar_count :]
        single = np.array([part(self.blocks[i])[0, 0] for i in scalars], dtype=float)
        return np.concatenate([single, *(symmetric_to_vector(part(self.blocks[i])) for i in larger)])

    def matrices(self, vector: Vector) -> tuple[Matrix, ...]:
        """The symmetric matrix of each block (in the order of `blocks`) from a stacked vector."""
        return tuple(
            vector[rows, None] if block.size == 1 else vector_to_symmetric(vector[rows])
            for block, rows in zip(self.blocks, self.slices, strict=True)
        )

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
        scalars = [self.blocks[i] for i in self.order[: self.scalar_count]]
        rows = [np.repeat(np.arange(len(scalars)), [len(block.indices) for block in scalars])]
        columns = [np.concatenate([np.zeros(0, dtype=np.intp), *(block.indices for block in scalars)])]
        values = [np.concatenate([np.zeros(0), *(block.coefficients[:, 0, 0] for block in scalars)])]
        rows, columns, values = ([one[0][values[0] != 0.0]] for one in (rows, columns, values))
        for block, place in zip(self.blocks, self.slices, strict=True):
            if block.size == 1 or not len(block.indices):
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
        """Smallest eigenvalue of every block, in the order of `blocks`; blocks of one size are taken together."""
        values = self.constant + self.coefficients @ parameters
        sizes = np.array([block.size for block in self.blocks])
        found = np.empty(len(sizes))
        found[sizes == 1] = values[: self.scalar_count]
        for size, rows in self.rows_by_size.items():
            found[sizes == size] = np.linalg.eigvalsh(vector_to_symmetric(values[rows]))[:, 0]
        return found

    def all_positive(self, parameters: Vector) -> bool:
        """Return whether all blocks are proved positive definite; 1 x 1 blocks may also be zero."""
        values = self.constant + self.coefficients @ parameters
        if not np.all(np.isfinite(values)) or np.any(values[: self.scalar_count] < 0):
            return False
        for size, rows in self.rows_by_size.items():
            matrices = vector_to_symmetric(values[rows])
            traces = np.maximum(np.trace(matrices, axis1=1, axis2=2), 0.0)
            shifts = 2 * (size + 2) * np.finfo(float).eps * traces + np.finfo(float).tiny
            try:
                np.linalg.cholesky(matrices - shifts[:, None, None] * np.eye(size))
            except np.linalg.LinAlgError:
                return False
        return True

    @cached_property
    def rows_by_size(self) -> dict[int, npt.NDArray[np.intp]]:
        """Rows of the larger blocks within the stacked vector, (blocks, rows) for each size."""
        found: dict[int, list[npt.NDArray[np.intp]]] = {}
        for block, rows in zip(self.blocks, self.slices, strict=True):
            if block.size > 1:
                found.setdefault(block.size, []).append(np.arange(rows.start, rows.stop))
        return {size: np.array(rows) for size, rows in found.items()}
