"""``steelyard compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import AllowExtensions, Json, JsonFile, Quiet
from .terminal import echo, progress, show

__all__ = ["compare"]


def compare(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="A B...",
            help="Results or estimate.json files of one robot; a description is its CAD.",
        ),
    ],
    robot: Annotated[
        Path | None, typer.Option(help="URDF or robot.toml; that of A's record where it is still there.")
    ] = None,
    log: Annotated[
        list[str] | None, typer.Option("--log", help="Log on which predictions are compared; may be repeated.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the random motion, where there is no log.", min=0)] = 0,
    page: Annotated[
        Path | None, typer.Option("--page", help="HTML file that shows the results beside each other.")
    ] = None,
    output: JsonFile = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell which parameters differ beyond their intervals, and how predictions differ: exit 0 nothing, 1 something.

    Each is compared with A. Two logs of the same robot differ in nothing in 95 of 100 cases.

    \b
    Examples:
      steelyard compare result estimate.json
      steelyard compare result estimate.json --log run2.csv --output differences.json
      steelyard compare robot.toml result --page comparison.html
    """
    from steelyard.files.writing import require_unread
    from steelyard.identification import compare_estimates
    from steelyard.regression.estimate import estimate_file
    from steelyard.robot import RobotFile

    file = None if robot is None else RobotFile.load(robot, allow_extensions=allow_extensions)
    for place in (output, page):
        read = (None if file is None else file.robot.source, *map(estimate_file, results), *(log or ()))
        require_unread(place, robot, *read)
    with progress(quiet=quiet) as say:
        found = compare_estimates(results, robot=file, logs=log or [], seed=seed, progress=say)
    if page is not None:
        from steelyard.report import write_comparison

        write_comparison(found, page)
    show(found, output, json=json, quiet=quiet)
    if page is not None and not json and not quiet:
        echo(f"Look at {page}")
    if found.differs:
        raise typer.Exit(1)
