"""``steelyard doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import LOG, AllowExtensions, Json, Quiet, Topic
from .robot_argument import SetLines, load_robot
from .terminal import echo, print_json, progress

__all__ = ["doctor"]


def doctor(
    log: Annotated[str, typer.Argument(help=LOG)],
    robot: Annotated[
        Path | None, typer.Argument(help="Description or robot.toml; with it more is found, and columns have joints.")
    ] = None,
    topic: Topic = None,
    lines: SetLines = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Say what is wrong with a recording and which line of robot.toml mends it: exit 1 where something is wrong.

    \b
    Examples:
      steelyard doctor run1.csv robot.toml
      steelyard doctor run1.csv robot.toml --json --quiet
    """
    from steelyard.errors import InputError
    from steelyard.identification import examine

    if robot is None and lines:
        raise InputError("--set changes lines of a robot file, and none is given; give ROBOT, too.")
    file = None if robot is None else load_robot(robot, lines, allow_extensions=allow_extensions)
    with progress(quiet=quiet) as say:
        found = examine(log, file, topic=topic, progress=say)
    if json:
        print_json(found.to_dict())
    else:
        echo(found)
    if found.findings:
        raise typer.Exit(1)
