"""Joint velocities from positions, for controllers whose robot measures positions only."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.simulation import Measurement

from .gains import positive

__all__ = ["FilteredDifference", "MeasuredVelocity", "NumericalDifference", "VelocityEstimator"]

Array = NDArray[np.float64]


class VelocityEstimator(Protocol):
    """Estimates joint velocities from the measurements of a control loop, one after the other."""

    def start(self, measurement: Measurement) -> None:
        """Forget everything; the joints stand still at this measurement."""

    def velocity(self, measurement: Measurement) -> Array:
        """Return joint velocities (..., N), rad/s or m/s."""


class NumericalDifference:
    """The difference of two positions by the time between them (thesis section 4.3.1), or the slope of a parabola.

    Of order 1 it lags half the time between them, and shows a step of an encoder as a spike of step / time. Of order 2,
    through three positions, it does not lag, and its noise is 1.8 times as large.

    Parameters
    ----------
    steps : int
        Calls between two of the positions.
    order : {1, 2}

    Examples
    --------
    >>> estimator = NumericalDifference()
    >>> estimator.start(Measurement(t=0.0, q=np.array([1.0])))
    >>> round(float(estimator.velocity(Measurement(t=0.001, q=np.array([1.002])))[0]), 9)
    2.0
    """

    def __init__(self, steps: int = 1, order: int = 1) -> None:
        if isinstance(steps, bool) or not isinstance(steps, int) or steps < 1:
            raise InputError(f"steps must be a positive integer, got {steps!r}.")
        if order not in (1, 2):
            raise InputError(f"order of a numerical difference must be 1 or 2, got {order!r}.")
        self._steps, self._order = steps, order
        self._past: list[tuple[float, Array]] = []
        self._last: Array | None = None

    def start(self, measurement: Measurement) -> None:
        """Forget everything; the joints stand still at this measurement."""
        self._past = [(measurement.t, measurement.q)]
        self._last = np.zeros_like(measurement.q)

    def velocity(self, measurement: Measurement) -> Array:
        """Return joint velocities (..., N), rad/s or m/s."""
        if self._last is None:
            self.start(measurement)
        assert self._last is not None
        t, q, past = measurement.t, measurement.q, self._past
        if t > past[-1][0]:
            one = past[max(len(past) - self._steps, 0)]
            slope = (q - one[1]) / (t - one[0])
            if self._order == 2 and len(past) == 2 * self._steps:
                two = past[0]
                before = (one[1] - two[1]) / (one[0] - two[0])
                slope = slope + (t - one[0]) / (t - two[0]) * (slope - before)
            self._last = slope
            past.append((t, q))
            if len(past) > self._order * self._steps:
                del past[0]
        return self._last


class FilteredDifference:
    """Numerical differences through a low-pass filter of the first order.

    Parameters
    ----------
    cutoff : float
        Frequency at which it passes 1/sqrt(2) of an oscillation, Hz.

    Examples
    --------
    >>> estimator = FilteredDifference(cutoff=50.0)
    >>> estimator.start(Measurement(t=0.0, q=np.array([0.0])))
    >>> speeds = [float(estimator.velocity(Measurement(t=k / 1e3, q=np.array([k / 1e3])))[0]) for k in range(1, 60)]
    >>> 0.2 < speeds[0] < 0.3, round(speeds[-1], 3)
    (True, 1.0)
    """

    def __init__(self, cutoff: float) -> None:
        self._rate = 2.0 * np.pi * positive(cutoff, "cutoff")
        self._time = 0.0
        self._place: Array | None = None
        self._last: Array | None = None

    def start(self, measurement: Measurement) -> None:
        """Forget everything; the joints stand still at this measurement."""
        self._time, self._place = measurement.t, measurement.q
        self._last = np.zeros_like(measurement.q)

    def velocity(self, measurement: Measurement) -> Array:
        """Return joint velocities (..., N), rad/s or m/s."""
        if self._place is None or self._last is None:
            self.start(measurement)
        assert self._place is not None
        assert self._last is not None
        step = measurement.t - self._time
        if step > 0.0:
            share = 1.0 - float(np.exp(-self._rate * step))
            self._last = self._last + share * ((measurement.q - self._place) / step - self._last)
            self._time, self._place = measurement.t, measurement.q
        return self._last


class MeasuredVelocity:
    """The velocities that the robot measures itself."""

    def start(self, measurement: Measurement) -> None:
        """Make sure that velocities are measured."""
        self.velocity(measurement)

    def velocity(self, measurement: Measurement) -> Array:
        """Return joint velocities (..., N), rad/s or m/s."""
        if measurement.dq is None:
            raise InputError(
                "The controller reads measured joint velocities, and the robot measures none; give it "
                "NumericalDifference() or FilteredDifference(cutoff), or sensors with velocities."
            )
        return measurement.dq
