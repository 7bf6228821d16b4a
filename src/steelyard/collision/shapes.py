"""The shapes between which distances are computed, and the optional package coal, which computes them."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError, missing_extra
from steelyard.once import cached_property
from steelyard.robot import Robot
from steelyard.robot.inertia import box_moments, capsule_moments, cylinder_moments, ellipsoid_moments
from steelyard.robot.placement import frozen

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Mesh",
    "PlacedShape",
    "Shape",
    "Sphere",
    "SweptSegment",
    "coal_or_none",
    "convex_hull",
    "moments_of_surface",
    "most_neighbours",
    "require_coal",
]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

SMALLEST, LARGEST = 1e-9, 1e9  # lengths of bodies, m; beyond them, squares of lengths lose all their digits
MOST_NEIGHBOURS = 255  # of a corner; coal counts them in one byte

# Points count as flat, or as lying on a line, where they extend by less than this part of the length of the body.
FLAT = 1e-9


def convex_hull(vertices: Array) -> tuple[Array, Indices]:
    """Return corners (k, 3) and outward triangles (t, 3) of the convex hull of points.

    The hull of a flat body is its polygon with triangles on both sides. Faces with many corners are divided into strips
    of triangles, so that no corner has unnecessarily many neighbours.

    Raises
    ------
    InputError
        If the points span no surface.

    Examples
    --------
    >>> corners, triangles = convex_hull(np.vstack([np.zeros(3), np.eye(3), np.full(3, 0.1)]))
    >>> len(corners), len(triangles)
    (4, 4)
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(vertices, axis=0)
    center = points.mean(axis=0) if len(points) else np.zeros(3)
    extents, axes = np.zeros(3), np.eye(3)
    if len(points) > 2:
        extents, axes = np.linalg.svd(points - center, full_matrices=False)[1:]
    if extents[1] <= FLAT * extents[0] or extents[0] < SMALLEST:
        raise InputError(f"a mesh: its {len(points)} different vertices span no surface; give a mesh of a body")
    flat = extents[2] <= FLAT * extents[0]
    try:
        hull = ConvexHull((points - center) @ axes[:2].T if flat else points)
    except QhullError as error:
        reason = " ".join(str(error).split())[:80]
        raise InputError(f"a mesh: its vertices have no convex hull ({reason}); give a mesh of a body") from None
    corners = points[hull.vertices]
    if flat:
        side = _strip(list(range(len(corners))))
        return corners, np.array([*side, *(triangle[::-1] for triangle in side)], dtype=np.intp)
    number = np.zeros(len(points), dtype=np.intp)
    number[hull.vertices] = np.arange(len(hull.vertices))
    triangles = number[hull.simplices]
    a, b, c = (corners[triangles[:, column]] for column in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    # Triangles of one face have exactly the same plane.
    face = np.unique(hull.equations, axis=0, return_inverse=True)[1].ravel()
    return corners, _in_strips(triangles, face)


def moments_of_surface(vertices: Array, triangles: Indices) -> Array:
    """Return ∫ (r, 1)(r, 1)ᵀ dV within a closed surface, (4, 4), negative where its triangles face inwards.

    Each triangle makes a tetrahedron with a point c: over a tetrahedron of volume V and corners hᵢ = (rᵢ, 1) the
    integral is V/20 (Σ hᵢhᵢᵀ + s sᵀ) with s = Σ hᵢ.

    Examples
    --------
    >>> corners, triangles = convex_hull(np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)]))
    >>> moments_of_surface(corners, triangles)[3].round(12).tolist()
    [3.0, 6.0, 9.0, 6.0]
    """
    # Far from the origin, differences of volumes would lose their digits.
    center = vertices.mean(axis=0)
    corners = np.ones((len(triangles), 4, 4))
    corners[:, :3, :3] = (vertices - center)[triangles]
    corners[:, 3, :3] = 0.0
    volumes = np.einsum("ti,ti->t", corners[:, 0, :3], np.cross(corners[:, 1, :3], corners[:, 2, :3])) / 6.0
    sums = corners.sum(axis=1)
    found = np.einsum("t,tki,tkj->ij", volumes, corners, corners) + np.einsum("t,ti,tj->ij", volumes, sums, sums)
    shift = np.eye(4)
    shift[:3, 3] = center
    return np.asarray(shift @ found @ shift.T / 20.0)


def most_neighbours(triangles: Indices) -> int:
    """Return the largest number of neighbours of a corner of a closed surface."""
    return int(np.bincount(triangles.ravel()).max())


def _in_strips(triangles: Indices, face: Indices) -> Indices:
    """Divide faces of more than two triangles into strips, instead of fans about one corner."""
    order = np.argsort(face, kind="stable")
    groups = np.split(triangles[order], np.flatnonzero(np.diff(face[order])) + 1)
    result: list[Indices] = []
    for group in groups:
        loop = _boundary(group) if len(group) > 2 else None
        result.append(group if loop is None else np.array(_strip(loop), dtype=np.intp))
    return np.vstack(result)


def _boundary(triangles: Indices) -> list[int] | None:
    """Return the corners around the triangles of a face in order, or None if they form no simple polygon."""
    edges = {(one, other) for t in triangles.tolist() for one, other in zip(t, t[1:] + t[:1], strict=True)}
    following = {one: other for one, other in edges if (other, one) not in edges}
    if len(following) != len(triangles) + 2:
        return None
    loop = [next(iter(following))]
    while len(loop) < len(following) and following[loop[-1]] != loop[0]:
        loop.append(following[loop[-1]])
    return loop if len(loop) == len(following) else None


def _strip(loop: list[int]) -> list[tuple[int, int, int]]:
    """Divide a convex polygon into a strip of triangles, with corners from its two sides in turn."""
    triangles = []
    low, high = 0, len(loop) - 1
    while high - low > 1:
        triangles.append((loop[low], loop[low + 1], loop[high]))
        low += 1
        if high - low > 1:
            triangles.append((loop[low], loop[high - 1], loop[high]))
            high -= 1
    return triangles


@dataclass(frozen=True, eq=False)
class SweptSegment:
    """A capsule (a segment with a radius) that contains a shape, whose distances are cheap to compute in batches.

    Attributes
    ----------
    start, end : ndarray
        (3,) ends of the segment in the frame of the shape, m.
    radius : float
        m.
    """

    start: Array
    end: Array
    radius: float


class Shape(ABC):
    """A solid in its own frame."""

    kind: str = "shape"

    @property
    def surface_only(self) -> bool:
        """Whether the shape is a surface of triangles, which has no inside."""
        return False

    @abstractmethod
    def lowest(self, direction: Array) -> Array:
        """Return the points (S, 3) of the shape that are lowest along directions (S, 3), m."""

    @property
    @abstractmethod
    def bounds(self) -> SweptSegment:
        """A capsule that contains the shape."""

    @property
    @abstractmethod
    def moments(self) -> Array:
        """∫ (r, 1)(r, 1)ᵀ dV over the solid, (4, 4): its pseudo-inertia at 1 kg/m³, the volume last."""

    @abstractmethod
    def collision_object(self, coal: Any) -> Any:
        """Return the shape as a geometry of the package coal."""


def _positive(owner: str, name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(f"{owner}: {name} must be a number in m, got {value!r}")
    if not SMALLEST <= value <= LARGEST:
        raise InputError(f"{owner}: {name} must be positive and finite, in m, got {float(value):g}")
    return float(value)


def _unit(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0))


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball whose centre is the origin.

    Parameters
    ----------
    radius : float
        m.

    Examples
    --------
    >>> Sphere(0.5).lowest(np.array([[0.0, 0.0, 2.0]])).tolist()
    [[0.0, 0.0, -0.5]]
    """

    radius: float
    kind = "sphere"

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _positive("a sphere", "radius", self.radius))

    def lowest(self, direction: Array) -> Array:
        """See `Shape`."""
        return -self.radius * _unit(direction) + 0.0

    @property
    def bounds(self) -> SweptSegment:
        """The sphere itself."""
        return SweptSegment(np.zeros(3), np.zeros(3), self.radius)

    @property
    def moments(self) -> Array:
        """See `Shape`."""
        return ellipsoid_moments(*[self.radius] * 3)

    def collision_object(self, coal: Any) -> Any:
        """See `Shape`."""
        return coal.Sphere(self.radius)


@dataclass(frozen=True)
class _AroundZ(Shape):
    """A shape of a radius about the z axis and of a length along it, with its middle in the origin."""

    radius: float
    length: float

    def __post_init__(self) -> None:
        for name in ("radius", "length"):
            object.__setattr__(self, name, _positive(f"a {self.kind}", name, getattr(self, name)))

    @property
    def bounds(self) -> SweptSegment:
        """A capsule: the segment along z, with half balls on both ends."""
        end = np.array([0.0, 0.0, self.length / 2])
        return SweptSegment(-end, end, self.radius)


@dataclass(frozen=True)
class Capsule(_AroundZ):
    """A cylinder along z with half balls on both ends.

    Parameters
    ----------
    radius : float
        m.
    length : float
        Distance between the centres of the half balls, m.
    """

    kind = "capsule"

    def lowest(self, direction: Array) -> Array:
        """See `Shape`."""
        points = -self.radius * _unit(direction)
        points[:, 2] -= np.copysign(self.length / 2, direction[:, 2])
        return points

    @property
    def moments(self) -> Array:
        """See `Shape`."""
        return capsule_moments(self.radius, self.length)

    def collision_object(self, coal: Any) -> Any:
        """See `Shape`."""
        return coal.Capsule(self.radius, self.length)


@dataclass(frozen=True)
class Cylinder(_AroundZ):
    """A cylinder along z whose centre is the origin.

    Parameters
    ----------
    radius, length : float
        m.
    """

    kind = "cylinder"

    def lowest(self, direction: Array) -> Array:
        """See `Shape`."""
        points = np.empty_like(direction)
        points[:, :2] = -self.radius * _unit(direction[:, :2])
        points[:, 2] = -np.copysign(self.length / 2, direction[:, 2])
        return points

    @property
    def moments(self) -> Array:
        """See `Shape`."""
        return cylinder_moments(self.radius, self.length)

    def collision_object(self, coal: Any) -> Any:
        """See `Shape`."""
        return coal.Cylinder(self.radius, self.length)


@dataclass(frozen=True)
class Box(Shape):
    """A box with edges along the axes whose centre is the origin.

    Parameters
    ----------
    size : tuple of float
        Lengths of the edges along x, y and z, m.

    Examples
    --------
    >>> Box((0.2, 0.4, 0.6)).lowest(np.array([[1.0, -1.0, 1.0]])).tolist()
    [[-0.1, 0.2, -0.3]]
    """

    size: tuple[float, float, float]
    kind = "box"

    def __post_init__(self) -> None:
        try:
            x, y, z = self.size
        except (TypeError, ValueError):
            raise InputError(f"a box: size must be three numbers in m, got {self.size!r}") from None
        object.__setattr__(self, "size", tuple(_positive("a box", "size", edge) for edge in (x, y, z)))

    def lowest(self, direction: Array) -> Array:
        """See `Shape`."""
        return -np.copysign(np.array(self.size) / 2, direction)

    @property
    def bounds(self) -> SweptSegment:
        """A capsule along the longest edge."""
        half = np.array(self.size) / 2
        longest = int(np.argmax(half))
        end = np.zeros(3)
        end[longest] = half[longest]
        return SweptSegment(-end, end, float(np.linalg.norm(np.delete(half, longest))))

    @property
    def moments(self) -> Array:
        """See `Shape`."""
        return box_moments(self.size)

    def collision_object(self, coal: Any) -> Any:
        """See `Shape`."""
        return coal.Box(*self.size)


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Shape):
    """A mesh of triangles: its convex hull, or the surface itself.

    Parameters
    ----------
    vertices : (k, 3) array
        m.
    triangles : (t, 3) array of int
        Indices of vertices; needed only with `exact`.
    exact : bool
        Whether the surface is kept. Otherwise the shape is the convex hull, which fills hollows of the surface.

    Raises
    ------
    InputError
        If the vertices span no surface, or the triangles refer to vertices that do not exist.

    Examples
    --------
    >>> Mesh(np.vstack([np.zeros(3), np.eye(3)]))
    Mesh(convex hull of 4 vertices)
    """

    vertices: Array
    triangles: Indices = field(default_factory=lambda: np.zeros((0, 3), dtype=np.intp))
    exact: bool = False
    kind = "mesh"

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.all(np.abs(vertices) <= LARGEST):
            raise InputError(
                f"a mesh: vertices must be finite, below {LARGEST:g} m and of shape (k, 3), got shape {vertices.shape}"
            )
        triangles = np.array(self.triangles, dtype=np.intp).reshape(-1, 3)
        if self.exact and not len(triangles):
            raise InputError("a mesh: an exact surface needs triangles, and there are none; use its convex hull")
        if triangles.size and (triangles.min() < 0 or triangles.max() >= len(vertices)):
            raise InputError(f"a mesh: its triangles name vertices that do not exist; it has {len(vertices)} vertices")
        for array in (vertices, triangles):
            array.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "triangles", triangles)
        _ = self.hull

    def __repr__(self) -> str:
        if self.exact:
            return f"Mesh(surface of {len(self.triangles)} triangles)"
        return f"Mesh(convex hull of {len(self.hull[0])} vertices)"

    @property
    def surface_only(self) -> bool:
        """Whether the surface is kept."""
        return self.exact

    @cached_property
    def hull(self) -> tuple[Array, Indices]:
        """Vertices and outward triangles of the convex hull."""
        return convex_hull(self.vertices)

    @property
    def as_hull(self) -> Mesh:
        """The convex hull of the same vertices."""
        return Mesh(self.vertices) if self.exact else self

    def lowest(self, direction: Array) -> Array:
        """See `Shape`."""
        corners = self.hull[0]
        return np.asarray(corners[np.argmin(direction @ corners.T, axis=1)])

    @cached_property
    def bounds(self) -> SweptSegment:
        """A capsule along the longest principal axis of the vertices."""
        return _swept_segment(self.hull[0])

    @cached_property
    def moments(self) -> Array:
        """See `Shape`: those of the convex hull, also of an exact surface, which need not be closed."""
        return moments_of_surface(*self.hull)

    def collision_object(self, coal: Any) -> Any:
        """See `Shape`."""
        vertices, triangles = (self.vertices, self.triangles) if self.exact else self.hull
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        points.extend(list(vertices))
        faces.extend([coal.Triangle(*(int(corner) for corner in triangle)) for triangle in triangles])
        if not self.exact:
            most = most_neighbours(triangles)
            if most > MOST_NEIGHBOURS:
                raise InputError(
                    f"a corner of the convex hull of its mesh has {most} neighbours, and coal takes at most "
                    f"{MOST_NEIGHBOURS}; simplify the mesh"
                )
            return coal.Convex(points, faces)
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(triangles), len(vertices))
        surface.addSubModel(points, faces)
        surface.endModel()
        surface.computeLocalAABB()
        return surface


def _swept_segment(vertices: ArrayLike) -> SweptSegment:
    """Return a capsule around points along their longest principal axis, as short as its radius allows."""
    points = np.asarray(vertices, dtype=np.float64)
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    local = points @ axes.T
    middle = (local.min(axis=0) + local.max(axis=0)) / 2
    along = local[:, 0]
    across = np.hypot(*(local[:, 1:] - middle[1:]).T)
    radius = float(across.max())
    cap = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = float((along + cap).min()), float((along - cap).max())
    if low > high:
        low = high = (low + high) / 2
    ends = np.array([[low, *middle[1:]], [high, *middle[1:]]]) @ axes
    # The increase makes up for rounding errors of the radius.
    return SweptSegment(ends[0], ends[1], radius * (1.0 + 1e-12) + 1e-15)


@cache
def coal_or_none() -> Any:
    """Return the module coal, or None where it is absent."""
    try:
        return importlib.import_module("coal")
    except ImportError:
        return None


def require_coal() -> Any:
    """Return the module coal.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    coal = coal_or_none()
    if coal is None:
        raise missing_extra("Distances between bodies need the package coal, which is not installed", "collision")
    return coal


@dataclass(frozen=True, eq=False)
class PlacedShape:
    """A shape that is fixed to a link.

    Use `PlacedShape.on` to place a shape on a link by its name.

    Parameters
    ----------
    shape : Shape
    link : str
        Link of the description that the shape belongs to, which may have been merged into another link.
    body : int
        Index of the moving link that carries the shape, -1 for the base.
    placement : (4, 4) array
        Pose of the shape in the frame of this moving link.

    Examples
    --------
    >>> from steelyard.robot import Robot
    >>> arm = Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")])
    >>> PlacedShape.on(arm, "link2", Capsule(radius=0.05, length=0.4))
    PlacedShape(Capsule(radius=0.05, length=0.4) on 'link2')
    """

    shape: Shape
    link: str
    body: int
    placement: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "placement", frozen(self.placement, (4, 4)))

    def __repr__(self) -> str:
        return f"PlacedShape({self.shape} on {self.link!r})"

    @property
    def moments(self) -> Array:
        """∫ (r, 1)(r, 1)ᵀ dV over the solid, (4, 4), in the frame of the moving link; see `Shape`."""
        return np.asarray(self.placement @ self.shape.moments @ self.placement.T)

    @property
    def box(self) -> Array:
        """Corners (2, 3) of the box around the shape, lower first, along the axes of the moving link, m."""
        rotation, origin = self.placement[:3, :3], self.placement[:3, 3]
        found = []
        for sign in (1.0, -1.0):
            points = self.shape.lowest(sign * rotation)  # rows of the rotation: the axes, seen from the shape
            found.append(np.einsum("ij,ij->i", rotation, points) + origin)
        return np.array(found)

    @classmethod
    def on(cls, robot: Robot, link: str, shape: Shape, placement: ArrayLike | None = None) -> PlacedShape:
        """Place a shape on a link.

        Parameters
        ----------
        robot : Robot
        link : str
            A moving link, the base, or a link that was merged into one of them.
        shape : Shape
        placement : (4, 4) array, optional
            Pose of the shape in the frame of the link; the frame of the link itself by default.

        Raises
        ------
        InputError
            If the robot has no such link.
        """
        body, of_link = robot.frame(link)
        own = np.eye(4) if placement is None else np.asarray(placement, dtype=np.float64)
        return cls(shape, link, body, of_link @ own)
