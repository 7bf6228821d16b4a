"""The centre of mass within the convex hull of points or of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.lmi import AffineBlock

from ..protocols import ModelLike
from .convex_hull import ConvexHullForm, convex_hull
from .entries import read_number, read_placement, table
from .links import LinkParameters, equation
from .points import read_points
from .protocol import Equality

__all__ = ["CenterOfMassHull"]

_FARTHEST = 1e9  # m
_LARGEST = 50.0
"""Extent, in m, from which a mesh without a scale is taken to be in other units."""


@dataclass(frozen=True)
class CenterOfMassHull:
    """The centre of mass of a link within the convex hull of points, such as the vertices of its mesh.

    Wherever the material is, the centre of mass is in the convex hull of the link's shape.

    Parameters
    ----------
    link : str
    points : (k, 3)
        In metres, in the link frame. Of those given only the vertices of the hull are kept. Points in a plane, on a
        line, or one point alone, bind the centre of mass to that plane, line or point.
    tolerance : float
        How far, in metres, the hull may reach beyond the points, so that fewer facets do; 0 for the hull itself.

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
        tolerance = read_number(self.tolerance, f"tolerance of {where}", "m")
        if tolerance < 0:
            raise InputError(f"tolerance of {where} must be at least 0 m, got {tolerance:g}.")
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
        """From the vertices of a mesh, or a file of points.

        Parameters
        ----------
        link : str
        path : str or Path
            STL, OBJ and whatever else trimesh reads (extra ``meshes``); ``.npy``, ``.csv``, ``.txt`` or ``.xyz`` with
            points.
        scale : float, optional
            Metres in a unit of the file, such as 0.001; 1 where absent.
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
            points = points * read_number(scale, f"{path}: scale", "m per unit", positive=True)
        if placement is not None:
            matrix = np.asarray(read_placement(placement, f"{path}: placement"))
            points = points @ matrix[:3, :3].T + matrix[:3, 3]
        return cls(link, points, tolerance)

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], folder: Path | None = None) -> CenterOfMassHull:
        """From ``{"link": "link1", "mesh": "link1.stl", "scale": 0.001}``, or with ``points``, as in ``robot.toml``."""
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
        mesh = given.pop("mesh")
        if not isinstance(mesh, str) or not mesh:
            raise InputError(f"[[constraints.center_of_mass_hull]] must have a path as mesh, got {mesh!r}.")
        return cls.from_mesh(path=Path(folder or ".") / mesh, **given)

    @cached_property
    def hull(self) -> ConvexHullForm:
        """Vertices, half-spaces and planes."""
        return convex_hull(np.asarray(self.points, dtype=float), self.tolerance)

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """One 1 x 1 block, in kg m, for each facet."""
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
