"""Neighbouring rows of long data, replaced by their projections on a few polynomials of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.block_projection import project_blocks

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

ROUNDING = 1e-20
"""Mean square of a column, relative to the largest of its joint, below which it is but rounding errors."""

FEWEST = 2 * ORDERS
"""Rows of the neighbours that are used, at most, for which combinations are not worth while."""


AT_ONCE = 8
"""Groups of neighbours whose regressor stands in memory together: one megabyte for seven joints, so that the
processor's cache holds it until it is combined."""

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
    """What takes the place of the rows ``[W omega]`` of one joint.

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
    """What computes the base regressor of some samples, all of it or what suffices where the motion is smooth.

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
        self._found: _Projections | None = None
        self._squares: Array | None = None

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
        counts = np.full((groups, joints), LENGTH) if used is None else used.sum(axis=2).T
        found = self._projections(source, counts)
        means = found.projected[:, 0]
        whole = counts == LENGTH
        squares = means**2 if whole.all() else means**2 * whole[:, self._owner]
        self._sums += squares.sum(axis=0)
        self._counts += np.count_nonzero(whole, axis=0) * LENGTH
        result = []
        for joint, (begin, end) in enumerate(zip(self.starts, self.ends, strict=True)):
            one = _Combination(torque[:, joint].reshape(groups, LENGTH), None if used is None else used[joint])
            one.combine_whole(np.flatnonzero(found.simple[:, joint]), found.projected[:, :, begin:end])
            others = ~found.simple[:, joint] & (counts[:, joint] > 0)
            places = np.flatnonzero(others & found.told)
            if len(places):
                one.add_even(places, found, slice(begin, end))
            places = np.flatnonzero(others & ~found.told)
            if len(places):
                one.add_others(places, found.rows_of(places, slice(begin, end)), found.limits[begin:end])
            result.append(one.result(end - begin + 1))
        return result

    def _projections(self, source: RegressorSource, counts: NDArray[np.intp]) -> _Projections:
        """Project the regressor of all groups, of which each joint uses so many rows, (groups, N)."""
        groups = len(counts)
        if (
            self._found is None or len(self._found.left) < groups
        ):  # new arrays take longer to be given than to be filled
            uneven = 0 if source.uneven is None else len(source.uneven)
            self._found = _Projections.empty(groups, len(self.starts), len(self.squares), uneven)
        found = self._found.first(groups, self._limits(), source.uneven)
        step = AT_ONCE if source.at_places is None else AT_ONCE * LENGTH // len(PLACES)
        for start in range(0, groups, step):
            part = slice(start, min(start + step, groups))
            if source.at_places is None:
                self._project_all(source, part, counts, found)
            else:
                self._project_places(source, part, counts, found)
        return found

    def _project_all(self, source: RegressorSource, part: slice, counts: NDArray[np.intp], found: _Projections) -> None:
        """Project the regressor of some groups, computed at all of their rows."""
        rows = source.entries(slice(part.start * LENGTH, part.stop * LENGTH)).reshape(-1, LENGTH, len(found.limits))
        project_blocks(_basis(0, LENGTH), rows, found.projected[part], found.left[part])
        self._judge(part, counts, found)
        found.told[part] = False
        others = ~found.simple[part] & (counts[part] > 0)
        for at in np.flatnonzero(others.any(axis=1)).tolist():
            found.rows[part.start + at] = rows[at].copy()

    def _project_places(
        self, source: RegressorSource, part: slice, counts: NDArray[np.intp], found: _Projections
    ) -> None:
        """Project the regressor of some groups, computed at few of their rows where these tell all the others."""
        assert source.at_places is not None
        assert source.uneven_entries is not None
        assert source.uneven is not None
        groups, width = part.stop - part.start, len(found.limits)
        values = source.at_places(part).reshape(groups, len(PLACES), width)
        lower, higher = _interpolation()
        left, beyond = found.left[part], found.beyond[part]
        project_blocks(lower, values, found.projected[part], left)
        project_blocks(higher, values, beyond, left)
        if self._squares is None or len(self._squares) < groups:
            self._squares = np.empty(beyond.shape)
        squares = np.square(beyond, out=self._squares[:groups])
        tail = squares[:, -2] + squares[:, -1]
        tail[:, source.uneven] = 0.0
        np.sum(squares, axis=1, out=left)
        rows = source.uneven_entries(slice(part.start * LENGTH, part.stop * LENGTH))
        if len(source.uneven):
            uneven = found.uneven_rows[part]
            uneven[...] = rows.reshape(uneven.shape)
            own, own_left = np.empty((groups, ORDERS, len(source.uneven))), np.empty((groups, len(source.uneven)))
            project_blocks(_basis(0, LENGTH), uneven, own, own_left)
            found.projected[part][:, :, source.uneven] = own
            left[:, source.uneven] = own_left
        found.told[part] = np.all(tail <= LENGTH / LARGEST_SHARE * LARGEST_TAIL * found.limits, axis=1)
        for at in np.flatnonzero(~found.told[part]).tolist():
            group = part.start + at
            own = source.entries(slice(group * LENGTH, (group + 1) * LENGTH)).reshape(1, LENGTH, width)
            project_blocks(_basis(0, LENGTH), own, found.projected[group : group + 1], left[at : at + 1])
            found.rows[group] = own[0].copy()
        self._judge(part, counts, found)

    def _judge(self, part: slice, counts: NDArray[np.intp], found: _Projections) -> None:
        """Note of which of some groups the projections take the place of the rows."""
        rough = np.logical_or.reduceat(found.left[part] > LENGTH * found.limits, self.starts, axis=1)
        found.simple[part] = (counts[part] == LENGTH) & ~rough

    def _limits(self) -> Array:
        """Return the mean square that each column may lose, (C,)."""
        squares = np.maximum(self.squares, self._sums / np.maximum(self._counts, 1.0)[self._owner])
        largest = np.maximum.reduceat(squares, self.starts)
        return np.asarray(LARGEST_SHARE * np.maximum(squares, ROUNDING * largest[self._owner]))


@dataclass(frozen=True, eq=False)
class _Projections:
    """The projected regressor of all groups, and what is known of those which that does not tell.

    Attributes
    ----------
    projected, beyond : ndarray
        (groups, `ORDERS`, C) and (groups, places - `ORDERS`, C), coefficients of the polynomials; the second where the
        regressor was computed at `PLACES`.
    left : ndarray
        (groups, C), squares of what the first leave.
    simple : ndarray of bool
        (groups, N), where projections take the place of the rows.
    told : ndarray of bool
        (groups,), where `PLACES` tell all but the uneven columns.
    uneven_rows : ndarray
        (groups, `LENGTH`, U).
    rows : dict
        (`LENGTH`, C) of groups that are not told.
    limits : ndarray
        (C,) mean square that may be lost.
    uneven : ndarray of int
        (U,) columns.
    """

    projected: Array
    beyond: Array
    left: Array
    simple: NDArray[np.bool_]
    told: NDArray[np.bool_]
    uneven_rows: Array
    rows: dict[int, Array]
    limits: Array
    uneven: NDArray[np.intp]

    @classmethod
    def empty(cls, groups: int, joints: int, width: int, uneven: int) -> _Projections:
        """Return room for so many groups."""
        beyond = np.empty((groups, len(PLACES) - ORDERS, width))
        return cls(
            np.empty((groups, ORDERS, width)),
            beyond,
            np.empty((groups, width)),
            np.empty((groups, joints), bool),
            np.empty(groups, bool),
            np.empty((groups, LENGTH, uneven)),
            {},
            np.empty(0),
            np.empty(0, np.intp),
        )

    def first(self, groups: int, limits: Array, uneven: NDArray[np.intp] | None) -> _Projections:
        """Return the room for the first groups, of which nothing is known."""
        names = ("projected", "beyond", "left", "simple", "told", "uneven_rows")
        cut: dict[str, Any] = {name: getattr(self, name)[:groups] for name in names}
        return _Projections(**cut, rows={}, limits=limits, uneven=self.uneven if uneven is None else uneven)

    def rows_of(self, places: NDArray[np.intp], columns: slice) -> Array:
        """Return some columns of groups that are not told, (groups, `LENGTH`, c)."""
        return np.stack([self.rows[place][:, columns] for place in places.tolist()])


class _Combination:
    """The neighbours of one joint, of which some are combined and the rows of others kept.

    Parameters
    ----------
    torque, used : ndarray
        (groups, `LENGTH`).
    """

    def __init__(self, torque: Array, used: NDArray[np.bool_] | None) -> None:
        self.used = np.ones(torque.shape, bool) if used is None else used
        self.torque = np.ascontiguousarray(torque) if used is None else torque * used
        self.count = torque.size if used is None else int(np.count_nonzero(used))
        self.rows: list[Array] = []
        self.sums: list[tuple[NDArray[np.intp], Array]] = []
        self.rest = float(np.vdot(self.torque, self.torque))

    def combine_whole(self, places: NDArray[np.intp], projected: Array) -> None:
        """Take the projections (groups, `ORDERS`, c) of these groups, which are used as a whole."""
        rows = np.empty((len(places), ORDERS, projected.shape[2] + 1))
        rows[:, :, :-1] = projected if len(places) == len(projected) else projected[places]
        torque = self.torque if len(places) == len(projected) else self.torque[places]
        rows[:, :, -1] = torque @ _basis(0, LENGTH).T
        self._take(rows, places, rows[:, 0] * np.sqrt(LENGTH))

    def _take(self, rows: Array, places: NDArray[np.intp], sums: Array) -> None:
        """Take rows (groups, r, c + 1) in the place of those of these groups, and the sums of those."""
        self.rows.append(rows.reshape(-1, rows.shape[2]))
        self.sums.append((places, sums))
        self.rest -= float(np.vdot(rows[:, :, -1], rows[:, :, -1]))

    def add_even(self, places: NDArray[np.intp], found: _Projections, columns: slice) -> None:
        """Take neighbours of which `PLACES` tell the even columns, and that are not whole, or jump."""
        limits = found.limits[columns]
        mine = np.flatnonzero((found.uneven >= columns.start) & (found.uneven < columns.stop))
        own = found.uneven[mine] - columns.start
        coefficients = np.concatenate([found.projected[places, :, columns], found.beyond[places, :, columns]], axis=1)
        left, uneven = found.left[places, columns], found.uneven_rows[places][:, :, mine]
        polynomials, used = _all_polynomials(), self.used[places]
        rows = np.concatenate([uneven * used[:, :, None], self.torque[places, :, None]], axis=2)
        sums = np.empty((len(places), len(limits) + 1))
        sums[:, :-1] = np.matmul((used @ polynomials.T)[:, None], coefficients)[:, 0]
        sums[:, [*own, -1]] = rows.sum(axis=1)
        # Polynomials over a part of the rows leave less than those over all.
        count = used.sum(axis=1)
        even = left <= count[:, None] * limits
        even[:, own] = True
        remaining = np.ones(len(places), bool)
        for runs in (_one_run, _two_runs):
            at = np.flatnonzero(remaining & even.all(axis=1))
            chosen, bases = runs(used[at], uneven[at], limits[own])
            at = at[chosen]
            if not len(at):
                continue
            jumping = np.matmul(bases, rows[at])
            squares = np.einsum("gkc,gkc->gc", rows[at], rows[at]) - np.einsum("gmc,gmc->gc", jumping, jumping)
            good = np.all(squares[:, :-1] <= count[at, None] * limits[own], axis=1)
            projected = np.empty((int(good.sum()), bases.shape[1], len(limits) + 1))
            projected[:, :, :-1] = np.matmul(bases[good] @ polynomials.T, coefficients[at[good]])
            projected[:, :, [*own, -1]] = jumping[good]
            self._take(projected, places[at[good]], sums[at[good]])
            remaining[at[good]] = False
        if remaining.any():
            regressor = polynomials.T @ coefficients[remaining]
            regressor[:, :, own] = uneven[remaining]
            self.add_others(places[remaining], regressor, limits)

    def add_others(self, places: NDArray[np.intp], regressor: Array, limits: Array) -> None:
        """Take neighbours (groups, `LENGTH`, c) that are not whole, or rough."""
        used = self.used[places]
        rows = np.concatenate([regressor, self.torque[places, :, None]], axis=2)
        rows[:, :, :-1] *= used[:, :, None]
        sums = rows.sum(axis=1)
        left = np.ones(len(places), bool)
        # First as one run of rows, then as two, with a jump between them.
        for runs in (_one_run, _two_runs):
            at = np.flatnonzero(left)
            chosen, bases = runs(used[at], regressor[at], limits)
            at = at[chosen]
            if not len(at):
                continue
            own = rows[at]
            projected = np.matmul(bases, own)
            squares = np.einsum("gkc,gkc->gc", own, own) - np.einsum("gmc,gmc->gc", projected, projected)
            good = np.all(squares[:, :-1] <= used[at].sum(axis=1)[:, None] * limits, axis=1)
            self._take(projected[good], places[at[good]], sums[at[good]])
            left[at[good]] = False
        if left.any():
            kept = rows[left]
            self.rest -= float(np.vdot(kept[:, :, -1], kept[:, :, -1]))
            self.rows.append(kept[used[left]])
            self.sums.append((places[left], sums[left]))

    def result(self, width: int) -> CombinedRows:
        """Return what was taken."""
        last, sums = np.zeros((1, width)), np.zeros((len(self.torque), width))
        last[0, -1] = np.sqrt(max(self.rest, 0.0))
        for places, own in self.sums:
            sums[places] = own
        return CombinedRows(np.concatenate([*self.rows, last]), self.count, sums)


def _one_run(used: NDArray[np.bool_], regressor: Array, limits: Array) -> tuple[NDArray[np.intp], Array]:
    """Return which neighbours use one run of rows but not all, and polynomials over it.

    (groups, `ORDERS`, `LENGTH`)
    """
    starts, stops = _ends(used)
    count = used.sum(axis=1)
    chosen = np.flatnonzero((stops - starts == count) & (count > FEWEST) & (count < LENGTH))
    return chosen, _bases([(starts[k], stops[k]) for k in chosen.tolist()])


def _two_runs(used: NDArray[np.bool_], regressor: Array, limits: Array) -> tuple[NDArray[np.intp], Array]:
    """Return which neighbours use two runs of rows, or one that jumps within, and polynomials over each of both.

    (groups, 2 `ORDERS`, `LENGTH`)
    """
    starts, stops = _ends(used)
    count = used.sum(axis=1)
    steps = np.diff(regressor, axis=1)
    # Rows that are not used separate two runs; else the largest step does.
    inner = ~used & (np.arange(LENGTH) >= starts[:, None]) & (np.arange(LENGTH) < stops[:, None])
    steps = np.einsum("gkc,gkc,c->gk", steps, steps, 1.0 / limits) * (used[:, 1:] & used[:, :-1])
    jumps = np.argmax(steps, axis=1) + 1
    first = np.where(inner.any(axis=1), inner.argmax(axis=1), jumps)
    second = np.where(inner.any(axis=1), LENGTH - inner[:, ::-1].argmax(axis=1), jumps)
    chosen = np.flatnonzero((first - starts + stops - second == count) & (count > 2 * FEWEST))
    before = _bases([(starts[k], first[k]) for k in chosen.tolist()])
    behind = _bases([(second[k], stops[k]) for k in chosen.tolist()])
    return chosen, np.concatenate([before, behind], axis=1)


def _ends(used: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first row that is used of each group, and the one behind the last."""
    return used.argmax(axis=1), LENGTH - used[:, ::-1].argmax(axis=1)


def _bases(runs: Sequence[tuple[int, int]]) -> Array:
    return np.stack([_basis(int(start), int(stop)) for start, stop in runs]) if runs else np.empty((0, ORDERS, LENGTH))


@cache
def _basis(start: int, stop: int) -> Array:
    """Return orthonormal polynomials over rows start:stop of `LENGTH`, (`ORDERS`, `LENGTH`), zero elsewhere."""
    found = np.zeros((ORDERS, LENGTH))
    count = min(ORDERS, stop - start)
    found[:count, start:stop] = _polynomials(stop - start, count)
    found.flags.writeable = False
    return found


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
def _interpolation() -> tuple[Array, Array]:
    """Return what makes coefficients of values at `PLACES`: of the first `ORDERS` polynomials, and of the others."""
    inverse = np.linalg.inv(_all_polynomials()[:, PLACES].T)
    return np.ascontiguousarray(inverse[:ORDERS]), np.ascontiguousarray(inverse[ORDERS:])
