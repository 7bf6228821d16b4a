"""Contiguous stretches of data, each reduced by itself, from which folds of a cross-validation are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.threads import in_threads

from .factor import Factor, extended, most_held, triangular

__all__ = ["FOLDS", "MOST", "TimeBlocks"]

Array = NDArray[np.float64]

MOST = 20
"""Blocks that are kept: enough that five folds of them differ in length by a third at most."""

FOLDS = 5
"""Folds of a cross-validation."""

SHORTEST = 64
"""Samples in a block of the shortest logs: 320 samples make five folds."""

HELD = 16384
"""Samples that are held as they are before they are reduced: a dozen of blocks in which many short ones came together,
so that no rows are reduced in small portions. Of robots with many joints fewer, see `most_held`. With 10240, blocks of
512 were reduced first, and the reduction of 37500 samples of seven joints took a quarter longer."""


class _Block:
    """The rows of every joint in one stretch of time, as they are or already reduced."""

    def __init__(self, widths: Sequence[int]) -> None:
        self.triangles: list[Array | None] = [None] * len(widths)
        self.rows: list[list[Array]] = [[] for _ in widths]
        self.widths = widths
        self.counts = np.zeros(len(widths), dtype=int)

    def add(self, rows: Sequence[Array], counts: Sequence[int] | None = None) -> None:
        self.counts += [len(own) for own in rows] if counts is None else counts
        for held, own in zip(self.rows, rows, strict=True):
            held.append(own)

    def reduce(self, joint: int) -> None:
        """Reduce the rows of a joint, unless they are so few that they take no more room as they are."""
        rows, width, triangle = self.rows[joint], self.widths[joint], self.triangles[joint]
        if triangle is not None or sum(map(len, rows)) > 2 * width:
            self.triangles[joint] = extended(np.zeros((width, width)) if triangle is None else triangle, *rows)
            self.rows[joint] = []
        elif rows:
            self.rows[joint] = [np.concatenate(rows)]

    def kept(self, joint: int) -> Array:
        """Return few rows of a joint that have the same factor as all, once they are reduced."""
        triangle, rows = self.triangles[joint], self.rows[joint]
        return triangle if triangle is not None else rows[0] if rows else np.zeros((0, self.widths[joint]))

    def merge(self, other: _Block) -> None:
        self.counts = self.counts + other.counts
        for joint, own in enumerate(self.rows):
            further = other.triangles[joint]
            if self.triangles[joint] is None:
                self.triangles[joint] = further
            elif further is not None:
                own.append(further)
            own.extend(other.rows[joint])


class TimeBlocks:
    """A bounded number of blocks of data, each a contiguous stretch, however long the data is.

    When there are too many, the shortest neighbours are merged. What the blocks are follows from the data alone, not
    from the chunks in which it was read. The empty factors, one for each joint, are those of no data.
    """

    def __init__(self, empty: tuple[Factor, ...], most: int = MOST) -> None:
        self.empty, self.most = empty, most
        width = sum(len(factor.columns) + 1 for factor in empty)
        self._most_held = width * most_held(HELD, width)
        self._blocks: list[_Block] = []
        self._length, self._filled, self._held = SHORTEST, 0, 0

    def add(self, rows: Sequence[Array], mask: NDArray[np.bool_] | None = None) -> None:
        """Add rows ``[W omega]`` (samples, c + 1) of every joint, of which the mask (samples, N) tells which count."""
        count, done = len(rows[0]), 0
        while done < count:
            if not self._blocks or self._filled >= self._length:
                self._open()
            take = count - done if self.most == 1 else min(self._length - self._filled, count - done)
            part = slice(done, done + take)
            self._blocks[-1].add(
                [
                    own[part] if mask is None else np.compress(mask[part, joint], own[part], axis=0)
                    for joint, own in enumerate(rows)
                ]
            )
            self._filled, done = (0 if self.most == 1 else self._filled + take), done + take
            self._held += take * sum(own.shape[1] for own in rows)
            if self._held >= self._most_held:
                self._reduce()

    def add_combined(self, rows: Sequence[Array], counts: Sequence[int], samples: int) -> None:
        """Add rows that stand for so many others of each joint, and for so many samples: they stay in one block."""
        if not self._blocks or self._filled >= self._length:
            self._open()
        self._blocks[-1].add(rows, counts)
        self._filled += 0 if self.most == 1 else samples
        self._held += sum(own.size for own in rows)
        if self._held >= self._most_held:
            self._reduce()

    def _reduce(self) -> None:
        """Reduce what is held as it is."""
        joints = range(len(self.empty))
        held = [(block, k) for k in joints for block in self._blocks if block.rows[k]]
        in_threads(lambda place: place[0].reduce(place[1]), held)
        self._held = 0

    def _open(self) -> None:
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
            # Were all merged in pairs, as blocks of one length are, the first would hold half of a thousand logs.
            sizes = [int(block.counts.sum()) for block in self._blocks]
            first = int(np.argmin(np.add(sizes[:-1], sizes[1:])))
            self._blocks[first].merge(self._blocks.pop(first + 1))
        self._reduce()

    @property
    def held(self) -> tuple[tuple[NDArray[np.intp], tuple[Array, ...]], ...]:
        """For each block the number of rows of every joint, (N,), and what is kept of them, as plain arrays."""
        self._reduce()
        joints = range(len(self.empty))
        return tuple((block.counts, tuple(map(block.kept, joints))) for block in self._blocks)

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

    def folds(self, count: int = FOLDS) -> tuple[tuple[Factor, ...], ...]:
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
        self._reduce()
        joints = range(len(self.empty))
        triangles = in_threads(
            lambda k: triangular(self.empty[k].triangle, *(block.kept(k) for block in blocks)), joints
        )
        counts = np.sum([np.zeros(len(joints), dtype=int), *(block.counts for block in blocks)], axis=0).tolist()
        return tuple(
            replace(factor, triangle=triangle, count=count)
            for factor, triangle, count in zip(self.empty, triangles, counts, strict=True)
        )
