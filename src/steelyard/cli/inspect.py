"""``steelyard inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, ConsistencyOption
from .terminal import show_model

__all__ = ["inspect"]


def inspect(
    robot: Annotated[Path, typer.Argument(help="URDF or robot.toml.")],
    consistency: ConsistencyOption = "full",
    allow_extensions: AllowExtensions = False,
) -> None:
    """Show joints, parameters, base parameters and operation counts, and whether the CAD is physically possible."""
    from steelyard.dynamics import Model

    show_model(Model.load(robot, allow_extensions=allow_extensions), consistency)
