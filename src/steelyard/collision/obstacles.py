"""Obstacles, and the constraint that the links keep clear of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.robot.placement import frozen

from .configuration_constraint import DistanceConstraint, check_possible, checked_margin
from .distances import PairDistances
from .robot_geometry import RobotGeometry
from .shapes import PlacedShape, Shape

__all__ = ["Obstacle", "ObstacleClearance"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A body that is fixed in the base frame of the robot.

    Parameters
    ----------
    name : str
    shape : Shape
    placement : (4, 4) array
        Pose of the shape in the base frame.
    ignore : sequence of str
        Links of the description that may touch the obstacle.
    margin : float, optional
        Least distance of the links from the obstacle, m; that of the constraint by default.

    Examples
    --------
    >>> from steelyard.collision import Box
    >>> Obstacle("wall", Box((0.1, 2.0, 2.0)))
    Obstacle('wall', Box(size=(0.1, 2.0, 2.0)))
    """

    name: str
    shape: Shape
    placement: Array = field(default_factory=lambda: np.eye(4))
    ignore: tuple[str, ...] = ()
    margin: float | None = None

    def __post_init__(self) -> None:
        if self.margin is not None:
            object.__setattr__(self, "margin", checked_margin(self.margin, f'obstacle "{self.name}"'))
        object.__setattr__(self, "placement", frozen(self.placement, (4, 4)))
        object.__setattr__(self, "ignore", tuple(self.ignore))

    def __repr__(self) -> str:
        return f"Obstacle({self.name!r}, {self.shape})"


class ObstacleClearance(DistanceConstraint):
    """The links of a robot keep a margin from obstacles.

    There is one clearance for each moving link and obstacle, ``min(distance, horizon) - margin``. The base is left out,
    because it does not move.

    Parameters
    ----------
    geometry : RobotGeometry
    obstacles : sequence of Obstacle
    margin : float
        Least distance from the obstacles that have no margin of their own, m.
    horizon : float, optional
        See `DistanceConstraint`, m; 0.1 m more than the margin by default.

    Raises
    ------
    InputError
        If no moving link has a shape, a name is unknown or used twice, or a link can never keep the margin.
    MissingExtraError
        If coal is not installed (extra ``collision``).

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.collision import Box, PlacedShape, Sphere
    >>> arm = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.5, 0, "q")])
    >>> wall = Obstacle("wall", Box((0.2, 2.0, 2.0)), sy.robot.placement.translation(1.2, 0.0, 0.0))
    >>> limit = ObstacleClearance(RobotGeometry(arm, [PlacedShape.on(arm, "link2", Sphere(0.05))]), [wall])
    >>> limit.labels, limit.distances([[0.0, 0.0]]).round(6).tolist()
    (('link2 to wall',), [[0.05]])
    """

    name = "obstacles"

    def __init__(
        self,
        geometry: RobotGeometry,
        obstacles: Iterable[Obstacle],
        margin: float = 0.0,
        *,
        horizon: float | None = None,
    ) -> None:
        bodies = tuple(obstacles)
        least = checked_margin(margin, self.name)
        names = [one.name for one in bodies]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InputError(f'two obstacles have the name "{twice}"; names must differ')
        for one in bodies:
            for link in one.ignore:
                geometry.robot.frame(link)
        moving = [body for body in geometry.bodies if body >= 0]
        if not moving:
            raise InputError(
                f'robot "{geometry.robot.name}" has no moving link with collision geometry to keep clear of obstacles; '
                "add <collision> elements to its URDF, or shapes"
            )
        shapes = (*geometry.shapes, *(PlacedShape(one.shape, one.name, -1, one.placement) for one in bodies))
        groups: list[list[tuple[int, int]]] = []
        labels: list[str] = []
        margins: list[float] = []
        largest = max([least, *(one.margin for one in bodies if one.margin is not None)])
        for number, one in enumerate(bodies, start=len(geometry.shapes)):
            for body in moving:
                group = _pairs_with(geometry, body, number, one.ignore)
                if group:
                    groups.append(group)
                    labels.append(f"{geometry.body_name(body)} to {one.name}")
                    margins.append(least if one.margin is None else one.margin)
        super().__init__(geometry, PairDistances(shapes, groups), tuple(labels), np.array(margins), largest, horizon)
        self.margin = least
        self.obstacles = bodies
        check_possible(self, "add the link to `ignore` of the obstacle, or move the obstacle")


def _pairs_with(geometry: RobotGeometry, body: int, obstacle: int, ignore: Sequence[str]) -> list[tuple[int, int]]:
    shapes = enumerate(geometry.shapes)
    return [(obstacle, index) for index, one in shapes if one.body == body and one.link not in ignore]
