"""``steelyard explain``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, ConsistencyOption
from .terminal import echo

__all__ = ["explain"]


def explain(
    robot: Annotated[Path, typer.Argument(help="URDF or robot.toml.")],
    estimate: Annotated[Path, typer.Argument(help="The estimate.json that identify saved.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="File for the same as JSON.")] = None,
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
