"""Torques at a limit of a drive or of its sensor, found while samples arrive: what they are in truth is not known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.diagnosis.detectors import LONGEST_LEAST, saturation_levels

from .saved_state import Stateful

__all__ = ["TorqueLimits"]

Array = NDArray[np.float64]

AGAIN = 20
"""Samples before a joint's torques are searched for a limit again; each search takes some 0.5 ms, and a robot whose
torques come ten times less often than its positions repeats each of them."""

SLACK = 1e-6
"""Part of the range of a torque by which it may be beside a level and stands at it, as in `clipped_rows`."""


class TorqueLimits(Stateful):
    """Knows the least and the largest value at which the torque of each joint stands, where it does.

    A torque that is the same in three samples running, and none of the newest is beyond it, makes `saturation_levels`
    be asked of the newest samples. A level that a later torque is beyond was none.

    Parameters
    ----------
    joints : int

    Attributes
    ----------
    levels : ndarray
        (N, 2), infinite where none is known.
    """

    _STATE = ("levels", "_slack", "_last", "_was_at", "_searched")

    def __init__(self, joints: int) -> None:
        self.levels = np.tile([-np.inf, np.inf], (joints, 1))
        self._slack = np.zeros(joints)
        self._last = np.full((LONGEST_LEAST - 1, joints), np.nan)
        self._was_at = np.zeros(joints, dtype=bool)
        self._searched = np.full(joints, AGAIN)  # samples since then

    def learn(self, torque: Array, newest: Callable[[int], Array]) -> None:
        """Learn from torques that come, (S, N); `newest` tells those of a joint that counted as moving, (M,)."""
        rows = np.vstack([self._last, torque])
        self._last = rows[1 - LONGEST_LEAST :]
        self._searched += len(torque)
        with np.errstate(invalid="ignore"):  # a torque may be missing
            sides = torque < self.levels[:, 0] - self._slack, torque > self.levels[:, 1] + self._slack
            for side, beyond in enumerate(sides):
                self.levels[beyond.any(axis=0), side] = (-np.inf, np.inf)[side]
            stays = np.diff(rows, axis=0) == 0.0
        if not stays.any():
            return
        stays = np.lib.stride_tricks.sliding_window_view(stays, LONGEST_LEAST - 1, axis=0).all(axis=-1)
        for joint in np.flatnonzero(stays.any(axis=0) & (self._searched >= AGAIN)).tolist():
            values = torque[stays[:, joint], joint]
            low, high = self.levels[joint]
            if np.all((values <= low + self._slack[joint]) | (values >= high - self._slack[joint])):
                continue
            shown = newest(joint)
            if len(shown) and (values.max() >= shown.max() or values.min() <= shown.min()):
                found = saturation_levels(shown[:, None])[0]
                self.levels[joint] = np.where(np.isfinite(found), found, self.levels[joint])
                self._slack[joint] = SLACK * float(np.ptp(shown))
                self._searched[joint] = 0

    def at(self, torque: Array, count: int) -> NDArray[np.bool_] | None:
        """Return which of the first torques (count, N), of rows that follow those asked for before, are at a level or
        next to one that is; None where no level is known. Further ones are those after them.
        """
        if not np.isfinite(self.levels).any():
            self._was_at[:] = False
            return None
        at = (torque <= self.levels[:, 0] + self._slack) | (torque >= self.levels[:, 1] - self._slack)
        near = at[:count].copy()
        near[1:] |= at[: count - 1]
        near[0] |= self._was_at
        after = at[1 : count + 1]
        near[: len(after)] |= after
        self._was_at = at[count - 1].copy()
        return np.asarray(near)
