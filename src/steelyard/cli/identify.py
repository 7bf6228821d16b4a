"""``steelyard identify``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from .choices import (
    CHUNK_ROWS,
    LOG,
    AllowExtensions,
    ChunkRows,
    ClusterAddress,
    ConsistencyOption,
    Json,
    Quiet,
    RobotArgument,
    Tls,
    Topic,
    Verbose,
    WeightsOption,
    Workers,
    given_options,
)
from .many_logs import many_logs
from .results_folder import require_results_folder
from .robot_argument import SetLines, load_robot
from .terminal import echo, print_json, progress, show_identification

if TYPE_CHECKING:
    from steelyard.robot import RobotFile

__all__ = ["identify"]


def identify(
    context: typer.Context,
    robot: RobotArgument,
    logs: Annotated[
        list[str], typer.Argument(metavar="LOG...", help=f"{LOG} A .json of steelyard reduce stands for its logs.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")],
    validate: Annotated[
        list[str] | None, typer.Option("--validate", help="Log that is predicted without refitting; may be repeated.")
    ] = None,
    consistency: ConsistencyOption = "full",
    weights: WeightsOption = "joint",
    prior: Annotated[
        Literal["auto", "none"],
        typer.Option(help="What the answer stays near: what is known of the robot, or nothing."),
    ] = "auto",
    prior_weight: Annotated[
        float | None, typer.Option(help="Weight of that; chosen by cross-validation where absent.", min=0.0)
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Write the description even where the model does not predict the robot.")
    ] = False,
    prefer: Annotated[
        Literal["auto", "cad", "lightest"],
        typer.Option(help="The choice among near-equal answers (auto: closest to CAD where there is one)."),
    ] = "auto",
    residual_slack: Annotated[
        float, typer.Option(help="Fraction of the squared residual that this choice may cost.", min=0.0, max=1.0)
    ] = 5e-4,
    estimator: Annotated[
        str,
        typer.Option(
            help="What estimates the parameters: fit, maximum_likelihood, bayesian, momentum, energy, "
            "instrumental_variables, output_error, or one that a package adds."
        ),
    ] = "fit",
    measured: Annotated[
        Literal["torques", "positions"],
        typer.Option("--from", help="What the logs hold beside motion: torques, or commands of positions alone."),
    ] = "torques",
    friction: Annotated[
        Literal["stated", "auto"],
        typer.Option(help="Friction: that of the terms, or with the laws that the logs call for."),
    ] = "stated",
    chunk_rows: ChunkRows = CHUNK_ROWS,
    workers: Workers = 1,
    cluster: ClusterAddress = None,
    tls: Tls = None,
    table: Annotated[bool, typer.Option("--table", help="Print all the parameters, as in parameters.csv.")] = False,
    verbose: Verbose = False,
    topic: Topic = None,
    lines: SetLines = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Identify a robot's dynamic parameters from its logs, physically feasible, with a report.

    \b
    Examples:
      steelyard identify robot.toml run1.csv --validate run2.csv --output result
      steelyard identify robot.toml run1.csv run2.csv --set processing.cutoff=8 --output result
      steelyard identify robot.toml run1.csv --output result --json --quiet
      steelyard identify robot.toml 'logs/**/*.parquet' --workers 4 --output result
      steelyard identify leg.toml sweeps.csv --from positions --output result
    """
    from contextlib import nullcontext

    from steelyard.identification import identify as run
    from steelyard.report import require_apart, require_replaceable

    require_results_folder(context, output)
    file = load_robot(robot, lines, topic=topic, allow_extensions=allow_extensions)
    require_apart(output, (file.path, file.robot.source, *map(Path, (*logs, *(validate or ())))))
    if measured == "positions":
        given = given_options(context)
        unused = [name for name in _TORQUES_ALONE if name in given]
        _from_positions(file, logs, validate or [], output, weights, friction, unused, json=json, quiet=quiet)
        return
    require_replaceable(output, file.robot)
    run_of_many = many_logs(output, [*logs, *(validate or [])], workers, cluster, tls)
    with progress(quiet=quiet) as say, run_of_many or nullcontext() as kept:
        result = run(
            file,
            logs,
            validate=validate or [],
            consistency=consistency,
            weights="joint" if weights == "joint" else None,
            prior="auto" if prior == "auto" else None,
            prior_weight="auto" if prior_weight is None else prior_weight,
            prefer=prefer,
            residual_slack=residual_slack,
            estimator=estimator,
            friction="auto" if friction == "auto" else None,
            chunk_rows=chunk_rows,
            reduction=None if kept is None else kept.reduction,
            progress=say,
        )
        say("writing the report")
        written = result.save(output, force=force, stale=() if kept is None else kept.checkpoints.names)
    if json:
        print_json({**result.to_dict(), "files": [str(path) for path in written]})
    elif quiet:
        echo(result.headline)
    else:
        show_identification(result, whole_table=table, verbose=verbose)
        echo(f"Look at {output / 'report.html'}")
    if result.prediction.word == "wrong":
        if not force and not json:
            echo("No robot description was written, since the model does not predict the robot; --force writes it.")
        raise typer.Exit(3)


_TORQUES_ALONE = (
    "prior", "prior_weight", "consistency", "prefer", "residual_slack", "estimator", "workers", "cluster", "tls",
    "chunk_rows", "force", "table", "verbose",
)  # fmt: skip


def _from_positions(
    file: RobotFile,
    logs: Sequence[str],
    validate: Sequence[str],
    output: Path,
    weights: str,
    friction: str,
    unused: Sequence[str],
    *,
    json: bool,
    quiet: bool,
) -> None:
    """Identify drives from commands and positions, and write what was found."""
    from steelyard.errors import InputError
    from steelyard.identification import identify_from_positions
    from steelyard.report import require_apart

    if unused:
        name = unused[0].replace("_", "-")
        raise InputError(f"--{name} belongs to identification from torques; leave it out with --from positions.")
    if file.robot.source is not None:  # whose copy with the results has the same name
        require_apart(output, (file.robot.source,), (file.robot.source.name,))
    with progress(quiet=quiet) as say:
        result = identify_from_positions(
            file,
            logs,
            validate=validate,
            weights="joint" if weights == "joint" else "equal",
            friction="auto" if friction == "auto" else None,
            progress=say,
        )
        say("writing the results")
        written = result.save(output)
    if json:
        print_json({**result.to_dict(), "files": [str(path) for path in written]})
    elif quiet:
        echo(result.headline)
    else:
        echo(str(result))
        echo(f"Look at {output / 'drives.json'}")
