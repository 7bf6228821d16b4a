"""The rows that are examined of a log that is too long to be examined as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from .formats import LogFiles
from .formats.log_file import BLOCK_ROWS, Columns, column_length
from .formats.memory import MemoryLog
from .recognition import Layout

__all__ = ["LONGEST_EXAMINED", "LogSample", "Stretch", "sample_of"]

LONGEST_EXAMINED = 300_000
"""Rows up to which a log is examined as a whole. Two million rows of seven joints would need 3 GB and minutes."""
IN_THE_MIDDLE, STRETCHES, IN_A_STRETCH = 200_000, 5, 40_000
"""Rows in the middle that are examined, and stretches beside them, from the first rows to the last, that are searched
for faulty rows."""


class Stretch(MemoryLog):
    """Rows of a log, from `first` on, in memory."""

    def __init__(self, files: LogFiles, columns: Columns, labels: Sequence[str], first: int) -> None:
        super().__init__(columns, files.name, labels, files.stated)
        self.files, self.first = files, first

    @property
    def rows(self) -> str:
        """Which rows these are, from 1."""
        return f"{self.first + 1} to {self.first + self.count()}"

    def offset(self, name: str) -> int | Fraction:
        """Return what was taken off a column in the log."""
        return self.files.offset(name)

    def origin(self, name: str) -> int:
        """Return from when a column of dates counts in the log."""
        return self.files.origin(name)

    def where(self, row: int) -> str:
        """Say where a row stands in the log."""
        return self.files.where(self.first + row)


@dataclass(frozen=True, eq=False)
class LogSample:
    """Stretches of a log, and what is known of all of its rows.

    Attributes
    ----------
    count : int
        Rows of the log.
    t : ndarray or None
        (S,) the stamps of all rows, s; None where there are none.
    incomplete : int
        Rows outside of the middle in which a position or a torque is missing.
    """

    count: int
    t: NDArray[np.float64] | None
    incomplete: int
    middle: Stretch
    others: tuple[Stretch, ...]

    def __str__(self) -> str:
        return (
            f"rows {self.middle.rows} of {self.count}; of all the stamps, and whether numbers are missing; and "
            f"{len(self.others)} stretches of {IN_A_STRETCH} rows for faulty ones"
        )


def sample_of(files: LogFiles, layout: Layout) -> LogSample | None:
    """Read a long log once, and keep some stretches of it; None for a log that can be examined as a whole."""
    count = files.count()
    if count <= LONGEST_EXAMINED:
        return None
    start = (count - IN_THE_MIDDLE) // 2
    begins = np.linspace(0, count - IN_A_STRETCH, STRETCHES + 1).astype(int).tolist()
    outside = [first for first in begins if first + IN_A_STRETCH <= start or first >= start + IN_THE_MIDDLE]
    wanted = [(start, start + IN_THE_MIDDLE), *((first, first + IN_A_STRETCH) for first in outside)]
    kept: list[list[Columns]] = [[] for _ in wanted]
    needed = (*layout.position, *layout.torque)
    stamps: list[NDArray[np.float64]] = []
    place = incomplete = 0
    for block in files.blocks(layout.names, BLOCK_ROWS):
        rows = column_length(block)
        if layout.time is not None:
            stamps.append(layout.seconds(block))
        whole = np.logical_and.reduce([np.isfinite(block[name]) for name in needed])
        whole[max(start - place, 0) : max(start + IN_THE_MIDDLE - place, 0)] = True
        incomplete += int(rows - np.count_nonzero(whole))
        for (first, stop), parts in zip(wanted, kept, strict=True):
            if first < place + rows and stop > place:
                part = slice(max(first - place, 0), stop - place)
                parts.append({name: values[part].copy() for name, values in block.items()})
        place += rows
    labels = files.joint_labels()
    middle, *others = (
        Stretch(files, {name: np.concatenate([part[name] for part in parts]) for name in layout.names}, labels, first)
        for (first, _), parts in zip(wanted, kept, strict=True)
    )
    return LogSample(count, np.concatenate(stamps) if stamps else None, incomplete, middle, tuple(others))
