"""``steelyard validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, Topic
from .terminal import echo, progress

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
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell how well a saved estimate predicts logs that it has not seen: exit 3 where it does not.

    The logs are processed as those of the estimate were.
    """
    from steelyard.identification import validate_estimate
    from steelyard.robot import RobotFile

    file = RobotFile.load(robot, allow_extensions=allow_extensions).with_settings("log", topic=topic)
    with progress() as say:
        found = validate_estimate(file, estimate, logs, chunk_rows=chunk_rows, progress=say)
    echo(str(found))
    if output is not None:
        found.save(output)
        echo(f"Written to {output}")
    if found.prediction.word == "wrong":
        raise typer.Exit(3)
