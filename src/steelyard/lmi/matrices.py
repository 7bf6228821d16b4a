"""Blocks from matrices of expressions, and back; values of named variables as vectors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError

from .affine import AffineBlock
from .linear_expression import LinearExpression, as_expression

__all__ = [
    "block_from_coefficients",
    "block_of_expressions",
    "expressions_of_block",
    "linear_map",
    "names_of_matrices",
    "read_matrix",
    "rearranged",
    "same_matrices",
    "values_as_vector",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
ExpressionMatrix = npt.NDArray[Any]

_ROUNDING = 1e-12
"""Elements on both sides of the diagonal may differ by this much, relative to their largest coefficient."""


def read_matrix(matrix: Any, names: Iterable[str] | None, label: str) -> ExpressionMatrix:
    """A square, symmetric matrix of expressions, (d, d).

    Parameters
    ----------
    matrix : nested sequence, array, SymPy matrix, or a single element
        Elements are numbers, texts, expressions or SymPy expressions.
    names : iterable of str, optional
        The names that exist.
    label : str
        What the messages call the matrix.

    Raises
    ------
    InputError
        If it is not square or not symmetric, or an element is not an affine expression.
    """
    if hasattr(matrix, "tolist"):
        matrix = matrix.tolist()
    if isinstance(matrix, str | Mapping) or not isinstance(matrix, Sequence):
        matrix = [[matrix]]
    rows = [row.tolist() if isinstance(row, np.ndarray) else row for row in matrix]
    size = len(rows)
    if size == 0:
        raise InputError(f"the matrix {label!r} has no rows; give at least one.")
    for number, row in enumerate(rows, start=1):
        if isinstance(row, str | Mapping) or not isinstance(row, Sequence):
            raise InputError(f"row {number} of the matrix {label!r} is {row!r}; give a list of {size} elements.")
        if len(row) != size:
            raise InputError(f"row {number} of the matrix {label!r} has {len(row)} elements; a square one has {size}.")
    known = None if names is None else tuple(names)
    read = np.empty((size, size), dtype=object)
    for i in range(size):
        for j in range(size):
            read[i, j] = as_expression(rows[i][j], known, f"element ({i + 1}, {j + 1}) of {label!r}:")
    for i in range(size):
        for j in range(i):
            if not _same(read[i, j], read[j, i]):
                raise InputError(
                    f"the matrix {label!r} is not symmetric: element ({i + 1}, {j + 1}) is {read[i, j]}, but "
                    f"({j + 1}, {i + 1}) is {read[j, i]}; make them equal."
                )
            read[i, j] = read[j, i]
    return read


def _same(one: LinearExpression, other: LinearExpression) -> bool:
    if one == other:
        return True
    difference = one - other
    values = [abs(value) for part in (one, other) for value in (*part.terms.values(), part.constant)]
    return all(abs(v) <= _ROUNDING * max(values) for v in (*difference.terms.values(), difference.constant))


def names_of_matrices(matrices: Iterable[ExpressionMatrix]) -> tuple[str, ...]:
    """The variables of all elements, in the order of their appearance."""
    return tuple(dict.fromkeys(name for matrix in matrices for element in matrix.flat for name in element.names))


def block_of_expressions(matrix: ExpressionMatrix, names: Sequence[str], label: str) -> AffineBlock:
    """The block of a constraint whose elements are the expressions, in the variables `names`.

    Parameters
    ----------
    matrix : (d, d) array of LinearExpression
        Symmetric; all its names are among `names`.
    label : str
        Of the block.
    """
    size = len(matrix)
    place = {name: index for index, name in enumerate(names)}
    used = sorted({place[name] for element in matrix.flat for name in element.names})
    column = {index: position for position, index in enumerate(used)}
    constant = np.zeros((size, size))
    coefficients = np.zeros((len(used), size, size))
    for i in range(size):
        for j in range(size):
            constant[i, j] = matrix[i, j].constant
            for name, value in matrix[i, j].terms.items():
                coefficients[column[place[name]], i, j] = value
    return AffineBlock(label, constant, np.array(used, dtype=np.intp), coefficients, "constraint")


def expressions_of_block(block: AffineBlock, names: Sequence[str]) -> ExpressionMatrix:
    """The elements of a block as expressions, (d, d)."""
    found = np.empty((block.size, block.size), dtype=object)
    for i in range(block.size):
        for j in range(block.size):
            terms = {names[k]: float(c) for k, c in zip(block.indices, block.coefficients[:, i, j], strict=True)}
            found[i, j] = LinearExpression(terms, float(block.constant[i, j]))
    return found


def block_from_coefficients(
    names: Sequence[str], constant: npt.ArrayLike | None, coefficients: Any, label: str
) -> AffineBlock:
    """The block D₀ + Σ Dᵢ xᵢ of a constraint.

    Parameters
    ----------
    constant : (d, d), optional
        D₀; zero where absent.
    coefficients : (c, d, d), or mapping from name to (d, d)
        Dᵢ, in the order of `names`; those not named in a mapping are zero.
    label : str
        Of the block.

    Raises
    ------
    InputError
        If shapes differ, a matrix is not symmetric or holds values that are not finite, or a name is unknown.
    """
    if isinstance(coefficients, Mapping):
        pairs = {str(name): _numeric(matrix, label, str(name)) for name, matrix in coefficients.items()}
    else:
        listed = list(coefficients)
        if len(listed) != len(names):
            raise InputError(
                f"{label!r} got {len(listed)} coefficient matrices for {len(names)} variables; give one for each."
            )
        pairs = {name: _numeric(matrix, label, name) for name, matrix in zip(names, listed, strict=True)}
    for name in pairs:
        if name not in names:
            raise InputError(f"{label!r} has a coefficient matrix of {name!r}, which is not among its variables.")
    if constant is None and not pairs:
        raise InputError(f"{label!r} has neither a constant nor coefficients; give at least one matrix.")
    shape = next(iter(pairs.values())).shape if constant is None else _numeric(constant, label, "constant").shape
    first = np.zeros(shape) if constant is None else _numeric(constant, label, "constant")
    for name, matrix in pairs.items():
        if matrix.shape != shape:
            raise InputError(
                f"{label!r} has matrices of several sizes: that of {name!r} is {matrix.shape[0]} x {matrix.shape[0]}, "
                f"others are {shape[0]} x {shape[0]}; make them equal."
            )
    order = [name for name in names if name in pairs and np.any(pairs[name] != 0.0)]
    indices = np.array([list(names).index(name) for name in order], dtype=np.intp)
    stacked = np.array([pairs[name] for name in order]).reshape(len(order), *shape)
    return AffineBlock(label, first, indices, stacked, "constraint")


def _numeric(matrix: npt.ArrayLike, label: str, name: str) -> Matrix:
    try:
        values = np.array(matrix, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"the matrix of {name!r} in {label!r} does not consist of numbers in equal rows.") from None
    if values.ndim == 0:
        values = values.reshape(1, 1)
    if values.ndim != 2 or values.shape[0] != values.shape[1] or not values.size:
        raise InputError(f"the matrix of {name!r} in {label!r} has the shape {values.shape}; give a square matrix.")
    if not np.all(np.isfinite(values)):
        raise InputError(f"the matrix of {name!r} in {label!r} has an element that is not finite.")
    if not np.array_equal(values, values.T):
        raise InputError(f"the matrix of {name!r} in {label!r} is not symmetric; give a symmetric matrix.")
    return values + 0.0


def rearranged(block: AffineBlock, names: Sequence[str], order: Sequence[str]) -> AffineBlock:
    """A block in the variables `names` as one in the variables `order`, in which its own must appear.

    Raises
    ------
    InputError
        If a variable of the block is left out.
    """
    place = {name: index for index, name in enumerate(order)}
    for index in block.indices:
        if names[index] not in place:
            raise InputError(f"the names leave out {names[index]!r}, which {block.name!r} depends on; name it too.")
    moved = np.array([place[names[index]] for index in block.indices], dtype=np.intp)
    sequence = np.argsort(moved)
    return replace(block, indices=moved[sequence], coefficients=block.coefficients[sequence])


def same_matrices(one: AffineBlock, other: AffineBlock) -> bool:
    """Return whether two blocks in the same variables are the same function; their names do not count."""
    if one.size != other.size or not np.array_equal(one.constant, other.constant):
        return False
    return all(map(np.array_equal, _nonzero(one), _nonzero(other)))


def _nonzero(block: AffineBlock) -> tuple[npt.NDArray[np.intp], Matrix]:
    used = [i for i in np.argsort(block.indices) if np.any(block.coefficients[i] != 0.0)]
    return block.indices[used], block.coefficients[used]


def values_as_vector(values: Mapping[str, Any] | npt.ArrayLike, names: Sequence[str]) -> Vector:
    """Numbers for the variables, in their order.

    Parameters
    ----------
    values : mapping from name to float, or (c,)
        A mapping may hold more names.
    names : sequence of c str

    Raises
    ------
    InputError
        If a value is missing or not a finite number, or a vector has another length.

    Examples
    --------
    >>> values_as_vector({"x": 1, "y": 2}, ["y", "x"]).tolist()
    [2.0, 1.0]
    """
    if isinstance(values, Mapping):
        for name in names:
            if name not in values:
                raise InputError(f"no value was given for the variable {name!r}; give one for each.")
        values = [values[name] for name in names]
    try:
        vector = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"the values of variables must be numbers, got {values!r}.") from None
    if vector.shape != (len(names),):
        raise InputError(f"there must be a value for each of {len(names)} variables, got the shape {vector.shape}.")
    bad = np.flatnonzero(~np.isfinite(vector))
    if len(bad):
        raise InputError(f"the value of {names[bad[0]]!r} must be finite, got {vector[bad[0]]}.")
    return vector


def linear_map(names: Sequence[str], values: Mapping[str, Any]) -> tuple[tuple[str, ...], Matrix, Vector]:
    """Return what substituting expressions for variables does: x = matrix y + offset.

    Parameters
    ----------
    names : sequence of c str
        The variables x.
    values : mapping from name to number, text, LinearExpression or SymPy expression
        Those not named stay.

    Returns
    -------
    tuple of k str
        The variables y, in the order in which they appear.
    (c, k)
        The matrix.
    (c,)
        The offset.

    Examples
    --------
    >>> linear_map(["a", "b"], {"a": "u - 2*b + 1"})[1].tolist()
    [[1.0, -2.0], [0.0, 1.0]]
    """
    given = {name: as_expression(value, where=f"the value of {name!r}:") for name, value in values.items()}
    rows = [given.get(name, LinearExpression({name: 1.0})) for name in names]
    found = tuple(dict.fromkeys(name for row in rows for name in row.names))
    place = {name: index for index, name in enumerate(found)}
    matrix = np.zeros((len(rows), len(found)))
    for line, row in zip(matrix, rows, strict=True):
        for name, value in row.terms.items():
            line[place[name]] = value
    return found, matrix, np.array([row.constant for row in rows])
