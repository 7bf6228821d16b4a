"""``steelyard doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, Topic
from .terminal import echo, progress

__all__ = ["doctor"]


def doctor(
    log: Annotated[
        str, typer.Argument(help="Such as a CSV or a bag; - is the standard input; side by side: a.csv+b.csv.")
    ],
    robot: Annotated[
        Path | None, typer.Argument(help="Description or robot.toml; with it more is found, and columns have joints.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON document.")] = False,
    topic: Topic = None,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Say what is wrong with a recording and which line of robot.toml mends it: exit 1 where something is wrong."""
    import json

    from steelyard.files.writing import plain
    from steelyard.identification import examine
    from steelyard.robot import RobotFile

    file = None if robot is None else RobotFile.load(robot, allow_extensions=allow_extensions)
    with progress() as say:
        found = examine(log, file, topic=topic, progress=say)
    if as_json:
        echo(json.dumps(plain(found.to_dict()), indent=1, ensure_ascii=False))
    else:
        for line in str(found).splitlines():
            echo(line)
    if found.findings:
        raise typer.Exit(1)
