"""``steelyard inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from steelyard.errors import InputError

from .choices import AllowExtensions, ConsistencyOption, Json, RobotArgument
from .terminal import echo, print_json, show_model, show_preflight

__all__ = ["inspect"]


def inspect(
    robot: RobotArgument,
    consistency: ConsistencyOption = "full",
    json: Json = False,
    repair: Annotated[
        bool, typer.Option("--repair", help="Write the nearest possible description, in its own format, to --output.")
    ] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file that --repair writes.")] = None,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Show joints, parameters, base parameters and operation counts, and whether the CAD is physically possible.

    Every link is compared with its shape; units, decimals, signs, axes, copies and placeholders that are probably wrong
    are named.

    \b
    Examples:
      steelyard inspect robot.toml
      steelyard inspect my_robot.urdf --json
      steelyard inspect my_robot.urdf --repair --output repaired.urdf
    """
    from steelyard.dynamics import Model
    from steelyard.files import listed
    from steelyard.files.writing import require_unread
    from steelyard.identification.preflight import preflight
    from steelyard.report.inspection import inspection

    model = Model.load(robot, allow_extensions=allow_extensions)
    if repair != (output is not None):
        raise InputError("--repair writes a file: give both --repair and --output FILE, or neither.")
    require_unread(output, robot, model.robot.source)
    if not json:
        show_model(model, consistency)
    findings = preflight(model.robot)
    told = inspection(model, consistency, findings) if json else {}
    if not json:
        show_preflight(findings)
    if output is not None:
        changes = findings.write(output)
        told["repaired"] = {"file": str(output), "changes": dict(changes)}
        if not json:
            lines = [f"{link}: {change}" for link, change in changes]
            if left := [one.link for one in findings.findings if one.mended is None]:
                lines.append(f"No numbers follow from what is said of {listed(left)}: left as it was.")
            wrote = "written" if changes else "written as it was"
            echo("\n".join([*lines, f"{output}: {wrote}{'' if findings.findings else '; nothing was wrong'}."]))
    if json:
        print_json(told)
