"""``steelyard excite``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from .choices import AllowExtensions, Quiet, RobotArgument, numbers
from .terminal import echo, progress, show_excitation

__all__ = ["excite"]


def excite(
    robot: RobotArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the trajectory.")],
    limits: Annotated[
        Path | None, typer.Option(help="Limits file (TOML); what it does not name is taken from the robot.")
    ] = None,
    family: Annotated[Literal["fourier", "spline", "quintic"], typer.Option(help="Kind of motion.")] = "fourier",
    criterion: Annotated[Literal["condition", "d", "a"], typer.Option(help="What makes a motion good.")] = "condition",
    subset: Annotated[
        list[str] | None,
        typer.Option(help="Joint, link or parameter that is to be shown, or payload; may be repeated."),
    ] = None,
    nuisance: Annotated[
        Literal["unknown", "known"], typer.Option(help="Whether the parameters beyond the subset are known already.")
    ] = "unknown",
    harmonics: Annotated[int, typer.Option(help="Of the Fourier series.", min=1)] = 6,
    points: Annotated[int | None, typer.Option(help="Of splines and moves.", min=3)] = None,
    period: Annotated[float, typer.Option(help="s.")] = 12.5,
    periods: Annotated[int, typer.Option(help="How many periods are played.", min=1)] = 1,
    ramp_time: Annotated[float | None, typer.Option(help="Time of start and stop, s; 0 for none.")] = None,
    margin: Annotated[float, typer.Option(help="Fraction of each limit that is left free.", min=0.0)] = 0.0,
    rate: Annotated[float, typer.Option(help="At which the motion will be recorded, Hz.")] = 1000.0,
    prior_information: Annotated[
        Path | None, typer.Option(help="Trajectory or saved Information of what is known already.")
    ] = None,
    estimate: Annotated[Path | None, typer.Option(help="estimate.json, whose parameters predict the torques.")] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            help="Standard deviation of the torques from the model, N·m or N: a number, or one for each joint with "
            "commas between; for the intervals that the page predicts."
        ),
    ] = None,
    starts: Annotated[int, typer.Option(help="Random starts.", min=1)] = 8,
    seed: Annotated[int, typer.Option(help="Of the random starts.", min=0)] = 0,
    time_limit: Annotated[
        float | None, typer.Option(help="s, after which the best motion so far is taken; so does Ctrl-C.")
    ] = None,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Design a motion that shows a robot's parameters, within all its limits: exit 3 where it cannot identify them.

    \b
    Examples:
      steelyard excite robot.toml --output motion
      steelyard excite robot.toml --limits limits.toml --subset payload --output motion
    """
    from steelyard.excitation import ExcitationObjective, SearchOptions
    from steelyard.identification import excite as run
    from steelyard.report import require_folder
    from steelyard.report.excitation_page import save_excitation
    from steelyard.robot import RobotFile

    deviations = None if noise is None else numbers(noise, "--noise", "0.5 or 2,2,1,0.3")
    require_folder(output)
    with progress(quiet=quiet) as say:
        file = RobotFile.load(robot, allow_extensions=allow_extensions)
        design = run(
            file,
            limits,
            prior_information=prior_information,
            estimate=estimate,
            family=family,
            objective=ExcitationObjective(criterion=criterion, subset=subset or None, nuisance=nuisance),
            harmonics=harmonics,
            points=points,
            period=period,
            periods=periods,
            ramp_time=ramp_time,
            margin=margin,
            rate=rate,
            search=SearchOptions(starts=starts, seed=seed, time_limit=time_limit),
            progress=say,
        )
        written = save_excitation(design, file, output, estimate=estimate, noise=deviations, progress=say)
    if quiet:
        echo(repr(design))
    else:
        show_excitation(design)
        echo(f"The motion is {', '.join(path.name for path in written[:-1])} in {output}")
        echo(f"Look at {written[-1]}")
    if not design.identifies:
        raise typer.Exit(3)
