"""Projections of blocks of rows on a few vectors, and what they leave, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .kernel import address_of
from .machine import batch_lanes, host_machine

__all__ = ["project_blocks", "transform_blocks"]

Array = NDArray[np.float64]


def project_blocks(vectors: Array, rows: Array, projected: Array, left: Array) -> None:
    """Project the columns of blocks of rows on orthonormal vectors.

    Each number of the rows is read from memory once; products with NumPy and a sum of squares take four times as long.

    Parameters
    ----------
    vectors : ndarray
        (m, k).
    rows : ndarray
        (groups, k, c), in C order as all of these.
    projected : ndarray
        (groups, m, c), where the products of the vectors with each block go.
    left : ndarray
        (groups, c), where the squares of each column go, less those of its projections.

    Examples
    --------
    >>> projected, left = np.empty((1, 1, 2)), np.empty((1, 2))
    >>> project_blocks(np.array([[0.0, 1.0]]), np.array([[[3.0, 8.0], [4.0, -6.0]]]), projected, left)
    >>> projected, left
    (array([[[ 4., -6.]]]), array([[ 9., 64.]]))
    """
    if rows.shape[2] < 2 * batch_lanes():
        np.matmul(vectors, rows, out=projected)
        left[...] = np.einsum("gkc,gkc->gc", rows, rows) - np.einsum("gmc,gmc->gc", projected, projected)
        return
    _call(None, vectors, rows, projected, left)


def transform_blocks(matrix: Array, rows: Array, products: Array, squares: Array, first: tuple[int, ...]) -> None:
    """Multiply blocks of rows by a matrix, and add the squares of the last products of each column.

    Parameters
    ----------
    matrix : ndarray
        (m, k).
    rows : ndarray
        (groups, k, c), in C order as all of these.
    products : ndarray
        (groups, m, c), where the products of the matrix with each block go.
    squares : ndarray
        (groups, len(first), c), where the sums of the squares of products from each of `first` to the last go.
    first : tuple of int
        In ascending order.

    Examples
    --------
    >>> products, squares = np.empty((1, 2, 2)), np.empty((1, 2, 2))
    >>> transform_blocks(np.array([[0.0, 1.0], [2.0, 0.0]]), np.ones((1, 2, 2)), products, squares, (0, 1))
    >>> products[0].tolist(), squares[0].tolist()
    ([[1.0, 1.0], [2.0, 2.0]], [[5.0, 5.0], [4.0, 4.0]])
    """
    if rows.shape[2] < 2 * batch_lanes():
        np.matmul(matrix, rows, out=products)
        for place, begin in enumerate(first):
            squares[:, place] = np.einsum("gmc,gmc->gc", products[:, begin:], products[:, begin:])
        return
    _call(first, matrix, rows, products, squares)


def _call(first: tuple[int, ...] | None, *arrays: Array) -> None:
    if not all(array.flags.c_contiguous and array.dtype == np.float64 for array in arrays):
        raise ValueError("blocks that are projected must be C-contiguous arrays of doubles")
    orders, (groups, length, width) = len(arrays[0]), arrays[1].shape
    _compiled(orders, length, first)(groups, width, *(address_of(array) for array in arrays))


@cache
def _compiled(orders: int, length: int, first: tuple[int, ...] | None) -> Callable[..., None]:
    machine = host_machine(batch_lanes())
    code = machine.load_source(_source(orders, length, first, 2 * batch_lanes(), machine.triple), ("project",), {})
    pointers = [ctypes.c_void_p] * 4
    function = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, *pointers)(code.addresses["project"])

    def call(*arguments: int, _kept: object = code) -> None:
        function(*arguments)

    return call


def _source(orders: int, length: int, first: tuple[int, ...] | None, lanes: int, triple: str) -> str:
    """Return the function as LLVM assembly: for each block and so many columns, all sums stay in registers.

    Its last argument receives the squares of the products from each of `first` on, or without it what the products
    leave of the squares of the columns.
    """
    vector = f"<{lanes} x double>"
    names = [f"p{m}" for m in range(orders)] + ["s"] * (first is None)
    lines = [
        f'target triple = "{triple}"',
        f"declare {vector} @llvm.fmuladd.v{lanes}f64({vector}, {vector}, {vector})",
        "define void @project(i64 %groups, i64 %width, ptr noalias readonly %v, ptr noalias readonly %rows, "
        "ptr noalias %out, ptr noalias %left) {",
        "entry:",
        f"  %last = sub i64 %width, {lanes}",
        "  br label %group",
        "group:",
        "  %g = phi i64 [ 0, %entry ], [ %gn, %grouped ]",
        "  %more = icmp slt i64 %g, %groups",
        "  br i1 %more, label %columns, label %done",
        "columns:",
        "  %c = phi i64 [ 0, %group ], [ %cn, %written ]",
        # The last columns are those up to the end, of which some were computed before.
        "  %over = icmp sgt i64 %c, %last",
        "  %a = select i1 %over, i64 %last, i64 %c",
        f"  %r0 = mul i64 %g, {length}",
        "  br label %row",
        "row:",
        "  %k = phi i64 [ 0, %columns ], [ %kn, %row ]",
        *(f"  %{n} = phi {vector} [ zeroinitializer, %columns ], [ %{n}n, %row ]" for n in names),
        "  %r = add i64 %r0, %k",
        "  %ro = mul i64 %r, %width",
        "  %ra = add i64 %ro, %a",
        "  %rp = getelementptr double, ptr %rows, i64 %ra",
        f"  %x = load {vector}, ptr %rp, align 8",
    ]
    if first is None:
        lines.append(f"  %sn = call {vector} @llvm.fmuladd.v{lanes}f64({vector} %x, {vector} %x, {vector} %s)")
    for m in range(orders):
        lines += [
            f"  %vo{m} = add i64 %k, {m * length}",
            f"  %vp{m} = getelementptr double, ptr %v, i64 %vo{m}",
            f"  %w{m} = load double, ptr %vp{m}, align 8",
            f"  %wi{m} = insertelement {vector} poison, double %w{m}, i32 0",
            f"  %wv{m} = shufflevector {vector} %wi{m}, {vector} poison, <{lanes} x i32> zeroinitializer",
            f"  %p{m}n = call {vector} @llvm.fmuladd.v{lanes}f64({vector} %wv{m}, {vector} %x, {vector} %p{m})",
        ]
    lines += [
        "  %kn = add i64 %k, 1",
        f"  %end = icmp eq i64 %kn, {length}",
        "  br i1 %end, label %written, label %row",
        "written:",
        f"  %o0 = mul i64 %g, {orders}",
    ]
    for m in range(orders):
        lines += [
            f"  %oo{m} = add i64 %o0, {m}",
            f"  %om{m} = mul i64 %oo{m}, %width",
            f"  %oa{m} = add i64 %om{m}, %a",
            f"  %op{m} = getelementptr double, ptr %out, i64 %oa{m}",
            f"  store {vector} %p{m}n, ptr %op{m}, align 8",
        ]
    square = "%sn" if first is None else "zeroinitializer"
    for m in range(orders) if first is None else reversed(range(first[0], orders)):
        other = f"%p{m}n"
        if first is None:
            lines.append(f"  %n{m} = fneg {vector} {other}")
            other = f"%n{m}"
        lines.append(
            f"  %q{m} = call {vector} @llvm.fmuladd.v{lanes}f64({vector} %p{m}n, {vector} {other}, {vector} {square})"
        )
        square = f"%q{m}"
    results = [square] if first is None else [f"%q{m}" for m in first]
    lines.append(f"  %l0 = mul i64 %g, {len(results)}")
    for place, result in enumerate(results):
        lines += [
            f"  %lr{place} = add i64 %l0, {place}",
            f"  %lo{place} = mul i64 %lr{place}, %width",
            f"  %la{place} = add i64 %lo{place}, %a",
            f"  %lp{place} = getelementptr double, ptr %left, i64 %la{place}",
            f"  store {vector} {result}, ptr %lp{place}, align 8",
        ]
    lines += [
        f"  %cn = add i64 %c, {lanes}",
        "  %again = icmp slt i64 %cn, %width",
        "  br i1 %again, label %columns, label %grouped",
        "grouped:",
        "  %gn = add i64 %g, 1",
        "  br label %group",
        "done:",
        "  ret void",
        "}",
    ]
    return "\n".join(lines)
