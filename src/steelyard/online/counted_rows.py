"""The data that an Information counts: all of it, that of a window, or the more the newer it is."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.regression import Information

from .running_information import RunningInformation

__all__ = ["CountedRows"]

Array = NDArray[np.float64]

PARTS = 8
"""A window is kept in so many parts, the oldest of which is dropped as a whole: it covers between the time that was
asked for and an eighth more. Twice as many make it sharper, and each sum over the parts dearer."""


class CountedRows:
    """The rows that count.

    Parameters
    ----------
    model : Model
    keep : float
        See `RunningInformation.add`.
    window : int, optional
        Samples; older ones are dropped.
    """

    def __init__(self, model: Model, keep: float = 1.0, window: int | None = None) -> None:
        self.model, self.keep = model, keep
        self._length = None if window is None else ceil(window / PARTS)
        self._parts: list[RunningInformation] = []
        self._older: RunningInformation | None = None
        self._current, self._filled = RunningInformation(model), 0

    def add(self, rows: Sequence[Array], used: NDArray[np.bool_]) -> None:
        """Add rows ``[W omega]`` of every joint; see `RunningInformation.add`."""
        start, count = 0, len(used)
        while start < count:
            stop = count if self._length is None else min(count, start + self._length - self._filled)
            part, shown = [own[start:stop] for own in rows], used[start:stop]
            self._current.add(part, shown, self.keep)
            if self.keep < 1.0 and self._older is not None:
                for earlier in (*self._parts, self._older):
                    earlier.forget(shown.sum(axis=0), self.keep)
            self._filled, start = self._filled + stop - start, stop
            if self._filled == self._length:
                self._end_part()

    def _end_part(self) -> None:
        self._parts = [*self._parts, self._current.ended()][-PARTS:]
        self._current, self._filled = RunningInformation(self.model), 0
        self._older = self._parts[0].copy()
        for part in self._parts[1:]:
            self._older.merge(part)

    def information(self, batch_means: bool = True) -> Information:
        """All of it, with sums of neighbouring rows or, at once, without."""
        current = self._current.information(batch_means)
        return current if self._older is None else self._older.information(batch_means) + current

    def squared(self) -> list[Array]:
        """Rows of each joint with the Gram matrix of all rows, weighted by the squares of what is left of them."""
        current = self._current.squared()
        if self._older is None:
            return list(current)
        return [np.vstack(both) for both in zip(self._older.squared(), current, strict=True)]
