"""Signed distances between pairs of bodies, for batches of configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from .configurations import LinkPlacements
from .robot_geometry import PlacedShape
from .shapes import Mesh, require_coal

__all__ = ["Nearest", "PairDistances", "segment_distance_bound"]

Array = NDArray[np.float64]

# Segments whose angle has a smaller squared sine are taken as parallel, which moves a point by at most `SLACK` of
# their length.
PARALLEL = 1e-9
SLACK = 1e-4


def segment_distance_bound(first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
    """Return lower bounds (...) of the distances of segments, equal to them but for 1e-4 of the segments' lengths.

    The closest points of two lines, clamped to the segments (Ericson, Real-Time Collision Detection, 2005, 5.1.9).

    Parameters
    ----------
    first, second : tuple of ndarray
        Both ends, (..., 3) each, m.

    Examples
    --------
    >>> x, y, z = np.eye(3)
    >>> float(segment_distance_bound((0 * x, x), (0.5 * x + z, y + z)).round(3))
    1.0
    """
    (p, p_end), (r, r_end) = first, second
    u, v, w = p_end - p, r_end - r, p - r
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    uw, vw = _dot(u, w), _dot(v, w)
    determinant = uu * vv - uv * uv
    s = np.clip(_ratio(uv * vw - uw * vv, determinant, determinant > PARALLEL * uu * vv), 0.0, 1.0)
    t = np.clip(_ratio(uv * s + vw, vv, vv > 0), 0.0, 1.0)
    s = np.clip(_ratio(uv * t - uw, uu, uu > 0), 0.0, 1.0)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.asarray(np.sqrt(_dot(gap, gap)) - SLACK * (np.sqrt(uu) + np.sqrt(vv)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _ratio(numerator: Array, denominator: Array, valid: NDArray[np.bool_]) -> Array:
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=valid)


# Signed distances between pairs of bodies for batches of configurations.

Flags = NDArray[np.bool_]

# Below this distance (m) surfaces of triangles count as crossing each other.
CROSSING = 1e-6


@dataclass(frozen=True, eq=False)
class Nearest:
    """What is nearest in one group at the rows that were asked for.

    Attributes
    ----------
    rows : ndarray
        (K,) indices of the configurations at which the distance is below the horizon.
    first, second : ndarray
        (K, 3) nearest points of the two bodies, base frame, m; where bodies overlap, the deepest points.
    normal : ndarray
        (K, 3) unit vectors from the first to the second: the gradient of the distance by the second point.
    """

    rows: NDArray[np.intp]
    first: Array
    second: Array
    normal: Array


class PairDistances:
    """Signed distances of groups of pairs of shapes: the least of each group.

    Parameters
    ----------
    shapes : sequence of PlacedShape
    groups : sequence of sequence of (int, int)
        For each of the m groups its pairs, as indices of shapes.

    Notes
    -----
    Pairs whose bounding capsules are farther apart than the horizon, or than the least distance of their group so far,
    are not computed; since the capsules contain the shapes, this changes no result. The rest is computed by coal:
    GJK and EPA for convex shapes, which find the distance and, where they overlap, the depth (Montaut et al., Collision
    Detection Accelerated: An Optimization Perspective, 2022), and hierarchies of boxes for surfaces of triangles.
    """

    def __init__(self, shapes: Sequence[PlacedShape], groups: Sequence[Sequence[tuple[int, int]]]) -> None:
        self._shapes = tuple(shapes)
        self._groups = tuple(tuple(group) for group in groups)
        self._pairs = np.array([pair for group in self._groups for pair in group], dtype=np.intp).reshape(-1, 2)
        starts = np.cumsum([0, *(len(group) for group in self._groups)]).tolist()
        self._members = [range(start, end) for start, end in pairwise(starts)]
        self._engine: _Engine | None = None

    def __getstate__(self) -> dict[str, Any]:
        # The objects of coal stay behind when a constraint goes to another process; they are made again there.
        return {**self.__dict__, "_engine": None}

    def bodies(self, group: int) -> tuple[int, int]:
        """Return the moving links (-1: the base) of a group."""
        first, second = self._groups[group][0]
        return self._shapes[first].body, self._shapes[second].body

    def distances(self, places: LinkPlacements, horizon: float) -> Array:
        """Return the signed distances (S, m), m, no larger than the horizon; negative values are depths."""
        wanted = np.ones((places.count, len(self._groups)), dtype=np.bool_)
        return self._search(places, wanted, horizon, None)

    def nearest(self, places: LinkPlacements, wanted: Flags, horizon: float) -> list[Nearest]:
        """Return for each group the nearest points at the configurations that are wanted, (S, m)."""
        found: list[Nearest] = []
        self._search(places, wanted, horizon, found)
        return found

    def _search(self, places: LinkPlacements, wanted: Flags, horizon: float, found: list[Nearest] | None) -> Array:
        if self._engine is None:
            self._engine = _Engine(self._shapes)
        poses = self._engine.poses(places, np.unique(self._pairs))
        result = np.full(wanted.shape, horizon)
        bounds = self._bounds(poses)
        for group, members in enumerate(self._members):
            least = result[:, group]
            points = np.empty((places.count, 3, 3)) if found is not None else None
            for pair in sorted(members, key=lambda index: float(bounds[index].sum())):
                rows = np.flatnonzero(wanted[:, group] & (bounds[pair] < least))
                first, second = self._pairs[pair]
                self._engine.measure(int(first), int(second), poses, rows, least, points)
            if found is not None and points is not None:
                rows = np.flatnonzero(wanted[:, group] & (least < horizon))
                found.append(Nearest(rows, *(points[rows, kind] for kind in range(3))))
        return result

    def _bounds(self, poses: _Poses) -> Array:
        """Return lower bounds (P, S) of the distances of all the pairs."""
        starts, ends, radii = poses.segments
        first, second = (poses.number[self._pairs[:, side]] for side in (0, 1))
        gap = segment_distance_bound((starts[first], ends[first]), (starts[second], ends[second]))
        return gap - (radii[first] + radii[second])[:, None]


@dataclass(frozen=True, eq=False)
class _Poses:
    """Frames of the shapes that take part, for a batch of configurations."""

    number: NDArray[np.intp]  # of a shape, among those that take part
    rotations: Array  # (K, S, 3, 3)
    positions: Array  # (K, S, 3)
    segments: tuple[Array, Array, Array]  # ends (K, S, 3) and radii (K,) of the bounding capsules
    transforms: list[list[Any]]  # (K, S) objects of coal, made when they are needed


class _Engine:
    """The objects of coal, made once."""

    def __init__(self, shapes: Sequence[PlacedShape]) -> None:
        self.coal = require_coal()
        self.shapes = shapes
        self.objects: dict[tuple[int, bool], Any] = {}

    def poses(self, places: LinkPlacements, used: NDArray[np.intp]) -> _Poses:
        number = np.full(len(self.shapes), -1, dtype=np.intp)
        number[used] = np.arange(len(used))
        rotations = np.empty((len(used), places.count, 3, 3))
        positions = np.empty((len(used), places.count, 3))
        starts, ends, radii = np.empty_like(positions), np.empty_like(positions), np.empty(len(used))
        for row, index in enumerate(used):
            one = self.shapes[index]
            rotations[row], positions[row] = places.of(one.body, one.placement)
            bounds = one.shape.bounds
            starts[row] = positions[row] + rotations[row] @ bounds.start
            ends[row] = positions[row] + rotations[row] @ bounds.end
            radii[row] = bounds.radius
        transforms = [[None] * places.count for _ in used]
        return _Poses(number, rotations, positions, (starts, ends, radii), transforms)

    def measure(
        self, first: int, second: int, poses: _Poses, rows: NDArray[np.intp], least: Array, points: Array | None
    ) -> None:
        """Lower `least` (S,) at these rows where a pair is nearer, and keep its points and normal (S, 3, 3)."""
        coal = self.coal
        request, result = coal.DistanceRequest(True), coal.DistanceResult()
        request.enable_signed_distance = True
        a, b = self._object(first), self._object(second)
        of_a, of_b = (self._transforms(poses, index, rows) for index in (first, second))
        surfaces = self.shapes[first].shape.surface_only or self.shapes[second].shape.surface_only
        distance, clear = coal.distance, result.clear
        for row in rows.tolist():
            clear()
            value = distance(a, of_a[row], b, of_b[row], request, result)
            crossing = surfaces and value <= CROSSING
            if crossing:
                clear()
                hulls = (self._object(index, hull=True) for index in (first, second))
                value = min(distance(next(hulls), of_a[row], next(hulls), of_b[row], request, result), 0.0)
            if value < least[row]:
                least[row] = value
                if points is not None:
                    start, end = result.getNearestPoint1(), result.getNearestPoint2()
                    points[row, 0], points[row, 1] = start, end
                    # Surfaces give no normal, and where they cross the hulls do.
                    points[row, 2] = (end - start) / value if surfaces and not crossing else result.normal

    def _transforms(self, poses: _Poses, shape: int, rows: NDArray[np.intp]) -> list[Any]:
        index = poses.number[shape]
        made, rotations, positions = poses.transforms[index], poses.rotations[index], poses.positions[index]
        for row in rows.tolist():
            if made[row] is None:
                made[row] = self.coal.Transform3s(rotations[row], positions[row])
        return made

    def _object(self, index: int, hull: bool = False) -> Any:
        shape = self.shapes[index].shape
        hull = hull and shape.surface_only
        if (index, hull) not in self.objects:
            solid = shape.as_hull if hull and isinstance(shape, Mesh) else shape
            try:
                self.objects[index, hull] = solid.collision_object(self.coal)
            except InputError as error:
                raise InputError(f"{self.shapes[index].link}: {error}") from None
        return self.objects[index, hull]
