"""Products of rows that a triangle is divided out of, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.kernel import address_of
from steelyard.graph.loops import Code
from steelyard.graph.machine import batch_lanes, host_machine

__all__ = ["WIDEST", "add_products"]

Array = NDArray[np.float64]

WIDEST = 16
"""Columns that are divided at a time, at most."""

TILE = 32
"""Rows that are divided before they are multiplied, so that the nearest cache holds them."""


def add_products(square: Array, rows: Array, steps: list[tuple[int, int, Array]], spared: int = 0) -> None:
    """Divide rows by a triangle from the right, and add their products with each other to a matrix.

    Rows are read from memory once and nothing is written but the products, without the interpreter.

    Parameters
    ----------
    square : ndarray
        (c, c), whose upper triangle receives the products B'B.
    rows : ndarray
        (m, c), C-contiguous.
    steps : list of (int, int, ndarray)
        First column, the column behind the last one, of `WIDEST` at most, and the (last, columns) matrix by which the
        quotients of all columns before them, and the given numbers of these, are multiplied to get their quotients.
    spared : int
        The first of so many neighbouring rows is left out each time; 0 for none.

    Examples
    --------
    >>> square = np.zeros((2, 2))
    >>> add_products(square, np.array([[2.0, 4.0], [0.0, 6.0]]), [(0, 1, np.array([[0.5]])), (1, 2, np.eye(2)[:, 1:])])
    >>> square[0].tolist(), square[1, 1].tolist()
    ([1.0, 4.0], 52.0)
    """
    count, width = rows.shape
    if spared:
        count -= -(-count // spared)
    if not count:
        return
    pair = 2 * batch_lanes()
    wide = -(-width // pair) * pair
    padded = wide + WIDEST
    factors = np.zeros((sum(end for _, end, _ in steps), WIDEST))
    ends, first = np.empty((len(steps), 3), np.int64), 0
    for place, (start, end, factor) in enumerate(steps):
        factors[first : first + end, : end - start] = factor
        ends[place], first = (start, end, first * WIDEST), first + end
    room, sums = np.zeros((TILE + 8, padded)), np.zeros((wide, wide))
    arrays = (rows, sums, factors, ends, room)
    if not rows.flags.c_contiguous or rows.dtype != np.float64:
        raise ValueError("rows that are multiplied must be a C-contiguous array of doubles")
    group, skipped = (spared - 1, 1) if spared else (count, 0)
    _compiled()(*map(address_of, arrays), count, group, skipped, width, wide, padded, len(steps))
    square += sums[:width, :width]


@cache
def _compiled() -> Callable[..., None]:
    machine = host_machine(batch_lanes())
    code = machine.load_source(lambda: _source(batch_lanes(), machine.triple), ("products",), {})
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5, *[ctypes.c_int64] * 7)(code.addresses["products"])

    def call(*arguments: int, _kept: object = code) -> None:
        function(*arguments)

    return call


def _source(lanes: int, triple: str) -> str:
    """Return the function as LLVM assembly; eight registers hold the sums of its innermost loops."""
    code, registers = Code(lanes, triple), WIDEST // lanes
    together = 8 // registers
    names, integers = ("rows", "sums", "factors", "steps", "room"), "count group skipped width wide padded number"
    with code.function("products", *names, integers=integers) as given:
        rows, sums, factors, steps, room, count, group, skipped, width, wide, padded, number = given
        for first in code.range(count, step=TILE):
            size = (count - first).below(TILE)
            for row in code.range(size, step=together):
                places = [(first + row + k).below(count - 1) for k in range(together)]
                sources = [rows.shared_at((p + (p.bits("udiv", group) + 1) * skipped) * width) for p in places]
                made = [room.shared_at((row + k) * padded) for k in range(together)]
                for step in code.range(number):
                    start, end = steps.integer(step * 3), steps.integer(step * 3 + 1)
                    lines = factors.shared_at(steps.integer(step * 3 + 2))
                    values = [code.number(0.0)] * (together * registers)
                    for one, begin, stop in ((made, 0, start), (sources, start, end)):
                        with code.fold(values, stop, begin) as loop:
                            line = lines.shared_at(loop.index * WIDEST)
                            own = [line[k] for k in range(registers)]
                            loop.next = [
                                loop.values[k * registers + j] + source.shared(loop.index) * own[j]
                                for k, source in enumerate(one)
                                for j in range(registers)
                            ]
                        values = loop.values
                    for k, target in enumerate(made):
                        for j in range(registers):
                            # What goes beyond the step is written over by the next one, and zero behind the last one.
                            target.shared_at(start)[j] = values[k * registers + j]
            for left in code.range(wide, step=4):
                for right in code.range(wide, left.bits("and", -2 * lanes), step=2 * lanes):
                    targets = [sums.shared_at((left + k) * wide + right) for k in range(4)]
                    with code.fold([target[j] for target in targets for j in range(2)], size) as loop:
                        line = room.shared_at(loop.index * padded)
                        own = [line.shared_at(right)[j] for j in range(2)]
                        loop.next = [
                            loop.values[2 * k + j] + line.shared(left + k) * own[j] for k in range(4) for j in range(2)
                        ]
                    for k, target in enumerate(targets):
                        for j in range(2):
                            target[j] = loop.values[2 * k + j]
    return code.text
