"""The plant that a damped tool makes with an elastic environment, in sampled time, and gains for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ForceLoop", "force_loop"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ForceLoop:
    """The plant ``f'' = Ks u - K2 f'`` for a stiffness of 1 N/m, with u held between samples.

    Attributes
    ----------
    transition : ndarray
        (2, 2) of force (N) and its rate (N/s).
    control : ndarray
        (2,); times Ks.
    gains : ndarray
        (2,) of the feedback of force and rate that places both poles; by Ks.
    """

    transition: Array
    control: Array
    gains: Array


def force_loop(bandwidth: float, velocity_gain: float, period: float) -> ForceLoop:
    """Sample the plant and place its poles.

    Parameters
    ----------
    bandwidth : float
        Both poles of the closed loop are here, rad/s.
    velocity_gain : float
        K2, 1/s.
    period : float
        s.

    Returns
    -------
    ForceLoop

    Examples
    --------
    >>> loop = force_loop(20.0, 40.0, 0.001)
    >>> closed = loop.transition - np.outer(loop.control, loop.gains)
    >>> bool(np.allclose(np.linalg.eigvals(closed), np.exp(-0.02), atol=1e-6))
    True
    """
    decay = float(np.exp(-velocity_gain * period))
    travel = -float(np.expm1(-velocity_gain * period)) / velocity_gain
    transition = np.array([[1.0, travel], [0.0, decay]])
    control = np.array([(period - travel) / velocity_gain, travel])
    # Ackermann: the last row of the inverse controllability matrix, times the wanted polynomial of the transition.
    pole = float(np.exp(-bandwidth * period))
    shifted = transition - pole * np.eye(2)
    reach = np.column_stack((control, transition @ control))
    gains = np.linalg.solve(reach.T, np.array([0.0, 1.0])) @ shifted @ shifted
    return ForceLoop(transition, control, gains)
