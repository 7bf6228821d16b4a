"""Recursive filters of all columns of a table at once, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .machine import address_of, batch_lanes, host_machine

__all__ = ["filter_columns"]

Array = NDArray[np.float64]


def filter_columns(sections: Array, states: Array, values: Array, backwards: bool = False) -> None:
    """Filter the columns of an array in place by second-order sections, one after the other.

    The columns stand side by side in the registers, where `scipy.signal.sosfilt` takes one after the other: of seven a
    tenth of its time. The outcome is the same up to rounding.

    Parameters
    ----------
    sections : ndarray
        (s, 6), as `scipy.signal.butter` returns them with ``output="sos"``.
    states : ndarray
        (s, 2, M), the initial states of each section, as `scipy.signal.sosfilt_zi` orders them.
    values : ndarray
        (S, M), in C order.
    backwards : bool
        From the last row to the first.

    Examples
    --------
    >>> values = np.array([[1.0, 8.0], [0.0, 0.0], [0.0, 0.0]])
    >>> filter_columns(np.array([[1.0, 0.0, 0.0, 1.0, -0.5, 0.0]]), np.zeros((1, 2, 2)), values)
    >>> values.T.tolist()
    [[1.0, 0.5, 0.25], [8.0, 4.0, 2.0]]
    """
    count, width = values.shape
    if not values.flags.carray or values.dtype != np.float64:
        raise ValueError("columns that are filtered must be a C-contiguous array of doubles")
    lanes, factors = batch_lanes(), np.column_stack([sections[:, :3], -sections[:, 4:]])
    first = address_of(values) + 8 * (count - 1) * width * backwards
    for column in range(0, width if count else 0, lanes):
        held = min(lanes, width - column)
        begin = np.zeros((len(sections), 2, lanes))
        begin[:, :, :held] = states[:, :, column : column + held]
        spread = np.repeat(factors[:, :, None], lanes, axis=2)
        step = -width if backwards else width
        _compiled(len(sections), held)(count, step, first + 8 * column, address_of(spread), address_of(begin))


@cache
def _compiled(sections: int, held: int) -> Callable[..., None]:
    machine = host_machine(batch_lanes())
    code = machine.load_source(_source(sections, batch_lanes(), held, machine.triple), ("filter",), {})
    return code.function("filter", ctypes.c_int64, ctypes.c_int64, *[ctypes.c_void_p] * 3)


def _source(sections: int, lanes: int, held: int, triple: str) -> str:
    """Return the function as LLVM assembly: the transposed direct form II, as that of SciPy.

    Of a register of so many lanes the first `held` have columns; the others are neither read nor written.
    """
    vector, mask, size = f"<{lanes} x double>", f"<{lanes} x i1>", 8 * lanes
    chosen = f"{mask} <{', '.join(f'i1 {int(lane < held)}' for lane in range(lanes))}>"
    fma = f"call {vector} @llvm.fmuladd.v{lanes}f64"
    lines = [
        f'target triple = "{triple}"',
        f"declare {vector} @llvm.fmuladd.v{lanes}f64({vector}, {vector}, {vector})",
        f"declare {vector} @llvm.masked.load.v{lanes}f64.p0(ptr, i32, {mask}, {vector})",
        f"declare void @llvm.masked.store.v{lanes}f64.p0({vector}, ptr, i32, {mask})",
        "define void @filter(i64 %count, i64 %step, ptr noalias %x, ptr noalias readonly %f, "
        "ptr noalias readonly %s) {",
        "entry:",
    ]
    for k in range(sections):
        for place, name in enumerate(("b", "c", "d", "e", "g")):
            lines += [
                f"  %p{name}{k} = getelementptr i8, ptr %f, i64 {(5 * k + place) * size}",
                f"  %{name}{k} = load {vector}, ptr %p{name}{k}, align 8",
            ]
        for place, name in enumerate(("u", "w")):
            lines += [
                f"  %p{name}{k} = getelementptr i8, ptr %s, i64 {(2 * k + place) * size}",
                f"  %{name}{k} = load {vector}, ptr %p{name}{k}, align 8",
            ]
    lines += ["  br label %row", "row:", "  %i = phi i64 [ 0, %entry ], [ %in, %row ]"]
    lines += ["  %a = phi ptr [ %x, %entry ], [ %an, %row ]"]
    for k in range(sections):
        lines += [f"  %{n}r{k} = phi {vector} [ %{n}{k}, %entry ], [ %{n}n{k}, %row ]" for n in ("u", "w")]
    lines.append(
        f"  %v0 = call {vector} @llvm.masked.load.v{lanes}f64.p0(ptr %a, i32 8, {chosen}, {vector} zeroinitializer)"
    )
    for k in range(sections):
        lines += [
            f"  %v{k + 1} = {fma}({vector} %b{k}, {vector} %v{k}, {vector} %ur{k})",
            f"  %t{k} = {fma}({vector} %c{k}, {vector} %v{k}, {vector} %wr{k})",
            f"  %un{k} = {fma}({vector} %e{k}, {vector} %v{k + 1}, {vector} %t{k})",
            f"  %m{k} = fmul {vector} %d{k}, %v{k}",
            f"  %wn{k} = {fma}({vector} %g{k}, {vector} %v{k + 1}, {vector} %m{k})",
        ]
    lines += [
        f"  call void @llvm.masked.store.v{lanes}f64.p0({vector} %v{sections}, ptr %a, i32 8, {chosen})",
        "  %an = getelementptr double, ptr %a, i64 %step",
        "  %in = add i64 %i, 1",
        "  %more = icmp slt i64 %in, %count",
        "  br i1 %more, label %row, label %done",
        "done:",
        "  ret void",
        "}",
    ]
    return "\n".join(lines)
