"""What a controller learns of the robot at one instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Measurement"]


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
