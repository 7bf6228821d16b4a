"""The robot of a command line: a robot file or a description, and lines of robot.toml that are given as options."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .terminal import SECTIONS

if TYPE_CHECKING:
    from steelyard.robot import RobotFile

__all__ = ["SetLines", "given_sections", "lines_told", "load_robot"]

SetLines = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SECTION.KEY=VALUE",
        help="A line of robot.toml in place of its own, for a URDF too, such as log.rate=500; may be repeated.",
    ),
]


def load_robot(
    robot: str | Path,
    lines: Sequence[str] | None = None,
    *,
    topic: Sequence[str] | None = None,
    allow_extensions: bool = False,
) -> RobotFile:
    """Return a robot file with the lines that ``--set`` gives, and the topics that ``--topic`` names.

    Raises
    ------
    InputError
        If the file cannot be used, or a line is none.
    """
    from steelyard.robot import RobotFile

    file = RobotFile.load(robot, allow_extensions=allow_extensions)
    for section, keys in given_sections(lines or ()).items():
        file = file.with_settings(section, **keys)
    return file.with_settings("log", topic=topic or None)


def given_sections(lines: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the keys that ``--set`` gives, by section."""
    from steelyard.errors import InputError
    from steelyard.files import suggestion

    found: dict[str, dict[str, Any]] = {}
    for line in lines:
        name, equals, value = line.partition("=")
        section, dot, key = name.strip().partition(".")
        if not (equals and dot and key and value.strip()):
            raise InputError(f"--set {line!r} is no line of robot.toml; write SECTION.KEY=VALUE, such as log.rate=500.")
        if section not in SECTIONS:
            raise InputError(f"--set {line!r}: {section!r} cannot be set; {suggestion(section, SECTIONS)}")
        found.setdefault(section, {})[key.strip()] = _value(value.strip())
    return found


def _value(text: str) -> Any:
    """Return a value as TOML has it; what is no TOML is a text without its quotes, which shells take away."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def lines_told(message: str, arguments: Sequence[str]) -> str:
    """Return a message that names lines of robot.toml, with what to do where the robot is a plain description.

    The arguments are the command line, from the name of the command.

    Examples
    --------
    >>> lines_told("a.csv has no column of time; name it with `time` in [log].", ["identify", "arm.urdf", "a.csv"])
    'a.csv has no column of time; name it with `time` in [log] (arm.urdf has no such section: add --set log.time=..., or
    write a robot.toml with: steelyard init arm.urdf LOG).'
    """
    named = [section for section in SECTIONS if f"[{section}]" in message]
    robots = [one for one in arguments[1:] if one.lower().endswith((".urdf", ".xacro", ".xml", ".mjcf", ".sdf"))]
    has_file = arguments[0] != "init" and any(one.lower().endswith(".toml") for one in arguments[1:])
    if not named or not robots or "--set" in arguments or has_file:
        return message
    if arguments[0] not in ("identify", "validate", "payload", "doctor", "init"):
        return message
    section = named[0]
    key = _key(message, section)
    other = "" if arguments[0] == "init" else f", or write a robot.toml with: steelyard init {robots[0]} LOG"
    if "[drive]" in message:  # a log without torques, which init refuses as well
        other = f", or write a robot.toml without the log: steelyard init {robots[0]}"
    hint = f"({robots[0]} has no such section: add --set {section}.{key}=...{other})"
    return f"{message.rstrip().removesuffix('.')} {hint}."


def _key(message: str, section: str) -> str:
    """Return the key of a section that a message names in backticks, the last one before the section."""
    import re

    before = message[: message.index(f"[{section}]")]
    keys = re.findall(r"`(\w+)[^`]*`", before)
    return keys[-1] if keys else "KEY"
