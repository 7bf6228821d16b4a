"""Options that several commands share."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

__all__ = ["AllowExtensions", "ConsistencyOption", "Json", "Quiet", "Topic", "WeightsOption"]


AllowExtensions = Annotated[
    bool,
    typer.Option("--allow-extensions", help="Run code that robot.toml names by import path; only for files you trust."),
]

Topic = Annotated[
    str | None,
    typer.Option("--topic", help="Topic of a bag that is read, as `topic` in [log] of robot.toml."),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on standard output, and nothing else there.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress, and of results the answer alone.")]

ConsistencyOption = Annotated[
    Literal["full", "inertia"],
    typer.Option(
        "--consistency",
        help="What counts as physically possible: full, a body of positive mass density; inertia, positive mass and "
        "inertia alone (the thesis).",
    ),
]

WeightsOption = Annotated[Literal["joint", "none"], typer.Option(help="How the joints are weighted.")]
