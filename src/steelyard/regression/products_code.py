"""Products of rows that a triangle is divided out of, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.machine import address_of, batch_lanes, host_machine

if TYPE_CHECKING:
    from steelyard.graph.loops import Code

__all__ = ["WIDEST", "Division"]

Array = NDArray[np.float64]

WIDEST = 16
"""Columns that are divided at a time, at most."""

TILE = 32
"""Rows that are divided before they are multiplied, so that the nearest cache holds them."""


class Division:
    """A division of rows by a triangle from the right, in steps of neighbouring columns.

    Each step multiplies the quotients of all columns before it, and its own columns, by a matrix. That is faster than
    substitution column by column, and as exact as long as each block on the diagonal is well conditioned, which narrow
    ones always are.

    Parameters
    ----------
    triangle : ndarray
        (c, c), upper triangular.
    sizes : ndarray
        (c,), of its columns.
    widest : int
        Columns of a step, `WIDEST` at most.
    growth : float
        Of rounding errors by the inverse of a block, in columns of their sizes, that is accepted; blocks that have more
        are narrower.

    Attributes
    ----------
    is_finite : bool
        Whether all numbers are in range.

    Examples
    --------
    >>> square, triangle = np.zeros((2, 2)), np.array([[2.0, 1.0], [0.0, 1.0]])
    >>> division = Division(triangle, np.ones(2), 1, 128.0)
    >>> division.add_products(square, np.array([[2.0, 4.0], [0.0, 6.0]]))
    >>> square[0].tolist(), square[1, 1].tolist()
    ([1.0, 3.0], 45.0)
    """

    def __init__(self, triangle: Array, sizes: Array, widest: int, growth: float) -> None:
        self.width = width = len(triangle)
        # A step has a column at least, so that these suffice for all of them.
        self._factors, self._steps = np.empty((width * (width + 1) // 2, WIDEST)), np.empty((width, 3), np.int64)
        room, state = np.zeros((2 * WIDEST + 1, WIDEST)), np.zeros(4, np.int64)
        numbers = np.append(np.float64(growth), sizes)
        arrays = (np.ascontiguousarray(triangle), numbers, self._factors, self._steps, room, state)
        _compiled().divide(*map(address_of, arrays), width, widest)
        self.is_finite, self._count = int(state[DONE]) == width, int(state[STEPS])

    def add_products(self, square: Array, rows: Array, spared: int = 0) -> None:
        """Divide rows, and add their products with each other to a matrix.

        Rows are read from memory once and nothing is written but the products, without the interpreter.

        Parameters
        ----------
        square : ndarray
            (c, c), whose upper triangle receives the products B'B.
        rows : ndarray
            (m, c), C-contiguous.
        spared : int
            The first of so many neighbouring rows is left out each time; 0 for none.
        """
        count, width = rows.shape
        if not rows.flags.c_contiguous or rows.dtype != np.float64 or width != self.width:
            raise ValueError(
                f"rows that are multiplied must be a C-contiguous array of {self.width} columns of doubles"
            )
        group, skipped = (spared - 1, 1) if spared else (max(count, 1), 0)
        count -= -(-count // spared) if spared else 0
        if count:
            pair = 2 * batch_lanes()
            wide = -(-width // pair) * pair
            room, sums = np.zeros((TILE + 8, wide + WIDEST)), np.zeros((wide, wide))
            arrays = (rows, sums, self._factors, self._steps, room)
            sizes = (count, group, skipped, width, wide, room.shape[1], self._count)
            _compiled().products(*map(address_of, arrays), *sizes)
            square += sums[:width, :width]


class _Functions(NamedTuple):
    divide: Callable[..., None]
    products: Callable[..., None]


@cache
def _compiled() -> _Functions:
    def write(code: Code) -> None:
        _divide(code)
        _products(code)

    loaded = host_machine(batch_lanes()).load_code(write, _Functions._fields)
    array, integer = ctypes.c_void_p, ctypes.c_int64
    return _Functions(
        loaded.function("divide", *[array] * 6, *[integer] * 2),
        loaded.function("products", *[array] * 5, *[integer] * 7),
    )


DONE, STEPS, ROWS, FIRST = range(4)
"""The state of a division: columns, steps and rows of factors so far, and the first column of large growth."""


def _divide(code: Code) -> None:
    """Invert blocks on the diagonal, and multiply what stands above them by that."""
    registers = range(WIDEST // code.lanes)
    names, integers = ("triangle", "numbers", "factors", "steps", "room", "state"), "width widest"
    with code.function("divide", *names, integers=integers) as given:
        triangle, numbers, factors, steps, room, state, width, widest = given
        sizes, inverses = numbers.shared_at(1), room.shared_at(WIDEST * WIDEST)
        growth = room.shared_at(2 * WIDEST * WIDEST)
        for number in code.range(width):
            start = state.integer(DONE)
            code.leave_when(start.holds("eq", width))
            size = (width - start).below(widest)
            for i in code.range(size):
                for j in code.range(size):
                    value = triangle.shared((start + i) * width + start + j) / sizes.shared(start + j)
                    room.put(i * WIDEST + j, value)
                for k in registers:
                    inverses.shared_at(i * WIDEST)[k] = 0.0
                inverses.put(i * WIDEST + i, 1.0)
            for k in registers:
                growth[k] = 0.0
            for back in code.range(size):
                i = size - 1 - back
                row = inverses.shared_at(i * WIDEST)
                with code.fold([row[k] for k in registers], size, i + 1) as loop:
                    factor, other = room.shared(i * WIDEST + loop.index), inverses.shared_at(loop.index * WIDEST)
                    loop.next = [value - factor * other[k] for k, value in enumerate(loop.values)]
                diagonal = room.shared(i * WIDEST + i)
                for k in registers:
                    row[k] = loop.values[k] / diagonal
                with code.fold([growth[k] for k in registers], size, i) as loop:
                    factor, other = row.shared(loop.index).size(), room.shared_at(loop.index * WIDEST)
                    loop.next = [value + factor * other[k].size() for k, value in enumerate(loop.values)]
                for k in registers:
                    growth[k] = loop.values[k]
            state.put_integer(FIRST, size)
            for j in code.range(size):
                large = ~(growth.shared(j) < numbers.shared(0)).any()
                with code.when(large & state.integer(FIRST).holds("eq", size)):
                    state.put_integer(FIRST, j)
            with code.when(state.integer(FIRST).holds("eq", 0)):
                state.put_integer(FIRST, 1)
            size = state.integer(FIRST)
            # The inverse of a leading block of a triangle is the leading block of the inverse.
            target = factors.shared_at(state.integer(ROWS) * WIDEST)
            for k in registers:
                growth[k] = 0.0
            for i in code.range(size):
                growth.put(i, 1.0)
            with code.fold([0.0], size) as finite:
                i = finite.index
                row, worst = inverses.shared_at(i * WIDEST), finite.values[0]
                for k in registers:
                    value = (growth[k] > 0.0).choose(row[k] / sizes.shared(start + i), 0.0)
                    row[k] = value
                    target.shared_at((start + i) * WIDEST)[k] = value
                    worst = value.is_finite().choose(worst, 1.0)
                finite.next = [worst]
            code.leave_when((finite.values[0] > 0.0).any())
            for r in code.range(start):
                with code.fold([0.0 for _ in registers], size) as loop:
                    factor, other = (
                        triangle.shared(r * width + start + loop.index),
                        inverses.shared_at(loop.index * WIDEST),
                    )
                    loop.next = [value - factor * other[k] for k, value in enumerate(loop.values)]
                for k in registers:
                    target.shared_at(r * WIDEST)[k] = loop.values[k]
            steps.put_integer(number * 3, start)
            steps.put_integer(number * 3 + 1, start + size)
            rows = state.integer(ROWS)
            steps.put_integer(number * 3 + 2, rows * WIDEST)
            state.put_integer(ROWS, rows + start + size)
            state.put_integer(DONE, start + size)
            state.put_integer(STEPS, number + 1)


def _products(code: Code) -> None:
    """Divide some rows, and multiply them; eight registers hold the sums of the innermost loops."""
    lanes, registers = code.lanes, WIDEST // code.lanes
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
                    # Sums over few rows are added, whose rounding errors are a sixth of those of one sum over all rows.
                    with code.fold([0.0] * 8, size) as loop:
                        line = room.shared_at(loop.index * padded)
                        own = [line.shared_at(right)[j] for j in range(2)]
                        loop.next = [
                            loop.values[2 * k + j] + line.shared(left + k) * own[j] for k in range(4) for j in range(2)
                        ]
                    for k, target in enumerate(targets):
                        for j in range(2):
                            target[j] = target[j] + loop.values[2 * k + j]
