"""What the columns of terms are: constant torques, constant inertias, or odd in the velocities."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from .layout import ParameterLayout
from .row_space import Row
from .unidentifiable import DriveEffects

__all__ = ["TermColumns", "term_columns"]

Array = NDArray[np.float64]
_SAMPLES = 12
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class TermColumns:
    """The columns of the terms, sorted by what they do.

    Attributes
    ----------
    regular : tuple of int
        Columns of the regressor that are constant torques or constant inertias.
    effects : DriveEffects
        Of these, in their order.
    odd : tuple of int
        Columns that change their sign with the velocities, as friction does; no link does that.
    others : tuple of int
        All others, such as springs.
    """

    regular: tuple[int, ...]
    effects: DriveEffects
    odd: tuple[int, ...]
    others: tuple[int, ...]


def term_columns(layout: ParameterLayout, random: np.random.Generator) -> TermColumns:
    """Sort the columns of the terms by their values at random motions."""
    count = layout.robot.dof
    q, dq, ddq = (random.uniform(-size, size, (_SAMPLES, count)) for size in (np.pi, 3.0, 9.0))
    forth, back = _columns(layout, q, dq, ddq), _columns(layout, q, -dq, ddq)
    calm = _columns(layout, q, dq, 0.0 * ddq)
    units = _columns(layout, np.repeat(q[:1], count, 0), np.repeat(dq[:1], count, 0), np.eye(count))
    torques: dict[int, Row] = {}
    inertias: dict[tuple[int, int], Row] = {}
    regular: list[int] = []
    odd: list[int] = []
    others: list[int] = []
    for column in sorted(forth):
        values, place = forth[column], len(regular)
        size = max(float(np.abs(value).max()) for value in values.values())
        constant = all(np.all(value == value[0]) for value in values.values())
        matrix = {(i, j): float(v) for i, row in units[column].items() for j, v in enumerate(row) if v}
        if constant:
            regular.append(column)
            for row, value in values.items():
                if value[0]:
                    torques.setdefault(row, {})[place] = _decimal(value[0])
        elif all(np.all(v == 0.0) for v in calm[column].values()) and _is_inertia(values, matrix, ddq, size):
            regular.append(column)
            for pair, element in matrix.items():
                inertias.setdefault(pair, {})[place] = _decimal(element)
        elif all(np.array_equal(value, -back[column][row]) for row, value in values.items()):
            odd.append(column)
        else:
            others.append(column)
    return TermColumns(tuple(regular), DriveEffects(torques, inertias), tuple(odd), tuple(others))


def _columns(layout: ParameterLayout, q: Array, dq: Array, ddq: Array) -> dict[int, dict[int, Array]]:
    found: dict[int, dict[int, Array]] = {}
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np):
        rows = found.setdefault(column, {})
        rows[row] = rows.get(row, 0.0) + np.broadcast_to(np.asarray(value, dtype=float), (len(q),))
    return found


def _is_inertia(values: dict[int, Array], matrix: dict[tuple[int, int], float], ddq: Array, size: float) -> bool:
    if any(abs(matrix.get((j, i), 0.0) - value) > _ROUNDING * size for (i, j), value in matrix.items()):
        return False
    expected = {row: np.zeros(len(ddq)) for row in values}
    for (i, j), value in matrix.items():
        expected[i] += value * ddq[:, j]
    return all(np.abs(expected[row] - value).max() <= _ROUNDING * size for row, value in values.items())


def _decimal(value: float) -> Fraction:
    """The decimal number that a float stands for; the last digit or two are what products of decimals leave."""
    return Fraction(f"{value:.15g}")
