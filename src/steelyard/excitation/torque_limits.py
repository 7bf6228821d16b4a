"""Limits of joint torques and of power, predicted with given parameters, as constraints on a motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError

from .constraint import MotionConstraint
from .limits import MotionLimits
from .pull_back import PullBack

__all__ = ["PowerLimit", "TorqueLimit", "TotalPowerLimit", "predicted_parameters", "torque_limits"]

Array = NDArray[np.float64]


def predicted_parameters(model: Model, parameters: ArrayLike | None) -> Array:
    """Return the parameters with which torques are predicted, (n,).

    Parameters
    ----------
    model : Model
    parameters : array_like, optional
        (n,); by default those of the description, with 0 for friction that it does not tell.

    Raises
    ------
    InputError
        If the description has no inertia for some link, or the parameters have a wrong size.
    """
    robot = model.robot
    if parameters is not None:
        given = np.asarray(parameters, dtype=np.float64)
        if given.shape != (model.parameter_count,) or not np.isfinite(given).all():
            raise InputError(
                f"parameters must be {model.parameter_count} finite numbers, as model.parameter_names lists them, "
                f"got shape {given.shape}{'' if np.isfinite(given).all() else ' with some that are not finite'}."
            )
        return given
    values = np.array(robot.parameters, dtype=np.float64)
    for link, columns in zip(robot.links, model.link_columns, strict=True):
        if np.isnan(values[columns]).any():
            raise InputError(
                f"Torque and power limits need the parameters of every link, but the description of {robot.name} has "
                f"no inertia for {link.name}: give parameters (an estimate), or leave these limits out."
            )
    return np.nan_to_num(values)


@dataclass(frozen=True, eq=False)
class TorqueLimit:
    """A limit on the magnitude of each joint's torque.

    Attributes
    ----------
    torque : PullBack
        Inverse dynamics at the parameters.
    joint_names : tuple of str
    limit : ndarray
        (N,) N·m or N; infinite where there is none.
    """

    torque: PullBack
    joint_names: tuple[str, ...]
    limit: Array
    name: str = "torque"

    @cached_property
    def _columns(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.isfinite(self.limit))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Joint and limit of each column."""
        return tuple(f"{self.joint_names[k]} within {self.limit[k]:.6g}" for k in self._columns)

    @cached_property
    def scale(self) -> Array:
        """The limits themselves."""
        return np.asarray(self.limit[self._columns])

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return limit less magnitude, (S, m), N·m or N."""
        return self.scale - np.abs(self.torque(q, dq, ddq)[:, self._columns])

    def pull_back(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``; friction counts as constant."""
        slope = np.zeros_like(q)
        slope[:, self._columns] = -weights * np.sign(self.torque(q, dq, ddq)[:, self._columns])
        return self.torque.pull_back(q, dq, ddq, slope)


@dataclass(frozen=True, eq=False)
class PowerLimit:
    """A limit on the magnitude of torque times velocity of each joint, W.

    Attributes
    ----------
    torque : PullBack
    joint_names : tuple of str
    limit : ndarray
        (N,) W; infinite where there is none.
    """

    torque: PullBack
    joint_names: tuple[str, ...]
    limit: Array
    name: str = "power"

    @cached_property
    def _columns(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.isfinite(self.limit))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Joint and limit of each column."""
        return tuple(f"{self.joint_names[k]} within {self.limit[k]:.6g}" for k in self._columns)

    @cached_property
    def scale(self) -> Array:
        """The limits themselves."""
        return np.asarray(self.limit[self._columns])

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return limit less magnitude, (S, m), W."""
        power = self.torque(q, dq, ddq) * dq
        return self.scale - np.abs(power[:, self._columns])

    def pull_back(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``."""
        torque = self.torque(q, dq, ddq)
        slope = np.zeros_like(q)
        slope[:, self._columns] = -weights * np.sign((torque * dq)[:, self._columns])
        by_q, by_dq, by_ddq = self.torque.pull_back(q, dq, ddq, slope * dq)
        return by_q, by_dq + slope * torque, by_ddq


@dataclass(frozen=True, eq=False)
class TotalPowerLimit:
    """A limit on the magnitude of the mechanical power of all joints together, W.

    Attributes
    ----------
    torque : PullBack
    limit : float
        W.
    """

    torque: PullBack
    limit: float
    name: str = "total power"

    @property
    def labels(self) -> tuple[str, ...]:
        """The limit."""
        return (f"all joints within {self.limit:.6g}",)

    @property
    def scale(self) -> float:
        """The limit itself."""
        return self.limit

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return limit less magnitude, (S, 1), W."""
        return np.asarray(self.limit - np.abs((self.torque(q, dq, ddq) * dq).sum(axis=1, keepdims=True)))

    def pull_back(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``."""
        torque = self.torque(q, dq, ddq)
        slope = -weights * np.sign((torque * dq).sum(axis=1, keepdims=True))
        by_q, by_dq, by_ddq = self.torque.pull_back(q, dq, ddq, slope * dq)
        return by_q, by_dq + slope * torque, by_ddq


def torque_limits(
    model: Model, limits: MotionLimits, parameters: ArrayLike | None = None
) -> tuple[MotionConstraint, ...]:
    """Return the constraints on torques and power, those that are finite.

    Parameters
    ----------
    model : Model
    limits : MotionLimits
    parameters : array_like, optional
        See `predicted_parameters`.
    """
    if not limits.needs_torque:
        return ()
    uniform = {"parameters": predicted_parameters(model, parameters)}
    torque = PullBack(model.function("inverse_dynamics"), uniform)
    names = limits.joint_names
    every: list[MotionConstraint] = []
    if np.isfinite(limits.torque).any():
        every.append(TorqueLimit(torque, names, limits.torque))
    if np.isfinite(limits.power).any():
        every.append(PowerLimit(torque, names, limits.power))
    if np.isfinite(limits.total_power):
        every.append(TotalPowerLimit(torque, limits.total_power))
    return tuple(every)
