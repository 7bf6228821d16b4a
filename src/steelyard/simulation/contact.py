"""Contact of the robot with its environment: an elastic wall, or an environment that a user defines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files import read_number
from steelyard.files.arguments import real_array

__all__ = ["Contact", "ElasticContact", "Environment"]

Array = NDArray[np.float64]


@runtime_checkable
class Environment(Protocol):
    """An environment that acts on one point of one link.

    Attributes
    ----------
    link : str
        Name of the link; it may be a link that was merged into another one, such as ``"tool0"``.
    point : array_like
        (3,) point in the frame of the link, m.
    """

    link: str
    point: ArrayLike

    def wrench(self, t: Array | float, position: Array, rotation: Array, velocity: Array) -> Array:
        """Return the wrench on the link at the point, (..., 6): force (N) before moment (N·m), base axes.

        Parameters
        ----------
        t : float or ndarray
            Time, s; (..., 1) where runs are at different times.
        position : ndarray
            (..., 3) position of the point in the base frame, m.
        rotation : ndarray
            (..., 3, 3) orientation of the link frame in the base frame.
        velocity : ndarray
            (..., 6) velocity of the point, m/s, and angular velocity of the link, rad/s, base axes.
        """


@dataclass(frozen=True, eq=False)
class ElasticContact:
    """A flat, frictionless wall with a spring and a damper: ``force = stiffness depth - damping speed``, never a pull.

    Parameters
    ----------
    link : str
        Name of the link that touches the wall.
    surface : array_like
        (3,) a point on the undeformed wall, base frame, m.
    normal : array_like
        (3,) direction out of the wall, towards the free side, of any length.
    stiffness : float or callable
        Stiffness, N/m, or a function that returns it for a time (a float or an array, s).
    damping : float
        Damping along the normal, N·s/m.
    point : array_like
        (3,) point of the link that touches the wall, in the link frame, m.

    Raises
    ------
    InputError
        If a value is not finite or out of its range.

    Examples
    --------
    >>> wall = ElasticContact("link2", surface=(0, 0, 0), normal=(0, 0, 1), stiffness=1000.0)
    >>> wall.wrench(0.0, np.array([0.0, 0.0, -0.01]), np.eye(3), np.zeros(6))[:3].tolist()
    [0.0, 0.0, 10.0]
    """

    link: str
    surface: ArrayLike
    normal: ArrayLike
    stiffness: float | Callable[[Array | float], Array | float]
    damping: float = 0.0
    point: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("surface", "normal", "point"):
            vector = np.array(real_array(getattr(self, name), f"{name} of an elastic contact", "three finite numbers"))
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise InputError(f"{name} of an elastic contact must be three finite numbers, got {vector.tolist()}.")
            object.__setattr__(self, name, vector)
        length = float(np.linalg.norm(self.normal))
        if length == 0.0:
            raise InputError("normal of an elastic contact must point somewhere, got (0, 0, 0).")
        object.__setattr__(self, "normal", np.asarray(self.normal) / length)
        if not callable(self.stiffness):
            read_number(self.stiffness, "stiffness of an elastic contact", "at least 0 N/m", least=0.0)
        read_number(self.damping, "damping of an elastic contact", "at least 0 N·s/m", least=0.0)

    def wrench(self, t: Array | float, position: Array, rotation: Array, velocity: Array) -> Array:
        """Return the wrench on the link (..., 6)."""
        depth = (np.asarray(self.surface) - position) @ np.asarray(self.normal)
        stiffness = np.asarray(self.stiffness(t) if callable(self.stiffness) else self.stiffness, dtype=np.float64)
        if stiffness.ndim:  # runs at different times, (..., 1)
            stiffness = stiffness[..., 0]
        speed = velocity[..., :3] @ np.asarray(self.normal)
        force = np.where(depth > 0.0, np.maximum(stiffness * depth - self.damping * speed, 0.0), 0.0)
        wrench = np.zeros((*depth.shape, 6))
        wrench[..., :3] = force[..., np.newaxis] * np.asarray(self.normal)
        return wrench


class Contact:
    """Connects an environment with the link of the robot that it acts on.

    Raises
    ------
    InputError
        If the object lacks a member of :class:`Environment`, or the robot has no such link.
    """

    def __init__(self, model: Model, environment: Environment) -> None:
        if not isinstance(environment, Environment):
            raise InputError(
                "environment must have link, point and wrench(t, position, rotation, velocity), such as "
                f"ElasticContact, got {type(environment).__name__}."
            )
        self.environment = environment
        self._point = np.array(environment.point, dtype=np.float64)
        self._count = model.dof
        self._pose = model.kernel(f"pose({environment.link})")
        self._jacobian = model.kernel(f"jacobian({environment.link})")

    def state(self, t: Array | float, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the Jacobian of the point (m, 6, N) and the wrench on the link (m, 6)."""
        q = np.ascontiguousarray(q)
        pose = self._pose(q).reshape(-1, 4, 4)
        jacobian = self._jacobian(q, self._point).reshape(-1, 6, self._count)
        rotation = pose[:, :3, :3]
        position = pose[:, :3, 3] + rotation @ self._point
        velocity = (jacobian @ dq[..., np.newaxis])[..., 0]
        wrench = np.asarray(self.environment.wrench(t, position, rotation, velocity), dtype=np.float64)
        if wrench.shape != velocity.shape:
            raise InputError(
                f"wrench of {type(self.environment).__name__} must have shape {velocity.shape}, got {wrench.shape}."
            )
        return jacobian, wrench

    def torque(self, t: Array | float, q: Array, dq: Array) -> Array:
        """Return the joint torques of the wrench, ``J' f``, (m, N)."""
        jacobian, wrench = self.state(t, q, dq)
        return (wrench[:, np.newaxis] @ jacobian)[:, 0]
