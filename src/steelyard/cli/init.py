"""``steelyard init``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import Quiet, Topic
from .results_folder import require_results_folder
from .robot_argument import SetLines, given_sections
from .terminal import echo, progress

__all__ = ["init"]


def init(
    context: typer.Context,
    robot: Annotated[Path, typer.Argument(help="Description: a URDF, an SDF and so on.")],
    log: Annotated[
        str | None, typer.Argument(help="A log of it, by which columns, terms and filter are chosen; a.csv+b.csv.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to write.")] = Path("robot.toml"),
    topic: Topic = None,
    lines: SetLines = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file where it exists.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write a robot.toml with everything that a description and a log tell, each guess with its reason.

    \b
    Examples:
      steelyard init my_robot.urdf --output first.toml
      steelyard init my_robot.urdf run1.csv --output second.toml
    """
    import os

    from steelyard.errors import InputError
    from steelyard.files import write_text
    from steelyard.files.writing import require_unread
    from steelyard.identification import first_robot_file

    if os.path.lexists(output) and not force:
        raise InputError(f"{output} exists and is not overwritten; give another place with --output, or --force.")
    require_unread(output, robot, log)
    require_results_folder(context, output.parent)
    with progress(quiet=quiet) as say:
        made = first_robot_file(
            robot, log, folder=output.parent, topic=topic, settings=given_sections(lines or ()), progress=say
        )
    write_text(made.text, output)
    incomplete = f" {made.to_complete}" if made.to_complete else ""
    if quiet:
        echo(f"Wrote {output}.{incomplete}")
        return
    echo(made)
    if made.examination is not None:
        for finding in made.examination.findings:
            statement = finding.statement
            if "constraints" not in finding.remedy:  # these are left to the user, other lines are in the file
                statement = statement.replace("with the line below", f"with what {output.name} says now")
            echo(f"Of the log: {statement}{f' {finding.advice}' if finding.advice else ''}")
    next_step = "Then go on" if incomplete else "Go on"
    echo(f"Wrote {output}.{incomplete} {next_step} with: steelyard identify {output} {log or 'LOG'} --output result")
