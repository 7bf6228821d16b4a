"""Joints that stick: at rest while their torque changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .intervals import Intervals, runs
from .resolution import noise_deviation, resolution

if TYPE_CHECKING:
    from ..recording import Recording

__all__ = ["find_stiction", "stiction_duration", "stuck_while_others_move"]

Array = NDArray[np.float64]
AT_REST = "at rest while the torque changes"
LEAST_TIME = 0.02
TURN = 3.0
"""A rest is longer than this many times the time that a joint takes to turn around within the tolerance."""
PARTS = 6
TOGETHER = 0.7
"""Share of a joint's rest in which all joints are at rest, from which it is a rest of the robot."""


def stiction_duration(recording: Recording) -> tuple[Array, Array]:
    """Return for each joint (N,) the tolerance within which it counts as at rest, and how long it has to, in s.

    The tolerance is one and a half steps of the encoder or four times the noise of the positions. A moving joint that
    turns around stays within it for ``2 sqrt(2 tolerance / |ddq|)``; three times that, for the usual acceleration, is
    no turn any more.
    """
    q, rate = recording.q, recording.rate
    tolerance = np.maximum(1.5 * resolution(q), 4.0 * noise_deviation(q))
    tolerance = np.maximum(tolerance, 1e-9)
    size = max(1, round(0.05 * rate))
    coarse = q[::size]
    longest = np.full(len(tolerance), LEAST_TIME)
    if len(coarse) >= 5:
        acceleration = np.sqrt(np.mean(np.diff(coarse, n=2, axis=0) ** 2, axis=0)) * (rate / size) ** 2
        with np.errstate(divide="ignore"):
            turn = 2.0 * np.sqrt(2.0 * tolerance / acceleration)
        longest = np.maximum(longest, TURN * turn)
    return tolerance, longest


def find_stiction(
    recording: Recording, duration: Array | float | None = None, tolerance: Array | None = None
) -> Intervals:
    """Find where a joint stands still while its torque changes.

    Static friction then takes up whatever the rest of the joint's torque is; no model of sliding friction says what.

    Parameters
    ----------
    recording : Recording
    duration : float or ndarray, optional
        s, shortest rest; by default what `stiction_duration` says.
    tolerance : ndarray, optional
        (N,) rad or m, travel within a rest; by default what `stiction_duration` says.

    Returns
    -------
    Intervals
        Its `level` is the tolerance.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(4000) / 1000
    >>> q = np.where(t < 1, np.sin(np.pi / 2 * t), np.where(t < 2, 1.0, 1.0 + np.sin(t - 2)))
    >>> found = find_stiction(Recording(t=t, q=q[:, None], torque=np.sin(5 * t)[:, None]))
    >>> [(round(one.begin, 1), round(one.end, 1)) for one in found]
    [(1.0, 2.0)]
    """
    own_tolerance, own_duration = stiction_duration(recording)
    tolerance = own_tolerance if tolerance is None else np.asarray(tolerance, dtype=np.float64)
    lengths = own_duration if duration is None else np.broadcast_to(np.asarray(duration, float), own_duration.shape)
    flags = _resting(recording, tolerance, lengths)
    for j in range(recording.joint_count):
        for start, stop in runs(flags[:, j]):
            flags[start:stop, j] = _changes(recording.torque[start:stop, j])
    return Intervals(AT_REST, flags, recording.t, tolerance)


def stuck_while_others_move(recording: Recording) -> Intervals:
    """Return what `find_stiction` finds, without the rests that every sound log has.

    Those are the rests at its begin and end, and those of all joints together, where nothing was commanded to move.
    """
    found = find_stiction(recording)
    if not found:
        return found
    tolerance, lengths = stiction_duration(recording)
    together = np.all(_resting(recording, tolerance, lengths), axis=1) & (recording.joint_count > 1)
    flags = found.flags.copy()
    for one in found:
        rows = slice(one.start, one.stop)
        # Joints do not come to rest in the very same row.
        if one.start == 0 or one.stop == recording.count or np.mean(together[rows]) > TOGETHER:
            flags[rows, one.joint] = False
    return Intervals(AT_REST, flags, recording.t, tolerance)


def _resting(recording: Recording, tolerance: Array, lengths: Array) -> NDArray[np.bool_]:
    """(S, N) rows where a joint travels no further than its tolerance for its shortest rest at least."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    flags = np.zeros(recording.q.shape, dtype=bool)
    for j in range(recording.joint_count):
        if not np.isfinite(lengths[j]) or np.ptp(recording.q[:, j]) <= tolerance[j]:
            continue
        size = max(3, round(float(lengths[j]) * recording.rate) | 1)
        if size >= recording.count:
            continue
        q = recording.q[:, j]
        travel = maximum_filter1d(q, size, mode="nearest") - minimum_filter1d(q, size, mode="nearest")
        centre = travel <= tolerance[j]
        half = size // 2
        centre[:half] = centre[recording.count - half :] = False
        flags[:, j] = maximum_filter1d(centre.astype(np.uint8), size, mode="constant") > 0
    return flags


def _changes(torque: Array) -> bool:
    """Whether the torque changes by more than its scatter about the means of a few parts of the interval."""
    parts = np.array_split(torque, min(PARTS, len(torque)))
    means = np.array([part.mean() for part in parts])
    scatter = float(
        np.sqrt(np.mean(np.concatenate([part - mean for part, mean in zip(parts, means, strict=True)]) ** 2))
    )
    return float(np.ptp(means)) > max(scatter, 1e-9 * float(np.abs(torque).max()))
