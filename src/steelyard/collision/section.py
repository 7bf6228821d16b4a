"""The tables `[collision]`, `[[obstacles]]`, `[table]` and `[workspace]` of a limits file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.robot import Robot
from steelyard.robot.names import suggestion
from steelyard.robot.placement import rpy_rotation

from .configuration_constraint import ConfigurationConstraint
from .mesh_files import read_mesh
from .obstacles import Obstacle, ObstacleClearance
from .robot_geometry import PlacedShape, RobotGeometry
from .self_collision import SelfCollision
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from .workspace import TablePlane, WorkspaceBox

__all__ = ["GEOMETRY_KEYS", "geometry_from_dict"]

Array = NDArray[np.float64]
Made = TypeVar("Made")

LARGEST = 1e9  # m
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
    section: Mapping[str, Any], robot: Robot, folder: str | Path = ".", *, where: str = "limits"
) -> tuple[ConfigurationConstraint, ...]:
    """Return the constraints in space that a limits file describes.

    Parameters
    ----------
    section : mapping
        The tables `collision`, `obstacles`, `table` and `workspace` of the file, those that there are; the how-to
        "Collision-free motion" describes their keys.
    robot : Robot
    folder : str or Path
        Of the file: paths are relative to it.
    where : str
        The file, for messages.

    Raises
    ------
    InputError
        For what cannot be understood: an unknown key, a wrong value, a missing file.
    MissingExtraError
        When distances are asked for and coal is not installed (extra ``collision``).

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])
    >>> shape = {"link": "link2", "type": "capsule", "radius": 0.05, "length": 0.4}
    >>> tables = {"collision": {"self": False, "shapes": [shape]}, "table": {"offset": 0.0, "margin": 0.02}}
    >>> geometry_from_dict(tables, arm)
    (TablePlane(table plane: 1 clearance),)
    """
    for key in section:
        if key not in GEOMETRY_KEYS:
            raise InputError(f"{where}: {shown(key)} is no table of geometry; {suggestion(key, GEOMETRY_KEYS)}")
    reader = _Reader(robot, Path(folder), where)
    return tuple(reader.constraints(section))


class _Reader:
    def __init__(self, robot: Robot, folder: Path, where: str) -> None:
        self.robot = robot
        self.folder = folder
        self.where = where

    def constraints(self, section: Mapping[str, Any]) -> list[ConfigurationConstraint]:
        collision = self.table(section.get("collision", {}), f"{self.where}, [collision]", COLLISION_KEYS)
        obstacles = self.tables(section.get("obstacles", []), "obstacles")
        planes = self.tables(section.get("table", []), "table")
        boxes = self.tables(section.get("workspace", []), "workspace")
        found: list[ConfigurationConstraint] = []
        if "collision" in section or obstacles or planes:
            found += self.of_geometry(collision, "collision" in section, obstacles, planes)
        for where, values in boxes:
            self.table(values, where, ("link", "lower", "upper", "point"))
            link = self.text(values, "link", where)
            if link is None:
                raise InputError(f'{where}: it has no link; name the link of the tool, such as link = "tool0"')
            corners = {
                key: self.numbers(values[key], 3, f"{where}: {key}", infinite=key != "point")
                for key in ("lower", "upper", "point")
                if key in values
            }
            found.append(self.made(where, partial(WorkspaceBox, self.robot, link, **corners)))
        return _numbered(found)

    def of_geometry(
        self,
        collision: Mapping[str, Any],
        described: bool,
        obstacles: list[tuple[str, Mapping[str, Any]]],
        planes: list[tuple[str, Mapping[str, Any]]],
    ) -> list[ConfigurationConstraint]:
        where = f"{self.where}, [collision]"
        geometry = self.geometry(collision, where)
        found: list[ConfigurationConstraint] = []
        distances: dict[str, Any] = {
            key: self.length(collision, key, where) for key in ("margin", "horizon") if key in collision
        }
        watch = collision.get("self", described)
        if not isinstance(watch, bool):
            raise InputError(f"{where}: self must be true or false, got {shown(watch)}")
        if watch:
            options: dict[str, Any] = {"exclude": self.pairs(collision.get("exclude", []), where)}
            srdf = self.text(collision, "srdf", where)
            if srdf is not None:
                options["srdf"] = self.folder / srdf
            if "neutral_configuration" in collision:
                options["neutral_configuration"] = self.numbers(
                    collision["neutral_configuration"], self.robot.dof, f"{where}: neutral_configuration"
                )
            limit = self.made(where, lambda: SelfCollision(geometry, **distances, **options))
            found += [limit] if limit.labels else []
        if obstacles:
            bodies = [self.obstacle(values, place) for place, values in obstacles]
            place = f"{self.where}, [[obstacles]]"
            found.append(self.made(place, lambda: ObstacleClearance(geometry, bodies, **distances)))
        for place, values in planes:
            self.table(values, place, ("normal", "offset", "margin", "links", "ignore"))
            plane: dict[str, Any] = {
                key: self.names(values, key, place) for key in ("links", "ignore") if key in values
            }
            plane |= {key: self.length(values, key, place) for key in ("offset", "margin") if key in values}
            if "normal" in values:
                plane["normal"] = self.numbers(values["normal"], 3, f"{place}: normal")
            found.append(self.made(place, partial(TablePlane, geometry, **plane)))
        return found

    def geometry(self, collision: Mapping[str, Any], where: str) -> RobotGeometry:
        urdf = self.text(collision, "urdf", where)
        meshes = collision.get("meshes", "hull")
        packages = [self.folder / name for name in self.names(collision, "packages", where)]
        own = [
            self.shape_on_link(values, place)
            for place, values in self.tables(collision.get("shapes", []), "collision.shapes")
        ]
        if urdf is None and self.robot.source is None and own:
            return RobotGeometry(self.robot, own)
        path = None if urdf is None else self.folder / urdf
        geometry = self.made(where, lambda: RobotGeometry.from_urdf(self.robot, path, meshes=meshes, packages=packages))
        return geometry.with_shapes(own)

    def shape_on_link(self, values: Mapping[str, Any], where: str) -> PlacedShape:
        shape = self.shape(values, where, ("link", *PLACE_KEYS))
        link = self.text(values, "link", where)
        if link is None:
            raise InputError(f"{where}: it has no link; name the link that the shape is fixed to")
        return self.made(where, lambda: PlacedShape.on(self.robot, link, shape, self.placement(values, where)))

    def obstacle(self, values: Mapping[str, Any], where: str) -> Obstacle:
        shape = self.shape(values, where, ("name", "ignore", "margin", *PLACE_KEYS))
        name = self.text(values, "name", where)
        if name is None:
            raise InputError(f"{where}: it has no name; give one, which messages will use")
        margin = self.length(values, "margin", where) if "margin" in values else None
        ignore = tuple(self.names(values, "ignore", where))
        return self.made(where, lambda: Obstacle(name, shape, self.placement(values, where), ignore, margin))

    def shape(self, values: Mapping[str, Any], where: str, others: tuple[str, ...]) -> Shape:
        kind = values.get("type")
        if not isinstance(kind, str) or kind not in SHAPE_KEYS:
            known = suggestion(str(kind), SHAPE_KEYS) if kind is not None else suggestion("", SHAPE_KEYS)
            raise InputError(f"{where}: type must name a shape, got {shown(kind)}; {known}")
        self.table(values, where, ("type", *SHAPE_KEYS[kind], *others))
        for key in SHAPE_KEYS[kind]:
            if key not in values and key not in ("scale", "exact"):
                raise InputError(f"{where}: a {kind} needs {key}; add it, in m" if key != "file" else _no_file(where))
        if kind == "mesh":
            return self.mesh(values, where)
        if kind == "box":
            x, y, z = self.numbers(values["size"], 3, f"{where}: size")
            return self.made(where, lambda: Box((x, y, z)))
        radius = self.length(values, "radius", where)
        if kind == "sphere":
            return self.made(where, lambda: Sphere(radius))
        length = self.length(values, "length", where)
        return self.made(where, lambda: (Cylinder if kind == "cylinder" else Capsule)(radius, length))

    def mesh(self, values: Mapping[str, Any], where: str) -> Mesh:
        name = self.text(values, "file", where) or ""
        scale = values.get("scale", 1.0)
        factors = [scale] * 3 if not isinstance(scale, list) else scale
        factors = self.numbers(factors, 3, f"{where}: scale")
        exact = values.get("exact", False)
        if not isinstance(exact, bool):
            raise InputError(f"{where}: exact must be true or false, got {shown(exact)}")
        if not all(factors):
            raise InputError(f"{where}: the scale must not be 0, got {shown(scale)}")
        path = self.folder / name
        if not path.is_file():
            raise InputError(f"{where}: the mesh {path} is not found; the path is relative to the limits file")
        vertices, triangles = self.made(where, lambda: read_mesh(path))
        return self.made(f"{where}: {path}", lambda: Mesh(vertices * np.array(factors), triangles, exact))

    def placement(self, values: Mapping[str, Any], where: str) -> Array:
        roll, pitch, yaw = self.numbers(values.get("rpy", [0, 0, 0]), 3, f"{where}: rpy")
        placement = rpy_rotation(roll, pitch, yaw)
        placement[:3, 3] = self.numbers(values.get("xyz", [0, 0, 0]), 3, f"{where}: xyz")
        return placement

    # Values of tables

    def table(self, values: object, where: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
        if not isinstance(values, Mapping):
            raise InputError(f"{where}: a table is expected, got {shown(values)}")
        for key in values:
            if key not in keys:
                raise InputError(f"{where}: {shown(key)} is not known here; {suggestion(str(key), keys)}")
        return values

    def tables(self, values: object, name: str) -> list[tuple[str, Mapping[str, Any]]]:
        """Return one table or a list of them, each with its place in the file."""
        if isinstance(values, Mapping):
            return [(f"{self.where}, [{name}]", values)]
        if not isinstance(values, list) or not all(isinstance(one, Mapping) for one in values):
            raise InputError(f"{self.where}: {name} must be written as [[{name}]], one table each, got {shown(values)}")
        return [(f"{self.where}, [[{name}]] number {number}", one) for number, one in enumerate(values, start=1)]

    def text(self, values: Mapping[str, Any], key: str, where: str) -> str | None:
        value = values.get(key)
        if value is not None and (not isinstance(value, str) or not value):
            raise InputError(f"{where}: {key} must be a string, got {shown(value)}")
        return value

    def names(self, values: Mapping[str, Any], key: str, where: str) -> list[str]:
        found = values.get(key, [])
        if not isinstance(found, list) or not all(isinstance(name, str) and name for name in found):
            raise InputError(f"{where}: {key} must be a list of strings, got {shown(found)}")
        return found

    def pairs(self, values: object, where: str) -> list[str | list[str]]:
        if not isinstance(values, list) or not all(
            isinstance(one, str) or (isinstance(one, list) and all(isinstance(name, str) for name in one))
            for one in values
        ):
            raise InputError(f'{where}: exclude must be a list of links and of pairs ["a", "b"], got {shown(values)}')
        return values

    def length(self, values: Mapping[str, Any], key: str, where: str) -> float:
        return self.numbers([values[key]], 1, f"{where}: {key}")[0]

    def numbers(self, values: object, count: int, what: str, infinite: bool = False) -> list[float]:
        expected = "a number" if count == 1 else f"{count} numbers"
        valid = isinstance(values, list) and len(values) == count
        for value in values if valid and isinstance(values, list) else []:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            valid = valid and number and (abs(value) <= LARGEST or (infinite and math.isinf(value)))
        if not valid or not isinstance(values, list):
            found = values[0] if count == 1 and isinstance(values, list) and values else values
            raise InputError(f"{what} must be {expected}{'' if infinite else ', finite'}, got {shown(found)}")
        return [float(value) for value in values]

    def made(self, where: str, make: Callable[[], Made]) -> Made:
        """Return what `make` returns; say where in the file its complaints come from."""
        try:
            return make()
        except InputError as error:
            raise InputError(f"{where}: {error}") from None


def _no_file(where: str) -> str:
    return f"{where}: a mesh needs file; add the path of an STL or OBJ file"


def _numbered(found: list[ConfigurationConstraint]) -> list[ConfigurationConstraint]:
    """Tell constraints of one name apart."""
    names = [one.name for one in found]
    for index, name in enumerate(names):
        if names.count(name) > 1:
            found[index].name = f"{name} {names[: index + 1].count(name)}"
    return found
