"""Finds the changes of parameters that leave all torques of a tree of joints as they are, in exact arithmetic.

A body beyond a joint may be moved to the link below where no motion shows the difference: its pseudo-inertia S must
give no torque at the joint, and must look the same from below at every position of the joint. Which motions the link
below can make is carried from the base outward, as two spans (after Wensing, Niemeyer and Slotine 2024, "A geometric
characterization of observability in inertial parameter identification"):

- its twists, gravity among them as an acceleration of the base;
- the functions of S, among the ten there are, that the joints below can feel.

Twists are 4 x 4 matrices M with d/dt (x, 1) = M (x, 1), and S is 4 x 4, so that the product of inertia of two twists is
tr(M S N'), and a placement A takes S to A S A'. Drive terms that act like a constant torque (an offset) or a constant
inertia (a rotor) take part, since what they do may look like what a link does. All of it is linear algebra in at most
ten unknowns for each link, in rational numbers: a rank is not a matter of tolerance here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache

import numpy as np
from numpy.typing import NDArray

from steelyard.robot import Robot

from .exact_placement import ExactMatrix, Number, exact_placement, placed_back, quotient, times, transposed
from .layout import ParameterLayout

__all__ = [
    "UPPER_TRIANGLE",
    "DriveEffects",
    "LinkFreedom",
    "Row",
    "RowSpace",
    "TermColumns",
    "Unidentifiable",
    "term_columns",
    "unidentifiable",
]

Row = dict[int, Number]


class RowSpace:
    """The span of rows, each from column to value; the first column of a row, by number, is its pivot.

    Examples
    --------
    >>> space = RowSpace()
    >>> space.add({0: Fraction(2), 1: Fraction(4)}), space.add({0: Fraction(1), 1: Fraction(2)})
    (True, False)
    >>> space.rows
    {0: {0: 1, 1: 2}}
    """

    def __init__(self) -> None:
        self.rows: dict[int, Row] = {}

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, row: Row) -> bool:
        """Add a row; False where it lies in the span already."""
        rest = dict(row)
        for pivot in [column for column in rest if column in self.rows]:
            subtract(rest, rest[pivot], self.rows[pivot])
        rest = {column: value for column, value in rest.items() if value}
        if not rest:
            return False
        pivot = min(rest)
        factor = rest[pivot]
        rest = {column: quotient(value, factor) for column, value in rest.items()}
        for other in self.rows.values():
            if pivot in other:
                subtract(other, other[pivot], rest)
        self.rows[pivot] = rest
        return True

    def close(self, generator: Callable[[Row], Row]) -> RowSpace:
        """Add all that a linear map makes of the rows, until nothing new comes; returns itself."""
        waiting = [dict(row) for row in self.rows.values()]
        while waiting:
            image = generator(waiting.pop())
            if self.add(image):
                waiting.append(image)
        return self

    def null_vectors(self, columns: Iterable[int]) -> list[Row]:
        """A basis of the vectors over these columns that are orthogonal to every row."""
        found = []
        for free in columns:
            if free not in self.rows:
                vector = {pivot: -row[free] for pivot, row in self.rows.items() if free in row}
                found.append({free: _ONE, **vector})
        return found


def subtract(row: Row, factor: Number, other: Row) -> None:
    """Take a multiple of another row away, in place."""
    for column, value in other.items():
        changed = row.get(column, _ZERO) - factor * value
        if changed:
            row[column] = changed
        else:
            row.pop(column, None)


# Which changes of parameters leave all torques of a tree of joints as they are, in exact arithmetic.

UPPER_TRIANGLE = tuple((i, j) for i in range(4) for j in range(i, 4))
_ONE, _ZERO = 1, 0
_GRAVITY, _RATES = 6, 7  # keys of a twist's row beyond its six: whether it is gravity, and the joint rates with it
_TERMS = 10  # key of the first term parameter in a row of conditions, after the ten of S


@dataclass(frozen=True)
class DriveEffects:
    """The effects of those parameters of terms that are a constant torque or a constant inertia each.

    Attributes
    ----------
    torques : mapping from coordinate to Row
        Constant torque by each parameter.
    inertias : mapping from pair of coordinates to Row
        Element of the symmetric inertia matrix by each parameter; both orders of a pair are there.
    """

    torques: Mapping[int, Row] = field(default_factory=dict)
    inertias: Mapping[tuple[int, int], Row] = field(default_factory=dict)


@dataclass(frozen=True)
class LinkFreedom:
    """The bodies that may be moved over a joint to the link below, as pseudo-inertias in the moved frame of the joint.

    Attributes
    ----------
    vectors : tuple of Row
        A basis, over the ten elements of the upper triangle.
    answers : mapping from term parameter to Row
        What the link must have beside a unit of the parameter, where the torques of both cancel.
    """

    vectors: tuple[Row, ...]
    answers: Mapping[int, Row]


@dataclass(frozen=True)
class Unidentifiable:
    """All changes of the parameters of links and terms that have no effect on any torque.

    Attributes
    ----------
    terms : tuple of Row
        Combinations of term parameters that no torque shows, together with `answers` of the links.
    befores, afters : tuple of ExactMatrix
        The placements of the joints.
    """

    links: tuple[LinkFreedom, ...]
    terms: tuple[Row, ...]
    befores: tuple[ExactMatrix, ...]
    afters: tuple[ExactMatrix, ...]


@dataclass(frozen=True)
class _Seen:
    """The two spans of a link, in the moved frame of its joint."""

    twists: RowSpace
    functions: RowSpace

    @property
    def whole(self) -> bool:
        """Whether it makes all twists, whatever the joint rates, and shows all of S."""
        return len(self.functions) == 10 and all(
            k in self.twists.rows and len(self.twists.rows[k]) == 1 for k in range(6)
        )


def unidentifiable(robot: Robot, effects: DriveEffects, term_count: int) -> Unidentifiable:
    """Find all changes of links and terms without an effect, where each joint moves by itself.

    Joints that mimic others count as moving by themselves, too.

    Parameters
    ----------
    robot : Robot
        Without symbolic lengths.
    effects : DriveEffects
    term_count : int
        Number of the term parameters.
    """
    befores = tuple(exact_placement(joint.before) for joint in robot.joints)
    afters = tuple(exact_placement(joint.after) for joint in robot.joints)
    coupled = {i for i, j in effects.inertias if i != j}
    ground = RowSpace()
    gravity = {3 + k: -Fraction(repr(value)) for k, value in enumerate(robot.gravity.tolist()) if value}
    ground.add({**gravity, _GRAVITY: _ONE})
    seen: list[_Seen] = []
    conditions: list[RowSpace] = []
    below: list[set[int]] = []
    drives = RowSpace()
    for index, joint in enumerate(robot.joints):
        coordinate = joint.coordinate if joint.mimics is None else -1
        if joint.parent < 0:
            start, between, under = _Seen(ground, RowSpace()), befores[index], set()
        else:
            start, under = seen[joint.parent], below[joint.parent]
            between = _joined(afters[joint.parent], befores[index])
        found, here = _passed(start, between, joint.rotates, coordinate, effects, coupled)
        conditions.append(found)
        seen.append(here)
        below.append(under | {coordinate})
        for pivot, row in found.rows.items():
            if pivot >= _TERMS:
                drives.add({column - _TERMS: value for column, value in row.items()})
    # Rates meet in the energy of a link only where one joint lies below the other.
    related = {(robot.joints[i].coordinate, j) for i in robot.driving_joints for j in below[i]}
    for (i, j), row in effects.inertias.items():
        if (i, j) not in related and (j, i) not in related:
            drives.add(row)
    links = tuple(LinkFreedom(tuple(rows.null_vectors(range(10))), _answers(rows)) for rows in conditions)
    return Unidentifiable(links, tuple(drives.null_vectors(range(term_count))), befores, afters)


def _answers(rows: RowSpace) -> dict[int, Row]:
    found: dict[int, Row] = {}
    for pivot, row in rows.rows.items():
        for column, value in row.items():
            if pivot < _TERMS <= column:
                found.setdefault(column - _TERMS, {})[pivot] = -value
    return found


def _passed(
    start: _Seen,
    between: ExactMatrix,
    rotates: bool,
    coordinate: int,
    effects: DriveEffects,
    coupled: set[int],
) -> tuple[RowSpace, _Seen]:
    """Return the conditions on a body beyond a joint, over S and the terms, and the spans that its link sees."""
    rate = {_RATES + coordinate: _ONE} if coordinate in coupled else {}
    own = _unit_twist(rotates)
    twists, functions = RowSpace(), RowSpace()
    whole = start.whole
    for row in start.twists.rows.values():
        twists.add(row if whole else _turned_twist(row, between))
    found = RowSpace()
    if whole:
        for row in _conditions_of_all(rotates):
            found.rows[min(row)] = dict(row)
        functions = start.functions
    else:
        for row in start.functions.rows.values():
            functions.add(_turned_function(row, between))
        motion = _matrix(own)
        twists.close(lambda row: _bracket(row, motion))
        functions.close(lambda row: _derivative(row, motion))
        for row in functions.rows.values():
            found.add(_derivative(row, motion))
    shown = RowSpace()
    for row in functions.rows.values():
        shown.add(row)
    for row in [*twists.rows.values(), own]:
        product = _product(own, row)
        if not whole:
            shown.add(product)
        felt = {_TERMS + k: v for k, v in _felt(row, coordinate, effects, row is own).items()}
        if not whole or felt:
            found.add({**product, **felt})
    reached = RowSpace()
    for row in twists.rows.values():
        reached.add(row)
    reached.add({**own, **rate})
    return found, _Seen(reached, shown)


def _felt(row: Row, coordinate: int, effects: DriveEffects, alone: bool) -> Row:
    """Torque of the terms at a joint, by their parameters: of gravity's constant, and of the rates in a row."""
    total: Row = {}
    parts = [(effects.torques.get(coordinate, {}), row.get(_GRAVITY, _ZERO))]
    if alone:
        parts.append((effects.inertias.get((coordinate, coordinate), {}), _ONE))
    for column, value in row.items():
        if column >= _RATES:
            parts.append((effects.inertias.get((coordinate, column - _RATES), {}), value))
    for terms, factor in parts:
        for k, value in terms.items():
            total[k] = total.get(k, _ZERO) + factor * value
    return {k: value for k, value in total.items() if value}


@cache
def _conditions_of_all(rotates: bool) -> tuple[Row, ...]:
    """Conditions where every twist and every function is seen."""
    own = _unit_twist(rotates)
    motion = _matrix(own)
    space = RowSpace()
    for k in range(10):
        space.add(_derivative({k: _ONE}, motion))
    for k in range(6):
        space.add(_product(own, {k: _ONE}))
    return tuple(space.rows.values())


def _unit_twist(rotates: bool) -> Row:
    return {2 if rotates else 5: _ONE}


def _matrix(row: Row) -> list[list[Number]]:
    """The 4 x 4 matrix of a twist (angular, linear)."""
    x, y, z, *linear = (row.get(k, _ZERO) for k in range(6))
    turn = [[_ZERO, -z, y], [z, _ZERO, -x], [-y, x, _ZERO]]
    return [[*part, u] for part, u in zip(turn, linear, strict=True)] + [[_ZERO] * 4]


def _twist(matrix: Sequence[Sequence[Number]], row: Row) -> Row:
    """The row of a 4 x 4 matrix, with what `row` has beyond the twist."""
    values = (matrix[2][1], matrix[0][2], matrix[1][0], matrix[0][3], matrix[1][3], matrix[2][3])
    found = {k: value for k, value in enumerate(values) if value}
    return {**found, **{k: value for k, value in row.items() if k >= _GRAVITY}}


def _turned_twist(row: Row, between: ExactMatrix) -> Row:
    return _twist(times(times(placed_back(between), _matrix(row)), between), row)


def _bracket(row: Row, motion: Sequence[Sequence[Number]]) -> Row:
    """Return how a twist changes as the joint moves; the rates and gravity's constant do not."""
    matrix = _matrix(row)
    left, right = times(matrix, motion), times(motion, matrix)
    return _twist([[a - b for a, b in zip(x, y, strict=True)] for x, y in zip(left, right, strict=True)], {})


def _product(own: Row, other: Row) -> Row:
    """The product of inertia tr(M S N') of two twists, as a function of S."""
    return _function(times(transposed(_matrix(other)), _matrix(own)))


def _function(matrix: Sequence[Sequence[Number]]) -> Row:
    """Coefficients of Σ C_ij S_ij by the elements of the upper triangle of S."""
    found = {}
    for k, (i, j) in enumerate(UPPER_TRIANGLE):
        value = matrix[i][i] if i == j else matrix[i][j] + matrix[j][i]
        if value:
            found[k] = value
    return found


def _coefficients(row: Row) -> list[list[Number]]:
    matrix: list[list[Number]] = [[_ZERO] * 4 for _ in range(4)]
    for k, value in row.items():
        i, j = UPPER_TRIANGLE[k]
        matrix[i][j] = matrix[j][i] = value if i == j else quotient(value, 2)
    return matrix


def _turned_function(row: Row, between: ExactMatrix) -> Row:
    return _function(times(times(transposed(between), _coefficients(row)), between))


def _derivative(row: Row, motion: Sequence[Sequence[Number]]) -> Row:
    """Return how a function of S changes as the joint moves."""
    half = times(_coefficients(row), motion)
    return _function([[a + b for a, b in zip(x, y, strict=True)] for x, y in zip(half, transposed(half), strict=True)])


def _joined(first: ExactMatrix, second: ExactMatrix) -> ExactMatrix:
    """The product of two placements, without what rounding leaves where they cancel."""
    product = times(first, second)
    rounded = np.array([[float(value) for value in row] for row in product])
    cleaned = exact_placement(rounded)
    return tuple(
        (*row[:3], old[3] if row[3] else _ZERO) if i < 3 else row
        for i, (row, old) in enumerate(zip(cleaned, product, strict=True))
    )


# What the columns of terms are: constant torques, constant inertias, or odd in the velocities.

Array = NDArray[np.float64]
_SAMPLES = 12  # random motions at which columns are compared: more than enough to exclude agreement by chance
_ROUNDING = 1e-12  # relative: the columns of a term are a few products each, which round by 1e-16


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
    samples = _SAMPLES * len(layout.speeds_of_terms)
    q, dq = random.uniform(-np.pi, np.pi, (samples, count)), layout.random_speeds(random, samples)
    ddq = random.uniform(-9.0, 9.0, (samples, count))
    logged = layout.random_channels(random, samples)
    forth, back = _columns(layout, q, dq, ddq, logged), _columns(layout, q, -dq, ddq, logged)
    calm = _columns(layout, q, dq, 0.0 * ddq, logged)
    units = _columns(layout, np.repeat(q[:1], count, 0), np.repeat(dq[:1], count, 0), np.eye(count))
    torques: dict[int, Row] = {}
    inertias: dict[tuple[int, int], Row] = {}
    regular: list[int] = []
    odd: list[int] = []
    others: list[int] = []
    links = {int(column) for link in layout.links for column in link}
    for column in (k for k in range(len(layout.names)) if k not in links):
        values, place = forth.get(column, {}), len(regular)  # none where no torque depends on the parameter
        size = max((float(np.abs(value).max()) for value in values.values()), default=0.0)
        constant = all(np.all(value == value[0]) for value in values.values())
        matrix = {(i, j): float(v) for i, row in units.get(column, {}).items() for j, v in enumerate(row) if v}
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


def _columns(
    layout: ParameterLayout, q: Array, dq: Array, ddq: Array, channels: list[Array] | None = None
) -> dict[int, dict[int, Array]]:
    found: dict[int, dict[int, Array]] = {}
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np, channels=channels):
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
