"""Estimates of joint velocities for controllers: from positions, or as the robot measures them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import positive, read_whole
from steelyard.simulation import Measurement

__all__ = ["FilteredDifference", "MeasuredVelocity", "NumericalDifference", "VelocityEstimator"]

Array = NDArray[np.float64]


class VelocityEstimator(Protocol):
    """Estimates joint velocities from the consecutive measurements of a control loop.

    An estimator may also have a method ``transfer(sample_time)``, which returns numerator and denominator of its
    transfer function from the sampled position to the estimate, in powers of 1/z, or None for the true velocity. A
    controller that checks its gains then accounts for the lag of the estimate; without this method it takes the
    estimate for the true velocity.
    """

    def start(self, measurement: Measurement) -> None:
        """Forget everything, and begin at this measurement."""

    def velocity(self, measurement: Measurement) -> Array:
        """Return joint velocities (..., N), rad/s or m/s."""


class NumericalDifference:
    """The difference quotient of two positions (thesis section 4.3.1), or the slope of a parabola through three.

    With order 1 the estimate lags by half the time between the positions, and a step of the encoder appears as a spike
    of step / time. With order 2, the slope of a parabola through three positions, it does not lag, and its noise is 1.8
    times as large. The estimate starts with the measured velocity, or with zero where velocities are not measured.

    Parameters
    ----------
    steps : int
        Number of sample times between two of the positions.
    order : {1, 2}
        Number of differences: 1 for two positions, 2 for three.

    Examples
    --------
    >>> estimator = NumericalDifference()
    >>> estimator.start(Measurement(t=0.0, q=np.array([1.0])))
    >>> round(float(estimator.velocity(Measurement(t=0.001, q=np.array([1.002])))[0]), 9)
    2.0
    """

    def __init__(self, steps: int = 1, order: int = 1) -> None:
        steps = read_whole(steps, "steps", 1)
        if order not in (1, 2):
            raise InputError(f"order of a numerical difference must be 1 or 2, got {order!r}.")
        self._steps, self._order = steps, order
        self._past: list[tuple[float, Array]] = []
        self._last: Array | None = None

    def start(self, measurement: Measurement) -> None:
        """Forget everything, and begin at this measurement."""
        self._past = [(measurement.t, measurement.q.copy())]
        self._last = _first(measurement)

    def transfer(self, sample_time: float) -> tuple[Array, Array]:
        """Return numerator and denominator of the estimate over the position, in powers of 1/z."""
        gap = np.zeros(self._steps - 1)
        whole = self._steps * sample_time
        slope = np.concatenate(([1.0], gap, [-1.0])) / whole
        if self._order == 2:  # (3 - 4 z^-n + z^-2n) / (2 n T)
            slope = np.concatenate(([1.5], gap, [-2.0], gap, [0.5])) / whole
        return slope, np.ones(1)

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
            past.append((t, q.copy()))  # the caller may write its next measurement into the same array
            if len(past) > self._order * self._steps:
                del past[0]
        return self._last


class FilteredDifference:
    """Difference quotients through a first-order low-pass filter.

    The estimate starts with the measured velocity, or with zero where velocities are not measured.

    Parameters
    ----------
    cutoff : float
        Frequency at which the filter reduces an oscillation to 1/sqrt(2), Hz.

    Examples
    --------
    >>> estimator = FilteredDifference(cutoff=50.0)
    >>> estimator.start(Measurement(t=0.0, q=np.array([0.0])))
    >>> speeds = [float(estimator.velocity(Measurement(t=k / 1e3, q=np.array([k / 1e3])))[0]) for k in range(1, 60)]
    >>> 0.2 < speeds[0] < 0.3, round(speeds[-1], 3)
    (True, 1.0)
    """

    def __init__(self, cutoff: float) -> None:
        self._rate = 2.0 * np.pi * positive(cutoff, "cutoff", "Hz")
        self._time = 0.0
        self._place: Array | None = None
        self._last: Array | None = None

    def start(self, measurement: Measurement) -> None:
        """Forget everything, and begin at this measurement."""
        self._time, self._place = measurement.t, measurement.q.copy()
        self._last = _first(measurement)

    def transfer(self, sample_time: float) -> tuple[Array, Array]:
        """Return numerator and denominator of the estimate over the position, in powers of 1/z."""
        keep = float(np.exp(-self._rate * sample_time))
        return (1.0 - keep) / sample_time * np.array([1.0, -1.0]), np.array([1.0, -keep])

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
            self._time, self._place = measurement.t, measurement.q.copy()
        return self._last


class MeasuredVelocity:
    """The velocities that the robot measures itself."""

    def transfer(self, sample_time: float) -> None:
        """Return None: the estimate is the velocity itself."""

    def start(self, measurement: Measurement) -> None:
        """Check that the measurement has velocities."""
        self.velocity(measurement)

    def velocity(self, measurement: Measurement) -> Array:
        """Return joint velocities (..., N), rad/s or m/s."""
        if measurement.dq is None:
            raise InputError(
                "The controller reads measured joint velocities, and the robot measures none; give it "
                "NumericalDifference() or FilteredDifference(cutoff), or sensors with velocities."
            )
        return measurement.dq


def _first(measurement: Measurement) -> Array:
    """Return the initial velocities: the measured ones, or zero."""
    return np.zeros_like(measurement.q) if measurement.dq is None else measurement.dq.copy()
