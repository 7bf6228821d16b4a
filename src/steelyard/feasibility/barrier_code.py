"""Pivots of many small matrices, and the derivatives of logarithms of them and of lines, compiled for this processor.

Matrices of a robot have four rows, so that NumPy, which goes through all of them for each operation, spends nine tenths
of its time on calls.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from steelyard.graph.machine import address_of, host_machine

if TYPE_CHECKING:
    from steelyard.graph.loops import Array, Code, Index

__all__ = ["add_derivatives", "add_squares", "pivots"]

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

ROUNDING = 1e-14
"""A matrix with a smaller pivot, relative to the element of its diagonal, is not positive definite to rounding."""


def pivots(matrices: Matrix) -> Matrix:
    """Return the pivots of symmetric matrices (..., d, d), whose product is the determinant.

    Where a matrix is not positive definite, at least one of its pivots is -1.

    Examples
    --------
    >>> pivots(np.array([[[4.0, 2.0], [2.0, 3.0]], [[1.0, 2.0], [2.0, 1.0]]])).tolist()
    [[4.0, 2.0], [1.0, -1.0]]
    """
    size = matrices.shape[-1]
    found = np.empty(matrices.shape[:-1])
    _run("pivots", (matrices, found, np.empty(size * size)), found.size // size, size)
    return found


def add_derivatives(
    matrices: Matrix, coefficients: Matrix, indices: Indices, factors: Matrix, gradients: Matrix, hessians: Matrix
) -> None:
    """Add the derivatives of Σ log det of affine matrices, as `add_log_determinants` describes it."""
    points, blocks, size, _ = matrices.shape
    count = indices.shape[1]
    room, fails = np.empty((count + 2) * size * size), np.zeros(1, np.int64)
    arrays = (matrices, coefficients, indices, factors, gradients, hessians, room, fails)
    _run("derivatives", arrays, points, blocks, count, size, gradients.shape[1])
    if fails[0]:
        raise np.linalg.LinAlgError("a matrix whose determinant is to have a logarithm is not positive definite")


def add_squares(starts: Indices, columns: Indices, values: Matrix, factors: Matrix, hessians: Matrix) -> None:
    """Add (f r)(f r)ᵀ of sparse rows r, with factors f (p, b), to matrices (p, n, n)."""
    _run("squares", (starts, columns, values, factors, hessians), *factors.shape, hessians.shape[1])


def _run(name: str, arrays: tuple[npt.NDArray[Any], ...], *sizes: int) -> None:
    if not all(array.flags.c_contiguous and array.itemsize == 8 for array in arrays):
        raise ValueError("barriers are computed of C-contiguous arrays of doubles and of integers of 64 bits")
    getattr(_compiled(), name)(*map(address_of, arrays), *sizes)


class _Functions(NamedTuple):
    pivots: Callable[..., None]
    derivatives: Callable[..., None]
    squares: Callable[..., None]


@cache
def _compiled() -> _Functions:
    def write(code: Code) -> None:
        _pivots(code)
        _derivatives(code)
        _squares(code)

    loaded = host_machine(1).load_code(write, _Functions._fields)
    array, integer = ctypes.c_void_p, ctypes.c_int64
    return _Functions(
        loaded.function("pivots", *[array] * 3, *[integer] * 2),
        loaded.function("derivatives", *[array] * 8, *[integer] * 5),
        loaded.function("squares", *[array] * 5, *[integer] * 3),
    )


def _pivots(code: Code) -> None:
    with code.function("pivots", "matrices", "out", "rest", integers="count size") as given:
        matrices, out, rest, count, size = given
        for number in code.range(count):
            matrix, found = matrices.at(number * size * size), out.at(number * size)
            code.copy(rest, matrix, size * size)
            for k in code.range(size):
                pivot = rest[k * size + k]
                # What is not a number, or infinite, is no pivot, either: steps along which nothing bounds a problem.
                positive = (pivot > matrix[k * size + k] * ROUNDING) & (pivot > 0.0) & pivot.is_finite()
                found[k] = positive.choose(pivot, -1.0)
                _eliminate(code, rest, size, k, [])


def _eliminate(code: Code, rest: Array, size: Index, k: Index, others: list[Array]) -> None:
    """Take multiples of a row from those below it, and the same multiples in other matrices."""
    row, inverse = rest.at(k * size), 1.0 / rest[k * size + k]
    for i in code.range(size, k + 1):
        below = rest.at(i * size)
        part = below[k] * inverse
        for j in code.range(size, k + 1):
            below[j] = below[j] - part * row[j]
        for other in others:
            for j in code.range(k + 1):
                other[i * size + j] = other[i * size + j] - part * other[k * size + j]


def _derivatives(code: Code) -> None:
    """With W P Wᵀ = 1 the derivatives of log det P are traces of the matrices W A Wᵀ and of products of two of them."""
    names = "matrices coefficients indices factors gradients hessians room fails"
    with code.function("derivatives", *names.split(), integers="points blocks count size n") as given:
        matrices, coefficients, indices, factors, gradients, hessians, room, fails, *integers = given
        points, blocks, count, size, n = integers
        square = size * size
        rest, root, products = room, room.at(square), room.at(square * 2)
        for point in code.range(points):
            factor, gradient, hessian = factors[point], gradients.at(point * n), hessians.at(point * n * n)
            for block in code.range(blocks):
                code.copy(rest, matrices.at((point * blocks + block) * square), square)
                for place in code.range(square):
                    root[place] = 0.0
                for k in code.range(size):
                    root[k * size + k] = 1.0
                for k in code.range(size):
                    _eliminate(code, rest, size, k, [root])
                    with code.when(~(rest[k * size + k] > 0.0).any()):
                        fails.put_integer(0, 1)
                    scale = 1.0 / rest[k * size + k].root()
                    for j in code.range(k + 1):
                        root[k * size + j] = root[k * size + j] * scale
                for i in code.range(count):
                    number, own = block * count + i, products.at(i * square)
                    _congruent(code, size, root, coefficients.at(number * square), own)
                    at = indices.integer(number)
                    with code.fold([gradient[at]], size) as loop:
                        loop.next = [loop.values[0] + own[loop.index * size + loop.index] * factor]
                    gradient[at] = loop.values[0]
                    for j in code.range(i + 1):
                        other, column = products.at(j * square), indices.integer(block * count + j)
                        with code.fold([0.0], square) as loop:
                            loop.next = [loop.values[0] + own[loop.index] * other[loop.index]]
                        value = hessian[at * n + column] - loop.values[0] * factor
                        hessian[at * n + column] = value
                        hessian[column * n + at] = value


def _congruent(code: Code, size: Index, root: Array, given: Array, out: Array) -> None:
    """Write W A Wᵀ, of a matrix A that is mostly zeros and a triangular one W."""
    for place in code.range(size * size):
        out[place] = 0.0
    for r in code.range(size):
        for s in code.range(size):
            value = given[r * size + s]
            with code.when((value.size() > 0.0).any()):
                for i in code.range(size, r):
                    part = root[i * size + r] * value
                    for j in code.range(size, s):
                        out[i * size + j] = out[i * size + j] + part * root[j * size + s]


def _squares(code: Code) -> None:
    names, integers = ("starts", "columns", "values", "factors", "hessians"), "points rows n"
    with code.function("squares", *names, integers=integers) as given:
        starts, columns, values, factors, hessians, points, rows, n = given
        for point in code.range(points):
            hessian = hessians.at(point * n * n)
            for row in code.range(rows):
                first, last, factor = starts.integer(row), starts.integer(row + 1), factors[point * rows + row]
                for i in code.range(last, first):
                    line, part = hessian.at(columns.integer(i) * n), values[i] * factor
                    for j in code.range(last, first):
                        at = columns.integer(j)
                        line[at] = line[at] + part * (values[j] * factor)
