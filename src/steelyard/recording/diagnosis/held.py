"""Joints that do not move throughout a log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from .resolution import noise_deviation, resolution

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..recording import Recording

__all__ = ["HeldJoints"]

Array = NDArray[np.float64]

BLOCK_TIME, BLOCK_ROWS = 0.05, 16
"""Positions are averaged over at least so many s and rows: the means of 16 rows of white noise stay within 2.5 of its
standard deviations, in a log of any length."""
STEPS, DEVIATIONS = 1.5, 4.0
"""A joint is held where those means differ by no more than so many steps of the encoder or deviations of its noise."""
FEW_LEVELS = 3
"""An encoder that shows so few values throughout moves by single counts, too few to tell their size by."""
MOST_TRAVEL = 5e-3
"""rad or m: single positions of a held joint differ by no more, whatever their noise is said to be. Coarsely sampled
motion looks like noise, and goes farther."""
SMALLEST, SLOWEST = 1e-5, 1e-5
"""rad (m), and rad/s (m/s) on the average: a joint that goes no farther is held, however fine its encoder. On a
simulated arm of six joints without encoder noise, a first joint that creeps at 1e-6 rad/s let parameters be told by the
noise of the torques alone, and the error on another log rose from 1.3 to 139 %; at 1e-4 rad/s it stayed."""


@dataclass(frozen=True, eq=False)
class HeldJoints:
    """Joints whose positions differ from a constant by no more than the encoder's noise, or by next to nothing.

    Differences of such positions are noise, and so are their signs: as velocities and accelerations they would pass for
    a motion, which shows friction and inertia.

    Attributes
    ----------
    mask : ndarray of bool
        (N,).
    position : ndarray
        (N,) rad or m, where they are held.
    tolerance : ndarray
        (N,) rad or m: the means of positions over some hundredths of a second differ by no more.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(4000) / 1000
    >>> noise = 1e-5 * np.random.default_rng(1).normal(size=t.size)
    >>> q = np.column_stack([np.sin(t), 0.7 + noise])
    >>> held = HeldJoints.of(Recording(t=t, q=q, torque=np.column_stack([t, t])))
    >>> held.mask.tolist(), held.position.round(3).tolist()[1]
    ([False, True], 0.7)
    """

    mask: NDArray[np.bool_]
    position: Array
    tolerance: Array

    @classmethod
    def of(cls, recording: Recording) -> Self:
        """Find them in a recording, or in the first rows of a log."""
        q = recording.q
        tolerance = np.maximum(STEPS * resolution(q), DEVIATIONS * noise_deviation(q))
        tolerance = np.maximum(tolerance, max(SMALLEST, SLOWEST * recording.duration))
        travel = np.ptp(q, axis=0)
        few = np.array([len(np.unique(column[:1000])) <= FEW_LEVELS >= len(np.unique(column)) for column in q.T])
        tolerance[few] = np.maximum(tolerance[few], 1.001 * travel[few])  # means round
        held = cls(np.ones(q.shape[1], dtype=bool), np.median(q, axis=0), tolerance)
        return held.among([recording])

    def among(self, recordings: Iterable[Recording]) -> Self:
        """Those of them that do not move in other rows of the same log, either."""
        least = most = lowest = highest = self.position
        for recording in recordings:
            q = recording.q
            size = max(BLOCK_ROWS, round(BLOCK_TIME * recording.rate))
            blocks = len(q) // size
            means = q[: blocks * size].reshape(blocks, size, -1).mean(axis=1) if blocks else q
            least, most = np.minimum(least, means.min(axis=0)), np.maximum(most, means.max(axis=0))
            lowest, highest = np.minimum(lowest, q.min(axis=0)), np.maximum(highest, q.max(axis=0))
        still = (most - least <= self.tolerance) & (highest - lowest <= MOST_TRAVEL)
        return type(self)(self.mask & still, self.position, self.tolerance)

    def without_motion(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
        """The motion (S, N) with these joints at rest."""
        if not self.mask.any():
            return q, dq, ddq
        return tuple(  # type: ignore[return-value]
            np.where(self.mask, rest, values) for rest, values in ((self.position, q), (0.0, dq), (0.0, ddq))
        )

    def remarks(self, recording: Recording) -> tuple[str, ...]:
        """One sentence for each."""
        return tuple(
            f"J{recording.joint_label(j)[1:]} does not move (it stays at {self.position[j]:.6g}): the log shows "
            "nothing of its friction and rotor inertia, and of the links beyond it only what the other joints' motion "
            "and gravity show; record a motion of it to know more."
            for j in map(int, np.flatnonzero(self.mask))
        )
