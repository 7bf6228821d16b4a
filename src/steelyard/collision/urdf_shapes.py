"""The `<collision>` elements of a URDF as shapes on the links of a robot."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot
from steelyard.robot.names import suggestion
from steelyard.robot.urdf_document import UrdfReader, parse_urdf

from .mesh_files import MeshArrays, find_mesh, read_meshes
from .robot_geometry import MeshKind, PlacedShape
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["shapes_from_urdf"]

Array = NDArray[np.float64]

KINDS = ("box", "sphere", "cylinder", "capsule", "mesh")


def shapes_from_urdf(
    robot: Robot,
    path: Path,
    meshes: MeshKind,
    packages: Sequence[str | Path],
    skipped: list[tuple[str, str]] | None = None,
) -> tuple[list[PlacedShape], dict[str, str]]:
    """Return the shapes of the collision elements, and for each link its parent; see `RobotGeometry.from_urdf`.

    Elements that cannot be read are left out and added to `skipped`, by link and reason, where this is given.
    """
    root = parse_urdf(path)
    reader = _ShapeReader(path, meshes, packages)
    document = reader.document(root)
    reader.read_files(root)
    shapes: list[PlacedShape] = []
    for element in reader.children(root, "link"):
        link = element.get("name", "")
        try:
            robot.frame(link)
        except InputError:
            continue
        for collision in reader.children(element, "collision"):
            try:
                shape, placement = reader.collision(collision, f'link "{link}"')
            except InputError as error:
                if skipped is None:
                    raise
                skipped.append((link, str(error)))
                continue
            shapes.append(PlacedShape.on(robot, link, shape, placement))
    return shapes, {joint.child: joint.parent for joint in document.joints.values()}


class _ShapeReader(UrdfReader):
    def __init__(self, path: Path, meshes: MeshKind, packages: Sequence[str | Path]) -> None:
        super().__init__(path)
        self.meshes = meshes
        self.packages = packages
        self.files: dict[Path, MeshArrays | InputError] = {}

    def read_files(self, root: etree._Element) -> None:
        """Read all the meshes at once, which takes one other process; what is wrong is said where it is needed."""
        found = []
        for element in root.iterfind(f".//{self.namespace}collision//{self.namespace}mesh"):
            with contextlib.suppress(InputError):
                found.append(find_mesh(element.get("filename", ""), self.path, self.packages))
        self.files = read_meshes(found)

    def collision(self, element: etree._Element, owner: str) -> tuple[Shape, Array]:
        geometry = self.only(element, "geometry", f"{owner}, <collision>")
        if geometry is None:
            raise self.error(element, f"{owner}: a <collision> has no <geometry>; add one or remove the element")
        found = [child for child in geometry if isinstance(child.tag, str)]
        if len(found) != 1:
            raise self.error(geometry, f"{owner}: a <geometry> holds one shape, found {len(found)}; keep one")
        try:
            shape = self.shape(found[0], owner)
        except InputError as error:
            text = str(error)
            raise (error if text.startswith(str(self.path)) else self.error(found[0], f"{owner}: {text}")) from None
        return shape, self.origin(element, owner)

    def shape(self, element: etree._Element, owner: str) -> Shape:
        kind = self.tag(element)
        match kind:
            case "sphere":
                return Sphere(self.number(element, "radius", owner))
            case "cylinder" | "capsule":
                made = Cylinder if kind == "cylinder" else Capsule
                return made(self.number(element, "radius", owner), self.number(element, "length", owner))
            case "box":
                x, y, z = self.numbers(element, "size", self.text(element, "size", owner), owner, 3)
                return Box((x, y, z))
            case "mesh":
                return self.mesh(element, owner)
        raise InputError(f"<{kind}> is no shape that is read; {suggestion(kind, KINDS)}")

    def mesh(self, element: etree._Element, owner: str) -> Mesh:
        file = find_mesh(self.text(element, "filename", owner), self.path, self.packages)
        scale = np.array(self.vector(element, "scale", owner, (1.0, 1.0, 1.0)))
        if not scale.all():
            raise InputError(f"the scale of a mesh must not be 0, got {element.get('scale')!r}")
        read = self.files[file]
        if isinstance(read, InputError):
            raise read
        vertices, triangles = read
        try:
            return Mesh(vertices * scale, triangles, exact=self.meshes == "exact")
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
