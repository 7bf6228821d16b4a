"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

__all__ = [
    "CHUNK_ROWS",
    "LOG",
    "AllowExtensions",
    "ChunkRows",
    "ClusterAddress",
    "ConsistencyOption",
    "EstimateArgument",
    "Json",
    "JsonFile",
    "Logs",
    "Quiet",
    "RobotArgument",
    "Tls",
    "Topic",
    "Verbose",
    "WeightsOption",
    "Workers",
    "given_options",
    "numbers",
]

LOG = "Such as a CSV or a bag; - is the standard input; side by side: a.csv+b.csv."

RobotArgument = Annotated[Path, typer.Argument(help="URDF or robot.toml.")]

Logs = Annotated[list[str], typer.Argument(metavar="LOG...", help=LOG)]

EstimateArgument = Annotated[Path, typer.Argument(help="Folder of results, or estimate.json.")]

CHUNK_ROWS = 200_000  # that of the package, which takes long to load
ChunkRows = Annotated[int, typer.Option(help="Rows of a log that stand in memory together.", min=1000)]

Workers = Annotated[int, typer.Option("--workers", help="Processes of this machine.", min=1, max=1024)]

ClusterAddress = Annotated[
    str | None, typer.Option("--cluster", metavar="ADDRESS", help="Scheduler of a Dask cluster.")
]

Tls = Annotated[
    list[str] | None,
    typer.Option("--tls", metavar="NAME=FILE", help="TLS of the cluster: ca_file=, cert=, key= of PEM files."),
]

JsonFile = Annotated[Path | None, typer.Option("--output", "-o", help="File for the same as JSON.")]

AllowExtensions = Annotated[
    bool,
    typer.Option("--allow-extensions", help="Run code that robot.toml names by import path; only for files you trust."),
]

Topic = Annotated[
    list[str] | None,
    typer.Option(
        "--topic", help="Topic of a bag that is read, as `topic` in [log]; repeated where several belong together."
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on standard output, and nothing else there.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress, and of results the answer alone.")]

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print links, logs, columns and all remarks as well.")]

ConsistencyOption = Annotated[
    Literal["full", "inertia"],
    typer.Option(
        "--consistency",
        help="What counts as physically possible: full, a body of positive mass density; inertia, positive mass and "
        "inertia alone (the thesis).",
    ),
]

WeightsOption = Annotated[Literal["joint", "none"], typer.Option(help="How the joints are weighted.")]


def given_options(context: typer.Context) -> set[str]:
    """Return the names of the options that were given, rather than left as they are."""
    return {name for name in context.params if str(context.get_parameter_source(name)).endswith("COMMANDLINE")}


def numbers(text: str, option: str, example: str) -> list[float]:
    """Read numbers with commas between.

    Raises
    ------
    InputError
        If they are none; the message names the option, and an example.

    Examples
    --------
    >>> numbers("0,0.5,-1", "--initial", "0,0,0")
    [0.0, 0.5, -1.0]
    """
    from steelyard.errors import InputError

    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must be numbers with commas between, such as {example}, got {text!r}.") from None
