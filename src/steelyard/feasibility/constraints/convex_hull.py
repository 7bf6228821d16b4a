"""Convex hulls of points as half-spaces and hyperplanes, also where they are flat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["ConvexHullForm", "convex_hull"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

_FLAT = 1e-6
_POINT = 1e-12  # m; what extends over less is a point
"""Extents below this fraction of the largest one count as none: what is left of single precision in mesh files."""

_PARALLEL, _SAME = 1e-7, 1e-9
"""Facets whose normals differ by less than the first, and offsets by less than the second of the extent, are one."""


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

    @property
    def dimension(self) -> int:
        """3 for a body, 2 where all points lie in a plane, 1 on a line, 0 where there is one point."""
        return 3 - len(self.plane_values)


def convex_hull(points: Matrix, tolerance: float = 0.0) -> ConvexHullForm:
    """The convex hull of points.

    Parameters
    ----------
    points : (k, 3)
    tolerance : float
        How far the hull may reach beyond the points so that fewer facets do.

    Returns
    -------
    ConvexHullForm
        All points satisfy its inequalities.

    Examples
    --------
    >>> corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 2)], dtype=float)
    >>> hull = convex_hull(corners)
    >>> len(hull.vertices), len(hull.normals), hull.dimension
    (8, 6, 3)
    """
    center = points.mean(axis=0)
    axes, extents = _axes(points - center)
    local = (points - center) @ axes.T
    dimension = int(np.sum(extents > max(_FLAT * extents[0], _POINT)))
    flat = axes[dimension:]
    if dimension == 0:
        normals, offsets, vertices = np.zeros((0, 3)), np.zeros(0), points[:1]
    else:
        # In units of the extents, so that thin bodies are no harder than others.
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
    """Orthogonal axes (3, 3) by falling extent, and the extents: those of the frame, where they show what is flat."""
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
    """Some of the half-spaces, and a box, whose intersection reaches beyond the hull by at most the tolerance.

    The half-spaces that the outermost corners of the intersection violate are added until none is violated by more.
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
