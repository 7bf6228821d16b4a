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
from .shapes import Mesh, PlacedShape, require_coal

__all__ = ["Nearest", "PairDistances", "segment_distance_bound"]

Array = NDArray[np.float64]

# Segments are treated as parallel where the square of the sine of their angle is below PARALLEL. This moves the nearest
# point by at most the fraction SLACK of their length, which is subtracted, so that the result stays a lower bound.
PARALLEL = 1e-9
SLACK = 1e-4


def segment_distance_bound(first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
    """Return lower bounds (...) of the distances of segments, tight to 1e-4 of the lengths of the segments.

    They come from the closest points of two lines, clamped to the segments (Ericson, Real-Time Collision Detection,
    2005, section 5.1.9). A segment is given by its two ends, (..., 3) each, m.

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


Flags = NDArray[np.bool_]

# Surfaces of triangles count as crossing each other below this distance (m), the accuracy of the distances.
CROSSING = 1e-6


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest points of the pairs of one group.

    Attributes
    ----------
    rows : ndarray
        (K,) indices of the configurations at which the distance is below the horizon.
    first, second : ndarray
        (K, 3) nearest points of the two bodies, base frame, m; the deepest points where the bodies overlap.
    normal : ndarray
        (K, 3) unit vectors from the first to the second body: the gradient of the distance by the second point.
    """

    rows: NDArray[np.intp]
    first: Array
    second: Array
    normal: Array


class PairDistances:
    """Computes the smallest signed distance of each group of pairs of shapes.

    Parameters
    ----------
    groups : sequence of sequence of (int, int)
        The pairs of each of the m groups, as indices of shapes.

    Notes
    -----
    Pairs whose bounding capsules are farther apart than the horizon, or than the smallest distance of their group so
    far, are skipped. This changes no result, because the capsules contain the shapes. All other pairs are computed by
    coal: convex shapes with GJK and EPA, which find the distance and, where they overlap, the penetration depth
    (Montaut et al., Collision Detection Accelerated: An Optimization Perspective, 2022), and surfaces of triangles with
    hierarchies of boxes.
    """

    def __init__(self, shapes: Sequence[PlacedShape], groups: Sequence[Sequence[tuple[int, int]]]) -> None:
        self._shapes = tuple(shapes)
        self._groups = tuple(tuple(group) for group in groups)
        self._pairs = np.array([pair for group in self._groups for pair in group], dtype=np.intp).reshape(-1, 2)
        starts = np.cumsum([0, *(len(group) for group in self._groups)]).tolist()
        self._members = [range(start, end) for start, end in pairwise(starts)]
        self._engine: _Engine | None = None

    def __getstate__(self) -> dict[str, Any]:
        # Objects of coal cannot be sent to another process; they are made again there.
        return {**self.__dict__, "_engine": None}

    def bodies(self, group: int) -> tuple[int, int]:
        """Return the two moving links of a group; -1 is the base."""
        first, second = self._groups[group][0]
        return self._shapes[first].body, self._shapes[second].body

    def distances(self, places: LinkPlacements, horizon: float) -> Array:
        """Return the signed distances (S, m), m, limited to the horizon; negative values are penetration depths."""
        wanted = np.ones((places.count, len(self._groups)), dtype=np.bool_)
        return self._search(places, wanted, horizon, None)

    def nearest(self, places: LinkPlacements, wanted: Flags, horizon: float) -> list[Nearest]:
        """Return the nearest points of each group at the configurations where `wanted` (S, m) is True."""
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
        """Return lower bounds (P, S) of the distances of all pairs."""
        starts, ends, radii = poses.segments
        first, second = (poses.number[self._pairs[:, side]] for side in (0, 1))
        gap = segment_distance_bound((starts[first], ends[first]), (starts[second], ends[second]))
        return gap - (radii[first] + radii[second])[:, None]


@dataclass(frozen=True, eq=False)
class _Poses:
    """Poses of the K shapes in the pairs, for a batch of configurations."""

    number: NDArray[np.intp]  # index of each shape among those in the pairs
    rotations: Array  # (K, S, 3, 3)
    positions: Array  # (K, S, 3)
    segments: tuple[Array, Array, Array]  # ends (K, S, 3) and radii (K,) of the bounding capsules
    transforms: list[list[Any]]  # (K, S) transforms of coal, made when they are needed


class _Engine:
    """The geometries of coal, made once, and the calls of coal."""

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
        """Reduce `least` (S,) in the rows in which a pair is nearer, and store its points and normal (S, 3, 3)."""
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
                    # coal computes no normal for surfaces; where they cross, that of their hulls is used.
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
