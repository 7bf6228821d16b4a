"""Torques at a limit of a drive or of its sensor, found while samples arrive: what they are in truth is not known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.diagnosis.detectors import LONGEST_LEAST, saturation_levels

from .saved_state import Stateful

__all__ = ["ALIKE", "TorqueLimits"]

Array = NDArray[np.float64]

AROUND = 0.025
"""s before and after a torque at a limit that are left out, too. Beneath it noise decides which torque is clipped, and
those that are not are too small. *Measured* with 5 and 20 % of the torques of a WAM clipped, with white noise of 5 %:
without the clipped ones alone, intervals of 95 % hold 55 to 83 %."""

CROWDED, NEAR, FEWEST_STEPS = 12.0, 1e-3, 200
"""Torques at a level over those just below, within so large a part of their range or the next step of a coarse one; and
steps that the range must have at least. With the 4 by which a whole log is asked, which has all of its peaks, each flat
peak of a smooth torque in steps counts until a higher one comes: *measured* on 56 joints of a WAM that move for 10 s,
without noise and in steps of a thousandth to a twentieth of the torque, a quarter of all rows would be near a level."""

REPEATED = 0.01
"""Part of the torques below a level that are the same as the one before, beyond which this is asked: of others, which
have noise and hardly any steps, no three running are the same at a peak."""

ALIKE = 100
"""Samples of a joint that moves after which a torque that is always the same is no chance."""

FAR = 1_000_000  # samples from the last torque at a limit, where there was none

AGAIN = 20
"""Samples before a joint's torques are searched for a limit again; each search takes some 0.5 ms, and a robot whose
torques come ten times less often than its positions repeats each of them."""

SLACK = 1e-6
"""Part of the range of a torque by which it may be beside a level and stands at it, as in `clipped_rows`."""


class TorqueLimits(Stateful):
    """Knows the least and the largest value at which the torque of each joint stands, where it does.

    A torque that is the same in three samples running, and none of the newest is beyond it, makes `saturation_levels`
    be asked of the newest samples. A level that a later torque is beyond was none. A torque that is always the same
    while the joint moves stands at a limit, too.

    Parameters
    ----------
    joints : int
    rate : float
        Hz.

    Attributes
    ----------
    levels : ndarray
        (N, 2), infinite where none is known.
    """

    _STATE = ("levels", "_slack", "_last", "_since", "_searched")

    def __init__(self, joints: int, rate: float) -> None:
        self.levels = np.tile([-np.inf, np.inf], (joints, 1))
        self._slack = np.zeros(joints)
        self._last = np.full((LONGEST_LEAST - 1, joints), np.nan)
        self._around = round(AROUND * rate)
        self._since = np.full(joints, FAR)
        self._searched = np.full(joints, AGAIN)  # samples since then

    @property
    def known(self) -> NDArray[np.bool_]:
        """Of which joints (N,) a level is known."""
        return np.asarray(np.isfinite(self.levels).any(axis=1))

    def learn(self, torque: Array, newest: Callable[[int], Array]) -> None:
        """Learn from torques that come, (S, N); `newest` tells those of a joint that counted as moving, (M,)."""
        rows = np.vstack([self._last, torque])
        self._last = rows[1 - LONGEST_LEAST :]
        self._searched += len(torque)
        if not np.isinf(self.levels).all():
            with np.errstate(invalid="ignore"):  # a torque may be missing
                lower = np.any(torque < self.levels[:, 0] - self._slack, axis=0)
                higher = np.any(torque > self.levels[:, 1] + self._slack, axis=0)
            self.levels[lower, 0], self.levels[higher, 1] = -np.inf, np.inf
        alike = np.asarray(rows[1:] == rows[:-1], dtype=bool)
        if not alike.any():
            return
        pairs = np.lib.stride_tricks.sliding_window_view(alike, LONGEST_LEAST - 1, axis=0)
        stays = np.asarray(pairs.all(axis=-1))
        for joint in np.flatnonzero(stays.any(axis=0) & (self._searched >= AGAIN)).tolist():
            values = torque[stays[:, joint], joint]
            low, high = self.levels[joint]
            if np.all((values <= low + self._slack[joint]) | (values >= high - self._slack[joint])):
                continue
            shown = newest(joint)
            if len(shown) and (values.max() >= shown.max() or values.min() <= shown.min()):
                if len(shown) > ALIKE and np.ptp(shown) == 0.0:  # whether from above or below is not known yet
                    self.levels[joint] = shown[0]
                else:
                    found = np.array([-_highest(-shown), _highest(shown)])
                    self.levels[joint] = np.where(np.isfinite(found), found, self.levels[joint])
                self._slack[joint] = SLACK * float(np.ptp(shown))
                self._searched[joint] = 0

    def near(self, torque: Array, count: int) -> NDArray[np.bool_] | None:
        """Return which of the first torques (count, N) are at a level or near one that is; None where none is known.

        They follow those that were asked for before. Further ones are those after them, as far as these have come.
        """
        if np.isinf(self.levels).all():
            self._since[:] = FAR
            return None
        torque = torque[: count + self._around]
        at = (torque <= self.levels[:, 0] + self._slack) | (torque >= self.levels[:, 1] - self._slack)
        places = np.broadcast_to(np.arange(len(torque))[:, None], at.shape)
        last = np.maximum.accumulate(np.vstack([-1 - self._since, np.where(at, places, -FAR)]))[1:]
        following = np.minimum.accumulate(np.where(at, places, FAR)[::-1])[::-1]
        self._since = np.minimum(count - 1 - last[count - 1], FAR)
        return np.asarray(np.minimum(places - last, following - places)[:count] <= self._around)


def _highest(values: Array) -> float:
    """Return the level at which values (M,) are clipped from above; infinite where none is seen.

    Those that come in steps are looked at up to the last one at the level, and as they came there back again: a peak
    that has just passed is crowded by those below on one side alone.
    """
    top, spread = float(values.max()), float(np.ptp(values))
    at = values >= top - SLACK * spread
    below = np.flatnonzero(~at)
    if np.count_nonzero(np.diff(values[below]) == 0.0) > REPEATED * len(below):
        last, step = int(np.flatnonzero(at)[-1]), top - float(values[below].max())
        before = below[below < last]
        values = np.concatenate([values[: last + 1], values[: int(before[-1]) + 1 if len(before) else 0][::-1]])
        low, high = top - max(1.5 * step, NEAR * spread), top - SLACK * spread
        near = np.count_nonzero((values >= low) & (values < high))
        if step > spread / FEWEST_STEPS or np.count_nonzero(values >= high) <= CROWDED * near:
            return np.inf
    return float(saturation_levels(values[:, None])[0, 1])
