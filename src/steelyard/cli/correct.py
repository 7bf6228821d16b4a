"""``steelyard correct``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from .choices import AllowExtensions, ConsistencyOption, EstimateArgument, Quiet, RobotArgument
from .terminal import echo, progress

__all__ = ["correct"]


def correct(
    robot: RobotArgument,
    estimate: EstimateArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="File for the corrected estimate (JSON).")],
    consistency: ConsistencyOption = "full",
    metric: Annotated[
        Literal["deviation", "euclidean"],
        typer.Option(help="Base parameters count in units of their standard deviations, or all in SI units."),
    ] = "deviation",
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Write the physically possible estimate that is nearest to another one.

    \b
    Examples:
      steelyard correct robot.toml estimate.json --output corrected.json
    """
    from steelyard.files.writing import require_unread
    from steelyard.identification import correct_estimate
    from steelyard.regression.estimate import estimate_file
    from steelyard.robot import RobotFile

    file = RobotFile.load(robot, allow_extensions=allow_extensions)
    require_unread(output, robot, file.robot.source, estimate_file(estimate))
    with progress(quiet=quiet):
        corrected = correct_estimate(file, estimate, consistency, metric)
    corrected.save(output)
    echo(corrected.remarks[-1])
    if not quiet:
        echo(f"Written to {output}")
