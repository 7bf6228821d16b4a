"""Copies of columns of chosen blocks of rows, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .kernel import address_of
from .machine import batch_lanes, host_machine

__all__ = ["copy_blocks"]

Array = NDArray[np.float64]


def copy_blocks(places: NDArray[np.intp], rows: Array, columns: slice, last: Array, column: int, copies: Array) -> None:
    """Copy neighbouring columns of chosen blocks of rows, and one column of other blocks behind them.

    NumPy takes four times as long for it, and stops the other threads meanwhile.

    Parameters
    ----------
    places : ndarray of int
        (n,), which blocks.
    rows, columns
        (blocks, r, c), in C order, and which of these columns; none of them may be left out.
    last, column
        (blocks, s, d), in C order, with s at least k, and which of these columns goes behind the others.
    copies : ndarray
        (n, k, w) in C order, of which the last columns receive the first k rows of each block; others stay as they are.

    Examples
    --------
    >>> rows, copies = np.arange(12.0).reshape(3, 2, 2), np.zeros((2, 2, 3))
    >>> copy_blocks(np.array([2, 0]), rows, slice(1, 2), -rows, 0, copies)
    >>> copies.tolist()
    [[[0.0, 9.0, -8.0], [0.0, 11.0, -10.0]], [[0.0, 1.0, -0.0], [0.0, 3.0, -2.0]]]
    """
    arrays, places = (rows, last, copies), np.ascontiguousarray(places, dtype=np.int64)
    if not all(one.flags.c_contiguous and one.dtype == np.float64 for one in arrays):
        raise ValueError("blocks that are copied must be C-contiguous arrays of doubles")
    width, (count, orders, whole) = int(columns.stop - columns.start), copies.shape
    most = min(len(rows), len(last))
    fits = width < whole and columns.stop <= rows.shape[2] and column < last.shape[2]
    if not fits or count != len(places) or orders > min(rows.shape[1], last.shape[1]):
        raise ValueError("blocks that are copied must have so many rows and columns")
    if count and not 0 <= int(places.min()) <= int(places.max()) < most:
        raise ValueError("blocks that are copied must be there")
    _compiled()(
        count,
        orders,
        width,
        whole - width - 1,
        rows.shape[1] * rows.shape[2],
        rows.shape[2],
        last.shape[1] * last.shape[2],
        last.shape[2],
        address_of(places),
        address_of(rows) + 8 * int(columns.start),
        address_of(last) + 8 * int(column),
        address_of(copies),
    )


@cache
def _compiled() -> Callable[..., None]:
    machine = host_machine(batch_lanes())
    code = machine.load_source(f'target triple = "{machine.triple}"\n{_SOURCE}', ("copy",), {})
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 8, *[ctypes.c_void_p] * 4)(code.addresses["copy"])

    def call(*arguments: int, _kept: object = code) -> None:
        function(*arguments)

    return call


# For each place and each row of its block: %pad columns are passed over, %width are copied, and one is put behind them.
_SOURCE = """
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
define void @copy(i64 %count, i64 %orders, i64 %width, i64 %pad, i64 %block, i64 %row, i64 %lastblock, i64 %lastrow,
                  ptr noalias readonly %places, ptr noalias readonly %rows, ptr noalias readonly %last,
                  ptr noalias %copies) {
entry:
  %bytes = shl i64 %width, 3
  %step = add i64 %width, 1
  br label %group
group:
  %i = phi i64 [ 0, %entry ], [ %in, %grouped ]
  %to = phi ptr [ %copies, %entry ], [ %tog, %grouped ]
  %more = icmp slt i64 %i, %count
  br i1 %more, label %begin, label %done
begin:
  %pp = getelementptr i64, ptr %places, i64 %i
  %g = load i64, ptr %pp
  %fo = mul i64 %g, %block
  %from0 = getelementptr double, ptr %rows, i64 %fo
  %lo = mul i64 %g, %lastblock
  %last0 = getelementptr double, ptr %last, i64 %lo
  br label %order
order:
  %m = phi i64 [ 0, %begin ], [ %mn, %copied ]
  %tom = phi ptr [ %to, %begin ], [ %ton, %copied ]
  %from = phi ptr [ %from0, %begin ], [ %fromn, %copied ]
  %lastm = phi ptr [ %last0, %begin ], [ %lastn, %copied ]
  %go = icmp slt i64 %m, %orders
  br i1 %go, label %copied, label %grouped
copied:
  %at = getelementptr double, ptr %tom, i64 %pad
  call void @llvm.memcpy.p0.p0.i64(ptr align 8 %at, ptr align 8 %from, i64 %bytes, i1 false)
  %end = getelementptr double, ptr %at, i64 %width
  %x = load double, ptr %lastm, align 8
  store double %x, ptr %end, align 8
  %ton = getelementptr double, ptr %at, i64 %step
  %fromn = getelementptr double, ptr %from, i64 %row
  %lastn = getelementptr double, ptr %lastm, i64 %lastrow
  %mn = add i64 %m, 1
  br label %order
grouped:
  %tog = phi ptr [ %tom, %order ]
  %in = add i64 %i, 1
  br label %group
done:
  ret void
}
"""
