"""The interior-point method of `furthest`, compiled for this processor: several problems side by side.

It is written as for one problem. Values of the cone are arrays with one element for each line, then the elements of
each matrix, then the radius and the ball.
"""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum, auto
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from steelyard.graph.kernel import source_digest
from steelyard.graph.machine import batch_lanes, host_machine

if TYPE_CHECKING:
    from steelyard.graph.loops import Array, Code, Index, Number

__all__ = ["CONE", "SINGLE", "UNKNOWN", "Functions", "Word", "compiled"]

RIDGE = 1e-13
"""Relative to the diagonal of a Hessian, and added to it, so that directions in which nothing bounds the region leave a
matrix that has a factor."""

TO_BOUNDARY = 0.95
"""Part of the way to the boundary that a step goes at most."""

LIGHTEST = 1e-7
"""Least part of the denominator at the center by which the accuracy of a ratio is judged; below it, the end of the
tangent tells none."""

STEPS = 60
"""At most; four to nine are usual."""

UNROLLED = 6
"""Rows of matrices up to which their products are written without loops."""


class Word(IntEnum):
    """The words of the table that tells of a region and of the search; matrices of each size have `GROUP` more."""

    SIZE = 0  # unknowns, filled up to a multiple of four
    LINES = auto()
    CONIC = auto()  # elements of lines and matrices
    BALL = auto()  # elements of the ball, filled up to a multiple of four
    NUMBERS = auto()  # 1 / degree, enough, ahead
    CONSTANTS = auto()  # of the slacks
    STARTS, COLUMNS, VALUES = auto(), auto(), auto()  # lines and matrices by rows
    STARTS_T, COLUMNS_T, VALUES_T = auto(), auto(), auto()  # the same by columns
    ROWS, ROWS_T = auto(), auto()  # of the ball, and their transpose
    CURVATURE = auto()
    PRODUCT_STARTS, PRODUCT_PLACES, PRODUCTS = auto(), auto(), auto()  # what each line adds to a Hessian
    UNKNOWN_STARTS, UNKNOWNS = auto(), auto()  # of each matrix
    ELEMENT_STARTS, ELEMENTS, LEFTS, RIGHTS, COEFFICIENTS = auto(), auto(), auto(), auto(), auto()  # of each of these
    GROUPS = auto()  # of each size of matrices: how many, first element, first matrix


UNKNOWN = ("point", "along", "across", "affine", "centering", "step", "diagonal")
CONE = (
    *("slacks", "inverse", "duals", "dual_inverse", "change", "answer", "second"),
    *("products", "dual_products", "root", "work", "back", "middle"),
)
SINGLE = ("size", "length", "dual_length")
"""Arrays in memory of which a search has one each: of as many elements as there are unknowns, as the cone has, or one.
Behind them is the Hessian."""

Function = Callable[[int, int, int], None]


class Functions(NamedTuple):
    """Compiled functions. Each takes the addresses of a table, of the arrays of a problem, and of those of a search.

    Attributes
    ----------
    center : callable
        Factors the Hessian at y = 0, all in the arrays of the search.
    direct : callable
        Solves for the steps there.
    furthest : callable
        Searches from there.
    """

    center: Function
    direct: Function
    furthest: Function


@cache
def compiled(sizes: tuple[int, ...]) -> Functions:
    """Return the method for regions with groups of matrices of these sizes."""
    sources = source_digest(__file__)
    identity = None if sources is None else f"furthest {sources} {sizes}"  # since to write the source takes 40 ms
    loaded = host_machine(batch_lanes()).load_code(
        lambda code: _Method(code, sizes).write(), Functions._fields, identity
    )
    return Functions(*(loaded.function(name, *[ctypes.c_void_p] * 3) for name in Functions._fields))


class _Method:
    """The functions of the method, each of which takes the table and arrays."""

    def __init__(self, code: Code, sizes: tuple[int, ...]) -> None:
        self.code, self.sizes = code, sizes

    def write(self) -> None:
        self._change()
        self._adjoint()
        self._inverse()
        self._scaling()
        self._hessian()
        self._factor()
        self._solve("solve_one", 1)
        self._solve("solve_three", 3)
        self._response()
        self._products()
        self._longest()
        self._second()
        self._search()

    # Small parts.

    def _blocks(self, table: Array) -> Iterator[tuple[int, Index, Index]]:
        """Loop over matrices: their size, first element, and number."""
        for group, size in enumerate(self.sizes):
            count, first, number = (table.integer(Word.GROUPS + 3 * group + k) for k in range(3))
            for block in self.code.range(count):
                yield size, first + block * (size * size), number + block

    def _each(self, stop: Index | int, start: Index | int = 0) -> Iterator[Index]:
        """Loop over rows of a matrix, without a loop where they are few."""
        first, last = (one if isinstance(one, int) else one.value for one in (start, stop))
        if isinstance(first, int) and isinstance(last, int) and last <= UNROLLED:
            yield from (self.code.known(k) for k in range(first, last))
        else:
            yield from self.code.range(stop, start)

    def sum(self, stop: Index | int, term: Callable[[Index], Number], start: int = 0) -> Number:
        with self.code.fold([0.0], stop, start) as loop:
            loop.next = [loop.values[0] + term(loop.index)]
        return loop.values[0]

    def _small_sum(self, size: int, term: Callable[[Index], Number]) -> Number:
        if size > UNROLLED:
            return self.sum(size, term)
        found = term(self.code.known(0))
        for k in range(1, size):
            found = found + term(self.code.known(k))
        return found

    def _product(self, size: int, left: Array, right: Array, out: Array) -> None:
        for i in self._each(size):
            for j in self._each(size):
                out[i * size + j] = self._small_sum(size, lambda k: left[i * size + k] * right[k * size + j])  # noqa: B023

    def _symmetric_product(self, size: int, left: Array, right: Array, work: Array, out: Array, factor: float) -> None:
        """Write the symmetric part of a product times a factor."""
        self._product(size, left, right, work)
        for i in self._each(size):
            for j in self._each(size):
                out[i * size + j] = (work[i * size + j] + work[j * size + i]) * (0.5 * factor)

    def _ball(self, table: Array, values: Array) -> tuple[Array, Index]:
        """Return where the radius and the ball stand, and how many elements the ball has."""
        return values.at(table.integer(Word.CONIC)), table.integer(Word.BALL)

    def _rest(self, count: Index, a: Array, b: Array) -> Number:
        """Return the inner product of the elements behind the first one."""
        return self.sum(count + 1, lambda k: a[k] * b[k], 1)

    def _hyperbolic(self, count: Index, a: Array, b: Array) -> Number:
        """Return the product in which the first element counts positive, and all others negative."""
        return a[0] * b[0] - self._rest(count, a, b)

    def all_of(self, table: Array) -> Index:
        """Return how many elements a value of the cone has."""
        return table.integer(Word.CONIC) + table.integer(Word.BALL) + 1

    # Slacks of the cone, and what is linear in them.

    def _sparse(self, table: Array, words: tuple[Word, Word, Word], rows: Index, given: Array, out: Array) -> None:
        starts, columns, values = (table.array(word) for word in words)
        for row in self.code.range(rows):
            with self.code.fold([0.0], starts.integer(row + 1), starts.integer(row)) as loop:
                k = loop.index
                loop.next = [loop.values[0] + given[columns.integer(k)] * values.shared(k)]
            out[row] = loop.values[0]

    def _dense(self, rows: Array, count: Index, width: Index, given: Array, out: Array, adding: bool) -> None:
        """Write products with rows, four at a time."""
        for row in self.code.range(count, step=4):
            lines = [rows.shared_at((row + k) * width) for k in range(4)]
            with self.code.fold([0.0] * 4, width) as loop:
                value = given[loop.index]
                pairs = zip(loop.values, lines, strict=True)
                loop.next = [found + line.shared(loop.index) * value for found, line in pairs]
            for k, found in enumerate(loop.values):
                out[row + k] = out[row + k] + found if adding else found

    def _change(self) -> None:
        """By how much a step changes the slacks."""
        with self.code.function("change", "table", "step", "out", exported=False) as (table, step, out):
            size, (ball, count) = table.integer(Word.SIZE), self._ball(table, out)
            self._sparse(table, (Word.STARTS, Word.COLUMNS, Word.VALUES), table.integer(Word.CONIC), step, out)
            ball[0] = 0.0
            self._dense(table.array(Word.ROWS), count, size, step, ball.at(1), False)

    def _adjoint(self) -> None:
        """The transpose of `change`."""
        with self.code.function("adjoint", "table", "duals", "out", exported=False) as (table, duals, out):
            size, (ball, count) = table.integer(Word.SIZE), self._ball(table, duals)
            self._sparse(table, (Word.STARTS_T, Word.COLUMNS_T, Word.VALUES_T), size, duals, out)
            self._dense(table.array(Word.ROWS_T), size, count, ball.at(1), out, True)

    def _inverse(self) -> None:
        """The gradient of the barrier -Σ log - log det - ½ log (radius² - ‖ball‖²), but for its sign."""
        with self.code.function("inverse", "table", "values", "out", exported=False) as (table, values, out):
            for k in self.code.range(table.integer(Word.LINES)):
                out[k] = 1.0 / values[k]
            for size, first, _ in self._blocks(table):
                given, rest = values.at(first), out.at(first)
                for place in self.code.range(size * size):
                    rest[place] = given[place]
                # Gauss and Jordan, without a search for pivots: the matrices are positive definite.
                for pivot in self._each(size):
                    self._eliminate(size, rest, pivot)
            (ball, count), (flipped, _) = self._ball(table, values), self._ball(table, out)
            own = 1.0 / self._hyperbolic(count, ball, ball)
            flipped[0] = ball[0] * own
            for k in self.code.range(count + 1, 1):
                flipped[k] = -(ball[k] * own)

    def _eliminate(self, size: int, rest: Array, pivot: Index) -> None:
        row = rest.at(pivot * size)
        factor = 1.0 / row[pivot]
        row[pivot] = 1.0
        for j in self._each(size):
            row[j] = row[j] * factor
        for others in (self._each(pivot), self._each(size, pivot + 1)):
            for i in others:
                other = rest.at(i * size)
                part = other[pivot]
                other[pivot] = 0.0
                for j in self._each(size):
                    other[j] = other[j] - part * row[j]

    # The Newton system: the direction of Nesterov and Todd for lines and the ball, and for matrices that of Helmberg,
    # Rendl, Vanderbei and Wolkowicz, which needs no root of them.

    def _scaling(self) -> None:
        """The scaling of the ball: the root of its turn, its size, and the direction that it adds to the Hessian."""
        names = ("table", "slacks", "duals", "root", "size", "along", "work")
        with self.code.function("scaling", *names, exported=False) as (table, slacks, duals, root, size, along, work):
            (a, count), (b, _) = self._ball(table, slacks), self._ball(table, duals)
            own, other = self._hyperbolic(count, a, a), self._hyperbolic(count, b, b)
            first, second = 1.0 / own.root(), 1.0 / other.root()
            both = (a[0] * b[0] + self._rest(count, a, b)) * first * second
            half = 0.5 / ((both + 1.0) * 0.5).root()
            first, second = first * half, second * half
            root[0] = a[0] * first + b[0] * second
            for k in self.code.range(count + 1, 1):
                root[k] = a[k] * first - b[k] * second
            size[0] = (own / other).root()
            factor = (2.0 / size[0]).root()
            for k in self.code.range(count):
                work[k] = -(root[k + 1] * factor)
            self._dense(table.array(Word.ROWS_T), table.integer(Word.SIZE), count, work, along, False)

    def _hessian(self) -> None:
        """The lower triangle of the Hessian, without the direction that the ball adds; its upper one is not defined."""
        names = ("table", "inverse", "duals", "size", "work", "hessian")
        with self.code.function("hessian", *names, exported=False) as (table, inverse, duals, size, work, hessian):
            width, factor = table.integer(Word.SIZE), 1.0 / size[0]
            curvature = table.array(Word.CURVATURE)
            for i in self.code.range(width):
                row, given = hessian.at(i * width), curvature.shared_at(i * width)
                for j in self.code.range(i + 1):
                    row[j] = given.shared(j) * factor
            starts, places, products = (
                table.array(word) for word in (Word.PRODUCT_STARTS, Word.PRODUCT_PLACES, Word.PRODUCTS)
            )
            for k in self.code.range(table.integer(Word.LINES)):
                weight = inverse[k] * duals[k]
                for one in self.code.range(starts.integer(k + 1), starts.integer(k)):
                    place = places.integer(one)
                    hessian[place] = hessian[place] + products.shared(one) * weight
            owners, unknowns = table.array(Word.UNKNOWN_STARTS), table.array(Word.UNKNOWNS)
            begins, elements, lefts, rights, coefficients = (
                table.array(word)
                for word in (Word.ELEMENT_STARTS, Word.ELEMENTS, Word.LEFTS, Word.RIGHTS, Word.COEFFICIENTS)
            )
            for size_of, first, number in self._blocks(table):
                own, dual = inverse.at(first), duals.at(first)
                begin, end = owners.integer(number), owners.integer(number + 1)
                for i in self.code.range(end, begin):
                    row = hessian.at(unknowns.integer(i) * width)
                    for place in self.code.range(size_of * size_of):
                        work[place] = 0.0
                    for one in self.code.range(begins.integer(i + 1), begins.integer(i)):
                        value, left, right = coefficients.shared(one), lefts.integer(one), rights.integer(one)
                        left_row, right_row = own.at(left), dual.at(right)
                        for r in self._each(size_of):
                            scaled = left_row[r] * value
                            for s in self._each(size_of):
                                work[r * size_of + s] = work[r * size_of + s] + scaled * right_row[s]
                    for j in self.code.range(i + 1, begin):
                        with self.code.fold([0.0], begins.integer(j + 1), begins.integer(j)) as loop:
                            one = loop.index
                            loop.next = [loop.values[0] + work[elements.integer(one)] * coefficients.shared(one)]
                        at = unknowns.integer(j)
                        row[at] = row[at] + loop.values[0]

    def _factor(self) -> None:
        """Cholesky's factor in the place of the Hessian, by blocks of four columns, with inverted diagonal."""
        with self.code.function("factor", "table", "hessian", "diagonal", exported=False) as (table, hessian, diagonal):
            width = table.integer(Word.SIZE)
            for place in self.code.range(width):
                value = hessian[place * width + place] * (1.0 + RIDGE)
                hessian[place * width + place] = value
                diagonal[place] = value * RIDGE
            for column in self.code.range(width, step=4):
                lines = [hessian.at((column + k) * width) for k in range(4)]
                # Four rows on the diagonal; what stands above it is not used.
                for row in (column, column + 2):
                    pair = [hessian.at((row + k) * width) for k in range(2)]
                    for line, found in zip(pair, self._less(pair, lines, column), strict=True):
                        for j, one in enumerate(found):
                            line[column + j] = one
                block: dict[tuple[int, int], Number] = {}
                for i in range(4):
                    for j in range(i + 1):
                        value = lines[i][column + j]
                        for k in range(j):
                            value = value - block[i, k] * block[j, k]
                        if i == j:
                            # Where rounding leaves nothing of a pivot, the ridge is what it has.
                            least = diagonal[column + i]
                            value = 1.0 / value.above(least).root()
                        else:
                            value = value * block[j, j]
                        block[i, j] = value
                        lines[i][column + j] = value
                for row in self.code.range(width, column + 4, 2):
                    pair = [hessian.at((row + k) * width) for k in range(2)]
                    for line, found in zip(pair, self._less(pair, lines, column), strict=True):
                        for j in range(4):
                            value = found[j]
                            for k in range(j):
                                value = value - found[k] * block[j, k]
                            found[j] = value * block[j, j]
                            line[column + j] = found[j]

    def _less(self, rows: list[Array], lines: list[Array], column: Index) -> list[list[Number]]:
        """Return four columns of rows, less what the columns before them explain."""
        start = [row[column + k] for row in rows for k in range(4)]
        with self.code.fold(start, column) as loop:
            left = [row[loop.index] for row in rows]
            right = [line[loop.index] for line in lines]
            pairs = zip(loop.values, itertools.product(left, right), strict=True)
            loop.next = [value - a * b for value, (a, b) in pairs]
        return [loop.values[:4], loop.values[4:]]

    def _solve(self, name: str, count: int) -> None:
        """Divide vectors by the factor and by its transpose."""
        names = [f"x{k}" for k in range(count)]
        with self.code.function(name, "table", "hessian", *names, exported=False) as (table, hessian, *vectors):
            width = table.integer(Word.SIZE)
            for column in self.code.range(width, step=4):
                lines = [hessian.at((column + k) * width) for k in range(4)]
                start = [x[column + k] for x in vectors for k in range(4)]
                with self.code.fold(start, column) as loop:
                    values = [line[loop.index] for line in lines]
                    pairs = zip(loop.values, itertools.product([x[loop.index] for x in vectors], values), strict=True)
                    loop.next = [found - given * value for found, (given, value) in pairs]
                for number, x in enumerate(vectors):
                    found = loop.values[4 * number : 4 * number + 4]
                    for i in range(4):
                        for k in range(i):
                            found[i] = found[i] - lines[i][column + k] * found[k]
                        found[i] = found[i] * lines[i][column + i]
                        x[column + i] = found[i]
            for back in self.code.range(width, step=4):
                column = width - 4 - back
                lines = [hessian.at((column + k) * width) for k in range(4)]
                found_of = []
                for x in vectors:
                    found = [x[column + k] for k in range(4)]
                    for i in (3, 2, 1, 0):
                        for k in range(i + 1, 4):
                            found[i] = found[i] - lines[k][column + i] * found[k]
                        found[i] = found[i] * lines[i][column + i]
                        x[column + i] = found[i]
                    found_of.append(found)
                for before in self.code.range(column):
                    values = [line[before] for line in lines]
                    for x, found in zip(vectors, found_of, strict=True):
                        value = x[before]
                        for one, line_value in zip(found, values, strict=True):
                            value = value - one * line_value
                        x[before] = value

    def _response(self) -> None:
        """The change of duals that a change of slacks asks for; products of inverses and changes, on the way to it."""
        names = ("table", "inverse", "duals", "root", "size", "change", "products", "work", "out")
        with self.code.function("response", *names, exported=False) as arrays:
            table, inverse, duals, root, size, change, products, work, out = arrays
            for k in self.code.range(table.integer(Word.LINES)):
                out[k] = inverse[k] * duals[k] * change[k]
            for size_of, first, _ in self._blocks(table):
                own = products.at(first)
                self._product(size_of, inverse.at(first), change.at(first), own)
                self._symmetric_product(size_of, own, duals.at(first), work, out.at(first), 1.0)
            (given, count), (ball, _) = self._ball(table, change), self._ball(table, out)
            along = 2.0 * self._hyperbolic(count, root, given)
            factor = 1.0 / size[0]
            ball[0] = (along * root[0] - given[0]) * factor
            for k in self.code.range(count + 1, 1):
                ball[k] = (given[k] - along * root[k]) * factor

    def _products(self) -> None:
        """Products of the matrices of two values."""
        with self.code.function("products", "table", "left", "right", "out", exported=False) as arrays:
            table, left, right, out = arrays
            for size, first, _ in self._blocks(table):
                self._product(size, left.at(first), right.at(first), out.at(first))

    def _longest(self) -> None:
        """How many times a change can be added to a value inside the cone, at most 10; inverse · change is given."""
        names = ("table", "inverse", "value", "change", "products", "work", "out")
        with self.code.function("longest", *names, exported=False) as arrays:
            table, inverse, value, change, products, work, out = arrays
            with self.code.fold([-0.1], table.integer(Word.LINES)) as loop:
                loop.next = [(change[loop.index] * inverse[loop.index]).below(loop.values[0])]
            out[0] = loop.values[0]
            for size, first, _ in self._blocks(table):
                out[0] = self._least_eigenvalue(size, products.at(first), work).below(out[0])
            (ball, count), (given, _) = self._ball(table, value), self._ball(table, change)
            a, b = self._hyperbolic(count, given, given), self._hyperbolic(count, ball, given)
            c = self._hyperbolic(count, ball, ball)
            root = b * b - a * c
            # The first x with c + 2 b x + a x² = 0, inverted.
            first_root = (root > 0.0).choose((root.above(0.0).root() - b) / c, 0.0)
            out[0] = 1.0 / first_root.above(-out[0])

    def _least_eigenvalue(self, size: int, product: Array, work: Array) -> Number:
        """A bound from below, a close one, of the eigenvalues of a matrix whose eigenvalues are all real.

        Laguerre's method on its characteristic polynomial, whose coefficients are those of traces of powers (Newton's
        identities), begun below all of them, approaches the least one without passing it.
        """
        sums = [self._small_sum(size, lambda k: product[k * (size + 1)])]
        power = product
        for degree in range(2, size + 1):
            if degree == size:
                sums.append(self._trace(size, power, product))
                break
            following = work.at((degree % 2) * size * size)
            self._product(size, power, product, following)
            power = following
            sums.append(self._small_sum(size, lambda k, at=power: at[k * (size + 1)]))  # type: ignore[misc]
        coefficients = [self.code.number(1.0)]
        for k in range(1, size + 1):
            total = coefficients[k - 1] * sums[0]
            for j in range(2, k + 1):
                total = total + coefficients[k - j] * sums[j - 1]
            coefficients.append(total * (-1.0 / k))
        mean = sums[0] * (1.0 / size)
        # No eigenvalue is less (Wolkowicz and Styan, Bounds for eigenvalues using traces, 1980).
        found = mean - ((sums[1] * (1.0 / size) - mean * mean).above(0.0) * (size - 1.0)).root()
        found = found - found.size() * 1e-9
        sign = 1.0 if size % 2 == 0 else -1.0
        for _ in range(2):
            value, slope, bend = self.code.number(1.0), self.code.number(0.0), self.code.number(0.0)
            for coefficient in coefficients[1:]:
                bend = bend * found + slope
                slope = slope * found + value
                value = value * found + coefficient
            first = slope / value
            second = first * first - 2.0 * bend / value
            root = ((size * second - first * first) * (size - 1.0)).above(0.0).root()
            step = float(size) / (first - root)
            sound = (value * sign > 0.0) & (slope * sign < 0.0) & step.is_finite()
            found = found - sound.choose(step, 0.0)
        return found

    def _trace(self, size: int, left: Array, right: Array) -> Number:
        """Return the trace of a product."""

        def of_row(i: Index) -> Number:
            return self._small_sum(size, lambda j: left[i * size + j] * right[j * size + i])

        return self._small_sum(size, of_row)

    def _boosted(self, root: Array, turn: float, count: Index, factor: Number, values: Array, out: Array) -> None:
        """The hyperbolic rotation that takes (1, 0) to the root, turned back where `turn` is -1, of values."""
        along = self._rest(count, root, values) * turn
        first = (values[0] + along / (root[0] + 1.0)) * (factor * turn)
        out[0] = (root[0] * values[0] + along) * factor
        for k in self.code.range(count + 1, 1):
            out[k] = values[k] * factor + root[k] * first

    def _second(self) -> None:
        """What the product of both changes adds to the duals (Mehrotra)."""
        names = ("table", "inverse", "duals", "root", "size", "change", "products", "answer", "a", "b", "c", "out")
        with self.code.function("second", *names, exported=False) as arrays:
            table, inverse, duals, root, size, change, products, answer, scaled, back, middle, out = arrays
            for k in self.code.range(table.integer(Word.LINES)):
                out[k] = -(change[k] * answer[k] * inverse[k])
            for size_of, first, _ in self._blocks(table):
                pair = products.at(first), answer.at(first)
                self._symmetric_product(size_of, *pair, scaled, out.at(first), -1.0)
            count, forth = table.integer(Word.BALL), size[0].root()
            self._boosted(root, -1.0, count, 1.0 / forth, self._ball(table, change)[0], scaled)
            self._boosted(root, 1.0, count, forth, self._ball(table, answer)[0], back)
            self._boosted(root, 1.0, count, forth, self._ball(table, duals)[0], middle)
            inner = scaled[0] * back[0] + self._rest(count, scaled, back)
            a, b = scaled[0], back[0]
            for k in self.code.range(count + 1, 1):
                scaled[k] = a * back[k] + b * scaled[k]
            scaled[0] = inner
            top = self._hyperbolic(count, middle, scaled) / self._hyperbolic(count, middle, middle)
            factor = 1.0 / middle[0]
            for k in self.code.range(count + 1, 1):
                scaled[k] = (scaled[k] - middle[k] * top) * factor
            scaled[0] = top
            ball = self._ball(table, out)[0]
            self._boosted(root, -1.0, count, -1.0 / forth, scaled, ball)

    # The search.

    def _search(self) -> None:
        with self._searching("center") as search:
            search.begin()
            search.factor()
            search.copy(search.n, "across", search["along"])
            search.run("solve_one", search.hessian, search["across"])
        with self._searching("direct") as search:
            search.copy(search.n, search.ahead, search.row)
            search.run("solve_one", search.hessian, search.ahead)
            search.without_along(search.ahead)
        with self._searching("furthest") as search:
            self._furthest(search)

    @contextmanager
    def _searching(self, name: str) -> Iterator[_Search]:
        with self.code.function(name, "table", "problem", "room") as arrays:
            yield _Search(self, *arrays)

    def _furthest(self, search: _Search) -> None:
        """Mehrotra's method; see `furthest`."""
        code, n, everything, row = self.code, search.n, search.everything, search.row
        inverse, duals, change, answer = (search[name] for name in ("inverse", "duals", "change", "answer"))
        point, affine, centering, step = (search[name] for name in ("point", "affine", "centering", "step"))
        pull, found, second = search.pull[0], search.found, search["second"]
        active = pull > 0.0
        inverted = active.choose(1.0 / pull, 0.0)
        search.fill(n, found, lambda _: code.number(0.0))
        search.begin()
        search.run("scaling", search["slacks"], duals, *search.scaling, search["along"], search["work"])
        search.fill(n, point, lambda k: search.ahead[k] * inverted)
        search.run("change", point, change)
        search.respond()
        search.fill(everything, duals, lambda k: (duals[k] - answer[k]) * pull)
        with code.fold([active.choose(1.0, 0.0)], STEPS) as loop:
            active = loop.values[0] > 0.0
            search.measure()
            search.factor()
            gap = self.sum(everything, lambda k: search["slacks"][k] * duals[k])
            search.copy(n, affine, row)
            search.run("adjoint", inverse, centering)
            search.copy(n, "across", search["along"])
            search.run("solve_three", search.hessian, affine, centering, search["across"])
            search.without_along(affine)
            search.without_along(centering)
            total = self.sum(n, lambda k: (point[k] + affine[k]).size())
            active = active & gap.is_finite() & total.is_finite()
            search.fill(n, found, lambda k: active.choose(point[k] + affine[k], found[k]))
            way = search.dot(row, found).above(search.width[0])
            way = way * (search.dot(search.weight, found) + 1.0).above(LIGHTEST).below(1.0)
            rest = search.dot(row, affine)
            enough = (way * search.numbers.shared(k) for k in (1, 2))
            active = active & ((gap > next(enough)) | (rest > next(enough)))
            code.leave(active)

            search.run("change", affine, change)
            search.respond()
            search.fill(everything, answer, lambda k: -(duals[k] + answer[k]))
            search.run("inverse", duals, search["dual_inverse"])
            length, dual_length = search.lengths()
            away = 1.0 - length.below(dual_length).below(1.0)
            target = away * away * away * gap * search.numbers.shared(0)
            rooms = (search[name] for name in ("work", "back", "middle"))
            search.run("second", inverse, duals, *search.scaling, change, search["products"], answer, *rooms, second)
            search.run("adjoint", second, step)
            search.run("solve_one", search.hessian, step)
            search.without_along(step)
            search.fill(n, step, lambda k: affine[k] + target * centering[k] + step[k])
            search.run("change", step, change)
            search.respond()
            search.fill(everything, answer, lambda k: target * inverse[k] - duals[k] - answer[k] + second[k])
            length, dual_length = search.lengths()
            part = active.choose((length * TO_BOUNDARY).below(1.0), 0.0)
            search.fill(n, point, lambda k: point[k] + part * step[k])
            dual_part = active.choose((dual_length * TO_BOUNDARY).below(1.0), 0.0)
            search.fill(everything, duals, lambda k: duals[k] + dual_part * answer[k])
            loop.next = [active.choose(1.0, 0.0)]


class _Search:
    """The arrays of one of the functions that are called from Python, and what is done with them more than once."""

    def __init__(self, method: _Method, table: Array, problem: Array, room: Array) -> None:
        self.method, self.code, self.table = method, method.code, table
        self.row, self.weight, self.ahead, self.found, self.pull, self.width = (problem.array(k) for k in range(6))
        names = (*UNKNOWN, *CONE, *SINGLE)
        self._arrays = {name: room.array(k) for k, name in enumerate(names)}
        self.hessian = room.array(len(names))
        self.n, self.everything = table.integer(Word.SIZE), method.all_of(table)
        self.numbers = table.array(Word.NUMBERS)
        self.scaling = self["root"], self["size"]

    def __getitem__(self, name: str) -> Array:
        return self._arrays[name]

    def run(self, name: str, *arrays: Array) -> None:
        self.code.run(name, self.table, *arrays)

    def fill(self, count: Index, out: Array, term: Callable[[Index], Number]) -> None:
        for k in self.code.range(count):
            out[k] = term(k)

    def copy(self, count: Index, out: Array | str, given: Array) -> None:
        self.fill(count, self[out] if isinstance(out, str) else out, lambda k: given[k])

    def dot(self, one: Array, other: Array) -> Number:
        return self.method.sum(self.n, lambda k: one[k] * other[k])

    def begin(self) -> None:
        """The values at the center, and duals on the central path."""
        self.fill(self.n, self["point"], lambda _: self.code.number(0.0))
        self.measure()
        self.copy(self.everything, "duals", self["inverse"])

    def measure(self) -> None:
        """Slacks and their inverse."""
        slacks, constants = self["slacks"], self.table.array(Word.CONSTANTS)
        self.run("change", self["point"], slacks)
        self.fill(self.everything, slacks, lambda k: slacks[k] + constants.shared(k))
        self.run("inverse", slacks, self["inverse"])

    def factor(self) -> None:
        self.run("scaling", self["slacks"], self["duals"], *self.scaling, self["along"], self["work"])
        self.run("hessian", self["inverse"], self["duals"], self["size"], self["work"], self.hessian)
        self.run("factor", self.hessian, self["diagonal"])

    def respond(self) -> None:
        """The answer of the duals to a change."""
        rooms = (self[name] for name in ("change", "products", "work", "answer"))
        self.run("response", self["inverse"], self["duals"], *self.scaling, *rooms)

    def without_along(self, solved: Array) -> None:
        """Take account of the direction that the ball adds to the Hessian."""
        across = self["across"]
        factor = self.dot(self["along"], solved) / (self.dot(self["along"], across) + 1.0)
        self.fill(self.n, solved, lambda k: solved[k] - factor * across[k])

    def lengths(self) -> tuple[Number, Number]:
        """Return how often change and answer can be added."""
        self.run("products", self["dual_inverse"], self["answer"], self["dual_products"])
        for names in (
            ("inverse", "slacks", "change", "products", "work", "length"),
            ("dual_inverse", "duals", "answer", "dual_products", "work", "dual_length"),
        ):
            self.run("longest", *(self[name] for name in names))
        return self["length"][0], self["dual_length"][0]
