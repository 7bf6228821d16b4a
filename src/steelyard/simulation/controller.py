"""What a controller learns of the robot, and what a simulation asks of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Controller", "Measurement"]


@dataclass(frozen=True, eq=False)
class Measurement:
    """What the sensors say at one instant: of one run, or of R runs at once.

    A simulation gives new arrays each time. A loop of one's own may write into the same ones, since the controllers of
    :mod:`steelyard.control` copy what they remember.

    Attributes
    ----------
    t : float
        Time since the start, s.
    q : ndarray
        (N,) or (R, N) joint positions as the encoders give them, rad or m.
    dq : ndarray or None
        (N,) or (R, N) joint velocities, rad/s or m/s; None where nothing measures them.
    torque : ndarray or None
        (N,) or (R, N) joint torques as they are measured, N·m or N; None where nothing measures them.
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


# What a simulation asks of a controller.


@runtime_checkable
class Controller(Protocol):
    """Commands joint torques from measurements, once each sample time; between two calls the torques are held.

    Any object with these three names is a controller: nothing is inherited. Whatever it remembers between two calls
    (an integral, the last position) is forgotten in `start`, so that one object serves one simulation after another.
    Arrays of one run are (N,), those of R runs (R, N); a controller written with ``...`` and the last axis serves both.

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
        """Forget all state and begin at this measurement, which is also that of the first call of `torque`."""

    def torque(self, measurement: Measurement) -> NDArray[np.float64]:
        """Return the commanded joint torques, N·m or N, (N,) or (R, N) as the measurement.

        Must not change the measurement. What it returns may be an array that it writes to again at the next call.
        """
