"""Contiguous stretches of data, each reduced by itself, from which folds of a cross-validation are made."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .factor import Factor, triangular

__all__ = ["TimeBlocks"]

Array = NDArray[np.float64]

MOST = 20
"""Blocks that are kept: enough that five folds of them differ in length by a third at most."""

SHORTEST = 64
"""Samples in a block of the shortest logs: 320 samples make five folds."""


class _Block:
    """The rows of every joint in one stretch of time, as they are or already reduced."""

    def __init__(self, widths: Sequence[int]) -> None:
        self.rows: list[list[Array]] = [[np.zeros((0, width))] for width in widths]
        self.counts = np.zeros(len(widths), dtype=int)

    def add(self, joint: int, rows: Array) -> None:
        self.counts[joint] += len(rows)
        self.rows[joint].append(rows)
        if sum(map(len, self.rows[joint])) > 2048:  # as long as the blocks of rows that a reduction takes at once
            self.reduce(joint)

    def reduce(self, joint: int) -> None:
        stacked = np.vstack(self.rows[joint])
        # Fewer rows than twice their width take no more room as they are, and cost nothing.
        self.rows[joint] = [triangular(stacked) if len(stacked) > 2 * stacked.shape[1] else stacked.copy()]

    def close(self) -> None:
        for joint in range(len(self.rows)):
            self.reduce(joint)

    def merge(self, other: _Block) -> None:
        self.counts = self.counts + other.counts
        for own, further in zip(self.rows, other.rows, strict=True):
            own.extend(further)
        self.close()


class TimeBlocks:
    """At most so many blocks of data, each a contiguous stretch, however long the data is.

    When there are too many, neighbours are merged. What the blocks are follows from the data alone, not from the
    chunks in which it was read.

    Parameters
    ----------
    empty : tuple of Factor
        The factors of no data, one for each joint.
    most : int
    """

    def __init__(self, empty: tuple[Factor, ...], most: int = MOST) -> None:
        self.empty, self.most = empty, most
        self._blocks: list[_Block] = []
        self._length, self._filled = SHORTEST, 0

    def add(self, rows: Sequence[Array], mask: NDArray[np.bool_] | None = None) -> None:
        """Add rows ``[W omega]`` (samples, c + 1) of every joint, of which the mask (samples, N) tells which count."""
        count, done = len(rows[0]), 0
        while done < count:
            if not self._blocks or self._filled == self._length:
                self._open()
            take = count - done if self.most == 1 else min(self._length - self._filled, count - done)
            part = slice(done, done + take)
            for joint, all_rows in enumerate(rows):
                chosen = all_rows[part] if mask is None else all_rows[part][mask[part, joint]]
                self._blocks[-1].add(joint, chosen)
            self._filled, done = (0 if self.most == 1 else self._filled + take), done + take

    def _open(self) -> None:
        if self._blocks:
            self._blocks[-1].close()
        if len(self._blocks) >= self.most > 1:
            self._halve()
            self._length *= 2
        self._blocks.append(_Block([len(f.columns) + 1 for f in self.empty]))
        self._filled = 0

    def _halve(self) -> None:
        for left, right in zip(self._blocks[::2], self._blocks[1::2], strict=False):
            left.merge(right)
        self._blocks = self._blocks[::2]

    def append(self, other: TimeBlocks) -> None:
        """Add the blocks of data that follows, such as the next log."""
        self._blocks.extend(other._blocks)
        while len(self._blocks) > 2 * self.most:
            self._halve()

    @property
    def held(self) -> tuple[tuple[NDArray[np.intp], tuple[Array, ...]], ...]:
        """Of each block how many rows of every joint went in, (N,), and what is kept of them, as plain arrays."""
        for block in self._blocks:
            block.close()
        return tuple((block.counts, tuple(np.vstack(rows) for rows in block.rows)) for block in self._blocks)

    @classmethod
    def of_held(cls, empty: tuple[Factor, ...], held: Sequence[tuple[NDArray[np.intp], Sequence[Array]]]) -> TimeBlocks:
        """Return the blocks of which `held` told, perhaps in another process."""
        blocks = cls(empty)
        for counts, rows in held:
            block = _Block([len(f.columns) + 1 for f in empty])
            block.counts, block.rows = np.array(counts, dtype=int), [[one] for one in rows]
            blocks._blocks.append(block)
        return blocks

    def factors(self) -> tuple[Factor, ...]:
        """One for each joint, of all the data."""
        return self._factors(self._blocks)

    def folds(self, count: int = 5) -> tuple[tuple[Factor, ...], ...]:
        """The factors of so many stretches of about equal length, one after the other; fewer where data is short."""
        sizes = np.cumsum([int(block.counts.sum()) for block in self._blocks])
        if not len(sizes) or not sizes[-1]:
            return ()
        # A block belongs to the stretch in which its middle lies.
        middles = sizes - 0.5 * np.diff(sizes, prepend=0)
        stretch = np.minimum((middles / sizes[-1] * count).astype(int), count - 1)
        groups = [[b for b, s in zip(self._blocks, stretch, strict=True) if s == k] for k in range(count)]
        return tuple(self._factors(group) for group in groups if group)

    def _factors(self, blocks: Sequence[_Block]) -> tuple[Factor, ...]:
        found = []
        for joint, factor in enumerate(self.empty):
            rows = [part for block in blocks for part in block.rows[joint]]
            triangle = triangular(np.vstack(rows)) if rows else factor.triangle
            count = int(sum(block.counts[joint] for block in blocks))
            found.append(Factor(factor.joint, factor.columns, triangle, count))
        return tuple(found)
