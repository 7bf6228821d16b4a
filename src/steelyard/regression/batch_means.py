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

    Parameters
    ----------
    empty : sequence of Factor
        The factors of no rows; they say which columns belong to which.
    """

    def __init__(self, empty: tuple[Factor, ...]) -> None:
        self.empty = empty
        self.triangles = [[f.triangle for f in empty] for _ in BATCH_LENGTHS]
        self.counts = [[0] * len(empty) for _ in BATCH_LENGTHS]
        self.held: list[list[Array]] = [[] for _ in empty]
        self.held_long: list[list[Array]] = [[] for _ in empty]

    def add(self, rows: Sequence[Array], mask: NDArray[np.bool_] | None = None) -> None:
        """Add samples to each factor, in order: (samples, c + 1), or (samples, channels, c + 1).

        Where the mask (samples, factors) leaves a row out, or the row is zero already, it counts as none. Each call but
        the last must bring a multiple of 1024 samples; a batch that is begun ends with its call.
        """
        for index, (held, own) in enumerate(zip(self.held, rows, strict=True)):
            held.append(summed(own if mask is None else own * mask[:, index, None], BATCH_LENGTHS[0]))
        if sum(map(len, self.held[0])) >= most_held(BATCHES_HELD, sum(own[0].size for own in rows)):
            self._reduce_all()

    def add_combined(self, sums: Sequence[Array]) -> None:
        """Add the sums over `LONG` samples of each factor, (sums, c + 1), of a multiple of 1024 samples.

        Those of shorter batches are not told: the longer ones stand in their place, too. So the batches of 8 hold at
        least 8 samples, and show correlation at least as far. Of data so long none shorter than these is ever chosen.
        """
        for held, own in zip(self.held_long, sums, strict=True):
            held.append(own)
        if sum(map(len, self.held_long[0])) >= most_held(BATCHES_HELD // 2, sum(own[0].size for own in sums)):
            self._reduce_all()

    def end(self) -> None:
        """End a data set: no batch holds rows of this one and of what is added afterwards."""
        longest = BATCH_LENGTHS[-1] // BATCH_LENGTHS[0]
        for held in self.held:
            missing = -sum(map(len, held)) % longest
            if missing:
                held.append(np.zeros((missing, *held[0].shape[1:])))

    def factors(self) -> BatchMeans:
        """The factors of all that was added."""
        self._reduce_all()
        return tuple(
            tuple(
                Factor(f.joint, f.columns, triangle, count)
                for f, triangle, count in zip(self.empty, triangles, counts, strict=True)
            )
            for triangles, counts in zip(self.triangles, self.counts, strict=True)
        )

    def _reduce_all(self) -> None:
        in_threads(self._reduce, range(len(self.empty)))

    def _reduce(self, index: int) -> None:
        """Add the sums that are held to the triangles of every length; each is twice the one before."""
        for held, first in ((self.held[index], 0), (self.held_long[index], BATCH_LENGTHS.index(LONG))):
            if not held:
                continue
            sums = held[0] if len(held) == 1 else np.concatenate(held)
            held.clear()
            for level, rows in enumerate(sums_of_all_lengths(sums, first), first):
                # Sums that stand in the place of shorter ones, too, are reduced once.
                shorter = range(first) if level == first else ()
                kept = extended(np.zeros_like(self.triangles[level][index]), rows) if shorter else rows
                for each in (*shorter, level):
                    self.counts[each][index] += len(rows)
                    self.triangles[each][index] = extended(self.triangles[each][index], kept)


def sums_of_all_lengths(sums: Array, first: int = 0) -> Iterator[Array]:
    """Yield for each of `BATCH_LENGTHS` from the first the sums that are not zero, (batches, c + 1), from its sums."""
    for level in range(first, len(BATCH_LENGTHS)):
        if level > first:
            sums = summed(sums, 2)
        rows = sums.reshape(-1, sums.shape[-1])
        yield rows[np.any(rows != 0.0, axis=1)]


def summed(rows: Array, size: int) -> Array:
    """Return sums over `size` neighbours along the first axis; the last sum is over the remaining rows."""
    missing = -len(rows) % size
    if missing:
        rows = np.concatenate([rows, np.zeros((missing, *rows.shape[1:]))])
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
