"""``steelyard reduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import LOG, AllowExtensions, Json, Quiet, RobotArgument, Topic
from .robot_argument import SetLines, load_robot
from .terminal import progress, show

__all__ = ["reduce"]


def reduce(
    robot: RobotArgument,
    logs: Annotated[
        list[str], typer.Argument(metavar="LOG...", help=f"{LOG} A .json that this command wrote is added.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="File for the Information, such as day.json.")],
    topic: Topic = None,
    lines: SetLines = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Reduce logs to the sums from which the robot is estimated: a small file, however long they are.

    Files of days add up, and `steelyard fleet` takes them in the place of logs.

    \b
    Examples:
      steelyard reduce robot.toml run1.csv --output day1.json
      steelyard reduce robot.toml day1.json run2.csv --output both.json
    """
    from steelyard.files.writing import require_unread
    from steelyard.fleet import DataSet, reduce_data_sets

    file = load_robot(robot, lines, topic=topic, allow_extensions=allow_extensions)
    require_unread(output, robot, file.robot.source, *logs)
    with progress(quiet=quiet):
        [found] = reduce_data_sets([DataSet(file, logs, rotors=True)])
    show(found, output, json=json, quiet=quiet)
