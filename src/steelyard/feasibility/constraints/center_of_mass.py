"""Constraints that keep the centre of mass of a link within a box, a sphere, or the convex hull of points or a mesh."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard import collision
from steelyard.errors import InputError
from steelyard.files import read_bytes, read_text, require_file, shown
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property

from .constraint import Equality, LinkParameters, ModelLike, equation, scalar_block
from .toml_section import read_placement, read_quantity, read_vector, table

__all__ = ["CenterOfMassBox", "CenterOfMassHull", "CenterOfMassSphere", "ConvexHullForm", "convex_hull", "read_points"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class CenterOfMassBox:
    """Keeps the centre of mass of a link within a box along the axes of the link frame (thesis 4.38).

    Parameters
    ----------
    link : str
    lower, upper : (3,)
        Corners, in metres, in the link frame. An infinite bound leaves its side open; if both bounds of a coordinate
        are equal, it is known exactly.

    Raises
    ------
    InputError
        If a corner is not three numbers or a lower bound is above the upper one.

    See Also
    --------
    DensityInBox : The whole body within the box, which is a stronger condition.

    Examples
    --------
    >>> CenterOfMassBox("forearm", lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    CenterOfMassBox(link='forearm', lower=(-0.1, -0.1, 0.0), upper=(0.1, 0.1, 0.5))
    """

    link: str
    lower: Sequence[float]
    upper: Sequence[float]

    def __post_init__(self) -> None:
        for key in ("lower", "upper"):
            try:
                corner = tuple(float(value) for value in getattr(self, key))
            except (TypeError, ValueError):
                corner = ()
            if len(corner) != 3 or any(math.isnan(value) for value in corner):
                raise InputError(
                    f"CenterOfMassBox of link {self.link!r} must have three numbers (metres) as {key}, "
                    f"got {getattr(self, key)!r}."
                )
            object.__setattr__(self, key, corner)
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            if low > high:
                raise InputError(
                    f"CenterOfMassBox of link {self.link!r} has lower {axis} {low:g} m above upper {axis} {high:g} m; "
                    "swap or correct them."
                )
            if low == math.inf or high == -math.inf:
                raise InputError(f"CenterOfMassBox of link {self.link!r} leaves no room along {axis}; correct it.")

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """At most six 1 x 1 blocks in kg m, l - m lower and m upper - l, one for each finite bound."""
        link = LinkParameters.of(model, self.link, "CenterOfMassBox")
        name = f"{link.title}: centre of mass"
        found = []
        for k, (axis, low, high) in enumerate(zip("xyz", self.lower, self.upper, strict=True)):
            places = (int(link.indices[6 + k]), link.mass)
            if low == high:
                continue
            if math.isfinite(low):
                found.append(scalar_block(f"{name} {axis} >= {low:g} m", "kg m", places, (1.0, -low), 0.0))
            if math.isfinite(high):
                found.append(scalar_block(f"{name} {axis} <= {high:g} m", "kg m", places, (-1.0, high), 0.0))
        return tuple(found)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Return one equation for each coordinate that is known exactly."""
        link = LinkParameters.of(model, self.link, "CenterOfMassBox")
        exact = [k for k in range(3) if self.lower[k] == self.upper[k]]
        return tuple(_coordinate(link, k, self.lower[k]) for k in exact)


@dataclass(frozen=True)
class CenterOfMassSphere:
    """Keeps the centre of mass of a link within a sphere.

    Parameters
    ----------
    link : str
    center : (3,)
        In metres, in the link frame.
    radius : float
        In metres; 0 if the centre of mass is known exactly.

    Raises
    ------
    InputError
        If a value is not a number, or the radius is negative.

    Notes
    -----
    |l - m c| ≤ m r is the 4 x 4 block [[m r 1, l - m c], [(l - m c)ᵀ, m r]] ⪰ 0, by its Schur complement.

    Examples
    --------
    >>> CenterOfMassSphere("forearm", center=(0, 0, 0.2), radius=0.05)
    CenterOfMassSphere(link='forearm', center=(0.0, 0.0, 0.2), radius=0.05)
    """

    link: str
    center: Sequence[float]
    radius: float

    def __post_init__(self) -> None:
        where = f"of CenterOfMassSphere of link {self.link!r}"
        object.__setattr__(self, "center", read_vector(self.center, f"center {where}", "m"))
        object.__setattr__(self, "radius", read_quantity(self.radius, f"radius {where}", "m", nonnegative=True))

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return one block of order 4, in kg m."""
        link = LinkParameters.of(model, self.link, "CenterOfMassSphere")
        if self.radius == 0:
            return ()
        coefficients = np.zeros((4, 4, 4))
        for k in range(3):
            coefficients[k, k, 3] = coefficients[k, 3, k] = 1.0
        coefficients[3] = self.radius * np.eye(4)
        coefficients[3, :3, 3] = coefficients[3, 3, :3] = -np.asarray(self.center)
        name = f"{link.title}: centre of mass within sphere"
        return (AffineBlock(name, np.zeros((4, 4)), link.indices[6:], coefficients + 0.0, "constraint", "kg m"),)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Three equations if the radius is 0."""
        link = LinkParameters.of(model, self.link, "CenterOfMassSphere")
        return tuple(_coordinate(link, k, self.center[k]) for k in range(3)) if self.radius == 0 else ()


def _coordinate(link: LinkParameters, axis: int, value: float) -> Equality:
    """The equation that sets a coordinate of the centre of mass: l - m value = 0."""
    places = (int(link.indices[6 + axis]), link.mass)
    return equation(f"{link.title}: centre of mass {'xyz'[axis]} = {value:g} m", link.model, places, (1.0, -value))


_FLAT = 1e-6
"""Extents below this fraction of the largest one count as zero: mesh files hold numbers in single precision."""

_POINT = 1e-12
"""Points that extend over less than this, in m, count as one."""

_PARALLEL, _SAME = 1e-7, 1e-9
"""Facets whose normals differ by less than the first, and offsets by less than the second of the extent, are one."""

_BEYOND = 1e15
"""Coordinates beyond this, in the unit of the file, are refused."""

_FARTHEST = 1e9
"""Points beyond this, in m, are refused."""

_LARGEST = 50.0
"""A mesh without a given scale is refused if it extends over more than this, in m: it is probably in millimetres."""


@dataclass(frozen=True)
class CenterOfMassHull:
    """Keeps the centre of mass of a link within the convex hull of points, such as the vertices of its mesh.

    The centre of mass lies in the convex hull of the link's shape, however the mass is distributed.

    Parameters
    ----------
    link : str
    points : (k, 3)
        In metres, in the link frame; only the vertices of the hull are kept. Points in a plane, points on a line, or a
        single point restrict the centre of mass to that plane, line or point.
    tolerance : float
        Distance, in metres, by which the hull may extend beyond the points so that it has fewer facets; 0 for the exact
        hull.

    Raises
    ------
    InputError
        If there are no points, or they are not rows of three finite numbers.

    See Also
    --------
    CenterOfMassHull.from_mesh : From a mesh file.

    Notes
    -----
    For each facet n · r ≤ d there is one 1 x 1 block m d - n · l ≥ 0, in kg m, and for each plane n · r = d that all
    points lie in, the equation n · l - m d = 0. The triangles of a plane facet count once.

    Examples
    --------
    >>> CenterOfMassHull("forearm", [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.4), (0.01, 0.01, 0.1)])
    CenterOfMassHull('forearm', 4 vertices, 4 facets)
    """

    link: str
    points: npt.ArrayLike = field(repr=False)
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        where = f"CenterOfMassHull of link {self.link!r}"
        try:
            points = np.asarray(self.points, dtype=float)
        except (TypeError, ValueError):
            points = np.zeros(0)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise InputError(f"{where} must have points as rows of three numbers (m), got the shape {points.shape}.")
        bad = ~(np.abs(points) <= _FARTHEST)
        if bad.any():
            raise InputError(f"{where} has a point that is not finite, or beyond {_FARTHEST:g} m: {points[bad][0]}.")
        tolerance = read_quantity(self.tolerance, f"tolerance of {where}", "m", nonnegative=True)
        object.__setattr__(self, "tolerance", tolerance)
        object.__setattr__(self, "points", tuple(map(tuple, convex_hull(points).vertices.tolist())))

    def __repr__(self) -> str:
        tolerance = f", tolerance={self.tolerance:g}" if self.tolerance else ""
        hull = self.hull
        return f"CenterOfMassHull({self.link!r}, {len(hull.vertices)} vertices, {len(hull.normals)} facets{tolerance})"

    @classmethod
    def from_mesh(
        cls,
        link: str,
        path: str | Path,
        scale: float | None = None,
        placement: Any = None,
        tolerance: float = 0.0,
    ) -> CenterOfMassHull:
        """Build the constraint from the vertices of a mesh, or from a file of points.

        Parameters
        ----------
        link : str
        path : str or Path
            STL, OBJ and whatever else trimesh reads (extra ``meshes``); ``.npy``, ``.csv``, ``.txt`` or ``.xyz`` with
            points.
        scale : float, optional
            Metres per unit of the file, such as 0.001; 1 by default.
        placement : (4, 4), or mapping with xyz and rpy, optional
            Of the mesh in the link frame (m and rad), as URDF's ``<origin>``; applied after the scale.
        tolerance : float
            See the class.

        Raises
        ------
        InputError
            If the file cannot be used, or seems to be in millimetres.
        MissingExtraError
            If the file is a mesh and trimesh is absent.
        """
        points = read_points(path)
        extent = float(np.ptp(points, axis=0).max())
        if scale is None and extent > _LARGEST:
            raise InputError(
                f"{path}: its points extend over {extent:g} m; give scale=0.001 where the file is in millimetres, or "
                "scale=1 where it is in metres."
            )
        if scale is not None:
            points = points * read_quantity(scale, f"{path}: scale", "m per unit", positive=True)
        if placement is not None:
            matrix = np.asarray(read_placement(placement, f"{path}: placement"))
            points = points @ matrix[:3, :3].T + matrix[:3, 3]
        return cls(link, points, tolerance)

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], folder: Path | None = None) -> CenterOfMassHull:
        """Read ``{"link": "link1", "mesh": "link1.stl", "scale": 0.001}``, or with ``points``, as in ``robot.toml``."""
        optional = ("points", "mesh", "scale", "placement", "tolerance")
        given = table(entry, "center_of_mass_hull", ("link",), optional)
        if ("points" in given) == ("mesh" in given):
            raise InputError(
                "[[constraints.center_of_mass_hull]] takes either points or mesh; give exactly one of them."
            )
        if "points" in given:
            for key in ("scale", "placement"):
                if key in given:
                    raise InputError(f"[[constraints.center_of_mass_hull]] takes {key} with a mesh only; remove it.")
            return cls(**given)
        path = Path(folder or ".") / (given.text("mesh", "a path") or "")
        return cls.from_mesh(path=path, **{key: value for key, value in given.items() if key != "mesh"})

    @cached_property
    def hull(self) -> ConvexHullForm:
        """Vertices, half-spaces and planes."""
        return convex_hull(np.asarray(self.points, dtype=float), self.tolerance)

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Return one 1 x 1 block, in kg m, for each facet."""
        link = LinkParameters.of(model, self.link, "CenterOfMassHull")
        within = f"{link.title}: centre of mass within hull"
        found = []
        for number, (normal, offset) in enumerate(zip(self.hull.normals, self.hull.offsets, strict=True), start=1):
            row = np.concatenate([np.zeros(6), -normal, [offset]])
            towards = ", ".join(f"{value:.2g}" for value in normal + 0.0)
            name = f"{within}, facet {number} towards ({towards})"
            found.append(link.row_block(name, "kg m", row))
        return tuple(found)

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """The planes that a flat hull lies in."""
        link = LinkParameters.of(model, self.link, "CenterOfMassHull")
        what = f"{link.title}: centre of mass within flat hull"
        rows = [
            np.concatenate([np.zeros(6), normal, [-value]])
            for normal, value in zip(self.hull.plane_normals, self.hull.plane_values, strict=True)
        ]
        return tuple(equation(what, model, link.indices, row) for row in rows)


@dataclass(frozen=True, eq=False)
class ConvexHullForm:
    """A convex hull as half-spaces normal · r ≤ offset and hyperplanes normal · r = value.

    Attributes
    ----------
    vertices : (k, 3)
    normals : (f, 3)
        Of length 1, outwards.
    offsets : (f,)
    plane_normals : (3 - d, 3)
        Of length 1; d is the dimension of the hull.
    plane_values : (3 - d,)
    """

    vertices: Matrix
    normals: Matrix
    offsets: Vector
    plane_normals: Matrix
    plane_values: Vector


def convex_hull(points: Matrix, tolerance: float = 0.0) -> ConvexHullForm:
    """The convex hull of points.

    Parameters
    ----------
    points : (k, 3)
    tolerance : float
        Distance by which the hull may extend beyond the points so that it has fewer facets.

    Returns
    -------
    ConvexHullForm
        All points satisfy its inequalities.

    Examples
    --------
    >>> corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 2)], dtype=float)
    >>> hull = convex_hull(corners)
    >>> len(hull.vertices), len(hull.normals), len(hull.plane_values)
    (8, 6, 0)
    """
    center = points.mean(axis=0)
    axes, extents = _axes(points - center)
    local = (points - center) @ axes.T
    dimension = int(np.sum(extents > max(_FLAT * extents[0], _POINT)))
    flat = axes[dimension:]
    if dimension == 0:
        normals, offsets, vertices = np.zeros((0, 3)), np.zeros(0), points[:1]
    else:
        # Scaled to extents of 1, so that thin bodies are as accurate as others.
        scaled = local[:, :dimension] / extents[:dimension]
        kept = np.arange(len(points))
        if dimension == 1:
            directions = np.array([[1.0], [-1.0]])
            kept = np.array([int(np.argmin(scaled[:, 0])), int(np.argmax(scaled[:, 0]))])
        else:
            from scipy.spatial import ConvexHull

            hull = ConvexHull(scaled)
            kept, directions = np.asarray(hull.vertices), np.asarray(hull.equations)[:, :dimension]
        normals = (directions / extents[:dimension]) @ axes[:dimension]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        vertices = points[np.sort(kept)]
        normals, offsets = _merged(normals, vertices, float(extents[0]))
        if tolerance > 0 and dimension == 3:
            normals, offsets = _fewer(normals, offsets, vertices, tolerance)
    return ConvexHullForm(vertices, normals, offsets, flat, flat @ vertices.mean(axis=0))


def _axes(centered: Matrix) -> tuple[Matrix, Vector]:
    """Orthogonal axes (3, 3) in the order of falling extents, and the extents.

    They are those of the frame if the points are as flat along these as along their principal axes.
    """
    factor = np.zeros((3, 3))
    triangle = np.linalg.qr(centered, mode="r")
    factor[: len(triangle)] = triangle
    found = []
    for axes in (np.eye(3), np.linalg.svd(factor)[2]):
        extents = np.ptp(centered @ axes.T, axis=0)
        order = np.argsort(-extents, kind="stable")
        found.append((axes[order], extents[order]))
    (frame, along), (principal, across) = found
    same = np.sum(along > _FLAT * along[0]) == np.sum(across > _FLAT * across[0])
    return (frame, along) if same else (principal, across)


def _merged(normals: Matrix, vertices: Matrix, extent: float) -> tuple[Matrix, Vector]:
    """One half-space for all triangles of a facet, touching the outermost point."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    normals = np.where(np.abs(normals) < 1e-14, 0.0, normals)
    _, first = np.unique(normals.round(9), axis=0, return_index=True)
    normals = normals[first]
    offsets = (normals @ vertices.T).max(axis=1)
    pairs = KDTree(normals).query_pairs(_PARALLEL, output_type="ndarray")
    apart = np.abs(offsets[pairs[:, 0]] - offsets[pairs[:, 1]]) > _SAME * extent
    linked = coo_array((np.ones(int((~apart).sum())), pairs[~apart].T), shape=(len(normals),) * 2)
    _, label = connected_components(linked, directed=False)
    kept = np.unique(label, return_index=True)[1]
    return normals[kept], offsets[kept]


def _fewer(normals: Matrix, offsets: Vector, vertices: Matrix, tolerance: float) -> tuple[Matrix, Vector]:
    """Some of the half-spaces, and a box, whose intersection extends beyond the hull by at most the tolerance.

    Half-spaces are added that the corners of the intersection violate most, until no corner is beyond the tolerance.
    """
    from scipy.spatial import HalfspaceIntersection

    inside = vertices.mean(axis=0)
    box = np.vstack([np.eye(3), -np.eye(3)])
    chosen, limits = box, (box @ vertices.T).max(axis=1)
    region = HalfspaceIntersection(np.column_stack([chosen, -limits]), inside, incremental=True)
    for _ in range(len(normals)):
        beyond = normals @ np.asarray(region.intersections).T - offsets[:, None]
        furthest = beyond.max(axis=0)
        if furthest.max() <= tolerance:
            break
        added = np.unique(beyond.argmax(axis=0)[furthest > max(tolerance, 0.5 * furthest.max())])
        region.add_halfspaces(np.column_stack([normals[added], -offsets[added]]))
        chosen, limits = np.vstack([chosen, normals[added]]), np.append(limits, offsets[added])
    region.close()
    if len(limits) >= len(offsets):
        return normals, offsets
    return chosen, limits


def read_points(path: str | Path) -> Matrix:
    """The vertices of a mesh, or the points of an array, (k, 3).

    Parameters
    ----------
    path : str or Path
        ``.npy`` (k, 3); ``.csv``, ``.txt`` or ``.xyz`` with three columns, a line of column names or ``#`` comments
        allowed; or a mesh that coal or trimesh reads, such as ``.stl``, ``.obj``, ``.ply`` or ``.glb``.

    Raises
    ------
    InputError
        If the file cannot be read or holds no points.
    MissingExtraError
        For a mesh, without coal and trimesh.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "corners.csv"
    ...     _ = path.write_text("x,y,z\\n0,0,0\\n0.1,0,0\\n")
    ...     read_points(path).tolist()
    [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]
    """
    path = Path(path)
    require_file(path, "give the path of a mesh, or of a file of points")
    points = _READERS.get(path.suffix.lower(), _mesh)(path)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{path}: holds an array of shape {points.shape}; points are rows of x, y and z.")
    bad = ~(np.abs(points) <= _BEYOND)
    if bad.any():
        row = int(np.argwhere(bad)[0, 0]) + 1
        raise InputError(f"{path}: row {row} is not finite, or beyond {_BEYOND:g}; remove it.")
    return points


def _array(path: Path) -> Matrix:
    from steelyard.files.arrays import read_array

    content = read_bytes(path, remedy="give an array of NumPy")
    try:
        values = read_array(BytesIO(content), len(content))
        return np.asarray(values, dtype=float)
    except (ValueError, TypeError):
        raise InputError(f"{path}: is no array of numbers in NumPy's format; write it with numpy.save.") from None


def _columns(path: Path) -> Matrix:
    lines = read_text(path, remedy="write rows of x, y and z").splitlines()
    rows: list[list[float]] = []
    heading = False
    for number, line in enumerate(lines, start=1):
        cells = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not cells:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            if not rows and not heading:
                heading = True
                continue
            raise InputError(f"{path}: line {number} is {shown(line.strip())}; write numbers x, y and z.") from None
        if len(row) != 3:
            raise InputError(f"{path}: line {number} has {len(row)} numbers; write x, y and z.")
        rows.append(row)
    if not rows:
        raise InputError(f"{path}: holds no points; write rows of x, y and z.")
    return np.array(rows)


def _mesh(path: Path) -> Matrix:
    return collision.read_mesh(path)[0]


_READERS = {".npy": _array, ".csv": _columns, ".txt": _columns, ".xyz": _columns}
