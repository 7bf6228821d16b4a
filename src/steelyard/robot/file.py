"""The robot file `robot.toml`: the description of a robot and the settings of everything that is done with it."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from steelyard.errors import InputError
from steelyard.files import read_toml, shown

from .dh import robot_from_dh
from .limits import with_limits
from .names import suggestion
from .robot import Robot

__all__ = ["RobotFile"]

LARGEST = 1e15  # in SI units
TABLES = ("log", "processing", "limits", "constraints")
TOP_LEVEL = ("name", "description", "terms", *TABLES)
DEFAULT_TERMS = ("viscous", "coulomb", "offset")
"""Every robot has friction, and hardly a drive reads zero at rest: what a file that does not speak of terms gets."""
URDF_KEYS = ("urdf", "tip", "locked", "gravity")
DH_KEYS = ("convention", "rows", "lengths", "gravity")


@dataclass(frozen=True, eq=False)
class RobotFile:
    """A robot file as read: the robot, and the sections that others interpret.

    Use `RobotFile.load`. The schema is documented in the reference, under "robot.toml".

    Parameters
    ----------
    path : Path
        The file.
    robot : Robot
        The robot of the section `[description]`, without terms.
    terms : tuple of dict
        The tables `[[terms]]`, as written, or the default ones.
    sections : mapping from name to dict
        The tables `[log]`, `[processing]`, `[limits]` and `[constraints]`, as written; empty where absent.
    description : mapping
        How a URDF was read: its `tip` and its `locked` joints, where there are any.
    """

    path: Path
    robot: Robot
    terms: tuple[dict[str, Any], ...] = ()
    sections: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    description: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | Path) -> RobotFile:
        """Read a `.toml` robot file, or a plain `.urdf`.

        A URDF, and a robot file that does not speak of terms, stand for viscous friction, Coulomb friction and an
        offset at every joint. The line ``terms = []``, above the first table, says that there are none.

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
        path = Path(path)
        match path.suffix.lower():
            case ".urdf" | ".xml":
                return cls(path, Robot.from_urdf(path), _default_terms())
            case ".toml":
                return cls._from_toml(path)
        raise InputError(f"{path}: a robot is described by a .urdf or a .toml file, got the suffix {path.suffix!r}")

    @classmethod
    def _from_toml(cls, path: Path) -> RobotFile:
        content = read_toml(path, remedy="give a robot file")
        for key in content:
            if key not in TOP_LEVEL:
                raise InputError(f"{path}: {shown(key)} is no section of a robot file; {suggestion(key, TOP_LEVEL)}")
        terms = content.get("terms", list(_default_terms()))
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
            if not isinstance(content["name"], str) or not content["name"]:
                raise InputError(f"{path}: name must be a string, got {shown(content['name'])}")
            robot = replace(robot, name=content["name"])
        robot = with_limits(robot, sections["limits"], f"{path}, [limits]")
        kept = {key: description[key] for key in ("tip", "locked") if key in description}
        return cls(path, robot, tuple(terms), sections, kept)

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


def _default_terms() -> tuple[dict[str, Any], ...]:
    return tuple({"kind": kind} for kind in DEFAULT_TERMS)


def _describe(path: Path, description: dict[str, Any]) -> Robot:
    where = f"{path}, [description]"
    if "urdf" in description and "rows" in description:
        raise InputError(f"{where}: it has both urdf and rows; keep one")
    if "urdf" not in description and "rows" not in description:
        found = ", ".join(description) or "nothing"
        raise InputError(f"{where}: urdf = ... or rows = ... is needed, found {found}")
    allowed = URDF_KEYS if "urdf" in description else DH_KEYS
    for key in description:
        if key not in allowed:
            kind = "a URDF" if "urdf" in description else "DH rows"
            raise InputError(f"{where}: {shown(key)} does not belong to {kind}; {suggestion(key, allowed)}")

    gravity = description.get("gravity", [0, 0, -9.81])
    if not (isinstance(gravity, list) and len(gravity) == 3 and all(_is_number(value) for value in gravity)):
        raise InputError(f"{where}: gravity must be three numbers in m/s², got {shown(gravity)}")
    if "rows" in description:
        rows = description["rows"]
        if not isinstance(rows, list):
            raise InputError(f"{where}: rows must be a list of [alpha, a, d, theta], got {shown(rows)}")
        lengths = description.get("lengths", {})
        if not isinstance(lengths, dict) or not all(_is_number(value) for value in lengths.values()):
            raise InputError(f"{where}: lengths must be a table of names and numbers in m, got {shown(lengths)}")
        robot = robot_from_dh(rows, description.get("convention", "standard"), path.stem, gravity, where)
        return robot.with_lengths(lengths)

    urdf, tip, locked = description["urdf"], description.get("tip"), description.get("locked", [])
    if not isinstance(urdf, str) or not urdf:
        raise InputError(f"{where}: urdf must be a path, got {shown(urdf)}")
    if tip is not None and not isinstance(tip, str):
        raise InputError(f"{where}: tip must be the name of a link, got {shown(tip)}")
    if isinstance(locked, list):
        valid = all(isinstance(name, str) for name in locked)
    else:
        valid = isinstance(locked, dict) and all(_is_number(value) for value in locked.values())
    if not valid:
        raise InputError(f"{where}: locked must be a list of joint names or a table of positions, got {shown(locked)}")
    return Robot.from_urdf(path.parent / urdf, tip, locked, gravity)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
