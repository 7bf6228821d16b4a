"""Torques that are logged later or earlier than the motion, put beside the motion to which they belong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.recording.diagnosis.delay import cubic_weights

from .even_stream import Stretch
from .saved_state import Stateful

__all__ = ["MovedTorques"]

Array = NDArray[np.float64]


class MovedTorques(Stateful):
    """Holds positions back until the torques that belong to them are there.

    Between samples torques are interpolated by cubic polynomials, as in `Recording.process`.

    Parameters
    ----------
    rate : float
        Hz.
    delays : ndarray
        (N,) s, by which the torque of each joint is later than the motion; negative where it is earlier.

    Attributes
    ----------
    ahead : int
        Samples by which positions are held back.

    Examples
    --------
    >>> moved, t = MovedTorques(10.0, np.array([0.2])), np.arange(8) / 10
    >>> q, used = np.arange(8.0)[:, None], np.ones((8, 1), dtype=bool)
    >>> found = moved.add(Stretch(True, t, q, q - 2.0, used))
    >>> found.values[:, 0].tolist(), found.torque[:, 0].tolist()
    ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    """

    _STATE = ("_t", "_values", "_torque", "_behind", "_begins")

    def __init__(self, rate: float, delays: Array) -> None:
        self._offsets, self._weights = np.zeros((len(delays), 4), dtype=int), np.zeros((len(delays), 4))
        for joint, delay in enumerate(delays.tolist()):
            offsets, weights = cubic_weights(delay * rate)
            self._offsets[joint] = offsets  # a single one stands for all four
            self._weights[joint, : len(weights)] = weights
        self.ahead = max(0, int(self._offsets.max()))
        self._reach = max(0, -int(self._offsets.min()))
        self._t = np.zeros(0)
        self._values, self._torque = np.zeros((0, 0)), np.zeros((0, len(delays)))
        self._behind = 0  # of the rows that are held, those of which the motion was given on
        self._begins = True

    def add(self, stretch: Stretch) -> Stretch | None:
        """Add even samples; return those whose torques have come, None where there are none."""
        if stretch.begins:
            self._t, self._values, self._torque = self._t[:0], stretch.values[:0], self._torque[:0]
            self._behind, self._begins = 0, True
        self._t = np.concatenate([self._t, stretch.t])
        self._values = np.vstack([self._values, stretch.values]) if len(self._values) else stretch.values
        self._torque = np.vstack([self._torque, np.where(stretch.used, stretch.torque, np.nan)])
        first, end = self._behind, len(self._t) - self.ahead
        if end <= first:
            return None
        places = np.arange(first, end)[:, None, None] + self._offsets
        values = self._torque[np.maximum(places, 0), np.arange(self._torque.shape[1])[:, None]]
        # What no torque has come for, as before the first one, is not known.
        torque = np.einsum("snw,nw->sn", np.where(places >= 0, values, np.nan), self._weights)
        used = np.isfinite(torque)
        found = Stretch(self._begins, self._t[first:end], self._values[first:end], np.where(used, torque, 0.0), used)
        kept = max(0, end - self._reach)
        self._t, self._values, self._torque = self._t[kept:], self._values[kept:], self._torque[kept:]
        self._behind, self._begins = end - kept, False
        return found
