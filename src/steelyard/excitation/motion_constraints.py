"""The constraints of an excitation design, and the limits of joints, torques and power in this form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.functions import given_parameters
from steelyard.errors import InputError
from steelyard.once import cached_property

from .motion_limits import MotionLimits
from .vjp import CompiledVjp

__all__ = [
    "JointLimit",
    "MotionConstraint",
    "PowerLimit",
    "TorqueLimit",
    "TotalPowerLimit",
    "joint_limits",
    "predicted_parameters",
    "remedy_of",
    "torque_limits",
]

Array = NDArray[np.float64]


@runtime_checkable
class MotionConstraint(Protocol):
    """A constraint on each sample of a motion: clearances that must not be negative, and their gradients.

    All limits have this form: those of positions, velocities and accelerations, torque, power, distances of bodies, and
    the workspace of a tool. Any object with these members can be given to :func:`steelyard.design_excitation`. Several
    threads may call it at once.

    Attributes
    ----------
    name : str
        Name in messages, such as ``"table plane"`` or ``"torque"``. A constraint may also have an attribute `remarks`,
        a tuple of sentences, which become remarks of the design, an attribute `farthest`, (m,) clearances beyond which
        none are told apart, and an attribute `remedies`, (m,) clauses that say what to do where no motion keeps a
        clearance.
    labels : tuple of str
        (m,) descriptions of the columns of the clearances, such as ``"forearm_link to shoulder_link"``.
    scale : float or ndarray
        Clearance by which violations are compared, in the unit of the clearances: a number, or one for each column,
        (m,).
    """

    @property
    def name(self) -> str:
        """Name of the constraint in messages."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Descriptions of the columns of the clearances, (m,)."""
        ...

    @property
    def scale(self) -> float | Array:
        """Clearance by which violations are compared: a number, or one for each column (m,)."""
        ...

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the clearances (S, m): at least 0 where the limit is kept, in the unit of the limit.

        Parameters
        ----------
        q, dq, ddq : ndarray
            (S, N) samples of the motion.
        """
        ...

    def vjp(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) by q, dq and ddq of ``sum(weights * clearance)``.

        Parameters
        ----------
        q, dq, ddq : ndarray
            (S, N) samples of the motion.
        weights : ndarray
            (S, m). Samples whose weights are all 0 can be skipped.

        Returns
        -------
        tuple of ndarray
            An array of zeros where the clearance does not depend on a quantity.
        """
        ...


def remedy_of(constraints: Sequence[MotionConstraint], name: str, label: str, otherwise: str) -> str:
    """Return what to do where no motion keeps a part of a constraint."""
    for constraint in constraints:
        remedies = getattr(constraint, "remedies", None)
        if constraint.name == name and label in constraint.labels and remedies is not None:
            return str(remedies[constraint.labels.index(label)])
    return otherwise


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
        """Half the range of each joint; 1 rad or 1 m where it is not bounded on both sides."""
        half = 0.5 * (self.upper - self.lower)
        half = np.where(np.isfinite(half), half, 1.0)
        low, high = self._columns
        return np.concatenate([half[low], half[high]])

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the distances of the samples from the limits, (S, m), rad or m, per s or per s²."""
        values = (q, dq, ddq)[_ORDERS[self.name]]
        low, high = self._columns
        return np.hstack([values[:, low] - self.lower[low], self.upper[high] - values[:, high]])

    def vjp(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``."""
        low, high = self._columns
        slope = np.zeros_like(q)
        slope[:, low] = weights[:, : len(low)]
        slope[:, high] -= weights[:, len(low) :]
        result = [np.zeros_like(q)] * 3
        result[_ORDERS[self.name]] = slope
        return result[0], result[1], result[2]


def joint_limits(limits: MotionLimits) -> tuple[JointLimit, ...]:
    """Return the constraints for the finite limits of positions, velocities and accelerations."""
    names = limits.joint_names
    every = (
        JointLimit("position", names, limits.lower, limits.upper),
        JointLimit("velocity", names, -limits.velocity, limits.velocity),
        JointLimit("acceleration", names, -limits.acceleration, limits.acceleration),
    )
    return tuple(limit for limit in every if limit.labels)


def predicted_parameters(model: Model, parameters: ArrayLike | None) -> Array:
    """Return the parameters with which torques are predicted, (n,).

    Parameters
    ----------
    parameters : array_like, optional
        (n,); by default those of the description, with 0 for friction parameters that it does not have.

    Raises
    ------
    InputError
        If the description has no inertia for some link, or the number of parameters is wrong.
    """
    robot = model.robot
    if parameters is not None:
        given = given_parameters(model, parameters)
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
class _MagnitudeLimit:
    """Base of the limits on the magnitude of a quantity of each joint."""

    torque: CompiledVjp
    joint_names: tuple[str, ...]
    limit: Array

    @cached_property
    def _columns(self) -> NDArray[np.intp]:
        return np.flatnonzero(np.isfinite(self.limit))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Joint and limit of each column."""
        return tuple(f"{self.joint_names[k]} within {self.limit[k]:.6g}" for k in self._columns)

    @cached_property
    def scale(self) -> Array:
        """The limits, with which violations are compared."""
        return np.asarray(self.limit[self._columns])


@dataclass(frozen=True, eq=False)
class TorqueLimit(_MagnitudeLimit):
    """A limit on the magnitude of each joint's torque.

    Attributes
    ----------
    torque : CompiledVjp
        Inverse dynamics with the given parameters.
    joint_names : tuple of str
    limit : ndarray
        (N,) N·m or N; infinite where there is none.
    """

    name: str = "torque"

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return limit less magnitude, (S, m), N·m or N."""
        return self.scale - np.abs(self.torque(q, dq, ddq)[:, self._columns])

    def vjp(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``, at a constant sign of Coulomb friction."""
        slope = np.zeros_like(q)
        slope[:, self._columns] = -weights * np.sign(self.torque(q, dq, ddq)[:, self._columns])
        return self.torque.vjp(q, dq, ddq, slope)


@dataclass(frozen=True, eq=False)
class PowerLimit(_MagnitudeLimit):
    """A limit on the magnitude of torque times velocity of each joint, W.

    Attributes
    ----------
    torque : CompiledVjp
    joint_names : tuple of str
    limit : ndarray
        (N,) W; infinite where there is none.
    """

    name: str = "power"

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return limit less magnitude, (S, m), W."""
        power = self.torque(q, dq, ddq) * dq
        return self.scale - np.abs(power[:, self._columns])

    def vjp(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``."""
        torque = self.torque(q, dq, ddq)
        slope = np.zeros_like(q)
        slope[:, self._columns] = -weights * np.sign((torque * dq)[:, self._columns])
        by_q, by_dq, by_ddq = self.torque.vjp(q, dq, ddq, slope * dq)
        return by_q, by_dq + slope * torque, by_ddq


@dataclass(frozen=True, eq=False)
class TotalPowerLimit:
    """A limit on the magnitude of the mechanical power of all joints together, W.

    Attributes
    ----------
    limit : float
        W.
    """

    torque: CompiledVjp
    limit: float
    name: str = "total power"

    @property
    def labels(self) -> tuple[str, ...]:
        """Description of the limit."""
        return (f"all joints within {self.limit:.6g}",)

    @property
    def scale(self) -> float:
        """The limit, with which violations are compared."""
        return self.limit

    def clearance(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return limit less magnitude, (S, 1), W."""
        return np.asarray(self.limit - np.abs((self.torque(q, dq, ddq) * dq).sum(axis=1, keepdims=True)))

    def vjp(self, q: Array, dq: Array, ddq: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)``."""
        torque = self.torque(q, dq, ddq)
        slope = -weights * np.sign((torque * dq).sum(axis=1, keepdims=True))
        by_q, by_dq, by_ddq = self.torque.vjp(q, dq, ddq, slope * dq)
        return by_q, by_dq + slope * torque, by_ddq


def torque_limits(
    model: Model, limits: MotionLimits, parameters: ArrayLike | None = None
) -> tuple[MotionConstraint, ...]:
    """Return the constraints for the finite limits of torques and power.

    Torques are predicted with `parameters`, see `predicted_parameters`.
    """
    if not limits.needs_torque:
        return ()
    uniform = {"parameters": predicted_parameters(model, parameters)}
    torque = CompiledVjp(model.function("inverse_dynamics"), uniform)
    names = limits.joint_names
    every: list[MotionConstraint] = []
    if np.isfinite(limits.torque).any():
        every.append(TorqueLimit(torque, names, limits.torque))
    if np.isfinite(limits.power).any():
        every.append(PowerLimit(torque, names, limits.power))
    if np.isfinite(limits.total_power):
        every.append(TotalPowerLimit(torque, limits.total_power))
    return tuple(every)
