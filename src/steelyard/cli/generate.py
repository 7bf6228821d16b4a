"""``steelyard generate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from steelyard.errors import InputError

from .choices import AllowExtensions, Quiet, RobotArgument
from .terminal import echo, progress

__all__ = ["generate"]


def generate(
    robot: RobotArgument,
    language: Annotated[
        str | None,
        typer.Option(
            help="c, cpp, python, rust, julia, octave, matlab, casadi or jax, or a language that a package adds."
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; made where it is missing.")
    ] = None,
    function: Annotated[
        list[str] | None,
        typer.Option("--function", "-f", help="Function to write, may be repeated; 'list' names them all."),
    ] = None,
    base: Annotated[bool, typer.Option("--base", help="In base parameters instead of standard ones.")] = False,
    gravity: Annotated[
        Literal["fixed", "argument"],
        typer.Option(help="The robot's gravity, or an argument of the functions that depend on it."),
    ] = "fixed",
    sign: Annotated[
        Literal["exact", "smooth"],
        typer.Option(help="Sign of Coulomb friction; a smooth one has its width as an argument."),
    ] = "exact",
    estimate: Annotated[
        Path | None,
        typer.Option(help="Folder of results, or estimate.json, whose parameters stand in the source as numbers."),
    ] = None,
    online: Annotated[
        bool, typer.Option("--online", help="The estimator that runs in a controller while the robot moves, as C99.")
    ] = False,
    cad: Annotated[bool, typer.Option("--cad", help="The description's own values stand in the source.")] = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Write the model of a robot as source code: functions with documentation, sizes and a self-test.

    \b
    Examples:
      steelyard generate robot.toml --language c --output code
      steelyard generate robot.toml --language rust --function gravity --estimate estimate.json --output crate
      steelyard generate robot.toml --function list
      steelyard generate robot.toml --online --output estimator
    """
    from steelyard.identification import model_of_estimate, parameters_for_source
    from steelyard.robot import RobotFile

    if online:
        _estimator(robot, language, output, function or base or estimate or cad, quiet, allow_extensions)
        return
    model = model_of_estimate(None if cad else estimate, RobotFile.load(robot, allow_extensions=allow_extensions))
    if function == ["list"]:
        echo("\n".join(model.functions))
        return
    if language is None or output is None:
        raise InputError("Give --language and --output: what to write, and the folder for it.")
    parameters = parameters_for_source(model, estimate, cad=cad, base=base)
    with progress(quiet=quiet):
        written = model.generate(
            language,
            function or None,
            directory=output,
            base=base,
            gravity=gravity,
            sign=sign,
            parameters=parameters,
        )
    for path in written:
        echo(path)
    if cad and not quiet and (open_terms := model.terms_left_open):
        echo(
            f"Note: the description does not state these terms, which are 0 in the source: {open_terms}. State them in "
            "the description, or give an --estimate."
        )


def _estimator(
    robot: Path, language: str | None, output: Path | None, further: object, quiet: bool, allow_extensions: bool
) -> None:
    """Write the estimator for a controller."""
    from steelyard.feasibility import FeasibleSet
    from steelyard.identification import model_of_estimate
    from steelyard.identification.given import given_constraints
    from steelyard.online import generate_online
    from steelyard.robot import RobotFile

    if output is None:
        raise InputError("Give --output: the folder for the estimator.")
    if further:
        raise InputError("--online writes the estimator alone; leave out --function, --base, --estimate and --cad.")
    file = RobotFile.load(robot, allow_extensions=allow_extensions)
    with progress(quiet=quiet):
        feasible_set = FeasibleSet(model_of_estimate(None, file), constraints=given_constraints(file))
        written = generate_online(feasible_set, output, language=language or "c")
    for path in written:
        echo(path)
