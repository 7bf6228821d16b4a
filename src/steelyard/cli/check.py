"""``steelyard check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import Consistency

__all__ = ["check"]


def check(
    robot: Annotated[Path, typer.Argument(help="URDF or robot.toml.")],
    estimate: Annotated[Path, typer.Argument(help="estimate.json.")],
    consistency: Consistency = Consistency.FULL,
) -> None:
    """Tell whether a robot with these parameters could exist: exit 0 feasible, 1 infeasible, 2 bad input."""
    from steelyard.identification import check_estimate

    verdict = check_estimate(robot, estimate, consistency.value)
    typer.echo(str(verdict))
    if not verdict.feasible:
        raise typer.Exit(1)
