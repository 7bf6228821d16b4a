"""The newest motion and torques, thinned out: by them an estimator tells what may be wrong with the samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.recording import Samples

from .saved_state import Stateful

__all__ = ["RecentMotion"]

Array = NDArray[np.float64]

RATE = 200.0
"""Hz to which rows are averaged: a filtered motion shows no more, and delays come out to a fiftieth of the time between
rows."""

LASTS = 30.0
"""s that are kept: of trajectory A of the WAM, whose period is 12.5 s, delays are known to 0.4 ms by 25 s. It takes
1.7 MB for seven joints."""

TOGETHER = 200
"""Samples that are averaged at once; ten by ten takes as long as the filter does."""


class RecentMotion(Stateful):
    """Averages of q, dq, ddq and torque over a few neighbouring samples, of the newest half a minute.

    Parameters
    ----------
    joints : int
    rate : float
        Hz, of the samples.

    Examples
    --------
    >>> motion, t = RecentMotion(1, 1000.0), np.arange(1000) / 1000
    >>> ones = np.ones((1000, 1))
    >>> motion.add(True, t, (t[:, None], ones, 0.0 * ones, ones), ones > 0.0, ones > 0.0)
    >>> (stretch,) = motion.stretches()
    >>> stretch.count, stretch.q[:2, 0].round(3).tolist()
    (200, [0.002, 0.007])
    """

    _STATE = ("_kept", "_written", "_parts")

    def __init__(self, joints: int, rate: float) -> None:
        self.joints = joints
        self.length = max(1, round(rate / RATE))
        self._spacing = self.length / rate
        self._kept = np.zeros((round(LASTS / self._spacing), 2 + 5 * joints))  # a ring
        self._written, self._parts = 0, 0
        self._waiting: list[tuple[NDArray[Any], ...]] = []
        self._count = 0  # samples that wait

    def add(
        self, begins: bool, t: Array, motion: Sequence[Array], known: NDArray[np.bool_], used: NDArray[np.bool_]
    ) -> None:
        """Add samples that follow each other.

        Parameters
        ----------
        begins : bool
            Whether samples are missing before them.
        t : ndarray
            (S,) s.
        motion : sequence of ndarray
            q, dq, ddq and torque, (S, N) each.
        known, used : ndarray of bool
            (S, N), where the torque is known, and which rows count.
        """
        if begins:
            self._take()
            self._waiting, self._count, self._parts = [], 0, self._parts + 1
        *motion, torque = motion
        self._waiting.append((t, *motion, np.where(known, torque, np.nan), used))
        self._count += len(t)
        if self._count >= TOGETHER:
            self._take()

    def _take(self) -> None:
        """Average what waits, but for the last samples that do not make a whole average."""
        if not self._waiting:
            return
        rows = np.column_stack([np.concatenate(one) for one in zip(*self._waiting, strict=True)])
        count = len(rows) // self.length
        if not count:
            return
        whole, rest = np.split(rows, [count * self.length])
        self._wait(rest)
        means = whole.reshape(count, self.length, -1).mean(axis=1)[-len(self._kept) :]
        places = (self._written + np.arange(len(means))) % len(self._kept)
        self._kept[places, 0], self._kept[places, 1:] = self._parts, means
        self._written += len(means)

    def state(self) -> dict[str, Any]:
        """Return the state, without what of the ring is empty; whether it was asked before changes nothing of it."""
        self._take()
        waiting = [np.column_stack(one) for one in self._waiting]
        found = super().state() | {"waiting": np.vstack(waiting) if waiting else np.zeros((0, 1 + 5 * self.joints))}
        return found | {"kept": self._kept[: self._written]}

    def restore(self, state: Mapping[str, Any]) -> Self:
        """Take a state over."""
        kept, waiting = state["kept"], state["waiting"]
        self._kept[: len(kept)] = kept
        super().restore({**state, "kept": self._kept})
        self._wait(waiting)
        return self

    def _wait(self, rows: Array) -> None:
        """Let rows (S, 1 + 5 N) wait for those that make a whole average with them."""
        t, *parts = np.split(rows, [1 + k * self.joints for k in range(5)], axis=1)
        self._waiting = [(t[:, 0], *parts)] if len(rows) else []
        self._count = len(rows)

    @property
    def seconds(self) -> float:
        """s of motion that are kept."""
        return min(self._written, len(self._kept)) * self._spacing

    def stretches(self) -> list[Samples]:
        """Return the averages as samples with times, those without a gap together."""
        self._take()
        newest = np.roll(self._kept, -(self._written % len(self._kept)), axis=0)[-self._written :]
        ends = np.flatnonzero(np.diff(newest[:, 0])) + 1
        found = []
        for rows in np.split(newest, ends) if self._written else []:
            q, dq, ddq, torque, used = np.split(rows[:, 2:], 5, axis=1)
            mask = (used == 1.0) & np.isfinite(torque)
            for own in torque.T:  # what is moved or smoothed reaches over rows without a torque
                known = np.isfinite(own)
                own[~known] = np.interp(np.flatnonzero(~known), np.flatnonzero(known), own[known]) if known.any() else 0
            found.append(Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask, t=rows[:, 1]))
        return found
