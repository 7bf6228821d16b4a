"""Rows that repeat the row before: the logger went on while nothing new arrived."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .intervals import Intervals
from .resolution import resolution

if TYPE_CHECKING:
    from ..recording import Recording

__all__ = ["find_repeated"]


def find_repeated(recording: Recording) -> Intervals:
    """Find rows whose positions and torques, all of them, are those of the row before while a joint moves.

    A joint counts as moving where it changes, over the rows around, by more than two steps of its encoder a row; slow
    motion that the encoder does not resolve from row to row is no fault. All joints of such a row are flagged: its
    motion is wrong.

    Returns
    -------
    Intervals

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(1000)[:, None] / 1000
    >>> q, torque = np.sin(3 * t), np.cos(2 * t)
    >>> q[500:504], torque[500:504] = q[499], torque[499]
    >>> [(one.start, one.stop) for one in find_repeated(Recording(t=t[:, 0], q=q, torque=torque))]
    [(500, 504)]
    """
    q, torque = recording.q, recording.torque
    same = np.zeros(len(q), dtype=bool)
    same[1:] = np.all(q[1:] == q[:-1], axis=1) & np.all(torque[1:] == torque[:-1], axis=1)
    if same.any():
        reach = 10
        ahead = np.minimum(np.arange(len(q)) + reach, len(q) - 1)
        behind = np.maximum(np.arange(len(q)) - reach, 0)
        speed = np.abs(q[ahead] - q[behind]) / (ahead - behind)[:, None]
        same &= np.any(speed > np.maximum(2.0 * resolution(q), 1e-12), axis=1)
    flags = np.repeat(same[:, None], recording.joint_count, axis=1)
    return Intervals("copies of the row before", flags, recording.t)
