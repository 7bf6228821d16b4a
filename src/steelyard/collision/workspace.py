"""A box that the tool must stay in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot

from .placements import LinkPlacements
from .posture_constraint import PostureConstraint, check_possible

__all__ = ["WorkspaceBox"]

Array = NDArray[np.float64]


class WorkspaceBox(PostureConstraint):
    """A point of a link stays in a box along the axes of the base frame.

    One clearance for each side of the box that is finite.

    Parameters
    ----------
    robot : Robot
    link : str
        A link of the source, merged ones (such as ``tool0``) included.
    lower, upper : (3,) array
        Corners of the box in the base frame, m; infinite where it is open.
    point : (3,) array
        In the frame of the link, m; its origin by default.

    Raises
    ------
    InputError
        When the robot has no such link, the box is empty or open on all sides, or the point can never be in it.

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")])
    >>> limit = WorkspaceBox(arm, "link2", lower=(0.2, -np.inf, -np.inf), upper=(1.0, 0.6, np.inf))
    >>> limit.labels
    ('link2 above x = 0.2', 'link2 below x = 1', 'link2 below y = 0.6')
    >>> limit.clearance([[0.0, 0.0]]).round(3).tolist()
    [[0.7, 0.1, 0.6]]
    """

    name = "workspace"

    def __init__(
        self,
        robot: Robot,
        link: str,
        lower: ArrayLike = (-np.inf, -np.inf, -np.inf),
        upper: ArrayLike = (np.inf, np.inf, np.inf),
        point: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.robot = robot
        self._body, placement = robot.frame(link)
        if self._body < 0:
            raise InputError(f'{self.name}: link "{link}" is fixed to the base and does not move; name one that does')
        self.lower, self.upper = _corner(lower, "lower"), _corner(upper, "upper")
        offset = _corner(point, "point")
        if not np.isfinite(offset).all():
            raise InputError(f"{self.name}: the point must be finite, got {point!r}")
        self._point = placement[:3, :3] @ offset + placement[:3, 3]
        sides: list[tuple[int, float, float]] = []
        labels: list[str] = []
        for axis, name in enumerate("xyz"):
            if self.lower[axis] > self.upper[axis]:
                raise InputError(
                    f"{self.name}: the lower {name} of {self.lower[axis]:g} m is above the upper one of "
                    f"{self.upper[axis]:g} m; exchange them"
                )
            for sign, limit, word in ((1.0, self.lower[axis], "above"), (-1.0, self.upper[axis], "below")):
                if np.isfinite(limit):
                    sides.append((axis, sign, float(limit)))
                    labels.append(f"{link} {word} {name} = {limit:g}")
        if not sides:
            raise InputError(f"{self.name}: the box is open on all sides; give a finite lower or upper corner")
        self.link = link
        self.labels = tuple(labels)
        self._axes = np.array([axis for axis, _, _ in sides])
        self._signs = np.array([sign for _, sign, _ in sides])
        self._limits = np.array([limit for _, _, limit in sides])
        check_possible(self, "mend the box, which is given in the base frame, in m")

    def positions(self, q: ArrayLike) -> Array:
        """Return where the point is at postures (S, N): (S, 3), base frame, m."""
        return self._positions(self._places(q))

    def _positions(self, places: LinkPlacements) -> Array:
        return np.asarray(places.positions[self._body] + places.rotations[self._body] @ self._point)

    def _values(self, places: LinkPlacements) -> Array:
        return np.asarray(self._signs * (self._positions(places)[:, self._axes] - self._limits))

    def _forces(self, places: LinkPlacements, weights: Array) -> tuple[Array, Array]:
        forces, moments = (np.zeros_like(places.positions) for _ in range(2))
        for column, axis in enumerate(self._axes):
            forces[self._body, :, axis] += self._signs[column] * weights[:, column]
        moments[self._body] = np.cross(self._positions(places), forces[self._body])
        return forces, moments


def _corner(values: ArrayLike, what: str) -> Array:
    try:
        corner = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        corner = np.zeros(0)
    if corner.shape != (3,) or np.isnan(corner).any():
        raise InputError(f"workspace: {what} must be three numbers in m, got {values!r}")
    return corner
