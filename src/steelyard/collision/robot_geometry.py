"""The collision shapes of a robot, each fixed to a moving link or to the base, as its description tells them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import suggestion
from steelyard.robot import Robot
from steelyard.robot.description import DESCRIPTION_FORMATS, URDF, UrdfFormat, description_format
from steelyard.robot.urdf_document import UrdfReader, parse_urdf

from .described_shapes import ELEMENTS, DescribedShapes, GeometryElement, MeshKind, MeshShapes, ShapeElement
from .shapes import Box, Capsule, Cylinder, Mesh, PlacedShape, Shape, Sphere

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["RobotGeometry", "described_shapes", "files_of_meshes", "shapes_of_moving_links", "visual_shapes"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class RobotGeometry:
    """The collision shapes of a robot.

    Use `RobotGeometry.from_description`, or give your own shapes for a robot that has none.

    Parameters
    ----------
    robot : Robot
    shapes : sequence of PlacedShape
    parents : mapping, optional
        The parent link of each link of the description; by default those of the links that the robot knows.

    Examples
    --------
    >>> from steelyard.collision import Sphere
    >>> arm = Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], name="arm")
    >>> RobotGeometry(arm, [PlacedShape.on(arm, "link2", Sphere(0.1))])
    RobotGeometry 'arm': 1 shape on 1 link
      link2: Sphere(radius=0.1)
    """

    robot: Robot
    shapes: tuple[PlacedShape, ...]
    parents: Mapping[str, str] = field(default_factory=dict)

    def __init__(self, robot: Robot, shapes: Iterable[PlacedShape], parents: Mapping[str, str] | None = None) -> None:
        object.__setattr__(self, "robot", robot)
        object.__setattr__(self, "shapes", tuple(shapes))
        names = (*robot.link_names, robot.base_link)
        of_joints = {names[index]: names[joint.parent] for index, joint in enumerate(robot.joints)}
        of_joints |= {one.name: robot.base_link for one in robot.base_attachments}
        of_joints |= {one.name: link.name for link in robot.links for one in link.attachments}
        object.__setattr__(self, "parents", of_joints if parents is None else dict(parents))

    @classmethod
    def from_description(
        cls,
        robot: Robot,
        path: str | Path | None = None,
        *,
        meshes: MeshKind = "hull",
        packages: Sequence[str | Path] = (),
    ) -> RobotGeometry:
        """Return the shapes of the ``<collision>`` elements of a URDF or SDF, or of the geoms that collide in an MJCF.

        Boxes, spheres, ellipsoids, cylinders, capsules and meshes are read and placed on the moving links of the robot,
        into which links beyond fixed and locked joints are merged. Links that the robot does not have, such as side
        branches and those beyond its tip, are left out; so are planes and height fields, which are no shapes of links.

        Parameters
        ----------
        robot : Robot
        path : str or Path, optional
            Path of the description; by default the one that the robot was read from.
        meshes : {"hull", "exact"}
            Whether meshes are replaced by their convex hulls or kept as surfaces. Hulls are faster. They contain the
            meshes, so that a body that keeps clear of the hull keeps clear of the mesh.
        packages : sequence of path
            Folders of packages, or folders that contain packages, for ``package://``. ``ROS_PACKAGE_PATH``,
            ``AMENT_PREFIX_PATH`` and the folders above the description are searched after them.

        Raises
        ------
        InputError
            If the robot has no description with shapes, an element is wrong, or a mesh is missing or damaged.
        MissingExtraError
            If a mesh cannot be read because a package is not installed (extra ``collision``).
        """
        if meshes not in ("hull", "exact"):
            raise InputError(f'meshes must be "hull" or "exact", got {meshes!r}')
        source = robot.source if path is None else Path(path)
        if source is None:
            raise InputError(
                f'robot "{robot.name}" was not read from a URDF, so it has no collision geometry; name a URDF or give '
                "shapes (RobotGeometry(robot, shapes), or [[collision.shapes]] in the limits file)"
            )
        shapes, parents = described_shapes(robot, source, meshes, packages)
        return cls(robot, shapes, parents)

    from_urdf = from_description  # by the format that most robots have

    def with_shapes(self, shapes: Iterable[PlacedShape]) -> RobotGeometry:
        """Return the geometry with additional shapes."""
        return RobotGeometry(self.robot, (*self.shapes, *shapes), self.parents)

    def without(self, links: Iterable[str]) -> RobotGeometry:
        """Return the geometry without the shapes of some links of the description.

        Raises
        ------
        InputError
            If the robot has no such link.
        """
        dropped = set(links)
        for link in dropped:
            self.robot.frame(link)
        return RobotGeometry(self.robot, (one for one in self.shapes if one.link not in dropped), self.parents)

    @property
    def links(self) -> tuple[str, ...]:
        """The links of the description that have shapes."""
        return tuple(dict.fromkeys(one.link for one in self.shapes))

    @property
    def bodies(self) -> tuple[int, ...]:
        """Indices of the moving links that carry shapes; -1, the base, comes first."""
        return tuple(sorted({one.body for one in self.shapes}))

    def body_name(self, body: int) -> str:
        """Name of a moving link, or of the base for -1."""
        return self.robot.base_link if body < 0 else self.robot.links[body].name

    def check_links(self, links: Iterable[str], where: str) -> frozenset[str]:
        """Return the links as a set, or raise InputError if one of them has no shape."""
        for link in links:
            if link not in self.links:
                self.robot.frame(link)
                raise InputError(f'{where}: link "{link}" has no collision geometry; {suggestion(link, self.links)}')
        return frozenset(links)

    def between(self, first: str, second: str) -> tuple[str, ...]:
        """Return the links of the description that lie strictly between two links in the tree."""
        ways = []
        for link in (first, second):
            way = [link]
            while way[-1] in self.parents:
                way.append(self.parents[way[-1]])
            ways.append(way)
        other = set(ways[1])
        meeting = next((link for link in ways[0] if link in other), None)
        parts = [way[: way.index(meeting)] if meeting in way else way for way in ways]
        inner = [*parts[0], *([] if meeting is None else [meeting]), *reversed(parts[1])]
        return tuple(link for link in inner if link not in (first, second))

    def __repr__(self) -> str:
        count, links = len(self.shapes), len(self.links)
        lines = [
            f"RobotGeometry {self.robot.name!r}: {count} shape{'s' * (count != 1)} on {links} link{'s' * (links != 1)}"
        ]
        for link in self.links:
            lines.append(f"  {link}: {', '.join(str(one.shape) for one in self.shapes if one.link == link)}")
        return "\n".join(lines)


def described_shapes(
    robot: Robot,
    path: Path,
    meshes: MeshKind,
    packages: Sequence[str | Path],
    skipped: list[tuple[str, str]] | None = None,
) -> tuple[list[PlacedShape], dict[str, str]]:
    """Return the collision shapes of a description, and the parent of each link; see `from_description`.

    If `skipped` is given, elements that cannot be read are left out and appended to it as pairs of link and reason.
    """
    read = MeshShapes(path, meshes, packages)
    found = _elements(robot, path, read)
    if found is None:
        raise InputError(
            f"shapes are read from a URDF, an SDF or an MJCF alone, and {path.name} is none; add [[collision.shapes]], "
            "or [collision] with urdf = ..., to the limits file"
        )
    elements, tree = found
    shapes = _placed(robot, elements, read, ("collision",), skipped)["collision"]
    return shapes, {joint.child: joint.parent for joint in tree().joints.values()}


def shapes_of_moving_links(
    robot: Robot, path: Path, skipped: list[tuple[str, str]], largest: int
) -> dict[GeometryElement, list[PlacedShape]]:
    """Return what is seen and what collides of the moving links, meshes as convex hulls.

    Elements that cannot be read are left out and appended to `skipped` as pairs of link and reason, and so are meshes
    of more than `largest` bytes. A description of a format without shapes has none.
    """
    read = MeshShapes(path, "hull", (), largest)
    elements, _ = _elements(robot, path, read) or ([], None)
    return _placed(robot, elements, read, ("visual", "collision"), skipped, moving=True)


def files_of_meshes(robot: Robot, path: Path) -> list[Path]:
    """Return the files of the meshes of a description, those that can be found, and the files that name them."""
    from .mesh_files import find_mesh  # what is not asked for is not loaded

    elements, _ = _elements(robot, path, MeshShapes(path, "hull", ())) or ([], None)
    files: dict[Path, None] = {}
    for mesh in dict.fromkeys(one.mesh for one in elements if one.mesh is not None):
        files[mesh[1]] = None
        with contextlib.suppress(InputError):
            files[find_mesh(*mesh, ())] = None
    return list(files)


def visual_shapes(robot: Robot, path: Path, skipped: list[tuple[str, str]], largest: int) -> list[PlacedShape]:
    """Return the shapes that a description shows, meshes as surfaces: what is seen, or else what collides.

    Elements that cannot be read are left out and appended to `skipped` as pairs of link and reason, and so are meshes
    of more than `largest` bytes.
    """
    read = MeshShapes(path, "exact", (), largest)
    elements, _ = _elements(robot, path, read) or ([], None)
    kinds: tuple[GeometryElement, ...] = ("visual", "collision")
    for kind in kinds:
        found = _placed(robot, elements, read, (kind,), skipped)[kind]
        if found:
            return found
    return []


def _elements(robot: Robot, path: Path, read: MeshShapes) -> DescribedShapes | None:
    """Return the elements with shapes, and the tree; None where the format has none."""
    kind = description_format(path) or URDF
    if isinstance(kind, UrdfFormat):
        return _urdf_shapes(path, robot.xacro_arguments if path == robot.source else None, read)
    # What reads other formats is loaded when a file of theirs is read.
    if kind is DESCRIPTION_FORMATS.get("sdf"):
        from .sdf_shapes import sdf_shapes

        return sdf_shapes(path, read)
    if kind is DESCRIPTION_FORMATS.get("mjcf"):
        from .mjcf_shapes import mjcf_shapes

        return mjcf_shapes(path, read)
    return None


def _placed(
    robot: Robot,
    elements: Sequence[ShapeElement],
    read: MeshShapes,
    kinds: Sequence[GeometryElement],
    skipped: list[tuple[str, str]] | None,
    moving: bool = False,
) -> dict[GeometryElement, list[PlacedShape]]:
    """Return the shapes on the links of a robot, or on its moving links alone."""
    chosen = []
    for one in elements:
        try:
            carrier, _ = robot.frame(one.link)
        except InputError:
            continue
        if one.kind in kinds and (carrier >= 0 or not moving):
            chosen.append(one)
    read.read_files(one.mesh for one in chosen)
    found: dict[GeometryElement, list[PlacedShape]] = {kind: [] for kind in kinds}
    for one in chosen:
        try:
            shape, placement = one.make()
        except InputError as error:
            if skipped is None:
                raise
            skipped.append((one.link, str(error)))
            continue
        found[one.kind].append(PlacedShape.on(robot, one.link, shape, placement))
    return found


# URDF

KINDS = ("box", "sphere", "cylinder", "capsule", "mesh")


def _urdf_shapes(path: Path, xacro_arguments: Mapping[str, str] | None, read: MeshShapes) -> DescribedShapes:
    """Return the elements with shapes of a URDF or xacro, and its tree."""
    root = parse_urdf(path, xacro_arguments)
    reader = _ShapeReader(path, read)
    document = reader.document(root)
    elements = []
    for element in reader.children(root, "link"):
        link = element.get("name", "")
        for kind in ELEMENTS:
            for child in reader.children(element, kind):
                make = partial(reader.placed_shape, child, f'link "{link}"')
                mesh = next(child.iterfind(f".//{reader.namespace}mesh"), None)
                elements.append(
                    ShapeElement(kind, link, make, None if mesh is None else (mesh.get("filename", ""), path))
                )
    return elements, lambda: document


class _ShapeReader(UrdfReader):
    def __init__(self, path: Path, read: MeshShapes) -> None:
        super().__init__(path)
        self.read = read

    def placed_shape(self, element: etree._Element, owner: str) -> tuple[Shape, Array]:
        """Read the shape of a ``<collision>`` or ``<visual>`` element, and its frame in that of the link."""
        geometry = self.only(element, "geometry", f"{owner}, <{self.tag(element)}>")
        if geometry is None:
            raise self.error(
                element, f"{owner}: a <{self.tag(element)}> has no <geometry>; add one or remove the element"
            )
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
        raise InputError(f"<{kind}> cannot be read as a shape; {suggestion(kind, KINDS)}")

    def mesh(self, element: etree._Element, owner: str) -> Mesh:
        scale = np.array(self.vector(element, "scale", owner, (1.0, 1.0, 1.0)))
        if not scale.all():
            raise InputError(f"the scale of a mesh must not be 0, got {element.get('scale')!r}")
        return self.read.mesh(self.text(element, "filename", owner), np.diag([*scale, 1.0]))
