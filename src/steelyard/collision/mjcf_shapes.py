"""The shapes of an MJCF: its geoms."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.robot.mjcf_document import MjcfDocument, MjcfElement, asset_name, read_mjcf_document
from steelyard.robot.mjcf_reading import FEATHERLESS, BeyondReadingError, MjcfReader
from steelyard.robot.mjcf_tree import mjcf_tree
from steelyard.robot.placement import inverse

from .described_shapes import DescribedShapes, MeshShapes, ShapeElement, ellipsoid
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

__all__ = ["mjcf_shapes"]

Array = NDArray[np.float64]
Attributes = Mapping[str, str]


def mjcf_shapes(path: Path, read: MeshShapes) -> DescribedShapes:
    """Return the geoms of an MJCF, and its tree.

    A geom collides where its ``contype`` or ``conaffinity`` says that it can; others are seen alone.
    """
    document = read_mjcf_document(path)
    try:
        elements = _Geoms(document, read).elements()
    except BeyondReadingError as reason:
        raise InputError(f"{reason} hides which shapes the links have; save the model as MuJoCo compiles it") from None
    return elements, lambda: mjcf_tree(document).tree


class _Geoms:
    def __init__(self, document: MjcfDocument, read: MeshShapes) -> None:
        self.document, self.reader, self.read = document, MjcfReader(document), read
        self.assets: dict[str, tuple[MjcfElement, Attributes]] = {}
        for one in (mesh for section in self.document.root.all("asset") for mesh in section.all("mesh")):
            attributes = self.reader.classes.attributes(one)
            self.assets[asset_name(attributes)] = one, attributes

    def elements(self) -> list[ShapeElement]:
        found = []
        for link, geom, attributes, frame in self.reader.geoms():
            if attributes.get("type", "sphere") in FEATHERLESS:
                continue
            collides = any(attributes.get(key, "1") != "0" for key in ("contype", "conaffinity"))
            make = partial(self.placed, geom, attributes, frame)
            found.append(ShapeElement("collision" if collides else "visual", link, make, self.named(attributes)))
        return found

    def named(self, attributes: Attributes) -> tuple[str, Path] | None:
        """Return the file of the mesh of a geom."""
        _, mesh = self.assets.get(attributes.get("mesh", ""), (None, {}))
        return (self.document.mesh_file(mesh), self.read.path) if "file" in mesh else None

    def placed(self, geom: MjcfElement, attributes: Attributes, frame: Array) -> tuple[Shape, Array]:
        """Return the shape of a geom, and its placement (4, 4) in the frame of the link."""
        kind = attributes.get("type", "sphere")
        try:
            if kind == "mesh":
                return self.mesh(attributes), frame @ self.reader.placement(geom, attributes)
            if "mesh" in attributes:
                raise InputError(f"the shape of a {kind} that is fitted to a mesh cannot be read; give its size")
            (x, y, z), placement = self.reader.sized(geom, attributes)
            return self.shape(kind, x, y, z), frame @ placement
        except BeyondReadingError as reason:
            raise InputError(f"{reason}, which cannot be read as a shape") from None
        except InputError as error:
            text = str(error)
            raise (error if text.startswith(str(geom.file.path)) else InputError(f"{geom.where}: {text}")) from None

    def shape(self, kind: str, x: float, y: float, z: float) -> Shape:
        match kind:
            case "sphere":
                return Sphere(x)
            case "capsule":
                return Capsule(x, 2.0 * y)
            case "cylinder":
                return Cylinder(x, 2.0 * y)
            case "box":
                return Box((2.0 * x, 2.0 * y, 2.0 * z))
            case "ellipsoid":
                return ellipsoid(x, y, z)
        raise InputError(f"the shape of a geom of the type {kind} cannot be read; give a mesh or a solid")

    def mesh(self, attributes: Attributes) -> Mesh:
        """Return a mesh in the frame of its geom, where its file puts it."""
        name = attributes.get("mesh", "")
        if name not in self.assets:
            raise InputError(f'the mesh "{name}" is not among the assets')
        element, mesh = self.assets[name]
        affine = np.diag([*self.reader.numbers(element, mesh, "scale", (1.0, 1.0, 1.0)), 1.0])
        before = {key.removeprefix("ref"): mesh[key] for key in ("refpos", "refquat") if key in mesh}
        affine = affine @ inverse(self.reader.placement(element, before))
        if "vertex" in mesh:
            vertices = np.array(self.reader.numbers(element, mesh, "vertex", (), 3)).reshape(-1, 3)
            return Mesh(vertices @ affine[:3, :3].T + affine[:3, 3])
        named = self.named(attributes)
        if named is None:
            raise InputError(f'the mesh "{name}" has no file')
        return self.read.mesh(named[0], affine, named[1])
