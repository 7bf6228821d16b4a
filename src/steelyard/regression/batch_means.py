"""Sums of neighbouring rows, which show how far residuals are correlated in time when the data is gone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import in_threads

from .factor import Factor, extended, most_held

__all__ = ["BATCH_LENGTHS", "BatchMeans", "BatchMeansTree", "BatchSums", "added", "summed", "sums_of_all_lengths"]

Array = NDArray[np.float64]
BatchMeans = tuple[tuple[Factor, ...], ...]
"""For each of `BATCH_LENGTHS` the factors of the sums over batches, one for each factor of the rows."""

BATCH_LENGTHS = (8, 16, 32, 64, 128, 256, 512, 1024)
"""Samples in a batch. Each length divides the number of samples that are reduced at a time, and is twice the one
before, so that its sums come from those. 1024 samples are one second at 1 kHz, longer than the memory of friction and
filters."""

LONG = 64
"""Samples in the shortest batches of long data, whose neighbouring rows are combined."""

BATCHES_HELD = 8192
"""Shortest batches that are reduced together, a multiple of the longest: a minute at 1 kHz, so that also the longest
batches are not reduced a few at a time. Of robots with many joints fewer, see `most_held`."""


class BatchSums:
    """Accumulates the triangular factors of the sums over 8, 16, ... 1024 samples of the rows ``[W omega]``.

    Two neighbouring sums a and b have the same factor as ``(a + b) / sqrt(2)`` and ``(a - b) / sqrt(2)``, of which the
    first is a sum over twice as many samples. So each level is reduced by the differences alone, and the factors follow
    from the longest sums downwards: half of the rows (this is the transform of Haar). The empty factors, of no rows,
    say which columns belong to which.
    """

    def __init__(self, empty: tuple[Factor, ...]) -> None:
        self.empty = empty
        self._short, self._long = _Levels(empty, 0), _Levels(empty, BATCH_LENGTHS.index(LONG))

    def add(self, rows: Sequence[Array], mask: NDArray[np.bool_] | None = None) -> None:
        """Add samples to each factor, in order: (samples, c + 1), or (samples, channels, c + 1).

        Where the mask (samples, factors) leaves a row out, or the row is zero already, it counts as none. Each call but
        the last must bring a multiple of 1024 samples; a batch that is begun ends with its call.
        """
        for index, (held, own) in enumerate(zip(self._short.held, rows, strict=True)):
            held.append(summed(own, BATCH_LENGTHS[0], None if mask is None else mask[:, index]))
        if self._short.waiting >= most_held(BATCHES_HELD, sum(own[0].size for own in rows)):
            self._short.reduce()

    def add_combined(self, sums: Sequence[Array]) -> None:
        """Add the sums over `LONG` samples of each factor, (sums, c + 1), of a multiple of 1024 samples.

        Those of shorter batches are not told: the longer ones stand in their place, too. So the batches of 8 hold at
        least 8 samples, and show correlation at least as far. Of data so long none shorter than these is ever chosen.
        """
        for held, own in zip(self._long.held, sums, strict=True):
            held.append(own)
        if self._long.waiting >= most_held(BATCHES_HELD // 2, sum(own[0].size for own in sums)):
            self._long.reduce()

    def end(self) -> None:
        """End a data set: no batch holds rows of this one and of what is added afterwards."""
        longest = BATCH_LENGTHS[-1] // BATCH_LENGTHS[0]
        for held in self._short.held:
            missing = -sum(map(len, held)) % longest
            if missing:
                held.append(np.zeros((missing, *held[0].shape[1:])))

    def factors(self) -> BatchMeans:
        """The factors of all that was added."""
        short, long = self._short.factors(), self._long.factors()
        first = BATCH_LENGTHS.index(LONG)
        # Sums that stand in the place of shorter ones, too, were reduced once.
        return tuple(
            tuple(
                Factor(f.joint, f.columns, extended(a, b) if b.any() else a, m + n)
                for f, (a, m), (b, n) in zip(self.empty, own, long[max(level - first, 0)], strict=True)
            )
            for level, own in enumerate(short)
        )


class _Levels:
    """The factors of the sums over all of `BATCH_LENGTHS` from the first on, by the differences of each two."""

    def __init__(self, empty: tuple[Factor, ...], first: int) -> None:
        levels = len(BATCH_LENGTHS) - first
        self.held: list[list[Array]] = [[] for _ in empty]
        self._triangles = [[f.triangle for f in empty] for _ in range(levels)]  # of differences; of the longest sums
        self._counts = [[0] * len(empty) for _ in range(levels)]

    @property
    def waiting(self) -> int:
        """How many sums are held."""
        return sum(map(len, self.held[0]))

    def reduce(self) -> None:
        """Reduce the sums that are held."""
        in_threads(self._reduce, range(len(self.held)))

    def _reduce(self, index: int) -> None:
        held, last = self.held[index], len(self._counts) - 1
        if not held:
            return
        sums = held[0] if len(held) == 1 else np.concatenate(held)
        held.clear()
        for level in range(last + 1):
            self._counts[level][index] += int(np.count_nonzero(_not_zero(sums)))
            if level < last:
                if len(sums) % 2:
                    sums = np.concatenate([sums, np.zeros((1, *sums.shape[1:]))])
                differences = sums[::2] - sums[1::2]
                sums = sums[::2] + sums[1::2]
            else:
                differences = sums
            rows = differences.reshape(-1, differences.shape[-1])
            kept = _not_zero(rows)
            rows = rows if kept.all() else rows[kept]
            self._triangles[level][index] = extended(self._triangles[level][index], rows)

    def factors(self) -> list[list[tuple[Array, int]]]:
        """Return for each level the triangle of the sums of every factor, and how many of them are not zero."""
        self.reduce()
        found = [list(zip(self._triangles[-1], self._counts[-1], strict=True))]
        for triangles, counts in zip(self._triangles[-2::-1], self._counts[-2::-1], strict=True):
            both = [extended(longer, own) / np.sqrt(2.0) for (longer, _), own in zip(found[0], triangles, strict=True)]
            found.insert(0, list(zip(both, counts, strict=True)))
        return found


def _not_zero(rows: Array) -> NDArray[np.bool_]:
    """Tell which rows hold a number other than zero, (...,) of (..., c + 1); most do in the last column."""
    found = rows[..., -1] != 0.0
    zero = ~found
    if zero.any():
        found[zero] = np.any(rows[zero] != 0.0, axis=-1)
    return np.asarray(found)


def sums_of_all_lengths(sums: Array) -> Iterator[Array]:
    """Yield for each of `BATCH_LENGTHS` the sums that are not zero, (batches, c + 1), from its sums."""
    for level in range(len(BATCH_LENGTHS)):
        if level:
            sums = summed(sums, 2)
        rows = sums.reshape(-1, sums.shape[-1])
        yield rows[_not_zero(rows)]


def summed(rows: Array, size: int, used: NDArray[np.bool_] | None = None) -> Array:
    """Return sums over `size` neighbours along the first axis; the last sum is over the remaining rows.

    Of rows (S, c) those count that are `used`, (S,), where that is given.
    """
    missing = -len(rows) % size
    if missing:
        rows = np.concatenate([rows, np.zeros((missing, *rows.shape[1:]))])
    if used is not None:
        weights = np.concatenate([used, np.zeros(missing, dtype=bool)]).astype(float).reshape(-1, 1, size)
        return np.asarray(np.matmul(weights, rows.reshape(-1, size, rows.shape[1]))[:, 0])
    # This einsum is several times as fast as a sum over the middle axis.
    return np.asarray(np.einsum("ab...->a...", rows.reshape(-1, size, *rows.shape[1:])))


def added(first: BatchMeans, second: BatchMeans) -> BatchMeans:
    """Return the batch means of both data sets together; empty unless both data sets have them."""
    if not first or not second:
        return ()
    return tuple(
        tuple(a + b for a, b in zip(one, other, strict=True)) for one, other in zip(first, second, strict=True)
    )


class BatchMeansTree:
    """The batch means of many data sets together, added in pairs, pairs of pairs and so on, in the order they come.

    Which are added to which follows from their number alone: two, four or eight that stand together may as well have
    been added in the same way before, in another process, and the total is the same to the last bit.

    Examples
    --------
    >>> tree = BatchMeansTree()
    >>> tree.add(()), tree.total()
    (None, ())
    """

    def __init__(self) -> None:
        self._sums: list[BatchMeans | None] = []

    def add(self, means: BatchMeans) -> None:
        """Add those of the next data set, or of the next 2, 4, 8 ... together; empty ones are passed over."""
        if not means:
            return
        for level, held in enumerate(self._sums):
            if held is None:
                self._sums[level] = means
                return
            means, self._sums[level] = added(held, means), None
        self._sums.append(means)

    def total(self) -> BatchMeans:
        """The batch means of all of them; empty where there were none."""
        found: BatchMeans = ()
        for held in self._sums:
            if held is not None:
                found = added(held, found) if found else held
        return found
