"""The place on the robot that a task is about, and the force sensor that sits there."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.simulation import Measurement

__all__ = ["ForceSensing", "Tool", "require_force"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tool:
    """A frame that is fixed to a link.

    Attributes
    ----------
    link : str
        Name of a link of the robot.
    placement : ndarray
        (4, 4) pose of the tool in the link frame; the link frame itself where not given. A vector (3,) is a place
        without rotation, m.

    Raises
    ------
    InputError
        If the placement is not a pose.

    Examples
    --------
    >>> Tool("link7", [0.0, 0.0, 0.1]).point.tolist()
    [0.0, 0.0, 0.1]
    """

    link: str
    placement: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        given = np.array(self.placement, dtype=np.float64)
        if given.shape == (3,):
            given, place = np.eye(4), given
            given[:3, 3] = place
        turn = given[:3, :3] if given.shape == (4, 4) else np.zeros((3, 3))
        proper = np.isfinite(given).all() and np.allclose(turn @ turn.T, np.eye(3), atol=1e-6)
        if not proper or np.linalg.det(turn) < 0.0 or not np.array_equal(given[3], [0.0, 0.0, 0.0, 1.0]):
            raise InputError(
                f"The placement of a tool on {self.link!r} must be a pose (4, 4), a rotation with a place, or a place "
                f"(3,), got {np.asarray(self.placement).tolist()}."
            )
        object.__setattr__(self, "placement", given)

    @property
    def point(self) -> Array:
        """Origin of the tool in the link frame (3,), m."""
        return self.placement[:3, 3]

    @property
    def pose(self) -> str:
        """Name of the model's function that gives the pose of the link."""
        return f"pose({self.link})"

    @property
    def jacobian(self) -> str:
        """Name of the model's function that gives the Jacobian of the tool's origin."""
        return f"jacobian({self.link})"

    @property
    def jacobian_rate(self) -> str:
        """Name of the model's function that gives how the Jacobian changes."""
        return f"jacobian_rate({self.link})"


# The force sensor of a controller.


def require_force(measurement: Measurement) -> Array:
    """Return the measured wrench of the environment on the tool (..., 6), base axes, about the tool's origin.

    Raises
    ------
    InputError
        If nothing measures it.
    """
    if measurement.force is None:
        raise InputError(
            "The controller needs the force at the tool, and the robot measures none; give the simulation a force "
            "sensor, or use the controller without sensing."
        )
    return measurement.force


class ForceSensing:
    """The wrench in the middle of the sample time for which a torque is held, from the last two that were measured.

    A torque that cancels a force is held while the force goes on: on average it would come half a sample time late,
    which the robot feels as acceleration, the more so the lighter it is. The extrapolation multiplies noise by 1.6.

    Examples
    --------
    >>> sensing = ForceSensing()
    >>> sensing.start(Measurement(0.0, np.zeros(1), force=np.zeros(6)))
    >>> float(sensing.wrench(Measurement(0.001, np.zeros(1), force=np.ones(6)))[0])
    1.5
    """

    def __init__(self) -> None:
        self._last: Array | None = None

    def start(self, measurement: Measurement) -> None:
        """Forget everything."""
        self._last = require_force(measurement).copy()

    def wrench(self, measurement: Measurement) -> Array:
        """Return the wrench (..., 6), N and N·m."""
        force = require_force(measurement)
        last = force if self._last is None else self._last
        self._last = force.copy()
        return force + 0.5 * (force - last)
