"""``steelyard explain``."""

from __future__ import annotations

import typer

from .choices import AllowExtensions, ConsistencyOption, EstimateArgument, Json, JsonFile, Quiet, RobotArgument
from .terminal import progress, show

__all__ = ["explain"]


def explain(
    robot: RobotArgument,
    estimate: EstimateArgument,
    output: JsonFile = None,
    consistency: ConsistencyOption = "full",
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell why an estimate is impossible, or which values of each parameter are possible: exit 0 feasible, 1 not.

    \b
    Examples:
      steelyard explain robot.toml estimate.json
      steelyard explain robot.toml estimate.json --json --quiet
    """
    from steelyard.files.writing import require_unread
    from steelyard.identification import explain_estimate
    from steelyard.regression.estimate import estimate_file
    from steelyard.robot import RobotFile

    file = RobotFile.load(robot, allow_extensions=allow_extensions)
    require_unread(output, robot, file.robot.source, estimate_file(estimate))
    with progress(quiet=quiet):
        explanation = explain_estimate(file, estimate, consistency)
    show(explanation, output, json=json, quiet=quiet)
    if not explanation.feasible:
        raise typer.Exit(1)
