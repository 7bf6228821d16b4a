"""The place on the robot that a task is about."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["Tool"]

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
