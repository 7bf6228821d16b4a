"""Torques that are clipped at a level."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .intervals import Intervals, runs

if TYPE_CHECKING:
    from ..recording import Recording

__all__ = ["find_saturation", "saturation_levels"]

Array = NDArray[np.float64]
FEWEST = 5
LONGEST_LEAST = 3
CROWDED = 4.0
"""Rows at the level over rows just below it, in a band as wide: a smooth maximum has fewer than two and a half."""


def saturation_levels(torque: ArrayLike) -> Array:
    """Return the levels (N, 2), lowest and highest, at which torques (S, N) are clipped; infinite where none is seen.

    A clipped signal stands at its extreme many times, several rows running, while values just below are rare.

    Examples
    --------
    >>> t = np.arange(2000) / 1000
    >>> saturation_levels(np.clip(9 * np.sin(6 * t), -np.inf, 7.0)[:, None]).tolist()
    [[-inf, 7.0]]
    """
    columns = np.asarray(torque, dtype=np.float64)
    levels = np.tile([-np.inf, np.inf], (columns.shape[1], 1))
    for j, column in enumerate(columns.T):
        for side, sign in enumerate((-1.0, 1.0)):
            level = _clipped_at(sign * column)
            if level is not None:
                levels[j, side] = sign * level
    return levels


def _clipped_at(values: Array) -> float | None:
    """The level at which values are clipped from above."""
    top = float(values.max())
    spread = float(top - values.min())
    if spread <= 0.0:
        return None
    unequal = np.unique(values)
    gaps = np.diff(unequal[-200:])
    # One step of a quantised signal, or else next to nothing.
    width = max(
        1e-6 * spread,
        1e-9 * abs(top),
        0.5 * float(gaps.min()) if len(gaps) and len(unequal) < len(values) // 4 else 0.0,
    )
    at = values >= top - width
    longest = max((stop - start for start, stop in runs(at)), default=0)
    step = max(2.0 * width, 1e-3 * spread)
    below = np.count_nonzero((values < top - width) & (values >= top - width - step))
    count = np.count_nonzero(at)
    if count >= FEWEST and longest >= LONGEST_LEAST and count > CROWDED * below:
        return top
    return None


def find_saturation(recording: Recording, levels: ArrayLike | None = None) -> Intervals:
    """Find where the torque of a joint is clipped; the row before and after count, too.

    Parameters
    ----------
    recording : Recording
    levels : array_like, optional
        (N,) N·m or N, on either side of 0, or (N, 2) lowest and highest; by default those of `saturation_levels`.

    Returns
    -------
    Intervals
        Its `level` is the smaller level of each joint, infinite where it has none.

    Raises
    ------
    InputError
        Where the levels do not fit the joints.
    """
    bounds = saturation_levels(recording.torque) if levels is None else np.asarray(levels, dtype=np.float64)
    joints = recording.joint_count
    if bounds.ndim == 0:
        bounds = np.full(joints, float(bounds))
    if bounds.shape == (joints,):
        bounds = np.column_stack([-np.abs(bounds), np.abs(bounds)])
    if bounds.shape != (joints, 2):
        raise InputError(f"{recording.source} has {joints} joints; give one level of saturation, or one for each.")
    slack = 1e-6 * np.ptp(recording.torque, axis=0)
    at = (recording.torque <= bounds[:, 0] + slack) | (recording.torque >= bounds[:, 1] - slack)
    flags = at.copy()
    flags[1:] |= at[:-1]
    flags[:-1] |= at[1:]
    return Intervals("at a level where the torque is clipped", flags, recording.t, np.abs(bounds).min(axis=1))
