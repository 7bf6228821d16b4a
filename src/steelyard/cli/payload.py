"""``steelyard payload``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from .choices import (
    CHUNK_ROWS,
    AllowExtensions,
    ChunkRows,
    ConsistencyOption,
    Json,
    JsonFile,
    Quiet,
    RobotArgument,
    Topic,
    WeightsOption,
)
from .robot_argument import SetLines, load_robot
from .terminal import progress, show

if TYPE_CHECKING:
    from steelyard.identification import DriveGainIdentification, PayloadIdentification

__all__ = ["payload"]


def payload(
    robot: RobotArgument,
    logs: Annotated[
        list[str],
        typer.Argument(metavar="[UNLOADED] LOADED", help="The log without the payload, and the one with it."),
    ],
    estimate: Annotated[
        Path | None,
        typer.Option(help="Folder of results, or estimate.json, of the robot, instead of the log without the payload."),
    ] = None,
    frame: Annotated[
        str | None, typer.Option(help="Link of the description in whose frame the payload is mounted (the last one).")
    ] = None,
    changes: Annotated[
        Literal["nothing", "friction", "friction-and-offset"] | None,
        typer.Option(help="What of the joints may be other while loaded (friction)."),
    ] = None,
    mass: Annotated[
        float | None,
        typer.Option(help="kg, of a known payload, by which drive gains are found where robot.toml asks for them."),
    ] = None,
    output: JsonFile = None,
    consistency: ConsistencyOption = "full",
    weights: WeightsOption = "joint",
    chunk_rows: ChunkRows = CHUNK_ROWS,
    topic: Topic = None,
    lines: SetLines = None,
    json: Json = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Tell mass, centre of mass and inertia of what a robot carries, from its logs without and with it.

    Where [log] of robot.toml says gain = "find", the payload is the known one, and the drive gains are found.

    \b
    Examples:
      steelyard payload robot.toml unloaded.csv loaded.csv
      steelyard payload robot.toml loaded.csv --estimate estimate.json --json
    """
    from steelyard.errors import InputError
    from steelyard.files.writing import require_unread
    from steelyard.identification import identify_drive_gains, identify_payload
    from steelyard.recording import LogColumns
    from steelyard.regression.estimate import estimate_file

    if len(logs) != (2 if estimate is None else 1):
        raise InputError(
            f"steelyard payload needs ROBOT UNLOADED LOADED, or ROBOT LOADED with --estimate, got {len(logs)} "
            f"log{'s' * (len(logs) != 1)}{' and an estimate' if estimate else ''}."
        )
    if output is not None and output.is_dir():
        raise InputError(f"{output}: is a folder; give the path of a file.")
    file = load_robot(robot, lines, topic=topic, allow_extensions=allow_extensions)
    require_unread(output, robot, file.robot.source, estimate and estimate_file(estimate), *logs)
    gains = LogColumns.from_dict(file.section("log"), f"{file.path}, [log]").finds_gains
    if mass is not None and not gains:
        raise InputError(
            f"--mass is that of a known payload, by which drive gains are found; {file.path} does not ask for any "
            '(gain = "find" in [log]).'
        )
    with progress(quiet=quiet) as say:
        options: dict[str, Any] = {
            "frame": frame,
            "changes": changes,
            "consistency": consistency,
            "chunk_rows": chunk_rows,
            "progress": say,
        }
        found: DriveGainIdentification | PayloadIdentification
        if gains:
            if estimate is not None:
                raise InputError("Drive gains need the log without the payload, too; leave out --estimate.")
            found = identify_drive_gains(file, logs[-1:], logs[:-1], payload=mass, **options)
        else:
            chosen: Literal["joint"] | None = "joint" if weights == "joint" else None
            found = identify_payload(file, logs[-1:], logs[:-1], estimate=estimate, weights=chosen, **options)
    show(found, output, json=json, quiet=quiet)
