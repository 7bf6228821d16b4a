"""Constraints on the workspace: links keep clear of obstacles and above a table, or a point stays in a box."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot
from steelyard.robot.placement import frozen

from .configuration_constraint import ConfigurationConstraint, DistanceConstraint, check_possible, checked_margin
from .configurations import LinkPlacements
from .distances import PairDistances
from .robot_geometry import RobotGeometry
from .shapes import PlacedShape, Shape

__all__ = ["Obstacle", "ObstacleClearance", "TablePlane", "WorkspaceBox"]

Array = NDArray[np.float64]


class TablePlane(ConfigurationConstraint):
    """The links stay in the half space ``normal · x >= offset`` of the base frame, with a margin.

    There is one clearance for each moving link that carries shapes: the height of its lowest point above the plane,
    minus the margin. The height is exact for boxes, spheres, cylinders, capsules and meshes (the lowest point of a mesh
    is that of its convex hull).

    Parameters
    ----------
    geometry : RobotGeometry
    normal : (3,) array
        Direction away from the table, in the base frame, of any length.
    offset : float
        Value of ``normal · x`` on the plane; with the default normal this is the height of the table top, m.
    margin : float
        Least height above the plane, m.
    links : sequence of str, optional
        Links of the description that are watched; by default all that move.
    ignore : sequence of str
        Links of the description that are not watched.

    Raises
    ------
    InputError
        If no watched link has a shape, a name is unknown, or a link can never stay above the plane.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.collision import PlacedShape, Sphere
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])
    >>> limit = TablePlane(RobotGeometry(arm, [PlacedShape.on(arm, "link2", Sphere(0.05))]), margin=0.01)
    >>> limit.labels, limit.clearance([[0.0, 0.0]]).round(3).tolist()
    (('link2',), [[0.24]])
    """

    name = "table plane"

    def __init__(
        self,
        geometry: RobotGeometry,
        normal: ArrayLike = (0.0, 0.0, 1.0),
        offset: float = 0.0,
        margin: float = 0.0,
        *,
        links: Iterable[str] | None = None,
        ignore: Iterable[str] = (),
    ) -> None:
        direction = np.asarray(normal, dtype=np.float64)
        length = float(np.linalg.norm(direction)) if direction.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > 0):
            raise InputError(f"{self.name}: the normal must be three finite numbers, not all 0, got {normal!r}")
        if isinstance(offset, bool) or not isinstance(offset, int | float | np.number) or not np.isfinite(offset):
            raise InputError(f"{self.name}: the offset must be a finite number, in m, got {offset!r}")
        self.robot = geometry.robot
        self.geometry = geometry
        self.normal = direction / length
        self.offset = float(offset) / length
        self.margin = checked_margin(margin, self.name)
        ignored = set(ignore)
        for link in ignored:
            self.robot.frame(link)
        wanted = geometry.links if links is None else geometry.check_links(links, self.name)
        self._shapes: dict[int, list[PlacedShape]] = {}
        for one in geometry.shapes:
            if one.body >= 0 and one.link in wanted and one.link not in ignored:
                self._shapes.setdefault(one.body, []).append(one)
        if not self._shapes:
            raise InputError(
                f'{self.name}: no moving link of robot "{self.robot.name}" that is watched has collision geometry; '
                "add <collision> elements to its URDF, or shapes"
            )
        self._bodies = sorted(self._shapes)
        self.labels = tuple(geometry.body_name(body) for body in self._bodies)
        check_possible(self, "add the link to `ignore`, or correct normal, offset or margin")

    def lowest(self, places: LinkPlacements, body: int) -> tuple[Array, Array]:
        """Return the lowest points (S, 3) of the shapes on a moving link, base frame, and their heights (S,), m."""
        points, heights = np.empty((places.count, 3)), np.full(places.count, np.inf)
        for one in self._shapes[body]:
            rotation, position = places.of(body, one.placement)
            inside = one.shape.lowest(self.normal @ rotation)
            found = position + np.einsum("sij,sj->si", rotation, inside)
            height = found @ self.normal - self.offset
            lower = height < heights
            points[lower], heights[lower] = found[lower], height[lower]
        return points, heights

    def _values(self, places: LinkPlacements) -> Array:
        return np.stack([self.lowest(places, body)[1] for body in self._bodies], axis=1) - self.margin

    def _forces(self, places: LinkPlacements, weights: Array) -> tuple[Array, Array]:
        forces, moments = (np.zeros_like(places.positions) for _ in range(2))
        for column, body in enumerate(self._bodies):
            forces[body] = weights[:, column, None] * self.normal
            moments[body] = np.cross(self.lowest(places, body)[0], forces[body])
        return forces, moments


class WorkspaceBox(ConfigurationConstraint):
    """A point of a link stays in a box whose edges are along the axes of the base frame.

    There is one clearance for each finite side of the box.

    Parameters
    ----------
    robot : Robot
    link : str
        A link of the description, which may have been merged into another one (such as ``tool0``).
    lower, upper : (3,) array
        Corners of the box in the base frame, m; infinite where the box is open.
    point : (3,) array
        Point in the frame of the link, m; the origin of this frame by default.

    Raises
    ------
    InputError
        If the robot has no such link, the box is empty or open on all sides, or the point can never be in it.

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
        check_possible(self, "correct the box, which is given in the base frame, in m")

    def positions(self, q: ArrayLike) -> Array:
        """Return the positions of the point (S, 3) at configurations (S, N), base frame, m."""
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
