"""Limits of joint positions, velocities and accelerations, as constraints on a motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .limits import MotionLimits

__all__ = ["JointLimit", "joint_limits"]

Array = NDArray[np.float64]
_ORDERS = {"position": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True, eq=False)
class JointLimit:
    """An upper and a lower limit of the position, velocity or acceleration of each joint.

    Attributes
    ----------
    name : {"position", "velocity", "acceleration"}
    joint_names : tuple of str
    lower, upper : ndarray
        (N,); infinite where there is none.
    """

    name: str
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array

    @cached_property
    def _columns(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        return np.flatnonzero(np.isfinite(self.lower)), np.flatnonzero(np.isfinite(self.upper))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Joint and side of each column."""
        low, high = self._columns
        below = [f"{self.joint_names[k]} from {self.lower[k]:.6g}" for k in low]
        return (*below, *(f"{self.joint_names[k]} to {self.upper[k]:.6g}" for k in high))

    @cached_property
    def scale(self) -> Array:
        """Half the range of each joint; a half turn or half a metre where it is not bounded on both sides."""
        half = 0.5 * (self.upper - self.lower)
        half = np.where(np.isfinite(half), half, 1.0)
        low, high = self._columns
        return np.concatenate([half[low], half[high]])

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return how far each sample is from the limits, (S, m), in rad or m and per s."""
        values = (q, dq, ddq)[_ORDERS[self.name]]
        low, high = self._columns
        return np.hstack([values[:, low] - self.lower[low], self.upper[high] - values[:, high]])

    def pull_back(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``."""
        low, high = self._columns
        slope = np.zeros_like(q)
        slope[:, low] = weights[:, : len(low)]
        slope[:, high] -= weights[:, len(low) :]
        result = [np.zeros_like(q)] * 3
        result[_ORDERS[self.name]] = slope
        return result[0], result[1], result[2]


def joint_limits(limits: MotionLimits) -> tuple[JointLimit, ...]:
    """Return the constraints on positions, velocities and accelerations, those that are finite."""
    names = limits.joint_names
    every = (
        JointLimit("position", names, limits.lower, limits.upper),
        JointLimit("velocity", names, -limits.velocity, limits.velocity),
        JointLimit("acceleration", names, -limits.acceleration, limits.acceleration),
    )
    return tuple(limit for limit in every if limit.labels)
