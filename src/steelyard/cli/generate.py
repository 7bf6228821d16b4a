"""``steelyard generate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import Gravity, Language

__all__ = ["generate"]


def generate(
    robot: Annotated[Path, typer.Argument(help="URDF or robot.toml.")],
    language: Annotated[Language, typer.Option(help="Language of the source.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the files; made where it is missing.")],
    function: Annotated[
        list[str] | None,
        typer.Option("--function", "-f", help="Function to write, may be repeated; 'list' names them all."),
    ] = None,
    base: Annotated[bool, typer.Option("--base", help="In base parameters instead of standard ones.")] = False,
    gravity: Annotated[Gravity, typer.Option(help="The robot's gravity, or an argument.")] = Gravity.FIXED,
    estimate: Annotated[
        Path | None, typer.Option(help="estimate.json, whose parameters stand in the source as numbers.")
    ] = None,
) -> None:
    """Write the model of a robot as source code: functions with documentation, sizes and a self-test."""
    from steelyard.dynamics import Model
    from steelyard.identification import parameters_of_estimate

    model = Model.load(robot)
    if function == ["list"]:
        typer.echo("\n".join(model.functions))
        return
    values = None if estimate is None else parameters_of_estimate(model, estimate, base=base)
    options = {"functions": function} if function else {}
    written = model.generate(
        language.value, directory=output, base=base, gravity=gravity.value, parameters=values, **options
    )
    for path in written:
        typer.echo(path)
