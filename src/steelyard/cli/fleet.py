"""``steelyard fleet``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import ClusterAddress, Json, Quiet, Tls, Workers
from .many_logs import executor_of
from .results_folder import require_results_folder
from .terminal import echo, print_json, progress

__all__ = ["fleet"]


def fleet(
    context: typer.Context,
    manifest: Annotated[Path, typer.Argument(help="TOML, CSV or Parquet that names robots and their data.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")],
    workers: Workers = 1,
    cluster: ClusterAddress = None,
    tls: Tls = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate many robots; tell which differ, fall into batches or have drifted: exit 0 none, 1 some.

    Exits 1, too, where no parameters explain the data of a robot, or the model does not predict it. Exits 3 where
    nothing came of some entry, or a log of several was left out because it cannot be used; the others are there.

    \b
    Examples:
      steelyard fleet fleet.toml --output result
      steelyard fleet robots.csv --output result --workers 4 --json
    """
    from steelyard.fleet import Checkpoints, FleetManifest, identify_fleet
    from steelyard.report import require_apart, save_fleet
    from steelyard.report.fleet_results import FLEET_FILES

    read = FleetManifest.load(manifest)
    executor = executor_of(workers, cluster, tls)
    require_results_folder(context, output)
    require_apart(output, (read.path, read.table), FLEET_FILES)
    with Checkpoints(output) as checkpoints, progress(quiet=quiet) as say:
        found = identify_fleet(read, executor=executor, checkpoints=checkpoints, progress=say)
        say("writing the tables and the page")
        written = save_fleet(found, output, stale=checkpoints.names)
    if json:
        print_json({**found.to_dict(), "files": [str(path) for path in written]})
    elif quiet:
        echo(found.headline)
    else:
        echo(found)
        echo(f"Look at {output / 'fleet.html'}")
    if found.failed or found.left_out:
        raise typer.Exit(3)
    if found.findings or found.unexplained or found.unpredicted:
        raise typer.Exit(1)
