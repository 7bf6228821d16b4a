"""``steelyard demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import Quiet, Verbose
from .results_folder import require_results_folder
from .terminal import echo, progress, show_identification

__all__ = ["demo"]


def demo(
    context: typer.Context,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for everything.")] = Path("steelyard-demo"),
    seed: Annotated[int, typer.Option(help="Seed of the simulated noise.", min=0)] = 2014,
    verbose: Verbose = False,
    quiet: Quiet = False,
) -> None:
    """Simulate the seven-joint WAM arm with wrong CAD, identify it, and show the answer beside the truth.

    \b
    Examples:
      steelyard demo
      steelyard demo --output arm --seed 7
    """
    from steelyard.identification import demonstrate
    from steelyard.identification.wam import beside_truth
    from steelyard.report import save_results

    require_results_folder(context, output)
    with progress(quiet=quiet) as say:
        result = demonstrate(output, seed=seed, progress=say)
        say("writing the report")
        save_results(result, output / "result")
    if quiet:
        echo(result.headline)
        return
    show_identification(result, verbose=verbose)
    assert result.parameters is not None
    table, sentence = beside_truth(result.parameters, symbols="mtcFI" if verbose else "mt")
    echo("The truth of this simulated arm, CAD that is wrong by tens of percent, and the answer:")
    echo(table)
    echo(sentence)
    echo(f"Look at {output / 'result' / 'report.html'}")
