"""The combination of neighbouring rows, compiled for this processor: one call for thousands of rows.

Neighbours are taken group by group, and what is computed of a group stays in the processor's cache until its rows were
written. Columns stand side by side in the registers. Those of a joint, and its torque behind them, fill whole registers
in the room: its *block*. Rows are written with whole registers, too, in ascending order, so that each is written over
what the one before it wrote too far.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from enum import IntEnum, auto
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from steelyard.graph.machine import batch_lanes, host_machine

from .batch_means import LONG

if TYPE_CHECKING:
    from steelyard.graph.loops import Array, Code, Condition, Index, Number

__all__ = ["AT_ONCE", "FEWEST", "LENGTH", "ORDERS", "Field", "Functions", "Word", "compiled"]

LENGTH = LONG
"""Neighbours that are combined, 64 ms at 1 kHz. A motion of 5 Hz is a cubic parabola there to some 0.1 %.
With 32 rows twice as many remain, with 128 a jump of friction, of which all rows are kept, costs twice as much."""

ORDERS, FINE = 4, 8
"""Polynomials, of degree 0 to 3, that take the place of a group where it is smooth; and where these tell too little."""

FEWEST = 2 * ORDERS
"""Rows of the neighbours that are used, at most, for which combinations are not worth while."""

AT_ONCE = 8
"""Groups whose regressor stands in memory together, so that the cache holds it: 0.2 MB for seven joints."""


class Word(IntEnum):
    """The words of the table that is given to each function: sizes, numbers that change, and addresses of arrays."""

    # Sizes.
    JOINT_COUNT = 0
    GROUPS = auto()
    WIDTH = auto()  # C
    BLOCKS = auto()  # numbers in the blocks of all joints
    UNEVEN = auto()  # U
    UNEVEN_VECTORS, TORQUE_VECTORS = auto(), auto()
    DENSE = auto()  # numbers of what was computed at every row, in whole registers
    STRIDE = auto()  # numbers in the largest block
    # What changes.
    BITS = auto()  # rows of the group that the joint uses
    DONE = auto()
    FIRST, SECOND = auto(), auto()  # row behind the first of two runs, and first row of the second
    UNTOLD_COUNT = auto()
    # Arrays: what is given,
    JOINTS = auto()  # records of `Field`
    Q, DQ, DDQ, TORQUE, USED, ENTRIES = auto(), auto(), auto(), auto(), auto(), auto()
    KERNEL, UNEVEN_KERNEL = auto(), auto()
    PLACES = auto()
    POSITIONS, SOURCES = auto(), auto()  # in the block, and among what was computed at every row
    LIMITS, INVERSE, TAILS = auto(), auto(), auto()
    EVEN_INVERSE, EVEN_TAILS = auto(), auto()
    DENSE_LIMITS, DENSE_INVERSE = auto(), auto()
    HALVES, PLACE_HALVES = auto(), auto()  # of polynomials over all rows, and of interpolation
    POLYNOMIALS = auto()  # by rows
    RUNS, RUN_NUMBERS, MAPS = auto(), auto(), auto()
    NUMBERS = auto()  # see `Constant`
    # what is found,
    UNTOLD = auto()
    NOISE, TORQUES, LACKING, WHOLE, SQUARES = auto(), auto(), auto(), auto(), auto()
    # and room.
    MOVED_DQ, MOVED_DDQ = auto(), auto()
    PLACE_Q, PLACE_DQ, PLACE_DDQ = auto(), auto(), auto()
    VALUES, UNEVEN_ROWS, TORQUE_ROWS = auto(), auto(), auto()
    COEFFICIENTS, LEFT, TAIL, OWN_SQUARES = auto(), auto(), auto(), auto()
    ALLOWED = auto()  # part of `LIMITS` that may be lost beside the noise of a joint
    DENSE_COEFFICIENTS, DENSE_SQUARES = auto(), auto()
    ROWS, WEIGHTS, PROJECTED, ROW_SQUARES, ROW_SUMS, LOST, USAGE, SUM = (auto() for _ in range(8))


class Field(IntEnum):
    """What is known of each joint."""

    COLUMN = 0  # first of its columns
    COUNT = auto()  # c
    PLACE = auto()  # of its block
    VECTORS = auto()  # registers of its block
    EVEN_VECTORS = auto()  # registers without its torque
    DENSE_COUNT = auto()  # its uneven columns, and the torque
    DENSE_VECTORS = auto()
    DENSE_PLACE = auto()  # among the limits of these
    DENSE_FIRST = auto()  # in `POSITIONS` and `SOURCES`
    TARGET = auto()  # address of the rows that are written
    TAKEN = auto()  # how many were
    SUMS = auto()  # address of the sums over each group


class Constant(IntEnum):
    """The numbers in `Word.NUMBERS`."""

    NOISE = 0  # share of the noise that may be lost
    FINEST = auto()  # share of a column that may be lost however little noise there is
    SMALLEST = auto()
    SHARE = auto()  # from such a share to a part of the limits
    VELOCITY, ACCELERATION = auto(), auto()  # what rounding leaves of a joint at rest


class Functions(NamedTuple):
    """Compiled functions of the address of a table, of the first group, and of the one behind the last.

    Attributes
    ----------
    from_places : callable
        Takes groups of which the regressor is computed at few rows; those that these do not tell are listed.
    from_rows : callable
        Takes `AT_ONCE` groups at most, whose regressor is given at all rows.
    """

    from_places: Callable[[int, int, int], None]
    from_rows: Callable[[int, int, int], None]


@cache
def compiled() -> Functions:
    """Return the functions for this processor."""
    loaded = host_machine(batch_lanes()).load_code(lambda code: _Combination(code).write(), Functions._fields)
    kinds = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64
    return Functions(*(loaded.function(name, *kinds) for name in Functions._fields))


class _Joint:
    """The record of a joint, whose number is known when the code runs."""

    def __init__(self, table: Array, number: Index) -> None:
        self.records, self.number = table.array(Word.JOINTS), number
        self.begin = number * len(Field)

    def __getitem__(self, field: Field) -> Index:
        return self.records.integer(self.begin + int(field))

    def address(self, field: Field) -> Array:
        return self.records.array(self.begin + int(field))

    def put(self, field: Field, value: Index) -> None:
        self.records.put_integer(self.begin + int(field), value)

    def block(self, table: Array, word: Word) -> Array:
        """Return where the block of the joint begins in an array."""
        return table.array(word).shared_at(self[Field.PLACE])


class _Combination:
    """The functions, each of which takes the table; integers are a joint, a group, and the place of this in memory."""

    def __init__(self, code: Code) -> None:
        self.code, self.lanes = code, code.lanes

    def write(self) -> None:
        self._project("project", squared=True)
        self._project("interpolate", squared=False)
        self._take_whole()
        self._measure()
        self._judge()
        for even in (True, False):
            self._take_runs(even)
            self._attempt(even)
        self._keep()
        self._fill()
        for even in (True, False):
            self._take(even)
        self._group_of_places()
        self._group_of_rows()
        self._from_places()
        self._from_rows()

    # Projections.

    def _project(self, name: str, squared: bool) -> None:
        """Products of polynomials with columns: those of even degree are symmetric, and those of odd degree not.

        So the sums and the differences of the first and the last row, and so on, have half of the products.
        """
        code, orders = self.code, [*range(0, FINE, 2), *range(1, FINE, 2)]
        arguments, integers = ("rows", "halves", "out", "squares"), "stride pairs vectors width"
        with code.function(name, *arguments, exported=False, integers=integers) as given:
            rows, halves, out, squares, stride, pairs, vectors, width = given
            for vector in code.range(vectors):
                column = vector * self.lanes
                with code.fold([0.0] * (FINE + squared), pairs) as loop:
                    top = rows.shared_at(loop.index * stride + column)[0]
                    low = rows.shared_at((pairs * 2 - 1 - loop.index) * stride + column)[0]
                    line = halves.shared_at(loop.index * FINE)
                    parts = [top + low] * ORDERS + [top - low] * ORDERS
                    loop.next = [
                        v + line.shared(k) * part for k, (v, part) in enumerate(zip(loop.values, parts, strict=False))
                    ]
                    if squared:
                        loop.next.append(loop.values[FINE] + top * top + low * low)
                for order, value in zip(orders, loop.values, strict=False):
                    out.shared_at(width * order + column)[0] = value
                if squared:
                    squares.shared_at(column)[0] = loop.values[FINE]

    # Groups that are taken as a whole.

    def _take_whole(self) -> None:
        """Write so many coefficients of a group as rows, and the sum over the group."""
        code = self.code
        with code.function("take_whole", "table", exported=False, integers="number group orders") as given:
            table, number, group, orders = given
            joint, width = _Joint(table, number), table.integer(Word.BLOCKS)
            block, torque = joint.block(table, Word.COEFFICIENTS), joint[Field.COUNT]
            for order in code.range(orders):
                row = self._next_row(joint)
                for vector in code.range(joint[Field.VECTORS]):
                    row[vector] = block.shared_at(order * width)[vector]
            for vector in code.range(joint[Field.VECTORS]):
                table.array(Word.SUM)[vector] = block[vector] * float(LENGTH) ** 0.5
            self._put_sums(joint, group, table.array(Word.SUM))
            with code.fold([joint.block(table, Word.LEFT).shared(torque)], orders, ORDERS) as loop:
                value = block.shared(loop.index * width + torque)
                loop.next = [loop.values[0] - value * value]
            self._lose(table, joint, loop.values[0])

    def _next_row(self, joint: _Joint) -> Array:
        """Return where the next row of a joint is written, and count it."""
        taken, width = joint[Field.TAKEN], joint[Field.COUNT] + 1
        joint.put(Field.TAKEN, taken + 1)
        return joint.address(Field.TARGET).shared_at(taken * width)

    def _put_sums(self, joint: _Joint, group: Index, sums: Array) -> None:
        width = joint[Field.COUNT] + 1
        self.code.copy(joint.address(Field.SUMS).shared_at(group * width), sums, width)

    def _lose(self, table: Array, joint: _Joint, square: Number) -> None:
        """Add what rows lack of the squares of the torques of a joint."""
        lacking = table.array(Word.LACKING)
        lacking.put(joint.number, lacking.shared(joint.number) + square)

    # Runs of rows.

    def _used(self, table: Array) -> tuple[Index, Index, Index, Index]:
        """Return the rows in use as bits, how many they are, the first one, and the one behind the last one."""
        bits = table.integer(Word.BITS)
        return bits, bits.count("ctpop"), bits.count("cttz"), self.code.known(LENGTH) - bits.count("ctlz")

    def _measure(self) -> None:
        """Project columns on the polynomials over a run of rows, the first or the second one."""
        code = self.code
        with code.function("measure", "table", exported=False, integers="vectors run begin end") as given:
            table, vectors, run, begin, end = given
            length, stride = end - begin, table.integer(Word.STRIDE)
            lines = table.array(Word.RUNS).shared_at(length * (length - 1) * (ORDERS // 2))
            width, rows = vectors * self.lanes, table.array(Word.ROWS)
            for vector in code.range(vectors):
                column = vector * self.lanes
                with code.fold([0.0] * ORDERS, length) as loop:
                    value = rows.shared_at((begin + loop.index) * width + column)[0]
                    line = lines.shared_at(loop.index * ORDERS)
                    loop.next = [v + line.shared(k) * value for k, v in enumerate(loop.values)]
                for order, found in enumerate(loop.values):
                    place = (run * ORDERS + order) * stride + column
                    table.array(Word.PROJECTED).shared_at(place)[0] = found

    def _judge(self) -> None:
        """Find what projections on so many runs lose, and whether it is little."""
        code = self.code
        with code.function("judge", "table", "limits", exported=False, integers="vectors runs") as given:
            table, limits, vectors, runs = given
            stride, projected = table.integer(Word.STRIDE), table.array(Word.PROJECTED)
            most = self._used(table)[1].number() * table.array(Word.ALLOWED).shared(0)
            with code.fold([0.0], vectors) as worst:
                vector = worst.index
                with code.fold([table.array(Word.ROW_SQUARES)[vector]], runs * ORDERS) as loop:
                    value = projected.shared_at(loop.index * stride)[vector]
                    loop.next = [loop.values[0] - value * value]
                lost = loop.values[0]
                table.array(Word.LOST)[vector] = lost
                worst.next = [(lost > most * limits[vector]).choose(1.0, worst.values[0])]
            table.put_integer(Word.DONE, 1)
            with code.when((worst.values[0] > 0.5).any()):
                table.put_integer(Word.DONE, 0)

    def _take_runs(self, even: bool) -> None:
        """Write the projections on one run or two as rows."""
        code, name = self.code, f"take_runs_{'even' if even else 'all'}"
        with code.function(name, "table", exported=False, integers="number group runs begin end") as given:
            table, number, group, runs, begin, end = given
            joint, width = _Joint(table, number), table.integer(Word.BLOCKS)
            block, stride = joint.block(table, Word.COEFFICIENTS), table.integer(Word.STRIDE)
            projected, sums = table.array(Word.PROJECTED), table.array(Word.ROW_SUMS)
            lost = joint[Field.DENSE_COUNT] - 1 if even else joint[Field.COUNT]
            self._lose(table, joint, table.array(Word.LOST).shared(lost))
            for run in code.range(runs):
                for order in code.range(ORDERS):
                    row, own = self._next_row(joint), projected.shared_at((run * ORDERS + order) * stride)
                    if even:
                        behind, second = table.integer(Word.FIRST), table.integer(Word.SECOND)
                        start, stop = begin + run * (second - begin), behind + run * (end - behind)
                        place = table.array(Word.RUN_NUMBERS).integer(start * (LENGTH + 1) + stop)
                        line = table.array(Word.MAPS).shared_at((place * ORDERS + order) * FINE)
                        self._mix(joint[Field.VECTORS], line, block, width, row)
                        self._scatter(table, joint, own, row)
                    else:
                        for vector in code.range(joint[Field.VECTORS]):
                            row[vector] = own[vector]
            if not even:
                self._put_sums(joint, group, sums)
                return
            usage, weights = table.array(Word.USAGE), table.array(Word.WEIGHTS)
            for register in range(FINE // self.lanes):
                with code.fold([0.0], LENGTH) as loop:
                    line = table.array(Word.POLYNOMIALS).shared_at(loop.index * FINE)
                    loop.next = [loop.values[0] + weights.shared(loop.index) * line[register]]
                usage[register] = loop.values[0]
            total = table.array(Word.SUM)
            self._mix(joint[Field.VECTORS], usage, block, width, total)
            self._scatter(table, joint, sums, total)
            self._put_sums(joint, group, total)

    def _mix(self, vectors: Index, factors: Array, block: Array, width: Index, out: Array) -> None:
        """Write the sum of all lines of a block times factors."""
        for vector in self.code.range(vectors):
            value = block[vector] * factors.shared(0)
            for k in range(1, FINE):
                value = value + block.shared_at(width * k)[vector] * factors.shared(k)
            out[vector] = value

    def _scatter(self, table: Array, joint: _Joint, values: Array, row: Array) -> None:
        """Write what was computed at every row into its places in a row."""
        positions, first = table.array(Word.POSITIONS), joint[Field.DENSE_FIRST]
        for k in self.code.range(joint[Field.DENSE_COUNT]):
            row.put(positions.integer(first + k), values.shared(k))

    def _attempt(self, even: bool) -> None:
        """Look for one run, or two, of which polynomials tell enough of the rows in `ROWS`."""
        code, name = self.code, f"attempt_{'even' if even else 'all'}"
        with code.function(name, "table", exported=False, integers="number group") as given:
            table, number, group = given
            joint = _Joint(table, number)
            vectors = joint[Field.DENSE_VECTORS if even else Field.VECTORS]
            words = (Word.DENSE_LIMITS, Word.DENSE_INVERSE) if even else (Word.LIMITS, Word.INVERSE)
            place = joint[Field.DENSE_PLACE if even else Field.PLACE]
            limits, inverse = (table.array(word).shared_at(place) for word in words)
            rows, width = table.array(Word.ROWS), vectors * self.lanes
            bits, count, begin, end = self._used(table)
            for vector in code.range(vectors):
                with code.fold([0.0, 0.0], end, begin) as loop:
                    value = rows.shared_at(loop.index * width)[vector]
                    loop.next = [loop.values[0] + value * value, loop.values[1] + value]
                table.array(Word.ROW_SQUARES)[vector], table.array(Word.ROW_SUMS)[vector] = loop.values
            table.put_integer(Word.DONE, 0)
            take = f"take_runs_{'even' if even else 'all'}"
            done = table.integer
            one_run = (end - begin).holds("eq", count)
            with code.when(one_run & count.holds("sgt", FEWEST) & count.holds("slt", LENGTH)):
                code.run("measure", table, vectors, 0, begin, end)
                code.run("judge", table, limits, vectors, 1)
                with code.when(done(Word.DONE).holds("eq", 1)):
                    table.put_integer(Word.FIRST, end)
                    table.put_integer(Word.SECOND, end)
                    code.run(take, table, number, group, 1, begin, end)
            code.leave_when(done(Word.DONE).holds("eq", 1) | count.holds("sle", 2 * FEWEST))
            # Rows that are not used separate two runs; else the largest step does.
            table.put_integer(Word.FIRST, 0)
            with code.when(~one_run):
                span = code.known(-1).bits("lshr", code.known(LENGTH) - (end - begin)).bits("shl", begin)
                gap = span.bits("xor", bits)
                table.put_integer(Word.FIRST, gap.count("cttz"))
                table.put_integer(Word.SECOND, code.known(LENGTH) - gap.count("ctlz"))
            with code.when(one_run), code.fold([0.0], end, begin + 1) as largest:
                row = largest.index
                with code.fold([0.0], vectors) as loop:
                    step = rows.shared_at(row * width)[loop.index] - rows.shared_at((row - 1) * width)[loop.index]
                    loop.next = [loop.values[0] + step * step * inverse[loop.index]]
                step = code.total(loop.values[0])
                with code.when((step > largest.values[0]).any()):
                    table.put_integer(Word.FIRST, row)
                    table.put_integer(Word.SECOND, row)
                largest.next = [step.above(largest.values[0])]
            first, second = table.integer(Word.FIRST), table.integer(Word.SECOND)
            both = (first - begin + end - second).holds("eq", count)
            code.leave_when(first.holds("eq", 0) | ~both)
            code.run("measure", table, vectors, 0, begin, first)
            code.run("measure", table, vectors, 1, second, end)
            code.run("judge", table, limits, vectors, 2)
            with code.when(done(Word.DONE).holds("eq", 1)):
                code.run(take, table, number, group, 2, begin, end)

    def _keep(self) -> None:
        """Write the rows in `ROWS` that are used as they are."""
        code = self.code
        with code.function("keep", "table", exported=False, integers="number group") as (table, number, group):
            joint, (bits, _, begin, end) = _Joint(table, number), self._used(table)
            vectors, rows = joint[Field.VECTORS], table.array(Word.ROWS)
            for k in code.range(end, begin):
                with code.when(bits.bits("lshr", k).bits("and", 1).holds("eq", 1)):
                    row = self._next_row(joint)
                    for vector in code.range(vectors):
                        row[vector] = rows.shared_at(k * vectors * self.lanes)[vector]
            self._put_sums(joint, group, table.array(Word.ROW_SUMS))

    def _fill(self) -> None:
        """Fill `ROWS`: with what was computed at every row; with all columns, by coefficients; with entries."""
        code = self.code
        for name in ("fill_dense", "fill_from_coefficients", "fill_from_entries"):
            with code.function(name, "table", exported=False, integers="number place") as (table, number, place):
                joint, width = _Joint(table, number), table.integer(Word.BLOCKS)
                block, entries = joint.block(table, Word.COEFFICIENTS), table.array(Word.ENTRIES)
                vectors = joint[Field.DENSE_VECTORS if name == "fill_dense" else Field.VECTORS]
                for k in code.range(LENGTH):
                    row = table.array(Word.ROWS).shared_at(k * vectors * self.lanes)
                    weight, number_of_row = table.array(Word.WEIGHTS).shared(k), place * LENGTH + k
                    if name == "fill_from_coefficients":
                        line = table.array(Word.POLYNOMIALS).shared_at(k * FINE)
                        self._mix(vectors, line, block, width, row)
                    else:
                        for vector in code.range(vectors):
                            row[vector] = 0.0
                    if name == "fill_from_entries":
                        given = entries.shared_at(number_of_row * table.integer(Word.WIDTH) + joint[Field.COLUMN])
                        for vector in code.range(joint[Field.EVEN_VECTORS]):
                            row[vector] = given[vector]
                    first, count = joint[Field.DENSE_FIRST], joint[Field.DENSE_COUNT] - 1
                    uneven, torques = table.array(Word.UNEVEN_ROWS), table.array(Word.TORQUE_ROWS)
                    positions, sources = table.array(Word.POSITIONS), table.array(Word.SOURCES)
                    if name != "fill_from_entries":
                        for i in code.range(count):
                            source = number_of_row * table.integer(Word.UNEVEN) + sources.integer(first + i)
                            at = i if name == "fill_dense" else positions.integer(first + i)
                            row.put(at, uneven.shared(source))
                    at = count if name == "fill_dense" else joint[Field.COUNT]
                    row.put(at, torques.shared(number_of_row * table.integer(Word.JOINT_COUNT) + number))
                    if name != "fill_dense":  # what stands behind the torque is another joint's
                        for i in code.range(vectors * self.lanes, joint[Field.COUNT] + 1):
                            row.put(i, 0.0)
                    for vector in code.range(vectors):
                        row[vector] = row[vector] * weight

    # The neighbours of one joint.

    def _worst(self, table: Array, joint: _Joint, word: Word, inverse: Word) -> Number:
        """Return the largest of what is lost, by what may be."""
        lost, factors = joint.block(table, word), joint.block(table, inverse)
        with self.code.fold([0.0], joint[Field.VECTORS]) as loop:
            loop.next = [(lost[loop.index] * factors[loop.index]).above(loop.values[0])]
        return loop.values[0]

    def _tells(self, table: Array, joint: _Joint, limits: Word) -> Condition:
        """Tell whether eight polynomials say all of the columns."""
        tail, most = joint.block(table, Word.TAIL), joint.block(table, limits)
        with self.code.fold([0.0], joint[Field.VECTORS]) as loop:
            loop.next = [(tail[loop.index] > most[loop.index]).choose(1.0, loop.values[0])]
        return ~(loop.values[0] > 0.5).any()

    def _take(self, even: bool) -> None:
        """Take the neighbours of a joint, of which coefficients are known, and what they leave."""
        code, name = self.code, f"take_{'even' if even else 'all'}"
        with code.function(name, "table", exported=False, integers="number group place") as given:
            table, number, group, place = given
            joint = _Joint(table, number)
            bits = table.array(Word.USED).bytes_set((number * table.integer(Word.GROUPS) + group) * LENGTH)
            table.put_integer(Word.BITS, bits)
            count = bits.count("ctpop")
            code.leave_when(count.holds("eq", 0))
            whole = count.holds("eq", LENGTH)
            worst = self._worst(table, joint, Word.LEFT, Word.INVERSE)
            smooth = self._worst(table, joint, Word.LEFT, Word.EVEN_INVERSE) if even else worst
            told = self._tells(table, joint, Word.TAILS)
            block, torque, width = joint.block(table, Word.COEFFICIENTS), joint[Field.COUNT], table.integer(Word.BLOCKS)
            with code.when(whole):
                squares, counts = joint.block(table, Word.SQUARES), table.array(Word.WHOLE)
                for vector in code.range(joint[Field.VECTORS]):
                    squares[vector] = squares[vector] + block[vector] * block[vector]
                counts.put_integer(number, counts.integer(number) + 1)
            simple = whole & ~(worst > float(LENGTH)).any()
            noise, torques, numbers = (table.array(word) for word in (Word.NOISE, Word.TORQUES, Word.NUMBERS))
            with code.when(simple):
                lacking = joint.block(table, Word.TAIL).shared(torque)
                kept = lacking
                for order in range(FINE):
                    value = block.shared(width * order + torque)
                    kept = kept + value * value
                noise.put(number, noise.shared(number) + lacking)
                torques.put(number, torques.shared(number) + kept)
            share = noise.shared(number) / torques.shared(number).above(numbers.shared(Constant.SMALLEST))
            share = (share * numbers.shared(Constant.NOISE)).above(numbers.shared(Constant.FINEST))
            allowed = (share * numbers.shared(Constant.SHARE)).below(1.0)
            table.array(Word.ALLOWED).put(0, allowed)
            fine = (smooth > allowed * float(LENGTH)).any()
            with code.when(simple & ~fine):
                code.run("take_whole", table, number, group, ORDERS)
            code.leave_when(simple & ~fine)
            # Where the regressor was computed at few rows, those tell the columns that are even.
            finely = simple & fine if even else simple & fine & told
            with code.when(finely):
                code.run("take_whole", table, number, group, FINE)
            code.leave_when(finely)
            for k in code.range(LENGTH):
                table.array(Word.WEIGHTS).put(k, bits.bits("lshr", k).bits("and", 1).number())
            if even:
                table.put_integer(Word.DONE, 0)
                with code.when(count.holds("sgt", FEWEST) & ~(smooth > count.number() * allowed).any()):
                    code.run("fill_dense", table, number, place)
                    code.run("attempt_even", table, number, group)
                code.leave_when(table.integer(Word.DONE).holds("eq", 1))
            with code.when(whole & told):
                code.run("take_whole", table, number, group, FINE)
            code.leave_when(whole & told)
            code.run("fill_from_coefficients" if even else "fill_from_entries", table, number, place)
            code.run("attempt_all", table, number, group)
            with code.when(table.integer(Word.DONE).holds("eq", 0)):
                code.run("keep", table, number, group)

    # Groups.

    def _joints(self, table: Array) -> Index:
        return table.integer(Word.JOINT_COUNT)

    def _project_torques(self, table: Array, place: Index) -> None:
        """Project the torques of a group."""
        count, width = self._joints(table), table.integer(Word.DENSE)
        first = table.integer(Word.UNEVEN_VECTORS) * self.lanes
        self.code.run(
            "project",
            table.array(Word.TORQUE_ROWS).shared_at(place * LENGTH * count),
            table.array(Word.HALVES),
            table.array(Word.DENSE_COEFFICIENTS).shared_at(first),
            table.array(Word.DENSE_SQUARES).shared_at(first),
            count,
            LENGTH // 2,
            table.integer(Word.TORQUE_VECTORS),
            width,
        )

    def _place_dense(self, table: Array, joint: _Joint, source: Index, position: Index) -> None:
        """Write the coefficients of what was computed at every row into a block, and what they leave."""
        width, stride = table.integer(Word.BLOCKS), table.integer(Word.DENSE)
        block, given = joint.block(table, Word.COEFFICIENTS), table.array(Word.DENSE_COEFFICIENTS)
        left = table.array(Word.DENSE_SQUARES).shared(source)
        for order in range(FINE):
            value = given.shared(stride * order + source)
            block.put(width * order + position, value)
            left = left - value * value
            if order == ORDERS - 1:
                joint.block(table, Word.LEFT).put(position, left)
        joint.block(table, Word.TAIL).put(position, left)

    def _group_of_places(self) -> None:
        """Take a group whose regressor was computed at few rows, unless it turns out that those do not tell all."""
        code = self.code
        with code.function("group_of_places", "table", exported=False, integers="group place") as given:
            table, group, place = given
            width, columns = table.integer(Word.BLOCKS), table.integer(Word.WIDTH)
            values = table.array(Word.VALUES).shared_at(place * columns * FINE)
            halves, joints = table.array(Word.PLACE_HALVES), self._joints(table)
            with code.fold([0.0], joints) as untold:
                joint = _Joint(table, untold.index)
                block, vectors = joint.block(table, Word.COEFFICIENTS), joint[Field.EVEN_VECTORS]
                given_columns = values.shared_at(joint[Field.COLUMN])
                code.run("interpolate", given_columns, halves, block, block, columns, FINE // 2, vectors, width)
                left, tail = joint.block(table, Word.LEFT), joint.block(table, Word.TAIL)
                most = joint.block(table, Word.EVEN_TAILS)
                with code.fold([untold.values[0]], vectors) as loop:
                    own = [block.shared_at(width * order)[loop.index] for order in range(ORDERS, FINE)]
                    last = own[2] * own[2] + own[3] * own[3]
                    left[loop.index] = own[0] * own[0] + own[1] * own[1] + last
                    tail[loop.index] = last
                    loop.next = [(last > most[loop.index]).choose(1.0, loop.values[0])]
                untold.next = [loop.values[0]]
            unknown = (untold.values[0] > 0.5).any()
            with code.when(unknown):
                count = table.integer(Word.UNTOLD_COUNT)
                table.array(Word.UNTOLD).put_integer(count, group)
                table.put_integer(Word.UNTOLD_COUNT, count + 1)
            code.leave_when(unknown)
            uneven = table.integer(Word.UNEVEN)
            code.run(
                "project",
                table.array(Word.UNEVEN_ROWS).shared_at(place * LENGTH * uneven),
                table.array(Word.HALVES),
                table.array(Word.DENSE_COEFFICIENTS),
                table.array(Word.DENSE_SQUARES),
                uneven,
                LENGTH // 2,
                table.integer(Word.UNEVEN_VECTORS),
                table.integer(Word.DENSE),
            )
            self._project_torques(table, place)
            positions, sources = table.array(Word.POSITIONS), table.array(Word.SOURCES)
            for number in code.range(joints):
                joint = _Joint(table, number)
                first = joint[Field.DENSE_FIRST]
                for k in code.range(joint[Field.DENSE_COUNT]):
                    self._place_dense(table, joint, sources.integer(first + k), positions.integer(first + k))
                code.run("take_even", table, number, group, place)

    def _group_of_rows(self) -> None:
        """Take a group whose regressor was computed at all rows."""
        code = self.code
        with code.function("group_of_rows", "table", exported=False, integers="group place") as given:
            table, group, place = given
            width, columns = table.integer(Word.BLOCKS), table.integer(Word.WIDTH)
            entries = table.array(Word.ENTRIES).shared_at(place * LENGTH * columns)
            self._project_torques(table, place)
            positions, sources = table.array(Word.POSITIONS), table.array(Word.SOURCES)
            for number in code.range(self._joints(table)):
                joint = _Joint(table, number)
                block, squares = joint.block(table, Word.COEFFICIENTS), table.array(Word.OWN_SQUARES)
                halves, vectors = table.array(Word.HALVES), joint[Field.EVEN_VECTORS]
                given_columns = entries.shared_at(joint[Field.COLUMN])
                code.run("project", given_columns, halves, block, squares, columns, LENGTH // 2, vectors, width)
                for vector in code.range(vectors):
                    lost = squares[vector]
                    for order in range(FINE):
                        value = block.shared_at(width * order)[vector]
                        lost = lost - value * value
                        if order == ORDERS - 1:
                            joint.block(table, Word.LEFT)[vector] = lost
                    joint.block(table, Word.TAIL)[vector] = lost
                last = joint[Field.DENSE_FIRST] + joint[Field.DENSE_COUNT] - 1
                self._place_dense(table, joint, sources.integer(last), positions.integer(last))
                code.run("take_all", table, number, group, place)

    def _moved(self, given: Array, moved: Array, count: Index, least: Number) -> None:
        """Copy a motion without what rounding leaves of a joint at rest."""
        for k in self.code.range(count, step=self.lanes):
            value = given.shared_at(k)[0]
            moved.shared_at(k)[0] = (value.size() < least).choose(0.0, value)

    def _copy_torques(self, table: Array, first: Index, count: Index) -> None:
        joints = self._joints(table)
        torque = table.array(Word.TORQUE).shared_at(first * LENGTH * joints)
        self.code.copy(table.array(Word.TORQUE_ROWS), torque, count * LENGTH * joints)

    def _from_places(self) -> None:
        code = self.code
        with code.function("from_places", "table", integers="first last") as (table, first, last):
            joints, numbers = self._joints(table), table.array(Word.NUMBERS)
            motion = [table.array(word) for word in (Word.Q, Word.DQ, Word.DDQ)]
            moved = [table.array(word) for word in (Word.MOVED_DQ, Word.MOVED_DDQ)]
            chosen = [table.array(word) for word in (Word.PLACE_Q, Word.PLACE_DQ, Word.PLACE_DDQ)]
            for block in code.range(last, first, AT_ONCE):
                count = (last - block).below(AT_ONCE)
                own = [one.shared_at(block * LENGTH * joints) for one in motion]
                size = count * LENGTH * joints
                self._moved(own[1], moved[0], size, numbers.shared(Constant.VELOCITY))
                self._moved(own[2], moved[1], size, numbers.shared(Constant.ACCELERATION))
                for k in code.range(count):
                    for place in code.range(FINE):
                        row = k * LENGTH + table.array(Word.PLACES).integer(place)
                        for source, target in zip([own[0], *moved], chosen, strict=True):
                            to = target.shared_at((k * FINE + place) * joints)
                            code.copy(to, source.shared_at(row * joints), joints)
                rows = count * FINE
                code.run(table.array(Word.KERNEL), rows, *chosen, table.array(Word.VALUES), rows)
                with code.when(table.integer(Word.UNEVEN).holds("sgt", 0)):
                    rows = count * LENGTH
                    target = table.array(Word.UNEVEN_ROWS)
                    code.run(table.array(Word.UNEVEN_KERNEL), rows, own[0], *moved, target, rows)
                self._copy_torques(table, block, count)
                for k in code.range(count):
                    code.run("group_of_places", table, block + k, k)

    def _from_rows(self) -> None:
        code = self.code
        with code.function("from_rows", "table", integers="first last") as (table, first, last):
            self._copy_torques(table, first, last - first)
            for group in code.range(last, first):
                code.run("group_of_rows", table, group, group - first)
