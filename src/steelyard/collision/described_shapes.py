"""Reading of shapes, shared by all formats of descriptions: elements with a shape, and meshes from files."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard import collision  # meshes are read by what is imported when there are any
from steelyard.errors import InputError

from .shapes import Mesh, Shape

if TYPE_CHECKING:
    from steelyard.robot.described_tree import DescribedTree

    from .mesh_files import MeshArrays

__all__ = ["ELEMENTS", "DescribedShapes", "GeometryElement", "MeshKind", "MeshShapes", "ShapeElement", "ellipsoid"]

Array = NDArray[np.float64]
MeshKind = Literal["hull", "exact"]
GeometryElement = Literal["collision", "visual"]
ELEMENTS: tuple[GeometryElement, ...] = ("collision", "visual")

ROUND = 24
"""Corners around the equator of the polyhedron that stands for an ellipsoid; they lie 1.7 % beyond it."""


@dataclass(frozen=True)
class ShapeElement:
    """An element of a description that holds a shape.

    Parameters
    ----------
    kind : {"collision", "visual"}
    link : str
        The link that it stands on.
    make : callable
        Returns the shape, and its placement (4, 4) in the frame of the link.
    mesh : tuple of str and Path, or None
        The file that it needs, as the description names it, and the file of the description that does so.
    """

    kind: GeometryElement
    link: str
    make: Callable[[], tuple[Shape, Array]]
    mesh: tuple[str, Path] | None = None


DescribedShapes = tuple[list[ShapeElement], Callable[[], "DescribedTree"]]
"""The elements of a description with shapes, and what returns its tree: MuJoCo may have to compile a file for that."""


class MeshShapes:
    """The meshes of a description, each read once.

    Parameters
    ----------
    path : Path
        Of the description.
    meshes : {"hull", "exact"}
        Whether meshes are replaced by their convex hulls.
    packages : sequence of path
    largest : int, optional
        Bytes above which a file is not read.
    """

    def __init__(
        self, path: Path, meshes: MeshKind, packages: Sequence[str | Path], largest: int | None = None
    ) -> None:
        self.path = path
        self.exact = meshes == "exact"
        self.packages = packages
        self.largest = largest
        self.files: dict[Path, MeshArrays | InputError] = {}
        self.made: dict[tuple[Path, bytes], Mesh] = {}

    def read_files(self, named: Iterable[tuple[str, Path] | None]) -> None:
        """Read all meshes at once, in one other process; errors are raised where a mesh is used."""
        found = []
        for one in named:
            if one is not None:
                with contextlib.suppress(InputError):
                    found.append(collision.find_mesh(*one, self.packages))
        self.files = collision.read_meshes(found, self.largest) if found else {}

    def mesh(self, reference: str, affine: Array, description: Path | None = None) -> Mesh:
        """Return the mesh of a file.

        Parameters
        ----------
        reference : str
            As the description names the file.
        affine : (4, 4)
            From the numbers of the file to those of the mesh.
        description : Path, optional
            The file that names it; by default the description.
        """
        file = collision.find_mesh(reference, self.path if description is None else description, self.packages)
        key = (file, affine.tobytes())
        if key not in self.made:
            read = self.files[file]
            if isinstance(read, InputError):
                raise read
            vertices, triangles = read
            try:
                self.made[key] = Mesh(vertices @ affine[:3, :3].T + affine[:3, 3], triangles, exact=self.exact)
            except InputError as error:
                raise InputError(f"{file}: {error}") from None
        return self.made[key]


def ellipsoid(x: float, y: float, z: float) -> Mesh:
    """Return a polyhedron that contains an ellipsoid with these half axes, m, and little more.

    Raises
    ------
    InputError
        If a half axis is not positive.
    """
    if min(x, y, z) <= 0.0:
        raise InputError(f"an ellipsoid: its half axes must be positive, got {x:g} {y:g} {z:g}")
    step = np.pi / ROUND
    # Corners of a ball whose faces lie outside the ball of radius 1, at angles of at most `step` from their middle.
    radius = 1.0 / np.cos(step) ** 2
    around, along = np.meshgrid(2.0 * step * np.arange(ROUND), 2.0 * step * np.arange(1, ROUND // 2))
    ball = np.column_stack(
        [(np.sin(along) * np.cos(around)).ravel(), (np.sin(along) * np.sin(around)).ravel(), np.cos(along).ravel()]
    )
    poles = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    return Mesh(radius * np.vstack([ball, poles]) * np.array([x, y, z]))
