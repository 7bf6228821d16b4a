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

    def add(self, rows: Sequence[Array]) -> None:
        """Add samples to each factor, in order: (samples, c + 1), or (samples, channels, c + 1); zero where masked.

        Each call but the last must bring a multiple of 1024 samples; a batch that is begun ends with its call.
        """
        for held, own in zip(self.held, rows, strict=True):
            held.append(summed(own, BATCH_LENGTHS[0]))
        if sum(map(len, self.held[0])) >= most_held(BATCHES_HELD, sum(own[0].size for own in rows)):
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
        held = self.held[index]
        if not held:
            return
        sums = held[0] if len(held) == 1 else np.concatenate(held)
        held.clear()
        for level, rows in enumerate(sums_of_all_lengths(sums)):
            self.counts[level][index] += len(rows)
            self.triangles[level][index] = extended(self.triangles[level][index], rows)


def sums_of_all_lengths(sums: Array) -> Iterator[Array]:
    """Yield for each of `BATCH_LENGTHS` the sums that are not zero, (batches, c + 1), from those of the first."""
    for level in range(len(BATCH_LENGTHS)):
        if level:
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
