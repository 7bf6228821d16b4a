"""``steelyard reproduce``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.terminal import echo, progress

__all__ = ["reproduce"]


def reproduce(
    section: Annotated[
        list[str] | None, typer.Argument(help="Sections such as 4.2 or 6; all of them where none is named.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the tables, figures and the page.")] = Path(
        "steelyard-reproduction"
    ),
    data: Annotated[
        Path | None, typer.Option(envvar="STEELYARD_DATA", help="Folder of the real recordings, where you have it.")
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute anew what was computed before.")] = False,
) -> None:
    """Compute the tables and figures of Sousa's thesis (2014) again, and show them beside the published ones."""
    from steelyard_thesis.reproduction import reproduce as run

    with progress() as say:
        result = run(output, section or (), data=data, fresh=fresh, progress=say)
    for part, why in result.missing:
        echo(f"Not computed: {part.heading}: {why}")
    echo(f"{result.agreeing} of {result.published} published values agree.")
    echo(f"Look at {result.page}")
