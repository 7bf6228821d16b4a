"""Triangular factors that grow row by row: what an Information holds, updated a hundred times a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import replace
from math import ceil
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.regression import Factor, Information
from steelyard.regression.batch_means import BATCH_LENGTHS, summed, sums_of_all_lengths

from .saved_state import Stateful, alike

__all__ = ["CountedRows", "RunningInformation", "information_of", "information_state", "stacked"]

Array = NDArray[np.float64]

LONGEST = BATCH_LENGTHS[-1]
"""Samples after which all batches end, so that two parts that begin at such a sample add."""

PARTS = 8
"""A window is kept in so many parts, the oldest of which is dropped as a whole: it covers between the time that was
asked for and an eighth more. Twice as many make it sharper, and each sum over the parts dearer."""

COLUMNS_AT_ONCE = 16
"""The number of columns of a factor that LAPACK reduces in one piece; for factors of 12 to 80 columns, 8 and 32 take a
tenth longer."""


def stacked(triangle: Array, rows: Array) -> Array:
    """Return the upper triangle of the QR decomposition of a triangle (c, c) above rows (m, c), the triangle reused."""
    from scipy.linalg.lapack import dtpqrt

    # The rows are kept, as others may use them.
    found: Array = dtpqrt(0, min(COLUMNS_AT_ONCE, len(triangle)), triangle, rows, overwrite_a=1)[0]
    return found


class RunningInformation(Stateful):
    """The rows of each joint of one stretch of data, reduced as they come."""

    _STATE = ("_triangles", "_weights", "_levels", "_level_weights", "_filled", "_waiting")

    def __init__(self, model: Model) -> None:
        self._nothing = Information.empty(model)
        empty = self._nothing.factors
        self._triangles = [np.asfortranarray(f.triangle) for f in empty]
        self._weights = np.zeros(len(empty))
        # Of rows that are weighted by what is left of them once more: the variance of a weighted mean needs the squares
        # of the weights. Absent where nothing was forgotten yet.
        self._squared: list[Array] | None = None
        self._levels = [[np.asfortranarray(f.triangle) for f in empty] for _ in BATCH_LENGTHS]
        self._level_weights = np.zeros((len(BATCH_LENGTHS), len(empty)))
        self._block = [np.zeros((LONGEST, len(f.triangle))) for f in empty]
        # What is left of each row of the block; sums are of rows that count as those of the triangles do.
        self._left = np.ones((len(empty), LONGEST))
        self._filled = 0
        # Joints whose full block waits to be summed; one at a time, so that no update takes long.
        self._waiting: list[tuple[int, Array, Array]] = []

    def add(self, rows: Sequence[Array], used: NDArray[np.bool_], keep: float = 1.0) -> None:
        """Add rows ``[W omega]`` (samples, c + 1) of every joint, of which the mask (samples, N) tells which count.

        Parameters
        ----------
        rows : sequence of ndarray
        used : ndarray of bool
        keep : float
            What each new row of a joint leaves of the joint's squared residuals before it, such as 0.9999; 1 forgets
            nothing. A joint without rows forgets nothing.
        """
        count, start = len(used), 0
        if self._waiting:
            self._sum(*self._waiting.pop())
        while start < count:
            part = slice(start, min(count, start + LONGEST - self._filled))
            size = part.stop - part.start
            for k, own in enumerate(rows):
                mask = used[part, k]
                new = own[part]
                if not mask.all():
                    new = new * mask[:, None]
                self._block[k][self._filled : self._filled + size] = new
                if not mask.any():
                    continue
                weights = mask.astype(float)
                if keep < 1.0:
                    if self._squared is None:
                        self._squared = [triangle.copy(order="F") for triangle in self._triangles]
                    self._forget(k, keep ** int(mask.sum()))
                    # Rows that come together count as if they had come one by one.
                    left = keep ** (np.cumsum(weights[::-1])[::-1] - weights)
                    weights *= left
                    self._left[k, self._filled : self._filled + size] = left
                    self._squared[k] = stacked(self._squared[k], new * weights[:, None])
                    new = new * np.sqrt(weights)[:, None]
                self._triangles[k] = stacked(self._triangles[k], new)
                self._weights[k] += weights.sum()
            self._filled, start = self._filled + size, part.stop
            if self._filled == LONGEST:
                self._end_block()

    def forget(self, shown: NDArray[np.intp], keep: float) -> None:
        """Let the rows of each joint count less, as so many of it (N,) that are added elsewhere make them do."""
        for joint, left in enumerate(keep**shown):
            self._forget(joint, float(left))

    def _forget(self, joint: int, left: float) -> None:
        self._triangles[joint] *= np.sqrt(left)
        self._weights[joint] *= left
        if self._squared is not None:
            self._squared[joint] *= left
        for level in self._levels:
            level[joint] *= np.sqrt(left)
        self._level_weights[:, joint] *= left
        self._left[joint, : self._filled] *= left
        for other, _, waiting in self._waiting:
            if other == joint:
                waiting *= left

    def state(self) -> dict[str, Any]:
        """Return the state, without what of the block is empty."""
        blocks = [block[: self._filled] for block in self._block]
        return super().state() | {"squared": self._squared, "blocks": blocks, "left": self._left[:, : self._filled]}

    def restore(self, state: Mapping[str, Any]) -> Self:
        """Take a state over."""
        super().restore(state)
        if state["squared"] is not None:
            self._squared = [np.array(triangle, order="F") for triangle in state["squared"]]
        for own, given in zip([*self._block, self._left.T], [*state["blocks"], state["left"].T], strict=True):
            own[: self._filled] = given
        return self

    def _end_block(self) -> None:
        self._drain()
        self._waiting = list(zip(range(len(self._block)), self._block, self._left, strict=True))
        self._empty_block()

    def _empty_block(self) -> None:
        self._block = [np.zeros_like(block) for block in self._block]
        self._left = np.ones_like(self._left)
        self._filled = 0

    def _drain(self) -> None:
        while self._waiting:
            self._sum(*self._waiting.pop())

    def _sum(self, joint: int, block: Array, left: Array) -> None:
        share = 1.0
        if self._squared is not None:
            block, share = block * np.sqrt(left)[:, None], float(left.mean())
        for level, shown in enumerate(sums_of_all_lengths(summed(block, BATCH_LENGTHS[0]))):
            if len(shown):
                self._levels[level][joint] = stacked(self._levels[level][joint], shown)
                self._level_weights[level, joint] += share * len(shown)

    def ended(self) -> RunningInformation:
        """Sum the batches that are not full, too; nothing more may be added."""
        self._drain()
        if self._filled:
            for k, (block, left) in enumerate(zip(self._block, self._left, strict=True)):
                self._sum(k, block, left)
            self._empty_block()
        return self

    def copy(self) -> RunningInformation:
        """Return a copy that grows by itself."""
        return deepcopy(self, {id(self._nothing): self._nothing})

    def merge(self, other: RunningInformation) -> None:
        """Add what another part, which is ended, holds."""
        if self._squared is not None or other._squared is not None:
            parts = zip(self.squared(), other.squared(), strict=True)
            self._squared = [stacked(own.copy(order="F"), further) for own, further in parts]
        for k in range(len(self._triangles)):
            self._triangles[k] = stacked(self._triangles[k], other._triangles[k])
            for own, further in zip(self._levels, other._levels, strict=True):
                own[k] = stacked(own[k], further[k])
        self._weights += other._weights
        self._level_weights += other._level_weights

    def squared(self) -> Sequence[Array]:
        """Triangles of the rows of each joint, weighted by the squares of what is left of them."""
        return self._triangles if self._squared is None else self._squared

    def information(self, batch_means: bool = True) -> Information:
        """Return all the rows as an Information, with sums of neighbouring rows or without."""
        empty = self._nothing.factors
        levels: tuple[tuple[Factor, ...], ...] = ()
        if batch_means:
            whole = self.copy().ended()
            levels = tuple(
                _factors(empty, triangles, weights)
                for triangles, weights in zip(whole._levels, whole._level_weights, strict=True)
            )
        return replace(self._nothing, factors=_factors(empty, self._triangles, self._weights), batch_means=levels)


def _factors(empty: Sequence[Factor], triangles: Sequence[Array], weights: Array) -> tuple[Factor, ...]:
    found = []
    for factor, triangle, weight in zip(empty, triangles, weights, strict=True):
        signs = np.where(np.diagonal(triangle) < 0.0, -1.0, 1.0)
        upper = np.ascontiguousarray(np.triu(triangle) * signs[:, None])
        found.append(Factor(factor.joint, factor.columns, upper, round(float(weight))))
    return tuple(found)


class CountedRows(Stateful):
    """The rows that an Information counts: all of them, those of a window, or the more the newer they are.

    Parameters
    ----------
    keep : float
        See `RunningInformation.add`.
    window : int, optional
        Samples; older ones are dropped.
    """

    _STATE = ("_current", "_filled")

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

    def copy(self) -> CountedRows:
        """Return a copy that grows by itself."""
        other = copy(self)
        other._parts, other._current = [part.copy() for part in self._parts], self._current.copy()
        other._older = None if self._older is None else self._older.copy()
        return other

    def state(self) -> dict[str, Any]:
        """Return the state, with that of each part of the window."""
        older = None if self._older is None else self._older.state()
        return super().state() | {"parts": [part.state() for part in self._parts], "older": older}

    def restore(self, state: Mapping[str, Any]) -> Self:
        """Take a state over."""
        super().restore(state)
        self._parts = [RunningInformation(self.model).restore(part) for part in state["parts"]]
        if state["older"] is not None:
            self._older = RunningInformation(self.model).restore(state["older"])
        return self

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


def information_state(information: Information) -> list[list[list[Any]]]:
    """Return the numbers of an Information of such rows."""
    levels = (information.factors, *information.batch_means)
    return [[[factor.triangle, factor.count] for factor in level] for level in levels]


def information_of(model: Model, state: Sequence[Sequence[Sequence[Any]]]) -> Information:
    """Return the Information of which `information_state` gave the numbers."""
    empty = Information.empty(model)
    first, *others = (
        tuple(
            replace(factor, triangle=alike(factor.triangle, triangle, "triangle"), count=count)
            for factor, (triangle, count) in zip(empty.factors, level, strict=True)
        )
        for level in state
    )
    return replace(empty, factors=first, batch_means=tuple(others))
