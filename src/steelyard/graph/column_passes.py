"""Passes over tables with one row per sample, compiled for this processor: each reads what it needs once.

A log of seven joints is larger than the caches, and NumPy goes through it once for each question, into a new array for
some. For few values, where loading machine code takes longer than all of that, NumPy answers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .loops import Code

__all__ = ["ColumnFacts", "central_differences", "column_facts", "side_by_side"]

Array = NDArray[np.float64]

FEW = 50_000
"""Values below which NumPy is used: it takes 0.1 ms for the facts of so many, half as long as to load machine code."""
TILE = 512
"""Rows whose columns are put side by side at a time: those of 8 columns are half of the nearest cache."""


class ColumnFacts(NamedTuple):
    """What `column_facts` finds, of each column.

    Attributes
    ----------
    low, high : ndarray
        (N,) the least and the greatest value; NaN where a column has one, infinite of no rows.
    least_step, greatest_step : ndarray
        (N,) the least and the greatest difference from a row to the next, as `low` and `high`.
    zeros : ndarray of int
        (N,) how many values are 0.
    """

    low: Array
    high: Array
    least_step: Array
    greatest_step: Array
    zeros: NDArray[np.intp]

    @property
    def ranges(self) -> Array:
        """(N,) the greatest less the least value."""
        return self.high - self.low


@np.errstate(over="ignore", invalid="ignore")
def column_facts(values: Array) -> ColumnFacts:
    """Return extremes of the columns of a table (S, N) and of their steps, and how many of their values are zero.

    Examples
    --------
    >>> facts = column_facts(np.array([[0.0, 5.0], [2.0, 5.0], [1.0, 3.0]]))
    >>> facts.low.tolist(), facts.high.tolist(), facts.least_step.tolist(), facts.zeros.tolist()
    ([0.0, 3.0], [2.0, 5.0], [-1.0, -2.0], [1, 0])
    """
    count, width = values.shape
    if values.size >= FEW and values.flags.c_contiguous and values.dtype == np.float64:
        from .machine import address_of, batch_lanes  # for few values it need not be loaded

        held = min(width, batch_lanes())
        found = np.empty(6 * width + batch_lanes())
        _facts(held)(*map(address_of, (values, found)), count, width, width - held)
        low, high, least, greatest, zeros, spoiled = found[: 6 * width].reshape(6, width)
        if not np.isnan(spoiled).any():
            return ColumnFacts(low, high, least, greatest, zeros.astype(np.intp))
    found = np.empty((5, width))
    for column, given in enumerate(values.T):
        own = np.ascontiguousarray(given)  # which NumPy goes through ten times as fast
        steps = own[1:] - own[:-1]
        extremes = [end for one in (own, steps) for end in (one.min(initial=np.inf), one.max(initial=-np.inf))]
        found[:, column] = *extremes, count - np.count_nonzero(own)
    low, high, least, greatest, zeros = found
    return ColumnFacts(low, high, least, greatest, zeros.astype(np.intp))


def side_by_side(parts: Sequence[Sequence[Array]]) -> Array:
    """Return a table whose columns are given in parts that follow one another.

    Parameters
    ----------
    parts : sequence of sequences of ndarray
        For each part its N columns, of as many rows.

    Examples
    --------
    >>> side_by_side([[np.array([1.0, 2.0]), np.array([5.0, 6.0])], [np.array([3.0]), np.array([7.0])]]).tolist()
    [[1.0, 5.0], [2.0, 6.0], [3.0, 7.0]]
    """
    counts, width = [len(columns[0]) for columns in parts], len(parts[0])
    table, start = np.empty((sum(counts), width)), 0
    for columns, count in zip(parts, counts, strict=True):
        rows = table[start : start + count]
        if count * width < FEW:
            for index, column in enumerate(columns):
                rows[:, index] = column
        else:
            from .machine import address_of

            held = [np.ascontiguousarray(column, np.float64) for column in columns]
            if any(column.shape != (count,) for column in held):
                raise ValueError("columns that are put side by side must have as many rows")
            addresses = np.array([address_of(column) for column in held], np.int64)
            _stacking()(address_of(addresses), address_of(rows), count, width)
        start += count
    return table


def central_differences(values: Array, step: float, out: Array) -> None:
    """Write central differences of fourth order of a table (S, N) into `out`, (S - 4, N).

    They are ``(8 (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 step)`` to the last bit: derivatives
    of polynomials of degree four are exact.

    Examples
    --------
    >>> out = np.empty((1, 1))
    >>> central_differences(np.array([[0.0], [1.0], [8.0], [27.0], [64.0]]), 1.0, out)
    >>> out.tolist()
    [[12.0]]
    """
    arrays, span = (values, out), 12.0 * step
    if out.size < FEW or not all(one.flags.c_contiguous and one.dtype == np.float64 for one in arrays):
        np.subtract(values[3:-1], values[1:-3], out=out)
        out *= 8.0
        out -= values[4:] - values[:-4]
        out /= span
        return
    if out.shape != (len(values) - 4, values.shape[1]):
        raise ValueError("differences over four rows need an array of as many rows less four")
    from .machine import address_of

    over = np.array([span])  # which must live until it is read
    _differences()(*map(address_of, (values, over, out)), out.size, out.shape[1])


@cache
def _facts(held: int) -> Callable[..., None]:
    from .machine import batch_lanes, host_machine

    code = host_machine(batch_lanes()).load_code(lambda code: _write_facts(code, held), ("facts",))
    return code.function("facts", *[ctypes.c_void_p] * 2, *[ctypes.c_int64] * 3)


def _write_facts(code: Code, held: int) -> None:
    """Write the function: of as many columns as there are lanes all that is known stays in registers.

    Of fewer columns than lanes, `held`, a register reads nothing of the rows that follow.
    """
    infinite = float("inf")
    with code.function("facts", "values", "found", integers="count width last") as given:
        values, found, count, width, last = given
        for column in code.range(width, step=code.lanes):
            at = column.below(last)  # the last columns are those up to the end
            start = values.shared_at(at)
            first = start.of_first(held)
            zero = (first > 0.0).choose(0.0, (first < 0.0).choose(0.0, 1.0))
            initial = [first, first, infinite, -infinite, zero, first * 0.0, first]
            with code.fold(initial, count, 1) as loop:
                low, high, least, greatest, zeros, spoiled, before = loop.values
                own = start.shared_at(loop.index * width).of_first(held)
                step = own - before
                loop.next = [
                    (own < low).choose(own, low),
                    (own > high).choose(own, high),
                    (step < least).choose(step, least),
                    (step > greatest).choose(step, greatest),
                    zeros + (own > 0.0).choose(0.0, (own < 0.0).choose(0.0, 1.0)),
                    spoiled + own * 0.0,  # from a value on that is no number, or infinite, no number
                    own,
                ]
            for line, value in enumerate(loop.values[:6]):
                found.shared_at(width * line + at)[0] = value


@cache
def _differences() -> Callable[..., None]:
    from .machine import batch_lanes, host_machine

    def write(code: Code) -> None:
        with code.function("differences", "values", "span", "out", integers="count width") as given:
            values, span, out, count, width = given
            over = span.shared(0)
            first, second, fourth, fifth = (values.shared_at(width * row) for row in (0, 1, 3, 4))
            for index in code.range(count, step=code.lanes):
                at = index.below(count - code.lanes)  # the last numbers are those up to the end
                near = fourth.shared_at(at)[0] - second.shared_at(at)[0]
                far = fifth.shared_at(at)[0] - first.shared_at(at)[0]
                out.shared_at(at)[0] = (near * 8.0 - far) / over

    code = host_machine(batch_lanes()).load_code(write, ("differences",))
    return code.function("differences", *[ctypes.c_void_p] * 3, *[ctypes.c_int64] * 2)


@cache
def _stacking() -> Callable[..., None]:
    from .machine import host_machine

    def write(code: Code) -> None:
        with code.function("stack", "columns", "rows", integers="count width") as (columns, rows, count, width):
            for tile in code.range(count, step=TILE):
                stop = (tile + TILE).below(count)
                for column in code.range(width):
                    source, target = columns.array(column), rows.shared_at(column)
                    for row in code.range(stop, tile):
                        target.put(row * width, source.shared(row))

    code = host_machine(1).load_code(write, ("stack",))
    return code.function("stack", *[ctypes.c_void_p] * 2, *[ctypes.c_int64] * 2)
