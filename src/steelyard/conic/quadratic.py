"""Quadratic objectives as sums of squares."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

__all__ = ["Squares", "arrow", "square_root", "squares_of"]

Vector = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

NEGLIGIBLE = 1e-14
"""Eigenvalues below this part of the largest, in units in which the diagonal is 1, are zero but for rounding."""


@dataclass(frozen=True, eq=False)
class Squares:
    """½ xᵀP x as ½ ‖matrix w + constant‖², and a constant that does not matter.

    Attributes
    ----------
    matrix : (k, n_w) sparse
    constant : (k,)
    """

    matrix: sparse.csr_array = field(repr=False)
    constant: Vector = field(repr=False)


def square_root(P: sparse.csc_array) -> sparse.csr_array:
    """G with GᵀG = P, by parts that share no unknown; diagonal parts stay diagonal.

    Parameters
    ----------
    P : (n, n) sparse, symmetric, positive semidefinite

    Examples
    --------
    >>> P = sparse.csc_array(np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    >>> G = square_root(P)
    >>> G.shape, bool(abs(G.T @ G - P).max() < 1e-15)
    ((2, 3), True)
    """
    rows, columns, values = [np.zeros(0, dtype=np.intp)], [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    matrix = sparse.csr_array(P)
    matrix.eliminate_zeros()
    diagonal = matrix.diagonal()
    parts, label = connected_components(matrix, directed=False)
    order = np.argsort(label, kind="stable")
    count = 0
    for members in np.split(order, np.cumsum(np.bincount(label, minlength=parts))[:-1]):
        members = members[diagonal[members] > 0]
        if len(members) == 1:
            rows.append(np.array([count]))
            columns.append(members)
            values.append(np.sqrt(diagonal[members]))
            count += 1
        elif len(members):
            unit = np.sqrt(diagonal[members])
            part = matrix[members][:, members].toarray()
            eigenvalues, vectors = np.linalg.eigh(part / np.outer(unit, unit))
            kept = eigenvalues > NEGLIGIBLE * eigenvalues[-1]
            factor = (np.sqrt(eigenvalues[kept])[:, None] * vectors[:, kept].T) * unit
            row, column = np.nonzero(factor)
            rows.append(count + row)
            columns.append(members[column])
            values.append(factor[row, column])
            count += len(factor)
    places = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(sparse.coo_array((np.concatenate(values), places), shape=(count, P.shape[0])))


def squares_of(P: sparse.csc_array, offset: Vector, directions: sparse.csc_array) -> Squares | None:
    """The squares of ½ xᵀP x with x = offset + directions w; None where they do not depend on w."""
    if not P.count_nonzero():
        return None
    root = square_root(P)
    matrix, constant = sparse.csr_array(root @ directions), root @ offset
    matrix.eliminate_zeros()
    present = np.diff(matrix.indptr) > 0
    matrix, constant = sparse.csr_array(matrix[present]), constant[present]
    used = np.flatnonzero(np.diff(sparse.csc_array(matrix).indptr) > 0)
    if not len(used):
        return None
    if matrix.shape[0] > len(used):
        # Fewer squares of the same sum: orthogonal, so nothing is squared on the way.
        orthogonal, triangle = scipy.linalg.qr(matrix[:, used].toarray(), mode="economic")
        row, column = np.nonzero(triangle)
        places = (row, used[column])
        matrix = sparse.csr_array(
            sparse.coo_array((triangle[row, column], places), shape=(len(triangle), matrix.shape[1]))
        )
        constant = orthogonal.T @ constant
    return Squares(matrix, constant)


def arrow(diagonal: Indices, border: Indices) -> tuple[int, Indices, Indices, Indices, Vector]:
    """Elements of the matrix with these rows on the diagonal, and these in its first row beside it.

    Returns
    -------
    int, (elements,), (elements,), (elements,), (elements,)
        Order, row, column, source and factor.
    """
    order = len(diagonal)
    own = np.arange(order)
    row = np.concatenate([own, np.zeros(order - 1, dtype=np.intp)])
    return order, row, np.concatenate([own, own[1:]]), np.concatenate([diagonal, border]), np.ones(2 * order - 1)
