"""The formats of robot descriptions: how a file is read as a robot, and written again with identified parameters."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import read_bytes, shown

from .joint import Drives
from .robot import Robot

__all__ = [
    "DESCRIPTION_FORMATS",
    "MJCF",
    "SDF",
    "URDF",
    "DescriptionFormat",
    "MjcfFormat",
    "SdfFormat",
    "UrdfFormat",
    "description_format",
    "read_description",
]

Locked = Iterable[str] | Mapping[str, float]
STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # m/s²
SUFFIXES = ("xml", "urdf", "sdf", "world")
"""The suffixes of files that may hold another format than the suffix says; the root element tells."""
ROOTS = ("robot", "world", "mujoco")
"""Names of formats that are no suffixes of their own."""
_BEFORE_ROOT = re.compile(rb"<!--.*?-->|<\?.*?\?>|<!(?!--)[^>]*>", re.DOTALL)
_ROOT = re.compile(rb"<([A-Za-z_][\w.-]*)")


class DescriptionFormat(ABC):
    """A format of robot descriptions. One that derives from this class has `read`, and `write` where it is written."""

    holds: ClassVar[tuple[str, ...]] = ("damping", "friction")
    """What of `Drives` simulators take from elements of this format; the rest stands in an extension, or beside."""

    tells_gravity: ClassVar[bool] = False
    """Whether files hold gravity; `read` then gets None for a gravity that nobody has given."""

    @abstractmethod
    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """Read a robot.

        Parameters
        ----------
        path : Path
        tip : str or None
            Keep only the chain from the root to this link.
        locked : iterable of names, or mapping from name to position
            Joints held still; a format that does not know this, or `tip`, refuses what is not empty.
        gravity : (3,) array_like or None
            In the frame of the root link, m/s²; None, where `tells_gravity` alone, if nobody has given it.

        Raises
        ------
        InputError
            If the file does not describe a robot.
        """

    def write(self, robot: Robot, parameters: NDArray[np.float64], drives: Drives, source: Path, target: Path) -> None:
        """Write a copy of a description with other parameters; a format that is only read does not have this.

        Parameters
        ----------
        robot : Robot
            As `read` gives it.
        parameters : (n,)
            Values of `robot.parameter_names`.
        drives : Drives
            Friction, rotor inertia and offset of each coordinate; NaN where nothing is known.
        source, target : Path
        """
        raise InputError(f"{source}: descriptions of this format are read only; estimate.json holds the parameters.")

    def refusal(self, robot: Robot) -> str:
        """Return why the description of a robot cannot be written, as a sentence; empty where it can."""
        return ""

    @property
    def is_written(self) -> bool:
        """Whether the format has `write`."""
        return type(self).write is not DescriptionFormat.write


class UrdfFormat(DescriptionFormat):
    """URDF, which is edited in place, and xacro, which is expanded."""

    def __init__(self, xacro_arguments: Mapping[str, str] | None = None) -> None:
        self.xacro_arguments = dict(xacro_arguments or {})

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_urdf`."""
        gravity = STANDARD_GRAVITY if gravity is None else gravity
        return Robot.from_urdf(path, tip, locked, gravity, self.xacro_arguments)

    def write(self, robot: Robot, parameters: NDArray[np.float64], drives: Drives, source: Path, target: Path) -> None:
        """See `write_urdf`."""
        from .urdf_writer import write_urdf  # what writes is loaded when something is written

        write_urdf(robot, parameters, source=source, target=target, **vars(drives))


class SdfFormat(DescriptionFormat):
    """SDF."""

    tells_gravity = True

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_sdf`."""
        return Robot.from_sdf(path, tip, locked, gravity)

    def refusal(self, robot: Robot) -> str:
        """Say which links stand in other files."""
        from .sdf_document import SdfReader  # a format is loaded when it is used

        if robot.source is None:
            return ""
        reader = SdfReader(robot.source)
        reader.tree()
        here = {name for link in robot.links for name in (link.name, *link.absorbed)} & reader.included
        if not here:
            return ""
        return (
            f"{robot.source} includes {min(here)} from another file, so that it is not written with the identified "
            "parameters: identify the robot from that file."
        )

    def write(self, robot: Robot, parameters: NDArray[np.float64], drives: Drives, source: Path, target: Path) -> None:
        """See `write_sdf`."""
        from .sdf_writer import write_sdf

        write_sdf(robot, parameters, drives, source, target)


class MjcfFormat(DescriptionFormat):
    """MJCF."""

    tells_gravity = True
    holds = ("damping", "friction", "rotor_inertia", "stiffness", "quadratic_damping", "cubic_damping")

    def read(self, path: Path, tip: str | None, locked: Locked, gravity: ArrayLike | None) -> Robot:
        """See `Robot.from_mjcf`."""
        return Robot.from_mjcf(path, tip, locked, gravity)

    def write(self, robot: Robot, parameters: NDArray[np.float64], drives: Drives, source: Path, target: Path) -> None:
        """See `write_mjcf`."""
        from .mjcf_writer import write_mjcf

        write_mjcf(robot, parameters, drives, source, target)


def _checked_format(name: str, offered: object) -> DescriptionFormat:
    if isinstance(offered, type) and issubclass(offered, DescriptionFormat):
        return offered()
    raise TypeError(f"expected a class derived from steelyard.robot.DescriptionFormat, got {shown(offered)}")


URDF, SDF, MJCF = UrdfFormat(), SdfFormat(), MjcfFormat()
DESCRIPTION_FORMATS: Extensions[DescriptionFormat] = Extensions(
    "description_formats",
    "format of descriptions",
    {
        "urdf": URDF,
        "robot": URDF,
        "xacro": URDF,
        "sdf": SDF,
        "world": SDF,
        "mjcf": MJCF,
        "mujoco": MJCF,
    },
    _checked_format,
)
"""By the suffix in lower case without the dot, and for files of XML by the name of the root element."""


def description_format(
    path: Path, xacro_arguments: Mapping[str, str] | None = None, otherwise: DescriptionFormat | None = None
) -> DescriptionFormat | None:
    """Return the format of a file by its root element, or by its suffix, or `otherwise` where none has it.

    Raises
    ------
    InputError
        If the file cannot be read, or arguments are given for what is no xacro.
    """
    chosen = _chosen_format(path) or otherwise
    if xacro_arguments:
        if chosen is not URDF:
            raise InputError(f"{path}: it is no xacro, so it takes no arguments; remove xacro_arguments")
        return UrdfFormat(xacro_arguments)
    return chosen


def _chosen_format(path: Path) -> DescriptionFormat | None:
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in SUFFIXES:
        return DESCRIPTION_FORMATS.get(suffix) if suffix else None
    root = _root(read_bytes(path, remedy="give a robot description"))
    named = DESCRIPTION_FORMATS.get(root) if root else None
    return named or (URDF if suffix == "xml" else DESCRIPTION_FORMATS.get(suffix))


def _root(content: bytes) -> str:
    """Return the name of the first element; empty where something else stands in its place."""
    place = content.find(b"<")
    # Each piece is looked at once, so that a file of nothing but beginnings of comments takes no time.
    while place >= 0 and (passed := _BEFORE_ROOT.match(content, place)):
        place = content.find(b"<", passed.end())
    root = _ROOT.match(content, place) if place >= 0 else None
    return root[1].decode("ascii") if root else ""


def read_description(
    path: Path,
    tip: str | None = None,
    locked: Locked = (),
    gravity: ArrayLike | None = None,
    xacro_arguments: Mapping[str, str] | None = None,
    otherwise: DescriptionFormat | None = None,
) -> Robot:
    """Read a robot from a file in any of the formats, or `otherwise` in this one; see `DescriptionFormat.read`.

    Gravity that is not given is that of the file, or 9.81 m/s² against z where the format does not tell it.

    Raises
    ------
    InputError
        If no format has the suffix, or the file does not describe a robot.
    """
    chosen = description_format(path, xacro_arguments, otherwise)
    if chosen is None:
        known = ", ".join(f"a .{name}" for name in DESCRIPTION_FORMATS.names() if name not in ROOTS)
        got = "a folder" if path.is_dir() else f"the suffix {path.suffix!r}" if path.suffix else "no suffix"
        got = got if path.exists() else f"{got}, and nothing is there"
        raise InputError(f"{path}: a robot is described by {known} or a .toml file, got {got}; give the path of one.")
    if gravity is None and not chosen.tells_gravity:
        gravity = STANDARD_GRAVITY
    if isinstance(chosen, UrdfFormat):
        return chosen.read(path, tip, locked, gravity)
    with faults_told(f"{path} cannot be read", "mend the file, or the package that reads it"):
        robot = chosen.read(path, tip, locked, gravity)
        if not isinstance(robot, Robot):
            raise TypeError(f"expected a steelyard.Robot, got {shown(robot)}")
        return replace(robot, source=path)
