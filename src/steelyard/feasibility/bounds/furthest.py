"""Ends of a region in many directions at once, by a primal-dual interior-point method side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import in_threads
from steelyard.graph.machine import address_of, batch_lanes
from steelyard.once import cached_property

from .furthest_code import CONE, SINGLE, UNKNOWN, Word, compiled

__all__ = ["Region", "furthest"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Tensor = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

AT_ONCE = 4
"""Groups of problems side by side that a thread solves before it takes others."""

FIRST = 0.6
"""Part of the way to the end of the ellipsoid around the center with which the search begins; the ball counts as one
condition there, so that from 0.7 on it may be left."""

ENOUGH = 0.4
"""Gap of duality, relative to the way from the center, at which a search ends. The end of the tangent is then within
1.5 % of the way, with 0.2 within 0.8 %, with 0.8 within 4 %; from one to the next takes half a step of four."""

AHEAD = 0.05
"""Part of the way that is left to the tangent, at most. Where few conditions hold the region, the gap alone would leave
half of the way to it; robots have so many that this decides nothing."""

SMALLEST = 1e-12
"""Width relative to the widest, below which a direction is one in which the region has no extent."""


class Region:
    """All y with lines · y + constants ≥ 0, matrices that are positive semidefinite, and ‖ball y + middle‖ ≤ radius.

    Parameters
    ----------
    rows, constants : (m, n), (m,)
        The lines.
    groups : sequence of (indices (b, c), coefficients (b, c, d, d), constants (b, d, d))
        Affine matrices of each shape, as `matrix_conditions` returns them.
    ball, middle : (k, n), (k,)

    Examples
    --------
    Within a circle of radius two, and left of one:

    >>> region = Region(np.array([[-1.0, 0.0]]), np.ones(1), [], np.eye(2), np.zeros(2), 2.0)
    >>> furthest(region, np.array([[1.0, 0.0], [-1.0, 0.0]]))[:, 0].round(1).tolist()
    [1.0, -2.0]
    """

    def __init__(
        self,
        rows: Matrix,
        constants: Vector,
        groups: Sequence[tuple[Indices, Tensor, Tensor]],
        ball: Matrix,
        middle: Vector,
        radius: float,
    ) -> None:
        self.rows, self.constants, self.groups = rows, constants, groups
        self.ball, self.middle, self.radius = ball, middle, radius
        self.size = ball.shape[1]

    @property
    def degree(self) -> int:
        """Conditions of all lines and matrices, and of the ball."""
        return int(1 + len(self.rows) + sum(len(i) * c.shape[-1] for i, _, c in self.groups))

    @cached_property
    def table(self) -> tuple[Indices, dict[Word, npt.NDArray[Any]]]:
        """What the method reads of the region: sizes and addresses, and the arrays that are there."""
        # Unknowns and rows that are filled up have a unit of curvature and nothing else.
        size, ball = (-(-length // 4) * 4 for length in (self.size, len(self.ball)))
        rows = np.zeros((ball, size))
        rows[: len(self.ball), : self.size] = self.ball
        curvature = rows.T @ rows
        further = np.arange(self.size, size)
        curvature[further, further] = 1.0
        matrices = _Matrices(self)
        conic, missing = len(self.rows) + matrices.elements, ball - len(self.ball)
        fixed = [self.constants, *(constants.ravel() for _, _, constants in self.groups), np.array([self.radius])]
        arrays: dict[Word, npt.NDArray[Any]] = {
            Word.CONSTANTS: np.concatenate([*fixed, self.middle, np.zeros(missing)]),
            Word.ROWS: rows,
            Word.ROWS_T: np.ascontiguousarray(rows.T),
            Word.CURVATURE: curvature,
            **self._linear(matrices, conic, size),
            **self._products_of_lines(size),
            **matrices.arrays,
        }
        words = np.zeros(Word.GROUPS + len(matrices.starts), dtype=np.int64)
        words[[Word.SIZE, Word.LINES, Word.CONIC, Word.BALL]] = size, len(self.rows), conic, ball
        words[Word.GROUPS :] = matrices.starts
        for word, array in arrays.items():
            words[word] = address_of(array)
        return words, arrays

    def _linear(self, matrices: _Matrices, conic: int, size: int) -> dict[Word, npt.NDArray[Any]]:
        """Return how lines and matrices depend on the unknowns, by rows and by columns."""
        rows, columns = np.nonzero(self.rows)
        parts = [(rows, columns, self.rows[rows, columns]), *matrices.linear]
        rows, columns, values = (np.concatenate(one) for one in zip(*parts, strict=True))
        by_rows = Word.STARTS, Word.COLUMNS, Word.VALUES
        by_columns = Word.STARTS_T, Word.COLUMNS_T, Word.VALUES_T
        return {
            **dict(zip(by_rows, _by_rows(rows, columns, values, conic), strict=True)),
            **dict(zip(by_columns, _by_rows(columns, rows, values, size), strict=True)),
        }

    def _products_of_lines(self, size: int) -> dict[Word, npt.NDArray[Any]]:
        """Return what each line adds to the lower triangle of a Hessian."""
        used = [np.flatnonzero(row) for row in self.rows]
        lower = [np.tri(len(own), dtype=bool) for own in used]
        products = [np.outer(row[own], row[own])[low] for row, own, low in zip(self.rows, used, lower, strict=True)]
        places = [(own[:, None] * size + own)[low] for own, low in zip(used, lower, strict=True)]
        return {
            Word.PRODUCT_STARTS: _starts(products),
            Word.PRODUCT_PLACES: _joined(places, np.int64),
            Word.PRODUCTS: _joined(products, np.float64),
        }


class _Matrices:
    """The unknowns of the matrices of a region, and the elements that depend on each of them."""

    def __init__(self, region: Region) -> None:
        self.elements = 0
        self.linear: list[tuple[Indices, Indices, Vector]] = []
        self.starts: list[int] = []
        self._owners: list[int] = [0]
        self._unknowns: list[int] = []
        self._elements: list[tuple[Indices, Indices, Indices, Vector]] = []
        for indices, coefficients, _ in region.groups:
            self.starts += [len(indices), len(region.rows) + self.elements, len(self._owners) - 1]
            for own, matrices in zip(indices, coefficients, strict=True):
                self._add(len(region.rows) + self.elements, own, matrices)

    def _add(self, first: int, own: Indices, coefficients: Tensor) -> None:
        width = coefficients.shape[-1]
        for k in np.argsort(own):  # so that those before one are in the lower triangle
            left, right = np.nonzero(coefficients[k])
            values = coefficients[k, left, right]
            self._unknowns.append(int(own[k]))
            self._elements.append((left * width + right, left * width, right * width, values))
            self.linear.append((first + left * width + right, np.full(len(left), own[k]), values))
        self._owners.append(len(self._unknowns))
        self.elements += width * width

    @property
    def arrays(self) -> dict[Word, npt.NDArray[Any]]:
        """What the method reads of them."""
        kinds = (np.int64, np.int64, np.int64, np.float64)
        parts = (_joined([one[k] for one in self._elements], kind) for k, kind in enumerate(kinds))
        words = Word.ELEMENTS, Word.LEFTS, Word.RIGHTS, Word.COEFFICIENTS
        return {
            Word.UNKNOWN_STARTS: np.array(self._owners, dtype=np.int64),
            Word.UNKNOWNS: np.array(self._unknowns, dtype=np.int64),
            Word.ELEMENT_STARTS: _starts([one[0] for one in self._elements]),
            **dict(zip(words, parts, strict=True)),
        }


def _by_rows(rows: Indices, columns: Indices, values: Vector, count: int) -> tuple[Indices, Indices, Vector]:
    """A sparse matrix of so many rows: where each begins, columns and values."""
    order = np.argsort(rows, kind="stable")
    starts = np.searchsorted(rows[order], np.arange(count + 1))
    return starts.astype(np.int64), columns[order].astype(np.int64), values[order]


def _starts(parts: Sequence[Vector | Indices]) -> Indices:
    """Return where each part begins in all of them joined, and where the last one ends."""
    return np.cumsum([0, *map(len, parts)], dtype=np.int64)


def _joined(parts: Sequence[Vector | Indices], kind: npt.DTypeLike) -> npt.NDArray[Any]:
    return np.concatenate([np.zeros(0, dtype=kind), *parts]).astype(kind)


def furthest(region: Region, rows: Matrix, weights: Matrix | None = None, enough: float = ENOUGH) -> Matrix:
    """Return where each row · y is largest in the region, to about a hundredth of the way to there.

    Mehrotra's predictor-corrector method (On the implementation of a primal-dual interior point method, SIAM Journal on
    Optimization 2, 1992) from y = 0, which should be near the analytic center. The search stops where the gap of
    duality is still `ENOUGH` of the way: from there the tangent of the central path leads to its end.

    Parameters
    ----------
    rows : (p, n)
    weights : (p, n), optional
        Where rows belong to ratios, 1 + weight · y tells how many times as large as at y = 0 the denominator is.
    enough : float
        In the place of `ENOUGH`; the hundredth is less in proportion.

    Returns
    -------
    (p, n)
        Ends of the path, outside of the region by about the same hundredth.
    """
    if not len(rows):
        return np.zeros_like(rows)
    functions = compiled(tuple(constants.shape[-1] for _, _, constants in region.groups))
    table, _ = region.table
    table = table.copy()
    numbers = np.array([1.0 / region.degree, enough, AHEAD * enough / ENOUGH])
    table[Word.NUMBERS] = address_of(numbers)
    problems = _Problems(region, rows, weights)
    center = _Room(region)
    functions.center(address_of(table), problems.addresses(0), center.address)
    for group in range(problems.count):
        functions.direct(address_of(table), problems.addresses(group), center.address)
    problems.begin()
    rooms = [center]

    def solve(groups: Sequence[int]) -> None:
        try:  # threads take rooms of others that have done with them
            room = rooms.pop()
        except IndexError:
            room = _Room(region)
        for group in groups:
            functions.furthest(address_of(table), problems.addresses(group), room.address)
        rooms.append(room)

    starts = range(0, problems.count, AT_ONCE)
    in_threads(solve, [range(start, min(start + AT_ONCE, problems.count)) for start in starts])
    return problems.ends()


class _Problems:
    """Rows, weights and ends of many problems, those of some side by side."""

    def __init__(self, region: Region, rows: Matrix, weights: Matrix | None) -> None:
        self._rows, self._lanes = rows, batch_lanes()
        self.count = -(-len(rows) // self._lanes)
        # The last one fills up the last group.
        self._of = np.minimum(np.arange(self.count * self._lanes), len(rows) - 1)
        self._size = int(region.table[0][Word.SIZE])
        self.row, self.weight = self._side_by_side(rows), self._side_by_side(weights)
        self.ahead, self.end = np.zeros_like(self.row), np.zeros_like(self.row)
        self.pull, self.width = (np.zeros((self.count, self._lanes)) for _ in range(2))
        parts = (self.row, self.weight, self.ahead, self.end, self.pull, self.width)
        self._addresses = np.array([[address_of(part[k]) for part in parts] for k in range(self.count)], dtype=np.int64)

    def _side_by_side(self, rows: Matrix | None) -> Tensor:
        found = np.zeros((self.count, self._size, self._lanes))
        if rows is not None:
            found[:, : rows.shape[1]] = rows[self._of].reshape(self.count, self._lanes, -1).swapaxes(1, 2)
        return found

    def _one_by_one(self, values: Tensor) -> Matrix:
        found = values.swapaxes(1, 2).reshape(-1, self._size)
        return np.asarray(found[: len(self._rows), : self._rows.shape[1]])

    def addresses(self, group: int) -> int:
        """Return where the addresses of the arrays of a group are."""
        return address_of(self._addresses[group])

    def begin(self) -> None:
        """Widths of the ellipsoid around the center, and where the search begins; none where the region has none."""
        squares = np.einsum("pi,pi->p", self._rows, self._one_by_one(self.ahead))
        with np.errstate(invalid="ignore"):
            widths = np.sqrt(np.maximum(squares, 0.0))
        solved = widths > SMALLEST * np.max(widths, initial=0.0)
        self.width.ravel()[:] = widths[self._of]
        self.pull.ravel()[:] = np.where(solved, widths / FIRST, 0.0)[self._of]

    def ends(self) -> Matrix:
        return self._one_by_one(self.end)


class _Room:
    """The memory of a search."""

    def __init__(self, region: Region) -> None:
        words, lanes = region.table[0], batch_lanes()
        size, cone = int(words[Word.SIZE]), int(words[Word.CONIC] + words[Word.BALL] + 1)
        # Products of a matrix need room for two.
        widest = max((2 * constants.shape[-1] ** 2 for _, _, constants in region.groups), default=0)
        lengths = [size] * len(UNKNOWN) + [max(cone, widest)] * len(CONE) + [1] * len(SINGLE) + [size * size]
        places = np.cumsum([0, *lengths]) * lanes
        self._memory = np.empty(int(places[-1]) + 8)
        # A register that is read from two lines of the cache takes twice as long.
        begin = -(-address_of(self._memory) // 64) * 64
        self._addresses = begin + 8 * places[:-1]
        self.address = address_of(self._addresses)
