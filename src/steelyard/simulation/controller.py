"""The interface of controllers: the measurements that they receive and the torques that they return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["Controller", "Measurement", "checked_torque"]


@dataclass(frozen=True, eq=False)
class Measurement:
    """The readings of the sensors at one instant, for one run or for R runs at once.

    A simulation gives new arrays each time. Your own control loop may write into the same arrays again, because the
    controllers of :mod:`steelyard.control` copy what they keep.

    Attributes
    ----------
    t : float
        Time since the start, s.
    q : ndarray
        (N,) or (R, N) joint positions as the encoders measure them, rad or m.
    dq : ndarray or None
        (N,) or (R, N) joint velocities, rad/s or m/s; None where they are not measured.
    torque : ndarray or None
        (N,) or (R, N) measured joint torques, N·m or N; None where they are not measured.
    force : ndarray or None
        (6,) or (R, 6) wrench of the environment on the tool, base axes, force (N) before moment (N·m); None where
        there is no force sensor.

    Examples
    --------
    >>> Measurement(t=0.5, q=np.zeros(2)).dq is None
    True
    """

    t: float
    q: NDArray[np.float64]
    dq: NDArray[np.float64] | None = None
    torque: NDArray[np.float64] | None = None
    force: NDArray[np.float64] | None = None


@runtime_checkable
class Controller(Protocol):
    """Computes joint torques from measurements once each sample time; between two calls the torques are held.

    Any object with these three members is a controller; it need not inherit from this class. In `start` it resets
    whatever it keeps between two calls (an integral, the last position), so that one object can be used in several
    simulations. Arrays of one run are (N,), those of R runs (R, N); a controller that computes along the last axis
    serves both.

    Attributes
    ----------
    sample_time : float
        Time between two calls, s.

    Examples
    --------
    >>> import numpy as np
    >>> class Damper:
    ...     sample_time = 0.001
    ...
    ...     def start(self, measurement):
    ...         self.last = measurement.q
    ...
    ...     def torque(self, measurement):
    ...         velocity = (measurement.q - self.last) / self.sample_time
    ...         self.last = measurement.q
    ...         return -2.0 * velocity
    >>> isinstance(Damper(), Controller)
    True
    """

    sample_time: float

    def start(self, measurement: Measurement) -> None:
        """Reset all state and begin at this measurement, with which `torque` is called next."""

    def torque(self, measurement: Measurement) -> NDArray[np.float64]:
        """Return the commanded joint torques, N·m or N, (N,) or (R, N) as the measurement.

        The method must not change the measurement. It may return an array that it writes to again in the next call.
        """


def checked_torque(value: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return torques as an array of a given shape.

    Values that are not finite are let through: they do not stop the program, but end the run that they belong to.

    Raises
    ------
    InputError
        If the value is no array of numbers, or its shape is another one.
    """
    try:
        torque = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"torque must return an array of shape {shape}, got {type(value).__name__}.") from None
    if torque.shape != shape:
        raise InputError(f"torque must return an array of shape {shape}, got {torque.shape}.")
    return torque
