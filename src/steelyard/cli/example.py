"""``steelyard example``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import Quiet
from .terminal import echo, progress

__all__ = ["example"]


def example(
    name: Annotated[str | None, typer.Argument(help="Name of an example; without it they are listed.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the example; steelyard-NAME where not given.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Write a complete folder to try things on: a robot, two logs, a robot.toml, and what must come out.

    \b
    Examples:
      steelyard example
      steelyard example panda --output panda
    """
    from steelyard.identification.examples import list_examples, write_example

    if name is None:
        echo(list_examples())
        return
    with progress(quiet=quiet) as say:
        folder = write_example(name, output or Path(f"steelyard-{name}"), progress=say)
    if quiet:
        echo(folder)
        return
    echo(f"Wrote {folder}: robot.urdf, robot.toml, train.csv, validate.csv, truth.json and README.md.")
    echo(
        f"Go on with: steelyard identify {folder / 'robot.toml'} {folder / 'train.csv'} "
        f"--validate {folder / 'validate.csv'} --output {folder / 'result'}"
    )
