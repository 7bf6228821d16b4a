"""``steelyard validate``."""

from __future__ import annotations

import typer

from .choices import (
    CHUNK_ROWS,
    AllowExtensions,
    ChunkRows,
    EstimateArgument,
    Json,
    JsonFile,
    Logs,
    Quiet,
    RobotArgument,
    Topic,
)
from .robot_argument import SetLines, load_robot
from .terminal import progress, show

__all__ = ["validate"]


def validate(
    robot: RobotArgument,
    estimate: EstimateArgument,
    logs: Logs,
    output: JsonFile = None,
    chunk_rows: ChunkRows = CHUNK_ROWS,
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
    from steelyard.files.writing import require_unread
    from steelyard.identification import validate_estimate
    from steelyard.regression.estimate import estimate_file

    file = load_robot(robot, lines, topic=topic, allow_extensions=allow_extensions)
    require_unread(output, robot, file.robot.source, estimate_file(estimate), *logs)
    with progress(quiet=quiet) as say:
        found = validate_estimate(file, estimate, logs, chunk_rows=chunk_rows, progress=say)
    show(found, output, json=json, quiet=quiet)
    if found.prediction.word == "wrong":
        raise typer.Exit(3)
