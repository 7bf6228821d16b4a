"""Source projects of a model: which functions, constants and reference values they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import __version__, codegen
from steelyard.errors import InputError
from steelyard.files import tell
from steelyard.graph import Function
from steelyard.robot import Inertia, Robot
from steelyard.robot.robot import PRESLIDING

from .functions import DEFAULT_FUNCTIONS, ModelFunctions
from .layout import ParameterLayout

__all__ = ["model_project", "possible_parameters"]

_SAMPLES = 3  # random motions of a self-test: enough to notice any wrong element, and the files stay short


def possible_parameters(layout: ParameterLayout, seed: int = 0) -> NDArray[np.float64]:
    """Return parameters (n,) that are physically possible, the same for the same seed: a few point masses a link."""
    random = np.random.default_rng(seed)
    values = random.uniform(0.1, 1.0, len(layout.names))
    for columns in layout.links:
        body = Inertia.zero()
        for _ in range(5):
            body = body + Inertia.from_com(random.uniform(0.1, 1.0), random.uniform(-0.3, 0.3, 3), np.zeros((3, 3)))
        values[columns] = body.parameters
    return values


def model_project(
    functions: ModelFunctions,
    names: Sequence[str] | None = None,
    *,
    base: bool = False,
    gravity: str = "fixed",
    sign: str = "exact",
    parameters: ArrayLike | None = None,
) -> codegen.Project:
    """Collect functions of a model for one source project.

    Parameters
    ----------
    functions : ModelFunctions
        The functions of the model.
    names : sequence of str, optional
        Names of the functions that the project holds; where not given, `DEFAULT_FUNCTIONS`, and ``presliding_step``
        where friction has a state.
    base, gravity, sign, parameters
        See :meth:`steelyard.Model.function`.

    Returns
    -------
    Project
        The reference values of its self-test are of random motions and of parameters that are physically possible.
    """
    robot, random = functions.robot, np.random.default_rng(1)
    if names is None:
        names = (*DEFAULT_FUNCTIONS, *(["presliding_step"] if PRESLIDING in robot.channels else []))
    if isinstance(names, str) or not names:
        raise InputError(f"functions must be a sequence of names such as ['inverse_dynamics'], got {names!r}.")
    standard = possible_parameters(functions.layout)
    reference = {name: random.uniform(-2.0, 2.0, (_SAMPLES, robot.dof)) for name in ("q", "dq", "ddq", "tau")}
    reference |= {
        "parameters": np.tile(standard, (_SAMPLES, 1)),
        "gravity": random.uniform(-10.0, 10.0, (_SAMPLES, 3)),
        "point": random.uniform(-0.5, 0.5, (_SAMPLES, 3)),
        "sign_width": random.uniform(0.01, 0.1, (_SAMPLES, 1)),
        "channels": random.uniform(10.0, 50.0, (_SAMPLES, len(robot.channels) * robot.dof)),
        "lengths": random.uniform(0.2, 0.6, (_SAMPLES, len(robot.lengths))),
    }
    if PRESLIDING in robot.channels:
        reference |= _steps_of_bristles(robot, reference["q"], reference["dq"], random)
    constants = [
        codegen.Constant("joint_count", robot.dof, "number of joint coordinates"),
        codegen.Constant("link_count", len(robot.links), "number of moving links"),
        codegen.Constant("parameter_count", len(functions.layout.names), "number of standard parameters"),
    ]
    if base:
        independent = functions.base_parameters()
        reference["base_parameters"] = np.tile(independent.values(standard), (_SAMPLES, 1))
        constants.append(codegen.Constant("base_parameter_count", independent.count, "number of base parameters"))
    if len(set(names)) < len(names):
        twice = next(name for name in names if list(names).count(name) > 1)
        raise InputError(f"functions names {twice!r} twice; name each function once.")
    recorded = []
    for number, name in enumerate(names):
        tell("recording the functions of the model", number, len(names), "functions")
        recorded.append(functions.function(name, base=base, gravity=gravity, sign=sign, parameters=parameters))
    built = _told_apart(recorded)
    used = {argument.name for function in built for argument in function.arguments}
    return codegen.Project(
        robot.name,
        built,
        _description(robot, parameters is not None),
        tuple(constants),
        {name: values for name, values in reference.items() if name in used},
        __version__,
    )


def _steps_of_bristles(
    robot: Robot, q: NDArray[np.float64], dq: NDArray[np.float64], random: np.random.Generator
) -> dict[str, NDArray[np.float64]]:
    """Return what came before, and slow speeds in the last row: bristles forget long ways and fast motions."""
    from .bristles import Bristles  # few models have any

    bristles = Bristles(robot)
    displacements, speeds = np.ones((2, robot.dof))
    displacements[bristles.joints], _, speeds[bristles.joints] = bristles.shapes
    moved, slow, states = random.uniform(-1.0, 1.0, (3, *q.shape))
    slower = dq.copy()
    slower[-1] = random.uniform(-1.0, 1.0, robot.dof) * speeds
    before = {"q_before": q - moved * displacements, "dq_before": slow * speeds, "presliding_before": states}
    return {"dq": slower, **before}


def _told_apart(functions: Sequence[Function]) -> tuple[Function, ...]:
    """Number the functions of links whose names differ in signs that no identifier has."""
    names = [function.name for function in functions]
    result = []
    for k, function in enumerate(functions):
        name, count = function.name, names[:k].count(function.name)
        while count and f"{name}_{count + 1}" in names:
            count += 1
        result.append(replace(function, name=f"{name}_{count + 1}") if count else function)
    return tuple(result)


def _description(robot: Robot, fixed: bool) -> str:
    x, y, z = robot.gravity
    terms = ", ".join(term.kind.replace("_", " ") for term in robot.terms)
    parts = [
        f"Dynamics of the robot {robot.name!r}: {robot.dof} joints, {len(robot.links)} moving links"
        + (f", with {terms}" if terms else "")
        + ".",
        f"Units are SI, angles in radians. Gravity, where it is no argument, is ({x:g}, {y:g}, {z:g}) m/s² in the base "
        "frame.",
        "Inertial parameters are barycentric: L about the origin of the link frame, first moment l, mass m.",
        *_not_among_the_joints(robot),
    ]
    if fixed:
        parts.append("The parameters of one robot stand in the code as numbers.")
    return " ".join(parts)


def _not_among_the_joints(robot: Robot) -> list[str]:
    """Say of joints of the description that have no number in q where they stand, a sentence for each kind."""
    said = []
    if locked := robot.read_with.get("locked"):
        held = ", ".join(f"{name!r} at {value:g}" for name, value in locked.items())
        said.append(f"Joints that are held still, so that the functions hold there alone: {held} (rad or m).")
    names = robot.joint_names
    follow = [
        f"{joint.name!r} at {joint.multiplier:g} times {names[joint.coordinate]!r} plus {joint.offset:g}"
        for joint in robot.joints
        if joint.mimics is not None
    ]
    if follow:
        said.append(f"Joints that follow others, to which their torques are added: {', '.join(follow)} (rad or m).")
    return said
