"""Neighbouring rows of long data, replaced by their projections on a few polynomials of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.functions import RESIDUE_ACCELERATION, RESIDUE_VELOCITY
from steelyard.graph.machine import address_of, batch_lanes

from .neighbor_code import AT_ONCE, FINE, LENGTH, ORDERS, Constant, Field, Word, compiled

if TYPE_CHECKING:
    from steelyard.dynamics.functions import BaseColumns

__all__ = ["CombinedRows", "NeighborCombinations", "RegressorSource", "SmoothMotion"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LARGEST_SHARE = 1e-3
"""Share of the mean square of a column that may be lost. Of a motion it is 1e-5 and less. A jump of the sign of a
velocity, even right before the last of the neighbours, has 5 %: of such neighbours every row is kept."""

LARGEST_NOISE = 0.02
"""Share of the noise's mean square that what is lost of the torques may have, if they lose what the worst of the
columns does: standard errors then grow by 1 %. On logs of 3.5 Hz with 0.3 % of noise 3 to 12 % remain, of what all
polynomials lose; before, it was 14 to 25 %.
Neighbours that would lose more have as many polynomials as there are `PLACES`, and twice as many rows; where a column
jumps, every row is kept. The noise is what so many polynomials leave of the torques: four leave much of a motion of
8 Hz, and taken for noise it hid a loss eight times as large as the noise."""

FINEST_SHARE = 1e-12
"""Share of the mean square of a column that may be lost however little noise there is."""

ROUNDING = 1e-20
"""Mean square of a column, relative to the largest of its joint, below which it is but rounding errors."""

SMALLEST = float(np.finfo(np.float64).tiny)
"""Stands for the limit of a joint whose columns are all zero, where limits are divided by."""

ROOM = 2**23
"""Numbers of rows that are written at a time, at most, where all are kept: 64 MB, of which only those are touched."""

PLACES = (0, 4, 13, 25, 38, 50, 59, 63)
"""The places among `LENGTH` neighbours at which the even columns are computed: Lobatto's points, rounded, so that what
lies beyond degree 7 hardly shows in the projections, and a jump between any two rows does. They are at most 13 rows
apart, two gaps of a log at least 30."""

LARGEST_TAIL = 1e-8
"""Share of the mean square of a column that its two highest degrees may have, so that eight places tell all of it: what
lies beyond is then some 1e-5 of the column. Motions of the WAM filtered at 4.8 Hz have 3e-12 in the median and 2e-9 at
most; white noise has a quarter."""


@dataclass(frozen=True, eq=False)
class CombinedRows:
    """Combinations that replace the rows ``[W omega]`` of one joint.

    Attributes
    ----------
    rows : ndarray
        (r, c + 1), of about the same triangular factor.
    count : int
        How many rows they stand for.
    sums : ndarray
        (samples / `LENGTH`, c + 1), the sum over all neighbours.
    """

    rows: Array
    count: int
    sums: Array


@dataclass(frozen=True)
class SmoothMotion:
    """A motion that a filter has made smooth, so that few of its rows tell most columns of the base regressor.

    Attributes
    ----------
    q, dq, ddq : ndarray
        (S, N), C-contiguous.
    """

    q: Array
    dq: Array
    ddq: Array
    columns: BaseColumns


@dataclass(frozen=True)
class RegressorSource:
    """A source of the base regressor of samples: of all entries or, where the motion is smooth, of as many as suffice.

    Attributes
    ----------
    entries : callable
        Returns all entries of a slice of the samples, (samples, C), for one that may be overwritten by the next call.
    motion : SmoothMotion or None
        None where it would save nothing.
    """

    entries: Callable[[slice], Array]
    motion: SmoothMotion | None = None


class NeighborCombinations:
    """Combines neighbouring rows, 64 to four, where these say the same of the parameters.

    The regressor is a function of the motion, which a filter has made smooth: over a few samples its columns are
    polynomials, and all that the rows tell of the parameters is in their projections on an orthonormal basis of those.
    It is a linear map of the whole regression, so that it biases nothing; white noise stays white, with the same
    variance; and the squares of the torques stay the same, since what the projections lack of them, which is noise, is
    one further row. Neighbours of which some are masked have polynomials over the others, and where a column jumps, as
    by friction, there are polynomials before and behind the jump. Where a column is still no polynomial, all rows are
    kept.

    Columns that are polynomials, sines and cosines of the motion are computed at eight of the neighbours only, unless
    they turn out not to be polynomials of degree 7 there.

    Parameters
    ----------
    widths : sequence of int
        How many columns of the regressor belong to each joint.
    squares : ndarray
        (C,) mean squares of all columns so far, with which what is lost is compared.
    """

    def __init__(self, widths: Sequence[int], squares: Array) -> None:
        self.ends: NDArray[np.intp] = np.cumsum(widths)
        self.starts: NDArray[np.intp] = self.ends - np.array(widths, dtype=np.intp)
        self.squares = squares
        self._owner = np.repeat(np.arange(len(widths)), widths)
        self._work: _Work | None = None

    def combined(self, source: RegressorSource, torque: Array, mask: NDArray[np.bool_] | None) -> list[CombinedRows]:
        """Combine the rows of each joint: torque and mask are (S, N), S a multiple of `LENGTH`."""
        columns = None if source.motion is None else source.motion.columns
        if self._work is None or self._work.columns is not columns:
            self._work = _Work(self.starts, self.ends, columns, self._work)
        work, groups = self._work, len(torque) // LENGTH
        work.limit(self._limits(work))
        shape = len(self.starts), groups, LENGTH
        used = np.ones(shape, bool) if mask is None else np.ascontiguousarray(mask.T).reshape(shape)
        torque = np.ascontiguousarray(torque, np.float64)
        counts, lacking = [int(np.count_nonzero(own)) for own in used], work.lacking
        sums = [np.zeros((groups, end - begin + 1)) for begin, end in zip(self.starts, self.ends, strict=True)]
        lacking[:] = 0.0
        parts = [slice(start, min(start + work.groups, groups)) for start in range(0, groups, work.groups)]
        taken = []
        for part in parts:
            work.combine(source, torque, used, sums, part)
            taken.append(work.taken(room=part.stop == groups))
        rows = [own[0] if len(own) == 1 else np.concatenate(own) for own in zip(*taken, strict=True)]
        for own, lost in zip(rows, lacking.tolist(), strict=True):
            own[-1, -1] = np.sqrt(max(lost, 0.0))
        return [CombinedRows(*one) for one in zip(rows, counts, sums, strict=True)]

    def _limits(self, work: _Work) -> Array:
        """Return the mean square that each column may lose, (C,)."""
        squares = np.maximum(self.squares, work.mean_squares())
        largest = np.maximum.reduceat(squares, self.starts)
        return np.asarray(LARGEST_SHARE * np.maximum(squares, ROUNDING * largest[self._owner]))


class _Work:
    """The table of the compiled functions, and the arrays whose addresses stand in it.

    The columns of each joint are those from `starts` to `ends`, (N,). With `columns` motions are smooth, and `before`
    is what was known of the columns.
    """

    def __init__(
        self, starts: NDArray[np.intp], ends: NDArray[np.intp], columns: BaseColumns | None, before: _Work | None
    ) -> None:
        self.columns = columns
        lanes, joints, width = batch_lanes(), len(starts), int(ends[-1])
        uneven = np.empty(0, np.intp) if columns is None else columns.uneven
        self.table, self._held = np.zeros(len(Word), np.int64), dict[Word, NDArray[np.generic]]()
        self.joints = np.zeros((joints, len(Field)), np.int64)

        def registers(count: NDArray[np.intp] | int) -> NDArray[np.intp]:
            return np.asarray(-(-np.asarray(count) // lanes))

        counts = ends - starts
        sizes = lanes * registers(counts + 1)
        places = np.cumsum(sizes) - sizes
        blocks = int(sizes.sum())
        self._block_of = np.repeat(places - starts, counts) + np.arange(width)
        spans = list(zip(starts, ends, strict=True))
        mine = [np.flatnonzero((uneven >= begin) & (uneven < end)) for begin, end in spans]
        dense = np.array([len(own) + 1 for own in mine])
        dense_sizes = lanes * registers(dense)
        behind_uneven = lanes * int(registers(len(uneven)))
        for field, values in {
            Field.COLUMN: starts,
            Field.COUNT: counts,
            Field.PLACE: places,
            Field.VECTORS: sizes // lanes,
            Field.EVEN_VECTORS: registers(counts),
            Field.DENSE_COUNT: dense,
            Field.DENSE_VECTORS: dense_sizes // lanes,
            Field.DENSE_PLACE: np.cumsum(dense_sizes) - dense_sizes,
            Field.DENSE_FIRST: np.cumsum(dense) - dense,
        }.items():
            self.joints[:, field] = values
        stride = int(max(sizes.max(), dense_sizes.max()))
        for word, size in {
            Word.JOINT_COUNT: joints,
            Word.WIDTH: width,
            Word.BLOCKS: blocks,
            Word.UNEVEN: len(uneven),
            Word.UNEVEN_VECTORS: behind_uneven // lanes,
            Word.TORQUE_VECTORS: int(registers(joints)),
            Word.DENSE: behind_uneven + lanes * int(registers(joints)),
            Word.STRIDE: stride,
        }.items():
            self.table[word] = size
        positions = [
            np.append(uneven[own] - begin, end - begin) for own, begin, end in zip(mine, starts, ends, strict=True)
        ]
        sources = [np.append(own, behind_uneven + joint) for joint, own in enumerate(mine)]
        self._even = np.ones(width, bool)
        self._even[uneven] = False
        self._dense_of = np.concatenate(
            [place + np.arange(len(own)) for place, own in zip(self.joints[:, Field.DENSE_PLACE], mine, strict=True)]
        ).astype(np.intp)
        self._uneven = uneven
        tables = _tables()
        for word, array in {
            Word.JOINTS: self.joints,
            Word.POSITIONS: np.concatenate(positions).astype(np.int64),
            Word.SOURCES: np.concatenate(sources).astype(np.int64),
            Word.PLACES: np.array(PLACES, np.int64),
            Word.HALVES: tables.halves,
            Word.PLACE_HALVES: tables.place_halves,
            Word.POLYNOMIALS: tables.polynomials,
            Word.RUNS: tables.runs,
            Word.RUN_NUMBERS: tables.numbers,
            Word.MAPS: tables.maps,
            Word.NUMBERS: _constants(),
        }.items():
            self._hold(word, array)
        self.noise = np.zeros((2, joints))  # squares of what groups leave of the torques, and of the torques
        self.lacking, self.whole, self._totals = np.zeros(joints), np.zeros(joints, np.int64), np.zeros(blocks)
        if before is not None:
            self.noise[:], self.whole[:], self._totals[:] = before.noise, before.whole, before._totals
        for word, array in {
            Word.NOISE: self.noise[0],
            Word.TORQUES: self.noise[1],
            Word.LACKING: self.lacking,
            Word.WHOLE: self.whole,
            Word.SQUARES: self._totals,
        }.items():
            self._hold(word, array)
        rows = AT_ONCE * LENGTH
        for word, size in {
            Word.LIMITS: blocks,
            Word.INVERSE: blocks,
            Word.TAILS: blocks,
            Word.EVEN_INVERSE: blocks,
            Word.EVEN_TAILS: blocks,
            Word.DENSE_LIMITS: int(dense_sizes.sum()),
            Word.DENSE_INVERSE: int(dense_sizes.sum()),
            Word.MOVED_DQ: rows * joints,
            Word.MOVED_DDQ: rows * joints,
            Word.PLACE_Q: AT_ONCE * FINE * joints,
            Word.PLACE_DQ: AT_ONCE * FINE * joints,
            Word.PLACE_DDQ: AT_ONCE * FINE * joints,
            Word.VALUES: AT_ONCE * FINE * width if columns is not None else 0,
            Word.ENTRIES: rows * width,
            Word.UNEVEN_ROWS: rows * len(uneven),
            Word.TORQUE_ROWS: rows * joints,
            Word.COEFFICIENTS: FINE * blocks,
            Word.LEFT: blocks,
            Word.TAIL: blocks,
            Word.OWN_SQUARES: stride,
            Word.ALLOWED: 1,
            Word.DENSE_COEFFICIENTS: FINE * int(self.table[Word.DENSE]),
            Word.DENSE_SQUARES: int(self.table[Word.DENSE]),
            Word.ROWS: LENGTH * stride,
            Word.WEIGHTS: LENGTH,
            Word.PROJECTED: 2 * ORDERS * stride,
            Word.ROW_SQUARES: stride,
            Word.ROW_SUMS: stride,
            Word.LOST: stride,
            Word.USAGE: FINE,
            Word.SUM: stride,
        }.items():
            self._hold(word, np.zeros(size + lanes))  # registers reach beyond what is used
        if columns is not None:
            self.table[Word.KERNEL] = columns.kernel.batch_address
            self.table[Word.UNEVEN_KERNEL] = columns.uneven_kernel.batch_address if len(uneven) else 0
        self.groups = max(ROOM // (LENGTH * int((counts + 1).sum())), 1)
        self._target: list[Array] = []

    def _hold(self, word: Word, array: NDArray[np.generic]) -> None:
        self._held[word], self.table[word] = array, address_of(array)

    def mean_squares(self) -> Array:
        """Return the mean squares of the columns of what was taken, by the means of neighbours that are whole."""
        counts = np.repeat(self.whole, self.joints[:, Field.COUNT])
        return np.asarray(self._totals[self._block_of] / np.maximum(counts * LENGTH, 1))

    def limit(self, limits: Array) -> None:
        """Set the mean square that each column may lose, (C,)."""
        inverse, tails = 1.0 / np.maximum(limits, SMALLEST), LENGTH / LARGEST_SHARE * LARGEST_TAIL * limits
        even = self._block_of[self._even]
        for word, places, values, others in (
            (Word.LIMITS, self._block_of, limits, np.inf),
            (Word.INVERSE, self._block_of, inverse, 0.0),
            (Word.TAILS, self._block_of, tails, np.inf),
            (Word.EVEN_INVERSE, even, inverse[self._even], 0.0),
            (Word.EVEN_TAILS, even, tails[self._even], np.inf),
            (Word.DENSE_LIMITS, self._dense_of, limits[self._uneven], np.inf),
            (Word.DENSE_INVERSE, self._dense_of, inverse[self._uneven], 0.0),
        ):
            self._held[word][:] = others
            self._held[word][places] = values

    def combine(
        self,
        source: RegressorSource,
        torque: Array,
        used: NDArray[np.bool_],
        sums: Sequence[Array],
        part: slice,
    ) -> None:
        """Take some groups of samples; `used` is (N, groups, `LENGTH`)."""
        start, stop, functions, table = part.start, part.stop, compiled(), self.table
        if not self._target:
            most, lanes = self.groups * LENGTH, batch_lanes()
            self._target = [np.empty(most * (count + 1) + lanes) for count in self.joints[:, Field.COUNT].tolist()]
            self.joints[:, Field.TARGET] = [address_of(one) for one in self._target]
        self.joints[:, Field.TAKEN] = 0
        self.joints[:, Field.SUMS] = [address_of(one) for one in sums]
        table[Word.GROUPS], table[Word.UNTOLD_COUNT] = used.shape[1], 0
        for word, array in ((Word.TORQUE, torque), (Word.USED, used)):
            table[word] = address_of(array)
        self._hold(Word.UNTOLD, np.zeros(stop - start, np.int64))
        address, others = address_of(table), range(start, stop, AT_ONCE)
        if source.motion is not None:
            motion = source.motion.q, source.motion.dq, source.motion.ddq
            for word, one in zip((Word.Q, Word.DQ, Word.DDQ), motion, strict=True):
                table[word] = address_of(one)
            functions.from_places(address, start, stop)
            others = self._held[Word.UNTOLD][: table[Word.UNTOLD_COUNT]].tolist()
        for first in others:
            count = 1 if source.motion is not None else min(AT_ONCE, stop - first)
            entries = source.entries(slice(first * LENGTH, (first + count) * LENGTH))
            self._held[Word.ENTRIES][: entries.size] = entries.ravel()
            functions.from_rows(address, first, first + count)

    def taken(self, room: bool) -> list[Array]:
        """Return copies of the rows of each joint that were written, perhaps with a row of zeros behind them."""
        found = []
        for own, width, taken in zip(
            self._target, self.joints[:, Field.COUNT] + 1, self.joints[:, Field.TAKEN], strict=True
        ):
            rows = np.empty((taken + room, width))
            rows[:taken] = own[: taken * width].reshape(taken, width)
            rows[taken:] = 0.0
            found.append(rows)
        return found


@dataclass(frozen=True, eq=False)
class _Tables:
    """Polynomials in the order in which the compiled functions read them.

    Attributes
    ----------
    halves, place_halves : ndarray
        (`LENGTH` / 2, `FINE`) and (places / 2, `FINE`), the first halves of the polynomials of even degree, and then of
        odd degree, over all rows; and of what makes coefficients of those of values at `PLACES`.
    polynomials : ndarray
        (`LENGTH`, `FINE`).
    runs : ndarray
        Polynomials over runs of 1, 2, ... rows, (rows, `ORDERS`) each.
    numbers : ndarray of int
        (`LENGTH` + 1, `LENGTH` + 1), which run begins at a row and ends before another one.
    maps : ndarray
        (runs, `ORDERS`, `FINE`), the products of polynomials over each run with those over all neighbours.
    """

    halves: Array
    place_halves: Array
    polynomials: Array
    runs: Array
    numbers: Integers
    maps: Array


@cache
def _tables() -> _Tables:
    whole = _polynomials(LENGTH, FINE)
    # Both are symmetric in time, as the places are.
    parity = [*range(0, FINE, 2), *range(1, FINE, 2)]
    interpolation = np.linalg.inv(whole[:, PLACES].T)
    numbers = np.zeros((LENGTH + 1, LENGTH + 1), np.int64)
    runs, maps = list[Array](), list[Array]()
    for length in range(1, LENGTH + 1):
        own = np.zeros((length, ORDERS))
        own[:, :length] = _polynomials(length, min(ORDERS, length)).T
        runs.append(own.ravel())
        for start in range(LENGTH + 1 - length):
            numbers[start, start + length] = len(maps)
            maps.append(own.T @ whole[:, start : start + length].T)
    return _Tables(
        np.ascontiguousarray(whole[parity, : LENGTH // 2].T),
        np.ascontiguousarray(interpolation[parity, : FINE // 2].T),
        np.ascontiguousarray(whole.T),
        np.concatenate(runs),
        numbers,
        np.array(maps),
    )


def _polynomials(length: int, orders: int) -> Array:
    """Return orthonormal polynomials of degree 0, 1, ... over so many rows, (orders, length)."""
    times, found = np.linspace(-1.0, 1.0, length), np.empty((orders, length))
    for order in range(orders):
        values = times * found[order - 1] if order else np.ones(length)
        for _ in range(2):  # the second time for what rounding leaves
            for lower in found[:order]:
                values = values - (lower @ values) * lower
        found[order] = values / np.sqrt(values @ values)
    return found


def _constants() -> Array:
    numbers = np.empty(len(Constant))
    numbers[Constant.NOISE], numbers[Constant.FINEST], numbers[Constant.SMALLEST] = (
        LARGEST_NOISE,
        FINEST_SHARE,
        SMALLEST,
    )
    numbers[Constant.SHARE] = 1.0 / LARGEST_SHARE
    numbers[Constant.VELOCITY], numbers[Constant.ACCELERATION] = RESIDUE_VELOCITY, RESIDUE_ACCELERATION
    return numbers
