"""What a motion must keep to, as the design of excitation sees it."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = ["MotionConstraint"]

Array = NDArray[np.float64]


@runtime_checkable
class MotionConstraint(Protocol):
    """A limit on a motion, sample by sample: a clearance that must not be negative, and its gradient.

    Everything that is not linear in position, velocity and acceleration comes in this form: torque, power, distances
    of bodies, the workspace of a tool. A class of one's own that has these members can be given to
    :func:`steelyard.design_excitation`. Several threads may call it at once.

    Attributes
    ----------
    name : str
        For messages: ``"table plane"``, ``"torque"``. A constraint that has something to say of itself may also have
        `remarks`, a tuple of sentences, which the design passes on.
    labels : tuple of str
        What each of the m columns is, such as ``"forearm_link to shoulder_link"``.
    scale : float or ndarray
        What counts as one unit of violation, in the unit of the clearances: a number, or one for each column, (m,).
    """

    @property
    def name(self) -> str:
        """What it is called in messages."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column of the clearance is, (m,)."""
        ...

    @property
    def scale(self) -> float | Array:
        """What counts as one unit of violation: a number, or one for each column (m,)."""
        ...

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return (S, m): at least 0 where the limit is kept, in its own unit.

        Parameters
        ----------
        q, dq, ddq : ndarray
            (S, N) samples of the motion.
        """
        ...

    def pull_back(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) by q, dq and ddq of ``sum(weights * clearance)``.

        Parameters
        ----------
        q, dq, ddq : ndarray
            (S, N) samples of the motion.
        weights : ndarray
            (S, m); samples whose weights are all 0 need no work.

        Returns
        -------
        tuple of ndarray
            Zeros where the clearance does not depend on one of them.
        """
        ...
