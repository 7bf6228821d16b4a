"""``steelyard inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, ConsistencyOption, Json
from .terminal import print_json, show_model

__all__ = ["inspect"]


def inspect(
    robot: Annotated[Path, typer.Argument(help="URDF or robot.toml.")],
    consistency: ConsistencyOption = "full",
    json: Json = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Show joints, parameters, base parameters and operation counts, and whether the CAD is physically possible.

    \b
    Examples:
      steelyard inspect robot.toml
      steelyard inspect my_robot.urdf --json
    """
    from steelyard.dynamics import Model
    from steelyard.identification.inspection import inspection

    model = Model.load(robot, allow_extensions=allow_extensions)
    if json:
        print_json(inspection(model, consistency))
    else:
        show_model(model, consistency)
