"""Base parameters: the combinations of parameters that the torques depend on (thesis section 2.5.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table
from steelyard.once import cached_property
from steelyard.robot import Robot

from .exact_placement import ExactMatrix, Number, placed_back, robot_with_right_angles, times, transposed
from .layout import ParameterLayout
from .unidentifiable import UPPER_TRIANGLE, Row, TermColumns, Unidentifiable, term_columns, unidentifiable

__all__ = ["BaseParameters", "base_parameters_of", "model_base_parameters"]

Matrix = NDArray[np.float64]
Vector = dict[int, Decimal]

_DIGITS = 60
"""Decimal digits of K while it is computed: nearly parallel axes and long chains of joints cancel many of them, and far
more than the 16 of a float must be left."""
_NOTHING = Decimal("1e-40")
"""Rounding to 60 digits may leave this much of a zero."""

_CLEARLY_INDEPENDENT = 1e-2
"""A parameter that is shown less than others by this factor leads no combination, where another can: coefficients of K
would be as large as its inverse. A joint that is 1e-5 rad off the y axis of its frame shows lz 1e-5 as much as lx.
With 1e-4, elements of K for axes a hundredth of a radian off reached 6e5, and 8 of 600 verdicts were not decided."""

_CLEAR_GAP = 100.0
"""Ratio of the least distance of an independent column to the greatest of a dependent one from which the rank is clear,
and other thresholds are not tried. Only joints that mimic others, and terms of users, depend on it."""
_SUPPORT = (1e-7, 1e-9, 1e-11, 0.0)
"""Coefficients below this part of the largest are tried as zeros, the boldest guess first. A guess counts only where
the remaining columns still give the values."""
_SURE_DIGITS, _COINCIDENCE = 6, 500.0
"""A decimal of at most so many digits is taken as soon as it is met. One with more digits is taken only where the noise
is so many times smaller than its last digit: a number that is no decimal would otherwise be met by chance."""


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The map from the n standard parameters to the n_b base parameters, ``beta = K delta`` (thesis eq. 2.53).

    Attributes
    ----------
    parameter_names : tuple of str
        The n standard parameters.
    independent : ndarray of int
        Indices of the n_b left-most independent columns of the regressor.
    dependent : ndarray of int
        Indices of the others, of which some have no effect at all.
    Kd : ndarray
        (n_b, n_d): ``H_d = H_b Kd`` (thesis eq. 2.47).
    meant : bool
        Whether angles such as 1.5708 were taken for the multiples of π/2 that they stand for.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")], gravity=(0, -9.81, 0))
    >>> base = sy.Model(robot).base_parameters()
    >>> base.expressions[:2]
    ('Lzz1 - m1 - m2', 'lx1 + m1 + m2')
    """

    parameter_names: tuple[str, ...]
    independent: NDArray[np.intp]
    dependent: NDArray[np.intp]
    Kd: Matrix
    meant: bool = False
    _sampled: Callable[[], Matrix] = field(default=partial(np.zeros, (0, 0)), repr=False)

    def __repr__(self) -> str:
        return f"BaseParameters({self.count} of {len(self.parameter_names)})"

    def _repr_html_(self) -> str:
        return html_table(f"{self.count} base parameters", (), enumerate(self.expressions, start=1))

    @property
    def count(self) -> int:
        """Number n_b of base parameters."""
        return len(self.independent)

    @property
    def names(self) -> tuple[str, ...]:
        """The independent parameter that leads each combination."""
        return tuple(self.parameter_names[i] for i in self.independent)

    @cached_property
    def K(self) -> Matrix:
        """Map from standard to base parameters, (n_b, n)."""
        matrix = np.zeros((self.count, len(self.parameter_names)))
        matrix[np.arange(self.count), self.independent] = 1.0
        matrix[:, self.dependent] = self.Kd
        return matrix

    @cached_property
    def _measured(self) -> tuple[float, float]:
        matrix = self._sampled()
        lengths = np.linalg.norm(matrix, axis=0)
        scale = np.maximum(lengths, np.median(lengths[self.independent]) if self.count else 1.0)
        rest = matrix[:, self.dependent] - matrix[:, self.independent] @ self.Kd
        error = float((np.linalg.norm(rest, axis=0) / scale[self.dependent]).max(initial=0.0))
        factor = np.linalg.qr(matrix[:, self.independent] / scale[self.independent], mode="r")
        return error, float(np.abs(np.diag(factor)).min(initial=1.0))

    @property
    def error(self) -> float:
        """Largest part of a dependent column of the regressor that K misses, at random motions.

        Relative to the length of the column, or of a typical independent one if that is longer. Rounding, below 1e-14
        or so, except where an angle such as 1.5708 counts as a right one (`meant`).
        """
        return self._measured[0]

    @property
    def gap(self) -> float:
        """The margin by which random motions show the rank, which does not rest on it.

        It is the smallest relative distance of an independent column from those left of it, over `error`, or over
        rounding if that is larger.
        """
        error, nearest = self._measured
        return nearest / max(error, 1e-15)

    @cached_property
    def Pb(self) -> Matrix:
        """Columns of the permutation that pick the independent parameters, (n, n_b) (thesis eq. 2.48)."""
        return np.eye(len(self.parameter_names))[:, self.independent]

    @cached_property
    def Pd(self) -> Matrix:
        """Columns of the permutation that pick the dependent parameters, (n, n_d) (thesis eq. 2.48)."""
        return np.eye(len(self.parameter_names))[:, self.dependent]

    def values(self, parameters: ArrayLike) -> Matrix:
        """Return the base parameters (n_b,) of standard parameters (n,)."""
        return np.asarray(self.K @ np.asarray(parameters, dtype=np.float64))

    @cached_property
    def expressions(self) -> tuple[str, ...]:
        """Each combination as text, such as ``"Lyy1 + Iam1 + Lzz2"``."""
        return tuple(self._expression(row) for row in range(self.count))

    def _expression(self, row: int) -> str:
        text = str(self.parameter_names[self.independent[row]])
        for column in np.flatnonzero(self.Kd[row]):
            coefficient = float(self.Kd[row, column])
            size = f"{abs(coefficient):.8g}*" if abs(coefficient) != 1.0 else ""
            text += f" {'-' if coefficient < 0 else '+'} {size}{self.parameter_names[self.dependent[column]]}"
        return text


def model_base_parameters(layout: ParameterLayout, sampled: Callable[[ParameterLayout], Matrix]) -> BaseParameters:
    """Find the base parameters of a robot with its terms.

    The changes of links and drives that no torque shows are found exactly (see `unidentifiable`). Joints that mimic
    others, and terms that are neither constant torques nor inertias nor friction, may add to them; these changes are
    found from the regressor at random motions, among the columns that are left.

    Angles such as 1.5708 count as right angles only where the rank depends on it, because nobody means parameters that
    appear through such a rounding. Elsewhere the robot is taken as it is written, so that K is right to rounding.
    `sampled` returns the regressor (rows, n) at random motions, stacked; rows well above n.
    """
    written = _base_parameters(layout, layout.robot, sampled)
    meant = robot_with_right_angles(layout.robot)
    if meant is layout.robot:
        return written
    found = _base_parameters(layout, meant, sampled)
    return written if found.count == written.count else found


def _base_parameters(
    layout: ParameterLayout, robot: Robot, sampled: Callable[[ParameterLayout], Matrix]
) -> BaseParameters:
    names = layout.names
    columns = term_columns(layout, np.random.default_rng(20140101))
    exact = unidentifiable(robot, columns.effects, len(columns.regular))
    with localcontext() as context:
        context.prec = _DIGITS
        vectors = _null_vectors(layout, columns, exact)
    if columns.odd:
        _add_odd(vectors, columns.odd, layout)
    if columns.others or any(joint.mimics is not None for joint in robot.joints):
        left = np.array([k for k in range(len(names)) if k not in vectors], dtype=np.intp)
        found = base_parameters_of(sampled(ParameterLayout(robot))[:, left], tuple(names[k] for k in left))
        more = {
            int(left[d]): {
                int(left[d]): Decimal(1),
                **{int(left[i]): -Decimal(float(v)) for i, v in zip(found.independent, column, strict=True) if v},
            }
            for d, column in zip(found.dependent, found.Kd.T, strict=True)
        }
        with localcontext() as context:
            context.prec = _DIGITS
            for vector in vectors.values():
                _reduce(vector, more)
        vectors |= more
    dependent = np.array(sorted(vectors), dtype=np.intp)
    independent = np.setdiff1d(np.arange(len(names)), dependent)
    place = {int(k): row for row, k in enumerate(independent)}
    Kd = np.zeros((len(independent), len(dependent)))
    for column, pivot in enumerate(dependent.tolist()):
        for k, value in vectors[pivot].items():
            if k != pivot:
                Kd[place[k], column] = -float(value)
    meant = robot is not layout.robot
    return BaseParameters(names, independent, dependent, _without_last_digits(Kd), meant, partial(sampled, layout))


def _null_vectors(layout: ParameterLayout, columns: TermColumns, exact: Unidentifiable) -> dict[int, Vector]:
    """Null vectors of links and regular terms by their pivots: each pivot is in no other vector."""
    befores = [_decimals(placement) for placement in exact.befores]
    backs = [placed_back(_decimals(placement)) for placement in exact.afters]
    parents = [joint.parent for joint in layout.robot.joints]
    starts = [int(link[0]) for link in layout.links]

    def moved(link: int, row: Row) -> Vector:
        """A body that is added to a link, and taken from the one below."""
        body = _placed(backs[link], _body(row))
        vector = _parameters(body, starts[link], 1)
        if parents[link] >= 0:
            below = _placed(befores[link], _body(row))
            vector |= _parameters(below, starts[parents[link]], -1)
        return vector

    vectors: dict[int, Vector] = {}
    for link, freedom in enumerate(exact.links):
        rows = [moved(link, row) for row in freedom.vectors]
        for row in rows:
            _reduce(row, vectors)
        vectors |= _echelon(rows, _local_pivots(rows, starts[link]))
    combinations = []
    for weights in exact.terms:
        vector = {columns.regular[k]: _decimal(value) for k, value in weights.items()}
        for link, freedom in enumerate(exact.links):
            total: Row = {}
            for k, weight in weights.items():
                for place, value in freedom.answers.get(k, {}).items():
                    total[place] = total.get(place, 0) + weight * value
            if total:
                for column, number in moved(link, total).items():
                    vector[column] = vector.get(column, Decimal(0)) + number
        _reduce(vector, vectors)
        combinations.append(vector)
    more = _echelon([vector for vector in combinations if vector], range(len(layout.names) - 1, -1, -1))
    if more:
        for vector in vectors.values():
            _reduce(vector, more)
    return vectors | more


def _local_pivots(rows: Sequence[Vector], start: int) -> list[int]:
    """Return which of a link's ten parameters the others determine: all but the left-most clearly independent ones."""
    own = np.array([[float(row.get(start + k, 0)) for k in range(10)] for row in rows]).reshape(-1, 10)
    seen = np.linalg.svd(own)[2][len(rows) :]  # an orthonormal basis of what the vectors leave alone
    kept: list[int] = []
    while len(kept) < len(seen):
        directions = np.linalg.qr(seen[:, kept])[0]
        distances = np.linalg.norm(seen - directions @ (directions.T @ seen), axis=0)
        left_most = next((k for k in range(10) if k not in kept and distances[k] > _CLEARLY_INDEPENDENT), None)
        kept.append(int(np.argmax(distances)) if left_most is None else left_most)
    return [start + k for k in reversed(range(10)) if k not in kept]


def _echelon(rows: list[Vector], order: Sequence[int]) -> dict[int, Vector]:
    """Give each row a pivot, the first column in this order that it can have, which no other row has then."""
    found: dict[int, Vector] = {}
    for column in order:
        sizes = [abs(row.get(column, Decimal(0))) / max(map(abs, row.values())) for row in rows]
        if not sizes or not max(sizes):
            continue
        row = rows.pop(sizes.index(max(sizes)))
        factor = row[column]
        pivot = {column: {k: value / factor for k, value in row.items()}}
        for other in (*rows, *found.values()):
            _reduce(other, pivot)
        found |= pivot
    return found


def _reduce(vector: Vector, vectors: Mapping[int, Vector]) -> None:
    """Eliminate the pivots of other vectors, in place."""
    for pivot in [column for column in vector if column in vectors]:
        factor = vector[pivot]
        for column, value in vectors[pivot].items():
            changed = vector.get(column, Decimal(0)) - factor * value
            if abs(changed) > _NOTHING:
                vector[column] = changed
            else:
                vector.pop(column, None)


def _add_odd(vectors: dict[int, Vector], odd: Sequence[int], layout: ParameterLayout) -> None:
    """Add the null vectors of friction, which shares no torque with links: row by row, as far as motors couple them."""
    random = np.random.default_rng(20140102)
    count = (3 * 8 + 50) * len(layout.speeds_of_terms)
    q, dq = random.uniform(-np.pi, np.pi, (count, layout.robot.dof)), layout.random_speeds(random, count)
    ddq = random.uniform(-9.0, 9.0, dq.shape)
    values: dict[int, dict[int, Matrix]] = {column: {} for column in odd}
    logged = layout.random_channels(random, count)
    for row, column, value in layout.terms(list(q.T), list(dq.T), list(ddq.T), np, channels=logged):
        if column in values:
            values[column][row] = values[column].get(row, 0.0) + value
    for group in _connected({column: set(rows) for column, rows in values.items()}):
        rows = sorted({row for column in group for row in values[column]})
        blank = np.zeros(len(q))
        matrix = np.column_stack([np.concatenate([values[c].get(r, blank) for r in rows]) for c in group])
        found = base_parameters_of(matrix, tuple(layout.names[c] for c in group))
        for d, column in zip(found.dependent, found.Kd.T, strict=True):
            own = {group[i]: -Decimal(float(v)) for i, v in zip(found.independent, column, strict=True) if v}
            vectors[group[d]] = {group[d]: Decimal(1), **own}


def _connected(rows_of: Mapping[int, set[int]]) -> list[list[int]]:
    """Columns in groups that share rows, each group in order."""
    groups: list[tuple[set[int], list[int]]] = []
    for column, rows in rows_of.items():
        touching = [group for group in groups if group[0] & rows]
        groups = [group for group in groups if not group[0] & rows]
        groups.append((rows.union(*(g[0] for g in touching)), sorted([column, *(c for g in touching for c in g[1])])))
    return [columns for _, columns in groups]


def _decimal(value: Number) -> Decimal:
    return Decimal(value.numerator) / Decimal(value.denominator)


def _decimals(placement: ExactMatrix) -> list[list[Decimal]]:
    return [[_decimal(value) for value in row] for row in placement]


def _body(row: Row) -> list[list[Decimal]]:
    """A pseudo-inertia from its upper triangle."""
    matrix = [[Decimal(0)] * 4 for _ in range(4)]
    for k, value in row.items():
        i, j = UPPER_TRIANGLE[k]
        matrix[i][j] = matrix[j][i] = _decimal(value)
    return matrix


def _placed(placement: list[list[Decimal]], body: list[list[Decimal]]) -> list[list[Decimal]]:
    """A S A' of a pseudo-inertia S."""
    return times(times(placement, body), transposed(placement))


def _parameters(body: list[list[Decimal]], start: int, sign: int) -> Vector:
    """The ten parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` of a pseudo-inertia, by their columns."""
    (xx, xy, xz, x), (_, yy, yz, y), (_, _, zz, z), (_, _, _, m) = body
    values = (yy + zz, -xy, -xz, xx + zz, -yz, xx + yy, x, y, z, m)
    return {start + k: sign * value for k, value in enumerate(values) if abs(value) > _NOTHING}


def _without_last_digits(values: Matrix) -> Matrix:
    """Replace numbers that differ from zero or a short decimal only by the rounding of sines and cosines, 1e-16."""
    result = values.copy()
    for digits in range(13):
        short = np.round(values, digits)
        close = (result == values) & (np.abs(short - values) <= 1e-15 * np.where(short == 0.0, 1.0, np.abs(values)))
        result[close] = short[close]
    return np.asarray(result + 0.0)


def base_parameters_of(regressor: Matrix, parameter_names: tuple[str, ...]) -> BaseParameters:
    """Find the left-most independent columns of a regressor, and the others in terms of them.

    Each column is independent or not by its distance from the span of those left of it, relative to its own length or
    to that of a typical column, whichever is longer: what the motion hardly shows does not count. Where to draw the
    line is decided by a gap between these distances, the lowest one that is clear. The regressor (rows, n) is that of
    many random motions, stacked; rows well above n.
    """
    lengths = np.linalg.norm(regressor, axis=0)
    present = np.flatnonzero(lengths > 0.0)
    typical = float(np.median(lengths[present])) if len(present) else 1.0
    scale = np.maximum(lengths[present], typical)
    factor: Matrix = np.zeros((0, 0))
    if len(present):
        factor = np.asarray(np.linalg.qr(regressor[:, present] / scale, mode="r"))
    best: tuple[float, NDArray[np.intp]] = (0.0, np.zeros(0, dtype=np.intp))
    for exponent in (10, 11, 12, 9, 8, 7, 6, 5, 4):
        distances = _distances(factor, 10.0**-exponent)
        chosen = distances > 10.0**-exponent
        dropped = max(float(distances[~chosen].max(initial=0.0)), 1e-15)
        gap = float(distances[chosen].min(initial=1.0)) / dropped
        if gap > best[0]:
            best = (gap, np.flatnonzero(chosen))
        if gap > _CLEAR_GAP:
            break
    kept = best[1]
    independent = present[kept]
    dependent = np.setdiff1d(np.arange(len(parameter_names)), independent)
    combinations = np.zeros((len(independent), len(dependent)))
    rest = np.setdiff1d(np.arange(len(present)), kept)
    if len(rest) and len(kept):
        solved = np.column_stack([_sparse_solution(factor[:, kept], factor[:, column]) for column in rest])
        solved = solved / scale[kept][:, None] * scale[rest][None, :]
        combinations[:, np.searchsorted(dependent, present[rest])] = _rounded(solved)
    return BaseParameters(parameter_names, independent, dependent, combinations, False, partial(np.asarray, regressor))


def _sparse_solution(matrix: Matrix, values: Matrix) -> Matrix:
    """The combination of columns that gives the values, from as few columns as it takes.

    A column is a combination of a few others as a rule. Solved for these alone, nearly dependent columns beside them do
    not spoil the digits of their coefficients, and what does not belong to them is 0 and not rounding.
    """
    solved = np.linalg.lstsq(matrix, values, rcond=None)[0]
    noise = 1e-13 * max(1.0, float(np.linalg.norm(values))) + 2.0 * float(np.linalg.norm(matrix @ solved - values))
    for least in _SUPPORT:
        used = np.flatnonzero(np.abs(solved) > least * np.abs(solved).max(initial=0.0))
        few = np.linalg.lstsq(matrix[:, used], values, rcond=None)[0]
        if np.linalg.norm(matrix[:, used] @ few - values) <= noise:
            found = np.zeros_like(solved)
            found[used] = few
            return np.asarray(found)
    return np.asarray(solved)


def _distances(factor: Matrix, threshold: float) -> Matrix:
    """Distance of each column from the span of the independent ones left of it, by Gram-Schmidt done twice."""
    rows, count = factor.shape
    basis = np.zeros((rows, min(rows, count)))
    size = 0
    distances = np.zeros(count)
    for j in range(count):
        column = factor[:, j].copy()
        for _ in range(2):
            column -= basis[:, :size] @ (basis[:, :size].T @ column)
        distances[j] = np.linalg.norm(column)
        if distances[j] > threshold and size < basis.shape[1]:
            basis[:, size] = column / distances[j]
            size += 1
    return distances


def _rounded(values: Matrix) -> Matrix:
    """Round to the shortest decimal within the noise of the computation, where that is no coincidence.

    Lengths are decimals of a few digits, and so are their squares and products. A number with endlessly many digits
    stays as it is; that it lies near some decimal of ten digits or more means nothing.
    """
    result = values.copy()
    open_ = np.ones(values.shape, dtype=bool)
    size = np.maximum(1.0, np.abs(values))
    for digits in range(11):
        noise = (2e-12 if digits <= _SURE_DIGITS else 1e-13) * size
        short = np.round(values, digits)
        close = open_ & (np.abs(short - values) <= noise) & (_COINCIDENCE * noise <= 10.0**-digits)
        result[close] = short[close]
        open_ &= ~close
    return result + 0.0
