"""The verdict on an estimate that was saved."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, Verdict, check, constraints_from_dict
from steelyard.regression import Estimate
from steelyard.robot import RobotFile

__all__ = ["check_estimate"]


def check_estimate(
    robot: str | Path, estimate: str | Path, consistency: Literal["full", "inertia"] = "full"
) -> Verdict:
    """Tell whether a robot with the parameters of a saved estimate could exist.

    Parameters
    ----------
    robot : str or Path
        URDF or robot.toml, whose constraints count too.
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote; its standard parameters are checked where it has them, otherwise
        its base parameters.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate belongs to another robot.
    """
    file = RobotFile.load(robot)
    model = Model.from_file(file)
    loaded = Estimate.load(estimate)
    feasible = FeasibleSet(model, consistency, list(constraints_from_dict(file.section("constraints"))))
    if loaded.base_expressions != model.base_parameters().expressions:
        raise InputError(
            f"{estimate}: has the base parameters of another robot or of other terms than {robot} describes; "
            "give the robot file that it was identified with."
        )
    if loaded.parameters is not None:
        return check(feasible, parameters=loaded.parameters)
    return check(feasible, base=loaded.base)
