"""Logs of several episodes, as in LeRobot's data sets: each begins at the time 0, and they follow each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from .log_file import Columns, LogFile

__all__ = ["EpisodesLog", "with_episodes_apart"]

EPISODE, TIMESTAMP = "episode_index", "timestamp"
BETWEEN_EPISODES = 1000.0
"""s from the last row of an episode to the first one of the next, more than any gap that is filled."""


def with_episodes_apart(file: LogFile) -> LogFile:
    """Return a log with its episodes one after the other in time; the log itself where it has no more than one.

    Examples
    --------
    >>> from .memory import memory_log
    >>> episodes = {"timestamp": [0.0, 0.1, 0.0, 0.1], "episode_index": [0, 0, 1, 1]}
    >>> with_episodes_apart(memory_log(episodes, "data")).read(["timestamp"])["timestamp"].tolist()
    [0.0, 0.1, 1000.1, 1000.2]
    """
    if not {EPISODE, TIMESTAMP} <= set(file.names):
        return file
    read = file.read([EPISODE, TIMESTAMP])
    begins = np.flatnonzero(np.diff(read[EPISODE]) != 0) + 1
    return EpisodesLog(file, read[TIMESTAMP], begins) if begins.size else file


class EpisodesLog(LogFile):
    """A log whose episodes follow each other with long pauses, at which it is split; see `with_episodes_apart`."""

    def __init__(self, file: LogFile, t: NDArray[np.float64], begins: NDArray[np.intp]) -> None:
        super().__init__(file.path)
        self.file, self.names, self.stated = file, file.names, file.stated
        offsets = np.zeros_like(t)
        offsets[begins] = t[begins - 1] - t[begins] + BETWEEN_EPISODES
        self._times = t + np.cumsum(offsets)
        self._count = len(begins) + 1

    def __str__(self) -> str:
        return str(self.file)

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        return self._with_times(self.file.read(names), 0)

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of rows, from row `start` on."""
        for block in self.file.blocks_from(start, names, rows):
            yield self._with_times(block, start)
            start += len(block[names[0]])

    def _with_times(self, columns: Columns, start: int) -> Columns:
        if TIMESTAMP not in columns:
            return columns
        return {**columns, TIMESTAMP: self._times[start : start + len(columns[TIMESTAMP])]}

    def keep(self, names: Sequence[str]) -> None:
        """See `LogFile.keep`."""
        self.file.keep(names)

    def count(self) -> int:
        """Count the rows."""
        return self.file.count()

    def places(self) -> tuple[tuple[int, int], ...] | None:
        """See `LogFile.places`."""
        return self.file.places()

    def use_places(self, places: tuple[tuple[int, int], ...]) -> None:
        """See `LogFile.use_places`."""
        self.file.use_places(places)

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns."""
        return self.file.texts(names)

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints of numbered columns."""
        return self.file.joint_labels()

    def notes(self) -> tuple[str, ...]:
        """Say that there are episodes."""
        return (
            *self.file.notes(),
            f"It holds {self._count} episodes by its column {EPISODE!r}, each with times of its own: they follow each "
            f"other {BETWEEN_EPISODES:g} s apart here.",
        )

    def offset(self, name: str) -> int | Fraction:
        """See `LogFile.offset`."""
        return self.file.offset(name)

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        return self.file.origin(name)

    def where(self, row: int) -> str:
        """Say where row `row` (from 0) stands, for messages."""
        return self.file.where(row)
