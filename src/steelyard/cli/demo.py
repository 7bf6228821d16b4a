"""``steelyard demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .screen import echo
from .terminal import progress, show_identification

__all__ = ["demo"]


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for everything.")] = Path("steelyard-demo"),
    seed: Annotated[int, typer.Option(help="Seed of the simulated noise.", min=0)] = 2014,
) -> None:
    """Simulate the seven-joint WAM arm, identify it, and show why plain least squares is not enough."""
    from steelyard.identification import demonstrate
    from steelyard.report import require_folder, save_results

    require_folder(output)
    with progress() as say:
        result = demonstrate(output, seed=seed, progress=say)
        say("writing the report")
        save_results(result, output / "result")
    show_identification(result)
    echo(f"Look at {output / 'result' / 'report.html'}")
