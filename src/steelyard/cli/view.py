"""``steelyard view``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .choices import LOG, AllowExtensions, Quiet
from .terminal import echo, progress

__all__ = ["view"]


def view(
    given: Annotated[
        str, typer.Argument(metavar="DIR|ROBOT", help="Folder of results or estimate.json; or a URDF or robot.toml.")
    ],
    robot: Annotated[
        Path | None, typer.Option(help="URDF or robot.toml of the results; that of their record by default.")
    ] = None,
    log: Annotated[str | None, typer.Option("--log", help=f"Log that is played. {LOG}")] = None,
    motion: Annotated[
        Path | None, typer.Option("--motion", help="Trajectory that is played, or the folder that excite wrote.")
    ] = None,
    port: Annotated[int, typer.Option(help="Of the page; 0 for any that is free.", min=0, max=65535)] = 8080,
    host: Annotated[
        str, typer.Option(help="Address at which the page is served; by default to this machine alone.")
    ] = "127.0.0.1",
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser.")] = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Show a robot in the browser: shapes, inertia in CAD and as identified, motions with torques; Ctrl-C ends it.

    Links have the colour of what is known of them. A log or a motion is played with measured and predicted torques, and
    links that come too near each other turn red.

    \b
    Examples:
      steelyard view my_robot.urdf
      steelyard view result --log run2.csv
      steelyard view robot.toml --motion excitation
    """
    from steelyard.errors import InputError, require_package
    from steelyard.report.playback import play_log, play_trajectory, watch_collisions
    from steelyard.report.view import is_loopback, view_robot
    from steelyard.report.viewed_robot import load_viewed_robot

    require_package("viser", "The 3D view needs the package", "view")
    if log is not None and motion is not None:
        raise InputError("--log and --motion are both given, and one motion is played at a time; leave one out.")
    with progress(quiet=quiet) as say:
        say(f"reading {given}")
        viewed = load_viewed_robot(given, robot, allow_extensions=allow_extensions)
        played = None
        if log is not None:
            played = play_log(viewed, log, say)
        elif motion is not None:
            played = play_trajectory(viewed, motion)
        say("measuring distances between links")
        nearness, unchecked = watch_collisions(viewed, played)
    remarks = (*(played.remarks if played is not None else ()), *unchecked)
    for remark in dict.fromkeys(() if quiet else (*viewed.remarks, *remarks)):
        echo(f"Note: {remark}")
    if not is_loopback(host):
        echo(f"Note: {host} is reached from other machines, and who reaches it sees the robot and moves the sliders.")
    view_robot(
        viewed, played, nearness, remarks=remarks, host=host, port=port, open_browser=not no_open,
        ready=lambda address: echo(f"Look at {address} (Ctrl-C ends it)"),
    )  # fmt: skip
