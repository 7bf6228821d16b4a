"""The rows at which columns are least and greatest, group by group, compiled for this processor."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .machine import address_of, batch_lanes, host_machine

if TYPE_CHECKING:
    from .loops import Code

__all__ = ["extreme_rows"]

Array = NDArray[np.float64]


def extreme_rows(values: Array, others: Array, size: int) -> NDArray[np.intp]:
    """Return where columns, and their differences to other columns, are least and greatest in each group of rows.

    NumPy takes four times as long for it, most of it for copies in which a column stands together.

    Parameters
    ----------
    values, others : ndarray
        (S, N), S a multiple of `size`.
    size : int
        Rows of a group.

    Returns
    -------
    ndarray of int
        (S / size, 4 N), from 0 in each group, the first of equal ones: where the values are least, where the
        differences ``values - others`` are, where the values are greatest, and where the differences are.

    Examples
    --------
    >>> values = np.array([[3.0], [1.0], [2.0], [5.0], [5.0], [4.0]])
    >>> extreme_rows(values, np.array([[0.0], [0.0], [7.0], [0.0], [1.0], [0.0]]), 3).tolist()
    [[1, 2, 0, 0], [2, 1, 0, 0]]
    """
    values, others = (np.ascontiguousarray(one, dtype=np.float64) for one in (values, others))
    count, width = values.shape
    if others.shape != values.shape or size < 1 or count % size:
        raise ValueError("rows whose extremes are looked for must be whole groups of both arrays")
    groups, held = count // size, min(width, batch_lanes())
    found = np.empty(groups * 4 * width + batch_lanes())
    if groups:
        _compiled(held)(*map(address_of, (values, others, found)), groups, size, width, width - held)
    return found[: groups * 4 * width].reshape(groups, 4 * width).astype(np.intp)


@cache
def _compiled(held: int) -> Callable[..., None]:
    code = host_machine(batch_lanes()).load_code(lambda code: _write(code, held), ("extremes",))
    return code.function("extremes", *[ctypes.c_void_p] * 3, *[ctypes.c_int64] * 4)


def _write(code: Code, held: int) -> None:
    """Write the function: of as many columns as there are lanes all that is known of a group stays in registers.

    Of fewer columns than lanes, `held`, a register reads nothing of the rows that follow.
    """
    lanes = code.lanes
    with code.function("extremes", "values", "others", "found", integers="groups size width last") as given:
        values, others, found, groups, size, width, last = given
        for group in code.range(groups):
            for column in code.range(width, step=lanes):
                at = column.below(last)  # the last columns are those up to the end
                start = [values.shared_at(group * size * width + at), others.shared_at(group * size * width + at)]
                one = start[0].of_first(held)
                first = [one, one - start[1].of_first(held)]
                # Least values, where they are, greatest values, and where those are; of both quantities.
                with code.fold([*first, 0.0, 0.0, *first, 0.0, 0.0], size, 1) as loop:
                    row, place = loop.index * width, loop.index.number()
                    one = start[0].shared_at(row).of_first(held)
                    both = [one, one - start[1].shared_at(row).of_first(held)]
                    low, low_at, high, high_at = (loop.values[k : k + 2] for k in (0, 2, 4, 6))
                    less = [own < least for own, least in zip(both, low, strict=True)]
                    more = [own > most for own, most in zip(both, high, strict=True)]
                    loop.next = [
                        *(which.choose(own, old) for which, own, old in zip(less, both, low, strict=True)),
                        *(which.choose(place, old) for which, old in zip(less, low_at, strict=True)),
                        *(which.choose(own, old) for which, own, old in zip(more, both, high, strict=True)),
                        *(which.choose(place, old) for which, old in zip(more, high_at, strict=True)),
                    ]
                for line, place in enumerate([*loop.values[2:4], *loop.values[6:8]]):
                    found.shared_at((group * 4 + line) * width + at)[0] = place
