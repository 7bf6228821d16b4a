"""Neighbouring rows of long data, replaced by their projections on a few polynomials of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.block_projection import project_blocks

from .batch_means import LONG

__all__ = ["LENGTH", "CombinedRows", "NeighborCombinations"]

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


class NeighborCombinations:
    """Combines neighbouring rows, 64 to four, where these say the same of the parameters.

    The regressor is a function of the motion, which a filter has made smooth: over a few samples its columns are
    polynomials, and all that the rows tell of the parameters is in their projections on an orthonormal basis of those.
    It is a linear map of the whole regression, so that it biases nothing; white noise stays white, with the same
    variance; and the squares of the torques stay the same, since what the projections lack of them, which is noise, is
    one further row. Neighbours of which some are masked have polynomials over the others. Where a column is no
    polynomial, as at a jump of friction or a gap in time, all rows are kept.

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

    def combined(
        self, entries: Callable[[slice], Array], torque: Array, mask: NDArray[np.bool_] | None
    ) -> list[CombinedRows]:
        """Combine the rows of each joint.

        Parameters
        ----------
        entries : callable
            The entries of the base regressor for a slice of the samples, (samples, C).
        torque, mask : ndarray
            (S, N), S a multiple of `LENGTH`.
        """
        joints, groups = len(self.starts), len(torque) // LENGTH
        torque = torque.reshape(groups, LENGTH, joints)
        used = None if mask is None else mask.reshape(torque.shape)
        counts = np.full((groups, joints), LENGTH) if used is None else used.sum(axis=1)
        whole, limits = counts == LENGTH, self._limits()
        basis, projected = _basis(0, LENGTH), np.empty((groups, ORDERS, len(limits)))
        left, simple = np.empty((groups, len(limits))), np.empty((groups, joints), bool)
        others: list[list[Array]] = [[] for _ in range(joints)]  # neighbours that are not whole, or rough
        for start in range(0, groups, AT_ONCE):
            part = slice(start, min(start + AT_ONCE, groups))
            rows = entries(slice(part.start * LENGTH, part.stop * LENGTH)).reshape(-1, LENGTH, len(limits))
            project_blocks(basis, rows, projected[part], left[part])
            rough = np.logical_or.reduceat(left[part] > LENGTH * limits, self.starts, axis=1)
            simple[part] = whole[part] & ~rough
            for group, joint in np.argwhere(~simple[part] & (counts[part] > 0)).tolist():
                others[joint].append(rows[group, :, self.starts[joint] : self.ends[joint]].copy())
        means = projected[:, 0]
        self._sums += np.einsum("gc,gc,gc->c", means, means, whole[:, self._owner].astype(float))
        self._counts += LENGTH * np.count_nonzero(whole, axis=0)
        forces = np.matmul(basis, torque)
        found = []
        for joint, (begin, end) in enumerate(zip(self.starts, self.ends, strict=True)):
            result = _Combination(torque[:, :, joint], None if used is None else used[:, :, joint], counts[:, joint])
            places = np.flatnonzero(simple[:, joint])
            result.combine(places, projected[places, :, begin:end], forces[places, :, joint])
            if others[joint]:
                places = np.flatnonzero(~simple[:, joint] & (counts[:, joint] > 0))
                result.add_others(places, np.stack(others[joint]), whole[places, joint], limits[begin:end])
            found.append(result.result(end - begin + 1))
        return found

    def _limits(self) -> Array:
        """Return the mean square that each column may lose, (C,)."""
        squares = np.maximum(self.squares, self._sums / np.maximum(self._counts, 1.0)[self._owner])
        largest = np.maximum.reduceat(squares, self.starts)
        return np.asarray(LARGEST_SHARE * np.maximum(squares, ROUNDING * largest[self._owner]))


class _Combination:
    """The neighbours of one joint, of which some are combined and the rows of others kept.

    Parameters
    ----------
    torque, used : ndarray
        (groups, `LENGTH`).
    counts : ndarray
        (groups,) how many are used.
    """

    def __init__(self, torque: Array, used: NDArray[np.bool_] | None, counts: NDArray[np.intp]) -> None:
        self.used = None if used is None else np.ascontiguousarray(used)
        self.torque = np.ascontiguousarray(torque) if self.used is None else torque * self.used
        self.counts = counts
        self.rows: list[Array] = []
        self.sums: list[tuple[NDArray[np.intp], Array]] = []
        self.rest = float(np.vdot(self.torque, self.torque))

    def combine(self, places: NDArray[np.intp], projected: Array, forces: Array) -> None:
        """Take the projections of these neighbours, (groups, `ORDERS`, c) and (groups, `ORDERS`)."""
        rows = np.concatenate([projected, forces[:, :, None]], axis=2)
        self.rows.append(rows.reshape(-1, rows.shape[2]))
        self.sums.append((places, rows[:, 0] * np.sqrt(self.counts[places])[:, None]))
        self.rest -= float(np.vdot(forces, forces))

    def add_others(self, places: NDArray[np.intp], regressor: Array, whole: NDArray[np.bool_], limits: Array) -> None:
        """Take neighbours (groups, `LENGTH`, c) that are not whole, or rough."""
        left = np.ones(len(places), bool)
        if self.used is not None:
            runs, which = _runs(self.used[places], whole)
            if len(which):
                bases = np.stack([_basis(*run) for run in runs])
                own = regressor[which] * self.used[places[which], :, None]
                projected = np.matmul(bases, own)
                squares = np.einsum("gkc,gkc->gc", own, own) - np.einsum("gmc,gmc->gc", projected, projected)
                good = np.all(squares <= self.counts[places[which], None] * limits, axis=1)
                which = which[good]
                forces = np.einsum("gmk,gk->gm", bases[good], self.torque[places[which]])
                self.combine(places[which], projected[good], forces)
                left[which] = False
        if not left.any():
            return
        places = places[left]
        rows = np.concatenate([regressor[left], self.torque[places, :, None]], axis=2)
        self.rest -= float(np.vdot(rows[:, :, -1], rows[:, :, -1]))
        if self.used is None:
            self.rows.append(rows.reshape(-1, rows.shape[2]))
        else:
            rows *= self.used[places, :, None]
            self.rows.append(rows[self.used[places]])
        self.sums.append((places, np.einsum("gkc->gc", rows)))

    def result(self, width: int) -> CombinedRows:
        """Return what was taken."""
        last, sums = np.zeros((1, width)), np.zeros((len(self.counts), width))
        last[0, -1] = np.sqrt(max(self.rest, 0.0))
        for places, own in self.sums:
            sums[places] = own
        return CombinedRows(np.concatenate([*self.rows, last]), int(self.counts.sum()), sums)


def _runs(used: NDArray[np.bool_], whole: NDArray[np.bool_]) -> tuple[list[tuple[int, int]], NDArray[np.intp]]:
    """Return the rows start:stop that are used of neighbours that are not whole, and of which: all others apart."""
    starts, stops = used.argmax(axis=1), LENGTH - used[:, ::-1].argmax(axis=1)
    chosen = ~whole & (stops - starts == used.sum(axis=1)) & (stops - starts > FEWEST)
    return list(zip(starts[chosen].tolist(), stops[chosen].tolist(), strict=True)), np.flatnonzero(chosen)


@cache
def _basis(start: int, stop: int) -> Array:
    """Return orthonormal polynomials over rows start:stop of `LENGTH`, (`ORDERS`, `LENGTH`), zero elsewhere."""
    times = np.linspace(-1.0, 1.0, stop - start)
    found = np.zeros((ORDERS, LENGTH))
    for order in range(ORDERS):
        values = times**order
        for lower in found[:order, start:stop]:
            values = values - (lower @ values) * lower
        found[order, start:stop] = values / np.sqrt(values @ values)
    found.flags.writeable = False
    return found
