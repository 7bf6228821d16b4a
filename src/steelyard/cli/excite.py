"""``steelyard excite``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from .choices import AllowExtensions, Quiet, RobotArgument, given_options, numbers
from .results_folder import require_results_folder
from .terminal import echo, progress, show_excitation, show_on_the_fly

__all__ = ["excite"]


def excite(
    context: typer.Context,
    robot: RobotArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the trajectory.")],
    limits: Annotated[
        Path | None, typer.Option(help="Limits file (TOML); what it does not name is taken from the robot.")
    ] = None,
    family: Annotated[Literal["fourier", "spline", "quintic"], typer.Option(help="Kind of motion.")] = "fourier",
    criterion: Annotated[
        Literal["condition", "d", "a", "friction"],
        typer.Option(help="What makes a motion good; friction to choose friction by the log."),
    ] = "condition",
    subset: Annotated[
        list[str] | None,
        typer.Option(help="Joint, link or parameter that is to be shown, or payload; may be repeated."),
    ] = None,
    nuisance: Annotated[
        Literal["unknown", "known"], typer.Option(help="Whether the parameters beyond the subset are known already.")
    ] = "unknown",
    harmonics: Annotated[int | None, typer.Option(help="Of the Fourier series.", min=1)] = None,
    points: Annotated[int | None, typer.Option(help="Of splines and moves.", min=3)] = None,
    period: Annotated[float, typer.Option(help="s.")] = 12.5,
    periods: Annotated[int | None, typer.Option(help="How many periods are played.", min=1)] = None,
    slow_time: Annotated[
        float | None, typer.Option(help="Time of a slow passage after each period, s; 0 for none.")
    ] = None,
    ramp_time: Annotated[float | None, typer.Option(help="Time of start and stop, s; 0 for none.")] = None,
    margin: Annotated[float, typer.Option(help="Fraction of each limit that is left free.", min=0.0)] = 0.0,
    rate: Annotated[float, typer.Option(help="At which the motion will be recorded, Hz.")] = 1000.0,
    prior_information: Annotated[
        Path | None, typer.Option(help="Trajectory or saved Information of what is known already.")
    ] = None,
    estimate: Annotated[
        Path | None, typer.Option(help="Folder of results, or estimate.json, whose parameters predict the torques.")
    ] = None,
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
    on_the_fly: Annotated[
        bool,
        typer.Option(
            "--on-the-fly",
            help="Simulate a controller that learns the robot, whose masses it is not told, while it moves it.",
        ),
    ] = False,
    accuracy: Annotated[
        float, typer.Option(help="Expected relative torque error at which a motion on the fly ends.", min=1e-6)
    ] = 0.02,
    longest: Annotated[float, typer.Option(help="s, within which a motion on the fly ends at rest.", min=5.0)] = 60.0,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Design a motion that shows a robot's parameters, within all its limits: exit 3 where it cannot identify them.

    \b
    Examples:
      steelyard excite robot.toml --output motion
      steelyard excite robot.toml --limits limits.toml --subset payload --output motion
      steelyard excite robot.toml --limits limits.toml --criterion friction --output motion
      steelyard excite robot.toml --limits limits.toml --on-the-fly --output motion
    """
    from steelyard.excitation import ExcitationObjective, SearchOptions
    from steelyard.identification import excite as run
    from steelyard.regression.estimate import estimate_file
    from steelyard.report import require_apart
    from steelyard.report.excitation_page import EXCITATION_FILES, save_excitation
    from steelyard.report.on_the_fly_page import ON_THE_FLY_FILES
    from steelyard.robot import RobotFile

    deviations = None if noise is None else numbers(noise, "--noise", "0.5 or 2,2,1,0.3")
    _require_meaning(context, on_the_fly)
    require_results_folder(context, output)
    read = (robot, limits, prior_information, estimate and estimate_file(estimate))
    require_apart(output, read, ON_THE_FLY_FILES if on_the_fly else EXCITATION_FILES)
    if on_the_fly:
        named = given_options(context)
        _on_the_fly(
            robot,
            output,
            quiet,
            allow_extensions,
            limits=limits,
            estimate=estimate,
            accuracy=accuracy,
            longest=longest,
            criterion=criterion if "criterion" in named else "prediction",
            noise=deviations,
            rate=rate,
            seed=seed,
            **({"starts": starts} if "starts" in named else {}),
        )
        return
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
            slow_time=slow_time,
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


_DESIGN_ALONE = (
    "family", "subset", "nuisance", "harmonics", "points", "period", "periods", "slow_time", "ramp_time", "margin",
    "prior_information", "time_limit",
)  # fmt: skip
_ON_THE_FLY_ALONE = ("accuracy", "longest")


def _require_meaning(context: typer.Context, on_the_fly: bool) -> None:
    """Refuse options that would be passed over in silence."""
    from steelyard.errors import InputError

    named = given_options(context)
    for name in _DESIGN_ALONE if on_the_fly else _ON_THE_FLY_ALONE:
        if name in named:
            kind = (
                "that is designed beforehand; leave one of both out" if on_the_fly else "on the fly; add --on-the-fly"
            )
            raise InputError(f"--{name.replace('_', '-')} belongs to a motion {kind}.")
    if on_the_fly and "criterion" in named and context.params["criterion"] in ("condition", "friction"):
        raise InputError(
            f"--criterion {context.params['criterion']} belongs to a motion that is designed beforehand; with "
            "--on-the-fly give d or a, or leave it out, which makes the expected error of the torques small."
        )


def _on_the_fly(robot: Path, output: Path, quiet: bool, allow_extensions: bool, **options: Any) -> None:
    """Simulate an excitation on the fly, save it and print it; exit 3 beyond a limit, or short of the accuracy."""
    from steelyard.online import excite_on_the_fly
    from steelyard.report.on_the_fly_page import save_on_the_fly
    from steelyard.robot import RobotFile

    with progress(quiet=quiet) as say:
        file = RobotFile.load(robot, allow_extensions=allow_extensions)
        done = excite_on_the_fly(file, progress=say, **options)
        say("writing the motion")
        written = save_on_the_fly(done, file, output)
    if quiet:
        echo(" ".join((repr(done.excitation), *done.exceeded)))
    else:
        show_on_the_fly(done)
        echo(f"The motion is {', '.join(path.name for path in written[:4])}, what was measured log.csv, in {output}")
        echo(f"Look at {written[-1]}")
    if done.exceeded or not done.reached:
        raise typer.Exit(3)
