"""Neighbouring rows of long data, replaced by their projections on a few polynomials of time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.block_copies import copy_blocks
from steelyard.graph.block_projection import project_blocks, transform_blocks

from .batch_means import LONG

__all__ = ["LENGTH", "PLACES", "CombinedRows", "NeighborCombinations", "RegressorSource"]

Array = NDArray[np.float64]

LENGTH = LONG
"""Neighbours that are combined, 64 ms at 1 kHz. A motion of 5 Hz is a cubic parabola there to some 0.1 %.
With 32 rows twice as many remain, with 128 a jump of friction, of which all rows are kept, costs twice as much."""

ORDERS = 4
"""Polynomials, of degree 0 to 3: so many rows take the place of `LENGTH`."""

LARGEST_SHARE = 1e-3
"""Share of the mean square of a column that may be lost. Of a motion it is 1e-5 and less. A jump of the sign of a
velocity, even right before the last of the neighbours, has 5 %: of such neighbours every row is kept."""

LARGEST_NOISE = 0.02
"""Share of the noise's mean square that what is lost of the torques may have, if they lose what the worst of the
columns does: standard errors then grow by 1 %. On logs of 3.5 Hz with 0.3 % of noise 3 to 12 % remain, of what all
polynomials lose; before, it was 14 to 25 %.
Neighbours that would lose more have as many polynomials as there are `PLACES`, and twice as many rows."""

FINEST_SHARE = 1e-12
"""Share of the mean square of a column that may be lost however little noise there is."""

ROUNDING = 1e-20
"""Mean square of a column, relative to the largest of its joint, below which it is but rounding errors."""

SMALLEST = float(np.finfo(np.float64).tiny)
"""Stands for the limit of a joint whose columns are all zero, where limits are divided by."""

FEWEST = 2 * ORDERS
"""Rows of the neighbours that are used, at most, for which combinations are not worth while."""


AT_ONCE = 8
"""Groups of neighbours whose regressor stands in memory together: one megabyte for seven joints, so that the
processor's cache holds it until it is combined."""

MOST_IN_RUNS = 4096
"""Neighbours of single joints that are projected on polynomials over runs together, so that memory is bounded."""

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
class RegressorSource:
    """A source of the base regressor of samples: of all entries or, where the motion is smooth, of as many as suffice.

    An array that one of these returns is overwritten by the next call of the same one.

    Attributes
    ----------
    entries : callable
        Returns all entries of a slice of the samples, (samples, C).
    at_places : callable or None
        Returns for a slice of the groups of neighbours the entries at `PLACES`, (groups * places, C); None where it
        would save nothing.
    uneven_entries : callable
        Returns the entries that may jump or bend where the motion is smooth, of a slice of the samples, (samples, U).
    uneven : ndarray of int
        Which these are, (U,).
    """

    entries: Callable[[slice], Array]
    at_places: Callable[[slice], Array] | None = None
    uneven_entries: Callable[[slice], Array] | None = None
    uneven: NDArray[np.intp] | None = None


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
        self._sums, self._counts = np.zeros_like(squares), np.zeros(len(widths))
        self._noise, self._torque = np.zeros(len(widths)), np.zeros(len(widths))  # squares, of the same rows
        self._room: _Projections | None = None

    def combined(self, source: RegressorSource, torque: Array, mask: NDArray[np.bool_] | None) -> list[CombinedRows]:
        """Combine the rows of each joint.

        Parameters
        ----------
        source : RegressorSource
        torque, mask : ndarray
            (S, N), S a multiple of `LENGTH`.
        """
        joints, groups = len(self.starts), len(torque) // LENGTH
        used = None if mask is None else np.ascontiguousarray(mask.T).reshape(joints, groups, LENGTH)
        counts = np.full((groups, joints), LENGTH) if used is None else _count(used).T
        found = self._projections(source, torque, counts)
        means, whole = found.projected[:, 0], counts == LENGTH
        squares, counted = means * means, whole.astype(np.float64)
        for joint, (begin, end) in enumerate(zip(self.starts, self.ends, strict=True)):
            self._sums[begin:end] += counted[:, joint] @ squares[:, begin:end]
        self._counts += np.count_nonzero(whole, axis=0) * LENGTH
        masked = torque if mask is None else torque * mask
        # A sum over many long rows takes a fifth of that over many short ones, and of a product of tall matrices.
        norms = np.square(masked).reshape(groups, -1).sum(axis=0).reshape(LENGTH, joints).sum(axis=0)
        totals = counts.sum(axis=0)
        others = ~found.simple & (counts > 0)
        pieces = self._in_runs(found, used, counts, others & found.told[:, None])
        result = []
        for joint, (begin, end) in enumerate(zip(self.starts, self.ends, strict=True)):
            one = _Combination(groups, end - begin + 1)
            simple, fine = found.simple[:, joint], found.fine[:, joint]
            one.take_whole(np.flatnonzero(simple & ~fine), found, slice(begin, end), joint)
            one.take_finely(np.flatnonzero(simple & fine), found, slice(begin, end), joint)
            for piece in pieces:
                one.take_piece(piece, found, slice(begin, end), joint)
            places = np.flatnonzero(others[:, joint] & ~found.told)
            if len(places):
                rows = np.concatenate(
                    [found.rows_of(places, slice(begin, end)), found.torque(places, joint)[:, :, None]], axis=2
                )
                use = np.ones((len(places), LENGTH), bool) if used is None else used[joint, places]
                one.take_rows(places, rows, use, found.limits[begin:end])
            result.append(one.result(int(totals[joint]), float(norms[joint])))
        return result

    def _projections(self, source: RegressorSource, torque: Array, counts: NDArray[np.intp]) -> _Projections:
        """Project the regressor of all groups, of which each joint uses so many rows, (groups, N)."""
        groups, joints = counts.shape
        uneven = np.empty(0, np.intp) if source.at_places is None or source.uneven is None else source.uneven
        orders = ORDERS if source.at_places is None else len(PLACES)
        if self._room is None or len(self._room.left) < groups or self._room.projected.shape[1] != orders:
            # New arrays take longer to be given than to be filled.
            self._room = _Projections.empty(groups, joints, len(self.squares), uneven, orders)
        found = self._room.first(groups, self._limits())
        rows = torque.reshape(groups, LENGTH, joints)
        step = AT_ONCE if source.at_places is None else AT_ONCE * LENGTH // len(PLACES)
        for start in range(0, groups, step):
            part = slice(start, min(start + step, groups))
            dense = found.dense[part]
            dense[:, :, len(uneven) :] = rows[part]
            if source.at_places is None:
                project_blocks(_basis(), dense, found.dense_projected[part], found.dense_left[part])
                self._project_all(source, part, counts, found)
            else:
                self._project_places(source, part, counts, found)
        return found

    def _project_all(self, source: RegressorSource, part: slice, counts: NDArray[np.intp], found: _Projections) -> None:
        """Project the regressor of some groups, computed at all of their rows."""
        rows = source.entries(slice(part.start * LENGTH, part.stop * LENGTH)).reshape(-1, LENGTH, len(found.limits))
        project_blocks(_basis(), rows, found.projected[part], found.left[part])
        found.told[part] = False
        self._judge(part, counts, found)
        others = ~found.simple[part] & (counts[part] > 0)
        for at in np.flatnonzero(others.any(axis=1)).tolist():
            found.rows[part.start + at] = rows[at].copy()

    def _project_places(
        self, source: RegressorSource, part: slice, counts: NDArray[np.intp], found: _Projections
    ) -> None:
        """Project the regressor of some groups, computed at few of their rows where these tell all the others."""
        assert source.at_places is not None
        assert source.uneven_entries is not None
        groups, width, uneven = part.stop - part.start, len(found.limits), found.uneven
        values = source.at_places(part).reshape(groups, len(PLACES), width)
        squares = found.squares[:groups]
        transform_blocks(_interpolation(), values, found.projected[part], squares, (ORDERS, len(PLACES) - 2))
        left, tail = squares[:, 0], squares[:, 1]
        dense, projected = found.dense[part], found.dense_projected[part]
        if len(uneven):
            rows = source.uneven_entries(slice(part.start * LENGTH, part.stop * LENGTH))
            dense[:, :, : len(uneven)] = rows.reshape(groups, LENGTH, len(uneven))
        project_blocks(_basis(), dense, projected, found.dense_left[part])
        if len(uneven):
            found.projected[part, :ORDERS, uneven] = projected[:, :, : len(uneven)]
            squares[:, :, uneven] = 0.0
        found.left[part] = left
        found.told[part] = np.all(tail <= LENGTH / LARGEST_SHARE * LARGEST_TAIL * found.limits, axis=1)
        for at in np.flatnonzero(~found.told[part]).tolist():
            group = part.start + at
            own = source.entries(slice(group * LENGTH, (group + 1) * LENGTH)).reshape(1, LENGTH, width)
            orders, lost = np.empty((1, ORDERS, width)), np.empty((1, width))
            project_blocks(_basis(), own, orders, lost)
            found.projected[group, :ORDERS], found.left[group] = orders[0], lost[0]
            found.rows[group] = own[0].copy()
        self._judge(part, counts, found)

    def _judge(self, part: slice, counts: NDArray[np.intp], found: _Projections) -> None:
        """Note how much is lost in some groups, and where the projections take the place of the rows."""
        lost = found.left[part] / np.maximum(found.limits, SMALLEST)
        found.worst[part] = np.maximum.reduceat(lost, self.starts, axis=1)
        rough = found.worst[part] > LENGTH
        if len(found.uneven):
            uneven = found.dense_left[part, : len(found.uneven)] > LENGTH * found.limits[found.uneven]
            if uneven.any():
                groups, columns = np.nonzero(uneven)
                rough[groups, self._owner[found.uneven[columns]]] = True
        simple = (counts[part] == LENGTH) & ~rough
        lacking = found.dense_left[part, len(found.uneven) :]
        self._noise += np.sum(lacking, axis=0, where=simple)
        kept = np.sum(found.dense_projected[part, :, len(found.uneven) :] ** 2, axis=1)
        self._torque += np.sum(kept + lacking, axis=0, where=simple)
        share = LARGEST_NOISE * self._noise / np.maximum(self._torque, SMALLEST)
        fine = simple & (found.worst[part] > LENGTH / LARGEST_SHARE * np.maximum(share, FINEST_SHARE))
        told = found.told[part, None]
        found.fine[part] = fine & told
        found.simple[part] = simple & ~(fine & ~told)

    def _in_runs(
        self,
        found: _Projections,
        used: NDArray[np.bool_] | None,
        counts: NDArray[np.intp],
        chosen: NDArray[np.bool_],
    ) -> list[_Piece]:
        """Project neighbours of which `PLACES` tell the even columns, and that are not whole, or jump.

        All joints together: `chosen` (groups, N) says which neighbours of which joint.
        """
        joints, groups = np.nonzero(chosen.T)
        count = len(found.uneven)
        owner = self._owner[found.uneven]
        ends = np.searchsorted(owner, np.arange(len(self.starts)), side="right")
        begins = np.append(0, ends[:-1])
        width = int(np.max(ends - begins)) + 1
        # A joint with fewer uneven columns has columns of zeros before them; the last one is its torque.
        limits = np.full((len(self.starts), width), np.inf)
        for one, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            limits[one, width - 1 - (end - begin) : -1] = found.limits[found.uneven[begin:end]]
        pieces = []
        for start in range(0, len(joints), MOST_IN_RUNS):
            joint, group = joints[start : start + MOST_IN_RUNS], groups[start : start + MOST_IN_RUNS]
            use = np.ones((len(joint), LENGTH), bool) if used is None else used[joint, group]
            rows = np.zeros((len(joint), LENGTH, width))
            for one in np.unique(joint).tolist():
                part, columns = slice(*np.searchsorted(joint, [one, one + 1])), slice(int(begins[one]), int(ends[one]))
                copy_blocks(group[part], found.dense, columns, found.dense, count + one, rows[part])
            rows *= use[:, :, None]
            even = found.worst[group, joint] <= counts[group, joint]
            left = np.ones(len(joint), bool)
            for at, runs, projected in _by_runs(use, rows, limits[joint], even):
                maps = _runs().maps[runs].reshape(len(at), ORDERS * runs.shape[1], len(PLACES))
                maps = np.concatenate([maps, _usage(use[at])[:, None]], axis=1)
                sums = rows[at].sum(axis=1, keepdims=True)
                pieces.append(_Piece(joint[at], group[at], maps, np.concatenate([projected, sums], axis=1), None))
                left[at] = False
            if left.any():
                pieces.append(_Piece(joint[left], group[left], None, rows[left], use[left]))
        return pieces

    def _limits(self) -> Array:
        """Return the mean square that each column may lose, (C,)."""
        squares = np.maximum(self.squares, self._sums / np.maximum(self._counts, 1.0)[self._owner])
        largest = np.maximum.reduceat(squares, self.starts)
        return np.asarray(LARGEST_SHARE * np.maximum(squares, ROUNDING * largest[self._owner]))


@dataclass(frozen=True, eq=False)
class _Piece:
    """Neighbours of several joints that are used in part, or jump, in the order of the joints.

    Attributes
    ----------
    joints, groups : ndarray of int
        (n,).
    maps : ndarray or None
        (n, r + 1, places), from the coefficients of the even columns to r rows, and to the sum over all neighbours;
        None where all rows are kept.
    dense : ndarray
        (n, r + 1, d), the same rows and sums of the columns that were computed at every neighbour, the torque last;
        without maps (n, `LENGTH`, d), all of their rows.
    use : ndarray of bool or None
        (n, `LENGTH`), which rows are used, without maps.
    """

    joints: NDArray[np.intp]
    groups: NDArray[np.intp]
    maps: Array | None
    dense: Array
    use: NDArray[np.bool_] | None


@dataclass(frozen=True, eq=False)
class _Projections:
    """The projected regressor of all groups, and what is known of those which that does not tell.

    Attributes
    ----------
    projected : ndarray
        (groups, orders, C), coefficients of the polynomials: `ORDERS`, or as many as `PLACES` where the regressor was
        computed there.
    left : ndarray
        (groups, C), squares of what `ORDERS` of them leave, 0 of uneven columns.
    worst : ndarray
        (groups, N), the largest of these of each joint, by what may be lost of a row.
    dense, dense_projected, dense_left : ndarray
        (groups, `LENGTH`, U + N), the uneven columns and the torques, (groups, `ORDERS`, U + N) and (groups, U + N).
    simple : ndarray of bool
        (groups, N), where projections take the place of the rows.
    fine : ndarray of bool
        (groups, N), where `ORDERS` of them lose too much beside the noise, and all that are known are taken.
    told : ndarray of bool
        (groups,), where `PLACES` tell all but the uneven columns.
    squares : ndarray
        (groups, 2, C), room.
    uneven : ndarray of int
        (U,) columns.
    limits : ndarray
        (C,) mean square that may be lost.
    rows : dict
        (`LENGTH`, C) of groups that are not told.
    """

    projected: Array
    left: Array
    worst: Array
    dense: Array
    dense_projected: Array
    dense_left: Array
    simple: NDArray[np.bool_]
    fine: NDArray[np.bool_]
    told: NDArray[np.bool_]
    squares: Array
    uneven: NDArray[np.intp]
    limits: Array
    rows: dict[int, Array]

    @classmethod
    def empty(cls, groups: int, joints: int, width: int, uneven: NDArray[np.intp], orders: int) -> _Projections:
        """Return room for so many groups."""
        dense = len(uneven) + joints
        return cls(
            np.empty((groups, orders, width)),
            np.empty((groups, width)),
            np.empty((groups, joints)),
            np.empty((groups, LENGTH, dense)),
            np.empty((groups, ORDERS, dense)),
            np.empty((groups, dense)),
            np.empty((groups, joints), bool),
            np.empty((groups, joints), bool),
            np.empty(groups, bool),
            np.empty((min(groups, AT_ONCE * LENGTH // len(PLACES)), 2, width)),
            uneven,
            np.empty(0),
            {},
        )

    def first(self, groups: int, limits: Array) -> _Projections:
        """Return the room for the first groups, of which nothing is known."""
        names = ("projected", "left", "worst", "dense", "dense_projected", "dense_left", "simple", "fine", "told")
        cut: dict[str, Any] = {name: getattr(self, name)[:groups] for name in names}
        return replace(self, **cut, limits=limits, rows={})

    def rows_of(self, places: NDArray[np.intp], columns: slice) -> Array:
        """Return some columns of groups that are not told, (groups, `LENGTH`, c)."""
        return np.stack([self.rows[place][:, columns] for place in places.tolist()])

    def torque(self, places: NDArray[np.intp], joint: int) -> Array:
        """Return the torques of a joint in some groups, (groups, `LENGTH`)."""
        return np.asarray(self.dense[places, :, len(self.uneven) + joint])

    def uneven_of(self, columns: slice) -> NDArray[np.intp]:
        """Return which of the columns of a joint are uneven, from 0."""
        mine = (self.uneven >= columns.start) & (self.uneven < columns.stop)
        return np.asarray(self.uneven[mine] - columns.start)


class _Combination:
    """The combination that replaces the neighbours of one joint.

    Parameters
    ----------
    groups : int
    width : int
        Columns of the rows, c + 1.
    """

    def __init__(self, groups: int, width: int) -> None:
        self.width, self.sums = width, np.zeros((groups, width))
        self.rows: list[Array] = []
        self.taken = 0.0

    def take_whole(self, places: NDArray[np.intp], found: _Projections, columns: slice, joint: int) -> None:
        """Take the projections of these groups, which are used as a whole."""
        rows = np.empty((len(places), ORDERS, self.width))
        copy_blocks(places, found.projected, columns, found.dense_projected, len(found.uneven) + joint, rows)
        self._take(places, rows, np.sqrt(LENGTH) * rows[:, 0])

    def take_finely(self, places: NDArray[np.intp], found: _Projections, columns: slice, joint: int) -> None:
        """Take all polynomials that are known of these groups, which are used as a whole."""
        if not len(places):
            return
        rows = np.empty((len(places), len(PLACES), self.width))
        rows[:, :, :-1] = found.projected[places, :, columns]
        mine = np.flatnonzero((found.uneven >= columns.start) & (found.uneven < columns.stop))
        dense = found.dense[places[:, None], :, np.append(mine, len(found.uneven) + joint)]
        rows[:, :, [*found.uneven_of(columns), self.width - 1]] = np.matmul(dense, _all_polynomials().T).transpose(
            0, 2, 1
        )
        self._take(places, rows, np.sqrt(LENGTH) * rows[:, 0])

    def take_piece(self, piece: _Piece, found: _Projections, columns: slice, joint: int) -> None:
        """Take the neighbours of this joint out of those of several."""
        part = slice(*np.searchsorted(piece.joints, [joint, joint + 1]).tolist())
        places, dense = piece.groups[part], piece.dense[part]
        if not len(places):
            return
        uneven = found.uneven_of(columns)
        maps = _all_polynomials().T if piece.maps is None else piece.maps[part]
        rows = np.empty((len(places), dense.shape[1], self.width))
        rows[:, :, :-1] = np.matmul(maps, found.projected[places, :, columns])
        rows[:, :, [*uneven, self.width - 1]] = dense[:, :, dense.shape[2] - len(uneven) - 1 :]
        if piece.use is None:
            self._take(places, rows[:, :-1], rows[:, -1])
        else:
            self.take_rows(places, rows, piece.use[part], found.limits[columns])

    def take_rows(self, places: NDArray[np.intp], rows: Array, use: NDArray[np.bool_], limits: Array) -> None:
        """Take neighbours of which all rows are known, (groups, `LENGTH`, c + 1), and those in use."""
        few = _count(use) <= FEWEST
        if few.any():  # they stay as they are; to look for polynomials takes a tenth of the time of all
            own = rows[few] * use[few][:, :, None]
            self._take(places[few], rows[few][use[few]], own.sum(axis=1))
            places, rows, use = places[~few], rows[~few], use[~few]
        if not len(places):
            return
        rows *= use[:, :, None]
        limits = np.broadcast_to(np.append(limits, np.inf), (len(rows), self.width))
        projected = np.matmul(_all_polynomials(), rows)
        lost = np.einsum("gkc,gkc->gc", rows, rows) - np.einsum("gmc,gmc->gc", projected, projected)
        finely = np.all(lost <= LENGTH * LARGEST_TAIL / LARGEST_SHARE * limits, axis=1) & use.all(axis=1)
        self._take(places[finely], projected[finely], rows[finely].sum(axis=1))
        left = ~finely
        for at, _, projected in _by_runs(use, rows, limits, left.copy()):
            self._take(places[at], projected, rows[at].sum(axis=1))
            left[at] = False
        if left.any():
            self._take(places[left], rows[left][use[left]], rows[left].sum(axis=1))

    def _take(self, places: NDArray[np.intp], rows: Array, sums: Array) -> None:
        """Take rows (..., c + 1) in the place of those of these groups, and the sums of those."""
        self.rows.append(rows.reshape(-1, self.width))
        self.sums[places] = sums
        self.taken += float(np.vdot(rows[..., -1], rows[..., -1]))

    def result(self, count: int, norm: float) -> CombinedRows:
        """Return what was taken in the place of so many rows, the squares of whose torques come to `norm`."""
        last = np.zeros((1, self.width))
        last[0, -1] = np.sqrt(max(norm - self.taken, 0.0))
        return CombinedRows(np.concatenate([*self.rows, last]), count, self.sums)


def _by_runs(
    use: NDArray[np.bool_], rows: Array, limits: Array, allowed: NDArray[np.bool_]
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
    """Yield the neighbours of which polynomials over one run of rows tell enough, and then over two runs.

    Parameters
    ----------
    use : ndarray of bool
        (n, `LENGTH`).
    rows : ndarray
        (n, `LENGTH`, d), zero where not in use.
    limits : ndarray
        (n, d), mean square of each column that may be lost.
    allowed : ndarray of bool
        (n,).

    Yields
    ------
    at : ndarray of int
        (k,), which these are.
    runs : ndarray of int
        (k, 1 or 2), as `_runs` numbers them.
    projected : ndarray
        (k, `ORDERS` or 2 `ORDERS`, d).
    """
    starts, stops, count = use.argmax(axis=1), LENGTH - use[:, ::-1].argmax(axis=1), _count(use)
    numbers, bases = _runs().numbers, _runs().bases
    left = allowed.copy()

    def told(at: NDArray[np.intp], runs: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
        own = rows[at]
        projected = np.matmul(bases[runs].reshape(len(at), ORDERS * runs.shape[1], LENGTH), own)
        lost = np.einsum("gkc,gkc->gc", own, own) - np.einsum("gmc,gmc->gc", projected, projected)
        good = np.all(lost <= count[at, None] * limits[at], axis=1)
        left[at[good]] = False
        return at[good], runs[good], projected[good]

    at = np.flatnonzero(left & (stops - starts == count) & (count > FEWEST) & (count < LENGTH))
    if len(at):
        yield told(at, numbers[starts[at], stops[at]][:, None])
    at = np.flatnonzero(left & (count > 2 * FEWEST))
    if not len(at):
        return
    # Rows that are not used separate two runs; else the largest step does.
    own, begin, end = use[at], starts[at], stops[at]
    inner = ~own & (np.arange(LENGTH) >= begin[:, None]) & (np.arange(LENGTH) < end[:, None])
    steps = np.diff(rows[at], axis=1)
    steps *= np.sqrt(1.0 / np.maximum(limits[at], SMALLEST))[:, None]
    jumps = np.argmax(np.einsum("gkc,gkc->gk", steps, steps) * (own[:, 1:] & own[:, :-1]), axis=1) + 1
    parted = inner.any(axis=1)
    first = np.where(parted, inner.argmax(axis=1), jumps)
    second = np.where(parted, LENGTH - inner[:, ::-1].argmax(axis=1), jumps)
    two = first - begin + end - second == count[at]
    at, runs = at[two], np.stack([numbers[begin, first], numbers[second, end]], axis=1)[two]
    if len(at):
        yield told(at, runs)


def _count(use: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return how many of `LENGTH` neighbours are in use, (...,) of (..., `LENGTH`)."""
    return np.asarray(np.add.reduce(use.view(np.int8), axis=-1, dtype=np.int8), np.intp)  # at most 64: bytes suffice


def _usage(use: NDArray[np.bool_]) -> Array:
    """Return what makes sums over the rows in use of coefficients at `PLACES`, (n, places)."""
    return np.asarray(use @ _all_polynomials().T)


@dataclass(frozen=True, eq=False)
class _Runs:
    """Polynomials over all runs of neighbours.

    Attributes
    ----------
    numbers : ndarray of int
        (`LENGTH` + 1, `LENGTH` + 1), which run begins at a row and ends before another one; 0 is the empty run.
    bases : ndarray
        (runs, `ORDERS`, `LENGTH`), orthonormal polynomials, zero outside of the run.
    maps : ndarray
        (runs, `ORDERS`, places), their products with the polynomials over all neighbours.
    """

    numbers: NDArray[np.intp]
    bases: Array
    maps: Array


@cache
def _runs() -> _Runs:
    numbers = np.zeros((LENGTH + 1, LENGTH + 1), np.intp)
    bases = [np.zeros((1, ORDERS, LENGTH))]
    for length in range(1, LENGTH + 1):
        polynomials, orders = _polynomials(length, min(ORDERS, length)), min(ORDERS, length)
        own = np.zeros((LENGTH + 1 - length, ORDERS, LENGTH))
        for start in range(len(own)):
            own[start, :orders, start : start + length] = polynomials
            numbers[start, start + length] = sum(map(len, bases)) + start
        bases.append(own)
    together = np.concatenate(bases)
    return _Runs(numbers, together, together @ _all_polynomials().T)


@cache
def _basis() -> Array:
    """Return orthonormal polynomials over all neighbours, (`ORDERS`, `LENGTH`)."""
    return _polynomials(LENGTH, ORDERS)


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


@cache
def _all_polynomials() -> Array:
    """Return orthonormal polynomials over `LENGTH` rows, as many as there are `PLACES`, (places, `LENGTH`)."""
    return _polynomials(LENGTH, len(PLACES))


@cache
def _interpolation() -> Array:
    """Return what makes coefficients of those polynomials of values at `PLACES`, (places, places)."""
    return np.ascontiguousarray(np.linalg.inv(_all_polynomials()[:, PLACES].T))
