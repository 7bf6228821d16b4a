"""Projections of blocks of rows on a few vectors, and what they leave, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .kernel import address_of
from .machine import batch_lanes, host_machine

__all__ = ["project_blocks"]

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
    groups, length, width = rows.shape
    lanes = 2 * batch_lanes()
    if width < lanes:
        np.matmul(vectors, rows, out=projected)
        left[...] = np.einsum("gkc,gkc->gc", rows, rows) - np.einsum("gmc,gmc->gc", projected, projected)
        return
    arrays = (vectors, rows, projected, left)
    if not all(array.flags.c_contiguous and array.dtype == np.float64 for array in arrays):
        raise ValueError("blocks that are projected must be C-contiguous arrays of doubles")
    _compiled(len(vectors), length)(groups, width, *(address_of(array) for array in arrays))


@cache
def _compiled(orders: int, length: int) -> Callable[..., None]:
    machine = host_machine(batch_lanes())
    code = machine.load_source(_source(orders, length, 2 * batch_lanes(), machine.triple), ("project",), {})
    pointers = [ctypes.c_void_p] * 4
    function = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, *pointers)(code.addresses["project"])

    def call(*arguments: int, _kept: object = code) -> None:
        function(*arguments)

    return call


def _source(orders: int, length: int, lanes: int, triple: str) -> str:
    """Return the function as LLVM assembly: for each block and so many columns, all sums stay in registers."""
    vector = f"<{lanes} x double>"
    names = [f"p{m}" for m in range(orders)] + ["s"]
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
        f"  %sn = call {vector} @llvm.fmuladd.v{lanes}f64({vector} %x, {vector} %x, {vector} %s)",
    ]
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
    square = "%sn"
    for m in range(orders):
        lines += [
            f"  %oo{m} = add i64 %o0, {m}",
            f"  %om{m} = mul i64 %oo{m}, %width",
            f"  %oa{m} = add i64 %om{m}, %a",
            f"  %op{m} = getelementptr double, ptr %out, i64 %oa{m}",
            f"  store {vector} %p{m}n, ptr %op{m}, align 8",
            f"  %n{m} = fneg {vector} %p{m}n",
            f"  %q{m} = call {vector} @llvm.fmuladd.v{lanes}f64({vector} %p{m}n, {vector} %n{m}, {vector} {square})",
        ]
        square = f"%q{m}"
    lines += [
        "  %lo = mul i64 %g, %width",
        "  %la = add i64 %lo, %a",
        "  %lp = getelementptr double, ptr %left, i64 %la",
        f"  store {vector} {square}, ptr %lp, align 8",
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
