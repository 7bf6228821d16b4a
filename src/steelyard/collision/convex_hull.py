"""Convex hulls of points as closed surfaces of triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["convex_hull", "most_neighbours"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

FLAT = 1e-9  # of the length of a body
SMALLEST = 1e-9  # m, length of a body


def convex_hull(vertices: Array) -> tuple[Array, Indices]:
    """Return corners (k, 3) and outward triangles (t, 3) of the convex hull of points.

    A flat body is its polygon, seen from both sides. Faces of many corners are cut into strips, so that no corner has
    many more neighbours than it needs.

    Raises
    ------
    InputError
        When the points span no surface.

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
    # Triangles of one face have the very same plane.
    face = np.unique(hull.equations, axis=0, return_inverse=True)[1].ravel()
    return corners, _in_strips(triangles, face)


def most_neighbours(triangles: Indices) -> int:
    """Return the largest number of neighbours that a corner of a closed surface has."""
    return int(np.bincount(triangles.ravel()).max())


def _in_strips(triangles: Indices, face: Indices) -> Indices:
    """Cut the faces of more than two triangles anew: strips in place of fans about one corner."""
    order = np.argsort(face, kind="stable")
    groups = np.split(triangles[order], np.flatnonzero(np.diff(face[order])) + 1)
    result: list[Indices] = []
    for group in groups:
        loop = _boundary(group) if len(group) > 2 else None
        result.append(group if loop is None else np.array(_strip(loop), dtype=np.intp))
    return np.vstack(result)


def _boundary(triangles: Indices) -> list[int] | None:
    """Return the corners around some triangles of one face, in their order; None where these are no simple polygon."""
    edges = {(one, other) for t in triangles.tolist() for one, other in zip(t, t[1:] + t[:1], strict=True)}
    following = {one: other for one, other in edges if (other, one) not in edges}
    if len(following) != len(triangles) + 2:
        return None
    loop = [next(iter(following))]
    while len(loop) < len(following) and following[loop[-1]] != loop[0]:
        loop.append(following[loop[-1]])
    return loop if len(loop) == len(following) else None


def _strip(loop: list[int]) -> list[tuple[int, int, int]]:
    """Cut a convex polygon into triangles between its two sides, in turn."""
    triangles = []
    low, high = 0, len(loop) - 1
    while high - low > 1:
        triangles.append((loop[low], loop[low + 1], loop[high]))
        low += 1
        if high - low > 1:
            triangles.append((loop[low], loop[high - 1], loop[high]))
            high -= 1
    return triangles
