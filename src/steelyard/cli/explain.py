"""``steelyard explain``."""

from __future__ import annotations

import typer

from .choices import AllowExtensions, ConsistencyOption, EstimateArgument, JsonFile, RobotArgument
from .terminal import echo

__all__ = ["explain"]


def explain(
    robot: RobotArgument,
    estimate: EstimateArgument,
    output: JsonFile = None,
    consistency: ConsistencyOption = "full",
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell why an estimate is impossible, or which values of each parameter are possible: exit 0 feasible, 1 not.

    \b
    Examples:
      steelyard explain robot.toml estimate.json
    """
    from steelyard.identification import explain_estimate
    from steelyard.robot import RobotFile

    file = RobotFile.load(robot, allow_extensions=allow_extensions)
    explanation = explain_estimate(file, estimate, consistency)
    echo(str(explanation))
    if output is not None:
        explanation.save(output)
        echo(f"Written to {output}")
    if not explanation.feasible:
        raise typer.Exit(1)
