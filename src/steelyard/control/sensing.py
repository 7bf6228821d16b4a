"""The force sensor of a controller."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.simulation import Measurement

__all__ = ["ForceSensing", "require_force"]

Array = NDArray[np.float64]


def require_force(measurement: Measurement) -> Array:
    """Return the measured wrench of the environment on the tool (..., 6), base axes, about the tool's origin.

    Raises
    ------
    InputError
        If nothing measures it.
    """
    if measurement.force is None:
        raise InputError(
            "The controller needs the force at the tool, and the robot measures none; give the simulation a force "
            "sensor, or use the controller without sensing."
        )
    return measurement.force


class ForceSensing:
    """The wrench in the middle of the period for which a torque is held, from the last two that were measured.

    A torque that cancels a force is held while the force goes on: on average it would come half a period late, which
    the robot feels as acceleration, the more so the lighter it is. The extrapolation multiplies noise by 1.6.

    Examples
    --------
    >>> sensing = ForceSensing()
    >>> sensing.start(Measurement(0.0, np.zeros(1), force=np.zeros(6)))
    >>> float(sensing.wrench(Measurement(0.001, np.zeros(1), force=np.ones(6)))[0])
    1.5
    """

    def __init__(self) -> None:
        self._last: Array | None = None

    def start(self, measurement: Measurement) -> None:
        """Forget everything."""
        self._last = require_force(measurement).copy()

    def wrench(self, measurement: Measurement) -> Array:
        """Return the wrench (..., 6), N and N·m."""
        force = require_force(measurement)
        last = force if self._last is None else self._last
        self._last = force.copy()
        return force + 0.5 * (force - last)
