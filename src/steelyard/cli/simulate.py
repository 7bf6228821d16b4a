"""``steelyard simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from .choices import AllowExtensions, Quiet, RobotArgument, numbers
from .results_folder import require_results_folder
from .terminal import echo, progress

__all__ = ["simulate"]


def simulate(
    context: typer.Context,
    robot: RobotArgument,
    estimate: Annotated[
        Path | None,
        typer.Argument(help="Folder of results, or estimate.json; without it the values of the description (CAD)."),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "steelyard-simulation"
    ),
    duration: Annotated[
        float | None, typer.Option(help="Seconds; by default those of the torques or of the trajectory, or 5.")
    ] = None,
    initial: Annotated[
        str | None, typer.Option(help="Joint positions at the start, such as 0,0.5,-1; zeros by default.")
    ] = None,
    torque: Annotated[
        Path | None,
        typer.Option(
            help="CSV or Parquet with columns t, tau1, tau2, …; each row holds until the next. Without: motors off."
        ),
    ] = None,
    follow: Annotated[
        Path | None, typer.Option(help="Trajectory that is followed under computed torque at 1 kHz.")
    ] = None,
    method: Annotated[
        Literal["automatic", "dormand_prince", "dop853", "radau", "bdf", "lsoda", "runge_kutta_4", "rosenbrock"],
        typer.Option(help="Integration method."),
    ] = "automatic",
    rate: Annotated[
        float | None, typer.Option(help="Samples a second; by default 1000, or the rate of --torque if that is more.")
    ] = None,
    sign_width: Annotated[
        float, typer.Option(help="Speed within which friction changes its sign, rad/s or m/s; 0: at once.", min=0.0)
    ] = 1e-3,
    stop_at_limits: Annotated[
        bool,
        typer.Option(
            "--stop-at-limits", help="End where a joint passes a limit of the description, or starts beyond it."
        ),
    ] = False,
    quiet: Quiet = False,
    allow_extensions: AllowExtensions = False,
) -> None:
    """Simulate a robot: exit 0 when it ran to its end or to an event, 1 when it diverged, 2 bad input.

    \b
    Examples:
      steelyard simulate robot.toml --duration 2
      steelyard simulate robot.toml estimate.json --initial 0,0.5,0,0,0,0 --output fall
    """
    from steelyard.identification.simulated import simulate_files
    from steelyard.regression.estimate import estimate_file
    from steelyard.report import require_apart
    from steelyard.report.simulation import SIMULATION_FILES, save_simulation
    from steelyard.robot import RobotFile

    positions = None if initial is None else numbers(initial, "--initial", "0,0.5,-1")
    require_results_folder(context, output)
    require_apart(output, (robot, estimate and estimate_file(estimate), torque, follow), SIMULATION_FILES)
    with progress(quiet=quiet) as say:
        say(f"simulating {robot}")
        simulation = simulate_files(
            RobotFile.load(robot, allow_extensions=allow_extensions),
            estimate,
            duration=duration,
            initial=positions,
            torque=torque,
            follow=follow,
            method=method,
            rate=rate,
            sign_width=sign_width,
            stop_at_limits=stop_at_limits,
        )
        say("writing the results")
        save_simulation(simulation, output)
    result = simulation.result
    ending = f"{result.status} at {result.end_time:.6g} s"
    for note in () if quiet else simulation.notes:
        echo(f"Note: {note}.")
    echo(f"{ending}: {result.message}" if result.message else ending)
    if not quiet:
        echo(f"Look at {output / 'simulation.html'}")
    if result.status in ("diverged", "stopped"):
        raise typer.Exit(1)
