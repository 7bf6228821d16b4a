"""The shapes of an SDF."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import suggestion
from steelyard.robot.sdf_document import SdfFrame, SdfReader

from .described_shapes import ELEMENTS, DescribedShapes, MeshShapes, ShapeElement, ellipsoid
from .shapes import Box, Capsule, Cylinder, Shape, Sphere

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["sdf_shapes"]

Array = NDArray[np.float64]
KINDS = ("box", "sphere", "ellipsoid", "cylinder", "capsule", "mesh")
WITHOUT_BODY = ("plane", "heightmap", "empty")


def sdf_shapes(path: Path, read: MeshShapes) -> DescribedShapes:
    """Return the elements with shapes of an SDF, and its tree."""
    shapes = _SdfShapes(path, read)
    tree = shapes.reader.tree()
    return shapes.elements(), lambda: tree


class _SdfShapes:
    def __init__(self, path: Path, read: MeshShapes) -> None:
        self.reader, self.read = SdfReader(path), read

    def elements(self) -> list[ShapeElement]:
        found = []
        for frame in self.reader.links:
            assert frame.element is not None
            for kind in ELEMENTS:
                for child in self.reader.children(frame.element, kind):
                    geometry = self.reader.only(child, "geometry", f'link "{frame.name}", <{kind}>')
                    held = [] if geometry is None else [one for one in geometry if isinstance(one.tag, str)]
                    if len(held) == 1 and self.reader.tag(held[0]) in WITHOUT_BODY:
                        continue
                    mesh = held[0] if len(held) == 1 and self.reader.tag(held[0]) == "mesh" else None
                    named = None if mesh is None else (self.text(mesh, "uri"), self.reader.file(mesh))
                    found.append(ShapeElement(kind, frame.name, partial(self.placed, frame, child, held), named))
        return found

    def placed(self, frame: SdfFrame, element: etree._Element, held: list[etree._Element]) -> tuple[Shape, Array]:
        """Return the shape of an element, and its placement (4, 4) in the frame of the link."""
        owner = f'link "{frame.name}"'
        if len(held) != 1:
            raise self.reader.error(
                element, f"{owner}: a <{self.reader.tag(element)}> has {len(held)} shapes in its <geometry>; keep one"
            )
        placement, relative = self.reader.pose(element, owner)
        if relative is not None:
            placement = self.reader.between(frame, frame.scope.find(relative, element)) @ placement
        try:
            return self.shape(held[0], owner), placement
        except InputError as error:
            text = str(error)
            located = text.startswith(str(self.reader.file(element)))
            raise (error if located else self.reader.error(held[0], f"{owner}: {text}")) from None

    def shape(self, element: etree._Element, owner: str) -> Shape:
        kind, number = self.reader.tag(element), partial(self.reader.value, element, owner=owner, default=1.0)
        match kind:
            case "sphere":
                return Sphere(number("radius"))
            case "cylinder":
                return Cylinder(number("radius"), number("length"))
            case "capsule":
                return Capsule(number("radius", default=0.5), number("length"))
            case "box":
                x, y, z = self.vector(element, "size", owner)
                return Box((x, y, z))
            case "ellipsoid":
                return ellipsoid(*self.vector(element, "radii", owner))
            case "mesh":
                if self.reader.children(element, "submesh"):
                    raise InputError(
                        "one part of a mesh (<submesh>) cannot be read; name a file that holds this part alone"
                    )
                scale = np.diag([*self.vector(element, "scale", owner), 1.0])
                return self.read.mesh(self.text(element, "uri"), scale, self.reader.file(element))
        raise InputError(f"<{kind}> cannot be read as a shape; {suggestion(kind, KINDS)}")

    def vector(self, element: etree._Element, key: str, owner: str) -> tuple[float, ...]:
        """Return the three numbers of a child; 1 each where there is none, as the format says."""
        child = self.reader.only(element, key, owner)
        return (1.0, 1.0, 1.0) if child is None else self.reader.words(child, owner, 3)

    def text(self, element: etree._Element, key: str) -> str:
        child = self.reader.only(element, key, "a mesh")
        return "" if child is None else (child.text or "").strip()
