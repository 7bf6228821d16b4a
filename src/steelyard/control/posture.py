"""What a redundant arm does with the joints that its task leaves free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError

from .gains import joint_gains

__all__ = ["Posture"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Posture:
    """Joint accelerations ``stiffness (q_0 - q) - damping dq`` in the null space of a task.

    Without damping nothing holds the motions of a redundant arm that do not move its tool: they drift.

    Attributes
    ----------
    q : array_like, optional
        (N,) that the joints are drawn to, rad or m; nowhere where not given.
    stiffness : array_like
        A number or (N,), 1/s².
    damping : array_like
        A number or (N,), 1/s.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")]))
    >>> Posture([1.0], stiffness=4.0, damping=2.0).of(model).acceleration(np.zeros(1), np.ones(1)).tolist()
    [2.0]
    """

    q: ArrayLike | None = None
    stiffness: ArrayLike = 0.0
    damping: ArrayLike = 10.0

    def of(self, model: Model) -> Posture:
        """Return the posture with an array for each attribute, checked for a robot.

        Raises
        ------
        InputError
            If the shape of one does not fit, or there is a stiffness without positions.
        """
        count = model.joint_count
        stiffness = joint_gains(self.stiffness, count, "the posture's stiffness")
        if self.q is None and stiffness.any():
            raise InputError("The posture has a stiffness and no positions; give it q, or leave the stiffness out.")
        place = np.zeros(count) if self.q is None else np.array(self.q, dtype=np.float64)
        if place.shape != (count,) or not np.isfinite(place).all():
            raise InputError(f"The posture's q must be {count} finite numbers, got {self.q!r}.")
        return Posture(place, stiffness, joint_gains(self.damping, count, "the posture's damping"))

    def acceleration(self, q: Array, dq: Array) -> Array:
        """Return joint accelerations (..., N), of a posture that `of` returned."""
        place, stiffness, damping = (np.asarray(a, dtype=np.float64) for a in (self.q, self.stiffness, self.damping))
        return stiffness * (place - q) - damping * dq
