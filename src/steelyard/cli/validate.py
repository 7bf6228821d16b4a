"""``steelyard validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, Json, Quiet, Topic
from .robot_argument import SetLines, load_robot
from .terminal import progress, show

__all__ = ["validate"]


def validate(
    robot: Annotated[Path, typer.Argument(help="URDF or robot.toml.")],
    estimate: Annotated[Path, typer.Argument(help="Folder of results, or estimate.json.")],
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...", help="Such as a CSV or a bag; - is the standard input; side by side: a.csv+b.csv."
        ),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File for the same as JSON.")] = None,
    chunk_rows: Annotated[int, typer.Option(help="Rows of a log that stand in memory together.", min=1000)] = 200_000,
    topic: Topic = None,
    lines: SetLines = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell how well a saved estimate predicts logs that it has not seen: exit 3 where it does not.

    The logs are processed as those of the estimate were.

    \b
    Examples:
      steelyard validate robot.toml result run2.csv
      steelyard validate robot.toml estimate.json run1.csv run2.csv --json
    """
    from steelyard.identification import validate_estimate

    file = load_robot(robot, lines, allow_extensions=allow_extensions).with_settings("log", topic=topic)
    with progress(quiet=quiet) as say:
        found = validate_estimate(file, estimate, logs, chunk_rows=chunk_rows, progress=say)
    show(found, output, json=json, quiet=quiet)
    if found.prediction.word == "wrong":
        raise typer.Exit(3)
