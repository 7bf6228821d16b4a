"""The robot file `robot.toml`: the description of a robot and the settings of everything that is done with it."""

from __future__ import annotations

import copy
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.errors import InputError
from steelyard.files import TomlTable, is_number, listed, read_toml, shown, suggestion
from steelyard.files.arguments import is_name

from .description import STANDARD_GRAVITY, URDF, read_description
from .robot import Robot

__all__ = ["RobotFile"]

TABLES = ("log", "processing", "limits", "constraints", "payload", "elastic", "drive", "controller")
TOP_LEVEL = ("name", "description", "terms", *TABLES)
DEFAULT_TERMS = ("viscous", "coulomb", "offset")
"""The terms of a file that names none: every robot has friction, and few drives measure exactly zero torque at rest."""
FILE_KEYS = ("tip", "locked", "gravity", "xacro_arguments")
LIMITS = {"lower": "lower", "upper": "upper", "velocity": "velocity_limit", "effort": "effort_limit"}
_WITH_ARGUMENTS = re.compile(r"(.*\.(?:xacro|urdf|xml))((?:\s+\w+:=\S*)+)\s*", re.DOTALL)
_ARGUMENT = re.compile(r"(\w+):=(\S*)")
DH_KEYS = ("convention", "rows", "lengths", "inertials", "locked", "gravity")


@dataclass(frozen=True, eq=False)
class RobotFile:
    """A robot file as read: the robot, and the sections that other parts of the package interpret.

    Use `RobotFile.load`. The schema is documented in the reference, under "robot.toml".

    Parameters
    ----------
    path : Path
        The file; for a robot in memory its description, or its name.
    robot : Robot
        The robot of the section `[description]`, without terms.
    terms : tuple of dict
        The tables `[[terms]]`, as written, or the default ones.
    sections : mapping from name to dict
        The tables `[log]`, `[processing]`, `[limits]`, `[constraints]`, `[payload]`, `[elastic]`, `[drive]` and
        `[controller]`, as written; empty where absent.
    description : mapping
        How a URDF was read: its `tip` and its `locked` joints, where there are any.
    allow_extensions : bool
        Whether code may be run that the file names by import path.
    terms_are_default : bool
        Whether nothing states the terms: `steelyard.identify` then takes rotor inertias in, too, where its logs show
        them.
    """

    path: Path
    robot: Robot
    terms: tuple[dict[str, Any], ...] = ()
    sections: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    description: Mapping[str, Any] = field(default_factory=dict)
    allow_extensions: bool = False
    terms_are_default: bool = False

    @classmethod
    def load(cls, path: str | os.PathLike[str] | RobotFile | Robot, *, allow_extensions: bool = False) -> RobotFile:
        """Read a `.toml` robot file, or a plain description such as a `.urdf`.

        The robot of a description, or of a robot file that names no terms, gets viscous friction, Coulomb friction and
        an offset at every joint, and rotor inertia where the description tells of any (``armature`` in MJCF). The line
        ``terms = []``, above the first table, says that there are no terms. `steelyard.identify` adds rotor inertia to
        terms that nobody stated, where its logs show it.

        Parameters
        ----------
        path : str, Path, RobotFile or Robot
            A RobotFile, which has been read, is returned as it is; a Robot becomes one, see `of`. The arguments of a
            xacro may follow its path, as in ``arm.urdf.xacro name:=left``.
        allow_extensions : bool
            Whether terms and constraints that the file names by import path, as ``kind = "module:Class"``, may be
            imported, which runs code. Names of terms and constraints that installed packages add need no permission.

        Raises
        ------
        InputError
            When the file, or the description that it refers to, cannot be used.

        Examples
        --------
        >>> import tempfile
        >>> text = '''
        ... name = "elbow"
        ... [description]
        ... convention = "standard"
        ... rows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q"]]
        ... [[terms]]
        ... kind = "viscous"
        ... '''
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "robot.toml"
        ...     _ = path.write_text(text)
        ...     file = RobotFile.load(path)
        >>> file.robot.name, file.robot.dof, file.terms, file.section("log")
        ('elbow', 2, ({'kind': 'viscous'},), {})
        """
        if isinstance(path, RobotFile):
            return path
        if isinstance(path, Robot):
            return cls.of(path)
        path, arguments = _without_arguments(path)
        if path.suffix.lower() == ".toml":
            content = read_toml(path, remedy="give a robot file")
            return replace(cls.from_dict(content, path), allow_extensions=allow_extensions)
        robot = read_description(path, xacro_arguments=arguments)
        kept = {"xacro_arguments": arguments} if arguments else {}
        return cls(path, robot, _default_terms(robot), description=kept, terms_are_default=True)

    @classmethod
    def of(cls, robot: Robot) -> RobotFile:
        """A robot in memory, with what a robot file that says nothing else would say of it.

        A robot without terms gets those of a plain description, see `load`.

        Examples
        --------
        >>> file = RobotFile.of(Robot.from_dh([(0, 0.3, 0, "q")], name="arm"))
        >>> str(file.path), [term["kind"] for term in file.terms]
        ('arm', ['viscous', 'coulomb', 'offset'])
        """
        path = Path(robot.name) if robot.source is None else robot.source
        kept = {**robot.read_with, **({"xacro_arguments": robot.xacro_arguments} if robot.xacro_arguments else {})}
        terms = () if robot.terms else _default_terms(robot)
        return cls(path, robot, terms, description=kept, terms_are_default=not robot.terms)

    @classmethod
    def from_dict(cls, content: dict[str, Any], path: Path) -> RobotFile:
        """Take the content of a robot file that is, or could be, at a path; the paths in it count from its folder.

        Raises
        ------
        InputError
            As in `load`.

        Examples
        --------
        >>> rows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q"]]
        >>> RobotFile.from_dict({"name": "elbow", "description": {"rows": rows}}, Path("robot.toml")).robot.dof
        2
        """
        TomlTable(content, str(path), TOP_LEVEL, "is no section of a robot file")
        terms = content.get("terms", [])
        if not isinstance(terms, list) or not all(isinstance(term, dict) for term in terms):
            raise InputError(f"{path}: terms must be written as [[terms]], one table each, got {shown(terms)}")
        sections: dict[str, dict[str, Any]] = {}
        for name in TABLES:
            section = content.get(name, {})
            if not isinstance(section, dict):
                raise InputError(f"{path}: {name} must be one table [{name}], got {shown(section)}")
            sections[name] = section

        description = content.get("description")
        if not isinstance(description, dict):
            raise InputError(f"{path}: it has no table [description]; add one with urdf = ... or rows = ...")
        robot = _describe(path, description)
        if "name" in content:
            if not is_name(content["name"]):
                raise InputError(f"{path}: name must be a string of one line, got {shown(content['name'])}")
            robot = replace(robot, name=content["name"])
        robot = _with_limits(robot, sections["limits"], f"{path}, [limits]")
        kept = {key: description[key] for key in ("tip", "locked") if key in description}
        if robot.xacro_arguments:
            kept["xacro_arguments"] = dict(robot.xacro_arguments)
        stated = "terms" in content
        chosen = tuple(terms) if stated else _default_terms(robot)
        return cls(path, robot, chosen, sections, kept, terms_are_default=not stated)

    def with_settings(self, name: str, **settings: Any) -> RobotFile:
        """Return a copy in which keys of the table `[name]` have other values; those that are None stay as they are."""
        stated = {key: value for key, value in settings.items() if value is not None}
        return replace(self, sections={**self.sections, name: {**self.section(name), **stated}})

    def section(self, name: str) -> dict[str, Any]:
        """A copy of the table `[name]` as written, empty where absent.

        Raises
        ------
        InputError
            When no table of a robot file has this name.
        """
        if name not in TABLES:
            raise InputError(f'"{name}" is no table of a robot file; {suggestion(name, TABLES)}')
        return copy.deepcopy(self.sections.get(name, {}))


def _without_arguments(path: str | os.PathLike[str]) -> tuple[Path, dict[str, str]]:
    """Take the arguments of a xacro from what follows its path, as in ``arm.urdf.xacro name:=left load:=true``."""
    found = _WITH_ARGUMENTS.fullmatch(str(path))
    if found is None or Path(path).exists():
        return Path(path), {}
    return Path(found[1]), dict(_ARGUMENT.findall(found[2]))


def _default_terms(robot: Robot) -> tuple[dict[str, Any], ...]:
    rotors = any(joint.rotor_inertia > 0.0 for joint in robot.joints)
    return tuple({"kind": kind} for kind in (*DEFAULT_TERMS, *(["rotor_inertia"] if rotors else [])))


def _describe(path: Path, description: dict[str, Any]) -> Robot:
    where = f"{path}, [description]"
    given = [key for key in ("urdf", "file", "rows") if key in description]
    if len(given) > 1:
        raise InputError(f"{where}: it has both {given[0]} and {given[1]}; keep one")
    if not given:
        found = listed(description) if description else "nothing"
        raise InputError(f"{where}: urdf = ... or rows = ... is needed, found {found}")
    names = {"urdf": "a URDF", "file": "a file of a description", "rows": "DH rows"}
    keys, kind = DH_KEYS if given == ["rows"] else (*given, *FILE_KEYS), names[given[0]]
    table = TomlTable(description, where, keys, f"does not belong to {kind}")
    given_gravity = "gravity" in table
    gravity = table.numbers("gravity", 3, expected="three numbers in m/s²") if given_gravity else STANDARD_GRAVITY
    if "rows" in description:
        rows = description["rows"]
        if not isinstance(rows, list):
            raise table.refuse("rows", "a list of [alpha, a, d, theta]")
        lengths = description.get("lengths", {})
        if not isinstance(lengths, dict) or not all(is_number(value) for value in lengths.values()):
            raise table.refuse("lengths", "a table of names and numbers in m")
        from .described_tree import robot_parts  # a format is loaded when it is read
        from .dh import dh_inertias, dh_tree

        convention = description.get("convention", "standard")
        tree = dh_tree(rows, convention, path.stem, where, dh_inertias(table), lengths)
        return Robot(**robot_parts(tree, None, _locked(table)), gravity=np.asarray(gravity, dtype=object))

    source, tip = path.parent / (table.text(given[0], "a path") or ""), table.text("tip", "the name of a link")
    arguments = xacro_arguments(table)
    otherwise = URDF if given == ["urdf"] else None
    return read_description(source, tip, _locked(table), gravity if given_gravity else None, arguments, otherwise)


def xacro_arguments(table: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of the arguments of a xacro as xacro takes them."""
    given = table.get("xacro_arguments", {})
    if not isinstance(given, dict) or not all(isinstance(value, str | int | float) for value in given.values()):
        raise InputError(
            f"{getattr(table, 'where', '')}: xacro_arguments must be a table of texts, numbers and true or false, got "
            f"{shown(given)}"
        )
    return {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in given.items()}


def _locked(table: TomlTable) -> list[str] | dict[str, float]:
    """Return the joints that are held still: their names, or their positions by name."""
    locked: Any = table.get("locked", [])
    if isinstance(locked, list):
        valid = all(isinstance(name, str) for name in locked)
    else:
        valid = isinstance(locked, dict) and all(is_number(value) for value in locked.values())
    if not valid:
        raise table.refuse("locked", "a list of joint names or a table of positions")
    return locked  # type: ignore[no-any-return]


def _with_limits(robot: Robot, section: Mapping[str, Any], where: str) -> Robot:
    """Return the robot with the limits of a `[limits]` table.

    ``lower`` and ``upper`` (rad or m), ``velocity`` (rad/s or m/s) and ``effort`` (N·m or N) are each a number for all
    the driving joints, or a list with one for each.
    """
    joints = list(robot.joints)
    for key, value in TomlTable(section, where, tuple(LIMITS), "is no limit").items():
        values = value if isinstance(value, list) else [value] * robot.dof
        if len(values) != robot.dof:
            raise InputError(
                f"{where}: {key} has {len(values)} values, but {robot.name} has {robot.dof} joints; give one for each"
            )
        for number, index in zip(values, robot.driving_joints, strict=True):
            if isinstance(number, bool) or not isinstance(number, int | float) or math.isnan(number):
                raise InputError(f"{where}: {key} of {joints[index].name} must be a number, got {number!r}")
            if key in ("velocity", "effort") and number <= 0:
                raise InputError(f"{where}: {key} of {joints[index].name} must be positive, got {number!r}")
            change: dict[str, Any] = {LIMITS[key]: float(number)}
            joints[index] = replace(joints[index], **change)
    for joint in joints:
        if joint.lower > joint.upper:
            raise InputError(
                f"{where}: the lower limit of {joint.name} is {joint.lower:g}, above its upper limit of "
                f"{joint.upper:g}; exchange or correct them"
            )
    return replace(robot, joints=tuple(joints))
