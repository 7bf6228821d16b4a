"""The design of an excitation from files: a robot, its limits, and what it must keep clear of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.excitation import ExcitationDesign, ExcitationObjective, Trajectory, design_excitation, load_trajectory
from steelyard.regression import Information
from steelyard.robot import Robot, RobotFile

from .default_terms import model_of_estimate
from .payload import payload_mounting
from .saved import parameters_of_estimate

__all__ = ["excite"]


def excite(
    robot: str | Path | RobotFile,
    limits: str | Path | None = None,
    *,
    objective: ExcitationObjective | None = None,
    prior_information: str | Path | None = None,
    estimate: str | Path | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> ExcitationDesign:
    """Design a motion that shows the parameters of a robot.

    Parameters
    ----------
    robot : str, Path or RobotFile
        URDF or robot.toml.
    limits : str or Path, optional
        A limits file (TOML); without it the limits are those of the robot.
    objective : ExcitationObjective, optional
        Of :func:`steelyard.design_excitation`.
    prior_information : str or Path, optional
        A trajectory, or an Information that was saved, of what is known already.
    estimate : str or Path, optional
        Whose parameters predict the torques, instead of those of the description.
    progress : callable, optional
        Called with a few words after each step.
    **options
        Further ones of :func:`steelyard.design_excitation`.

    Raises
    ------
    InputError
        If a file or an option cannot be used.
    SolverError
        If no motion keeps every limit.
    """
    file = RobotFile.load(robot)
    model = model_of_estimate(estimate, file)
    parameters = None if estimate is None else parameters_of_estimate(model, estimate)
    asked = _about_the_carrier(file, model, ExcitationObjective() if objective is None else objective)
    if prior_information is not None:
        asked = replace(asked, prior_information=_known(prior_information, model.robot))
    return design_excitation(
        model,
        limits,
        objective=asked,
        parameters=parameters,
        progress=progress,
        **options,
    )


def _about_the_carrier(file: RobotFile, model: Model, objective: ExcitationObjective) -> ExcitationObjective:
    """Let the word payload mean the link that carries it by [payload]; the last link where that says nothing."""
    names = [objective.subset] if isinstance(objective.subset, str) else list(objective.subset or ())
    if "payload" not in names or "payload" in model.robot.link_names:
        return objective
    ends = [model.robot.link_names[index] for index in model.robot.end_links]
    if len(ends) > 1 and "frame" not in file.section("payload"):
        raise InputError(
            f"{model.robot.name} has several last links, {', '.join(ends)}; name the one that carries the payload in "
            "place of the word payload, or by frame = ... in [payload] of a robot file."
        )
    link = payload_mounting(file, model)[0]
    return replace(objective, subset=[model.robot.link_names[link] if name == "payload" else name for name in names])


def _known(path: str | Path, robot: Robot) -> Information | Trajectory:
    """Load a trajectory or an Information, whichever a file holds."""
    place = Path(path)
    if place.suffix.lower() == ".json" and place.is_file() and '"steelyard-information' in _head(place):
        return Information.load(place)
    return load_trajectory(place, robot)


def _head(path: Path) -> str:
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.read(200)
