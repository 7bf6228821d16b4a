"""Reads the tables `[collision]`, `[[obstacles]]`, `[table]` and `[workspace]` of a limits file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import TomlTable, shown, suggestion
from steelyard.robot import Robot
from steelyard.robot.placement import rpy_rotation

from .configuration_constraint import ConfigurationConstraint
from .mesh_files import read_mesh
from .robot_geometry import RobotGeometry
from .self_collision import MARGIN, SelfCollision
from .shapes import Box, Capsule, Cylinder, Mesh, PlacedShape, Shape, Sphere
from .workspace import Obstacle, ObstacleClearance, TablePlane, WorkspaceBox

__all__ = ["GEOMETRY_KEYS", "geometry_from_dict"]

Array = NDArray[np.float64]
Made = TypeVar("Made")

GEOMETRY_KEYS = ("collision", "obstacles", "table", "workspace")
SHAPE_KEYS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "mesh": ("file", "scale", "exact"),
}
PLACE_KEYS = ("xyz", "rpy")
COLLISION_KEYS = (
    "self", "margin", "horizon", "urdf", "meshes", "packages", "srdf", "exclude", "neutral_configuration", "shapes",
)  # fmt: skip


def geometry_from_dict(
    section: Mapping[str, Any], robot: Robot, folder: str | Path | None = None, *, where: str = "limits"
) -> tuple[ConfigurationConstraint, ...]:
    """Return the geometric constraints that a limits file describes.

    Parameters
    ----------
    section : mapping
        Those of the tables `collision`, `obstacles`, `table` and `workspace` that the file has; the how-to
        "Collision-free motion" describes their keys.
    robot : Robot
    folder : str or Path, optional
        Folder of the file, to which paths are relative; the working directory where absent.
    where : str
        Path of the file, for messages.

    Raises
    ------
    InputError
        If a key is unknown, a value is wrong, or a file is missing.
    MissingExtraError
        If distances are needed and coal is not installed (extra ``collision``).

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])
    >>> shape = {"link": "link2", "type": "capsule", "radius": 0.05, "length": 0.4}
    >>> tables = {"collision": {"self": False, "shapes": [shape]}, "table": {"offset": 0.0, "margin": 0.02}}
    >>> geometry_from_dict(tables, arm)
    (TablePlane(table plane: 1 clearance),)
    """
    tables = TomlTable(section, where, GEOMETRY_KEYS, "is no table of geometry")
    return tuple(_Reader(robot, Path(folder or "."), where).constraints(tables))


class _Reader:
    def __init__(self, robot: Robot, folder: Path, where: str) -> None:
        self.robot = robot
        self.folder = folder
        self.where = where

    def constraints(self, section: TomlTable) -> list[ConfigurationConstraint]:
        collision = section.table("collision", COLLISION_KEYS)
        obstacles, planes = section.tables("obstacles"), section.tables("table")
        found: list[ConfigurationConstraint] = []
        if "collision" in section or obstacles or planes:
            found += self.of_geometry(collision, "collision" in section, obstacles, planes)
        for where, content in section.tables("workspace"):
            values = TomlTable(content, where, ("link", "lower", "upper", "point"))
            link = values.text("link")
            if link is None:
                raise InputError(f'{where}: it has no link; name the link of the tool, such as link = "tool0"')
            corners = {
                key: values.numbers(key, 3, infinite=key != "point")
                for key in ("lower", "upper", "point")
                if key in values
            }
            found.append(self.made(where, partial(WorkspaceBox, self.robot, link, **corners)))
        return _numbered(found)

    def of_geometry(
        self,
        collision: TomlTable,
        described: bool,
        obstacles: list[tuple[str, Mapping[str, Any]]],
        planes: list[tuple[str, Mapping[str, Any]]],
    ) -> list[ConfigurationConstraint]:
        where = collision.where
        geometry = self.geometry(collision)
        found: list[ConfigurationConstraint] = []
        distances: dict[str, Any] = {key: collision.number(key) for key in ("margin", "horizon") if key in collision}
        if collision.flag("self", described):
            options: dict[str, Any] = {"exclude": self.pairs(collision.get("exclude", []), where)}
            srdf = collision.text("srdf")
            if srdf is not None:
                options["srdf"] = self.folder / srdf
            if "neutral_configuration" in collision:
                options["neutral_configuration"] = collision.numbers("neutral_configuration", self.robot.dof)
            # The table may be there for pairs to exclude alone.
            limit = self.made(where, lambda: SelfCollision(geometry, **({"margin": MARGIN} | distances), **options))
            found += [limit] if limit.labels else []
        if obstacles:
            bodies = [self.obstacle(values, place) for place, values in obstacles]
            place = f"{self.where}, [[obstacles]]"
            found.append(self.made(place, lambda: ObstacleClearance(geometry, bodies, **distances)))
        for place, content in planes:
            values = TomlTable(content, place, ("normal", "offset", "margin", "links", "ignore"))
            plane: dict[str, Any] = {key: values.texts(key) for key in ("links", "ignore") if key in values}
            plane |= {key: values.number(key) for key in ("offset", "margin") if key in values}
            if "normal" in values:
                plane["normal"] = values.numbers("normal", 3)
            found.append(self.made(place, partial(TablePlane, geometry, **plane)))
        return found

    def geometry(self, collision: TomlTable) -> RobotGeometry:
        where, urdf = collision.where, collision.text("urdf")
        meshes = collision.get("meshes", "hull")
        packages = [self.folder / name for name in collision.texts("packages")]
        own = [
            self.shape_on_link(values, place)
            for place, values in TomlTable(collision, self.where, COLLISION_KEYS).tables("shapes", "collision.shapes")
        ]
        if urdf is None and self.robot.source is None and own:
            return RobotGeometry(self.robot, own)
        path = None if urdf is None else self.folder / urdf
        geometry = self.made(
            where, lambda: RobotGeometry.from_description(self.robot, path, meshes=meshes, packages=packages)
        )
        return geometry.with_shapes(own)

    def shape_on_link(self, content: Mapping[str, Any], where: str) -> PlacedShape:
        values = self.shape_table(content, where, ("link", *PLACE_KEYS))
        shape, link = self.shape(values), values.text("link")
        if link is None:
            raise InputError(f"{where}: it has no link; name the link that the shape is fixed to")
        return self.made(where, lambda: PlacedShape.on(self.robot, link, shape, self.placement(values)))

    def obstacle(self, content: Mapping[str, Any], where: str) -> Obstacle:
        values = self.shape_table(content, where, ("name", "ignore", "margin", *PLACE_KEYS))
        shape, name = self.shape(values), values.text("name")
        if name is None:
            raise InputError(f"{where}: it has no name; give one, which messages will use")
        margin = values.number("margin") if "margin" in values else None
        ignore = tuple(values.texts("ignore"))
        return self.made(where, lambda: Obstacle(name, shape, self.placement(values), ignore, margin))

    def shape_table(self, content: Mapping[str, Any], where: str, others: tuple[str, ...]) -> TomlTable:
        kind = content.get("type")
        if not isinstance(kind, str) or kind not in SHAPE_KEYS:
            known = suggestion(str(kind), SHAPE_KEYS) if kind is not None else suggestion("", SHAPE_KEYS)
            raise InputError(f"{where}: type must name a shape, got {shown(kind)}; {known}")
        values = TomlTable(content, where, ("type", *SHAPE_KEYS[kind], *others))
        for key in SHAPE_KEYS[kind]:
            if key not in values and key not in ("scale", "exact"):
                raise InputError(f"{where}: a {kind} needs {key}; add it, in m" if key != "file" else _no_file(where))
        return values

    def shape(self, values: TomlTable) -> Shape:
        kind, where = values["type"], values.where
        if kind == "mesh":
            return self.mesh(values)
        if kind == "box":
            x, y, z = values.numbers("size", 3)
            return self.made(where, lambda: Box((x, y, z)))
        radius = values.number("radius")
        if kind == "sphere":
            return self.made(where, lambda: Sphere(radius))
        length = values.number("length")
        return self.made(where, lambda: (Cylinder if kind == "cylinder" else Capsule)(radius, length))

    def mesh(self, values: TomlTable) -> Mesh:
        where, name = values.where, values.text("file") or ""
        scale = values.get("scale", 1.0)
        if isinstance(scale, list):
            factors = values.numbers("scale", 3)
        else:
            factors = [values.number("scale") if "scale" in values else 1.0] * 3
        exact = values.flag("exact")
        if not all(factors):
            raise InputError(f"{where}: the scale must not be 0, got {shown(scale)}")
        path = self.folder / name
        if not path.is_file():
            raise InputError(f"{where}: the mesh {path} is not found; the path is relative to the limits file")
        vertices, triangles = self.made(where, lambda: read_mesh(path))
        return self.made(f"{where}: {path}", lambda: Mesh(vertices * np.array(factors), triangles, exact))

    def placement(self, values: TomlTable) -> Array:
        roll, pitch, yaw = values.numbers("rpy", 3) if "rpy" in values else (0.0, 0.0, 0.0)
        placement = rpy_rotation(roll, pitch, yaw)
        placement[:3, 3] = values.numbers("xyz", 3) if "xyz" in values else 0.0
        return placement

    def pairs(self, values: object, where: str) -> list[str | list[str]]:
        if not isinstance(values, list) or not all(
            isinstance(one, str) or (isinstance(one, list) and all(isinstance(name, str) for name in one))
            for one in values
        ):
            raise InputError(f'{where}: exclude must be a list of links and of pairs ["a", "b"], got {shown(values)}')
        return values

    def made(self, where: str, make: Callable[[], Made]) -> Made:
        """Return what `make` returns; its errors are raised again with the place in the file."""
        try:
            return make()
        except InputError as error:
            raise InputError(f"{where}: {error}") from None


def _no_file(where: str) -> str:
    return f"{where}: a mesh needs file; add the path of an STL or OBJ file"


def _numbered(found: list[ConfigurationConstraint]) -> list[ConfigurationConstraint]:
    """Number the constraints that have the same name."""
    names = [one.name for one in found]
    for index, name in enumerate(names):
        if names.count(name) > 1:
            found[index].name = f"{name} {names[: index + 1].count(name)}"
    return found
