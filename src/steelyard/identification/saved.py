"""Saved estimates: the verdict on one, and its parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, Verdict, check, constraints_from_dict
from steelyard.regression import Estimate
from steelyard.robot import RobotFile

__all__ = ["check_estimate", "matching_estimate", "parameters_of_estimate"]


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
    loaded = matching_estimate(model, estimate)
    feasible = FeasibleSet(model, consistency, list(constraints_from_dict(file.section("constraints"))))
    if loaded.parameters is not None:
        return check(feasible, parameters=loaded.parameters)
    return check(feasible, base=loaded.base)


def matching_estimate(model: Model, estimate: str | Path) -> Estimate:
    """Load a saved estimate and make sure that it belongs to a model.

    Parameters
    ----------
    model : Model
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote.

    Returns
    -------
    Estimate

    Raises
    ------
    InputError
        If the file cannot be used, or the estimate belongs to another robot.
    """
    loaded = Estimate.load(estimate)
    if loaded.base_expressions != model.base_parameters().expressions:
        raise InputError(
            f"{estimate}: has the base parameters of another robot or of other terms than {model.robot.name} has; "
            "give the robot file that it was identified with."
        )
    return loaded


def parameters_of_estimate(model: Model, estimate: str | Path, *, base: bool = False) -> NDArray[np.float64]:
    """Return the parameters of a saved estimate, for a model that is to hold them.

    Parameters
    ----------
    model : Model
    estimate : str or Path
    base : bool
        The base parameters instead of the standard ones.

    Returns
    -------
    ndarray
        (n,), or (n_b,).

    Raises
    ------
    InputError
        If the file cannot be used, belongs to another robot, or holds base parameters alone where standard ones are
        asked for.
    """
    loaded = matching_estimate(model, estimate)
    if base:
        return loaded.base
    if loaded.parameters is None:
        raise InputError(f"{estimate}: holds base parameters alone; use --base, or identify with a feasible method.")
    return loaded.parameters
