"""What a simulation asks of a controller."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from .measurement import Measurement

__all__ = ["Controller"]


@runtime_checkable
class Controller(Protocol):
    """Commands joint torques from measurements, once each period; between two calls the torques are held.

    Any object with these three names is a controller: nothing is inherited. Whatever it remembers between two calls
    (an integral, the last position) is forgotten in `start`, so that one object serves one simulation after another.
    Arrays of one run are (N,), those of R runs (R, N); a controller written with ``...`` and the last axis serves both.

    Attributes
    ----------
    period : float
        Time between two calls, s.

    Examples
    --------
    >>> import numpy as np
    >>> class Damper:
    ...     period = 0.001
    ...
    ...     def start(self, measurement):
    ...         self.last = measurement.q
    ...
    ...     def torque(self, measurement):
    ...         velocity = (measurement.q - self.last) / self.period
    ...         self.last = measurement.q
    ...         return -2.0 * velocity
    >>> isinstance(Damper(), Controller)
    True
    """

    period: float

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement, which is also that of the first call of `torque`."""

    def torque(self, measurement: Measurement) -> NDArray[np.float64]:
        """Return the commanded joint torques, N·m or N, (N,) or (R, N) as the measurement.

        Must not change the measurement. What it returns may be an array that it writes to again at the next call.
        """
