"""A plane that the links must stay above."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .distance_constraint import checked_margin
from .placements import LinkPlacements
from .posture_constraint import PostureConstraint, check_possible
from .robot_geometry import PlacedShape, RobotGeometry

__all__ = ["TablePlane"]

Array = NDArray[np.float64]


class TablePlane(PostureConstraint):
    """Links stay in the half space ``normal · x >= offset`` of the base frame, with a margin.

    One clearance for each moving link that carries shapes: the height of its lowest point above the plane, less the
    margin. The height is exact for boxes, spheres, cylinders, capsules and meshes (the lowest point of a mesh is that
    of its convex hull).

    Parameters
    ----------
    geometry : RobotGeometry
    normal : (3,) array
        Away from the table, in the base frame; of any length.
    offset : float
        ``normal · x`` on the plane: with the default normal, the height of the table top, m.
    margin : float
        Least height above the plane, m.
    links : sequence of str, optional
        The links of the source that are watched; all that move by default.
    ignore : sequence of str
        Links of the source that are not.

    Raises
    ------
    InputError
        When there is nothing to watch, a name is unknown, or a link can never stay above the plane.

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
        check_possible(self, "put its name into `ignore`, or mend normal, offset or margin")

    def lowest(self, places: LinkPlacements, body: int) -> tuple[Array, Array]:
        """Return the lowest points (S, 3) of what a moving link carries, base frame, and their heights (S,), m."""
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
