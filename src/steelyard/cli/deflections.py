"""``steelyard deflections``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, EstimateArgument, Json, JsonFile, Logs, Quiet, RobotArgument, Topic
from .robot_argument import SetLines, load_robot
from .terminal import progress, show

__all__ = ["deflections"]


def deflections(
    robot: RobotArgument,
    estimate: EstimateArgument,
    logs: Logs,
    samples: Annotated[
        Path | None, typer.Option("--samples", help="File for the deflections of every row: .csv, .npz or .parquet.")
    ] = None,
    output: JsonFile = None,
    topic: Topic = None,
    lines: SetLines = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Predict how far elastic joints deflect in any recording, and compare with second encoders where it has them.

    The robot was identified with a section [elastic] in robot.toml.

    \b
    Examples:
      steelyard deflections robot.toml result run2.csv
      steelyard deflections robot.toml result run2.csv --samples deflections.csv
    """
    from steelyard.errors import InputError
    from steelyard.files.writing import require_unread
    from steelyard.identification import predict_deflections
    from steelyard.regression.estimate import estimate_file

    if samples is not None and len(logs) > 1:
        raise InputError(f"{samples}: holds the deflections of one log, got {len(logs)} logs; give one at a time.")
    file = load_robot(robot, lines, topic=topic, allow_extensions=allow_extensions)
    for place in (output, samples):
        require_unread(place, robot, file.robot.source, estimate_file(estimate), *logs)
    with progress(quiet=quiet) as say:
        found = predict_deflections(file, estimate, logs, progress=say)
    show(found, output, json=json, quiet=quiet)
    if samples is not None:
        found.logs[0].save_samples(samples)
