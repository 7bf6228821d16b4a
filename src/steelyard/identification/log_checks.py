"""Signs that a log was read wrongly: columns that belong to other joints, and torques in the wrong unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information, least_squares

from .kinematic_bodies import reach_of

__all__ = ["implausible_mass", "swapped_positions", "swapped_torques"]

_ROWS = 600
"""Samples that are used: several times the number of base parameters on which the torque of one joint depends."""
_RATIO = 0.1
"""Exchanged torques must lower the product of the two errors tenfold before columns are called swapped: neighbouring
joints of a wrist have similar dynamics, and each may fit the other's torque nearly as well as its own."""
_FEW_ROWS = 300
"""Samples for exchanged positions, where each pair of joints is a regression of its own."""
_FALLEN = 0.8
"""Ratio of the errors with exchanged and given positions; right columns have at least 1.0 on real robots, exchanged
ones 0.1 to 0.75."""
_ALL_PAIRS = 10
"""Joints up to which every pair is tried; for more joints only neighbours, since the time grows with their square."""


def swapped_torques(model: Model, samples: Samples) -> tuple[str, ...]:
    """Name pairs of joints each of whose torques fits the other's dynamics far better than its own.

    Parameters
    ----------
    model : Model
    samples : Samples
        A few hundred are used.

    Returns
    -------
    tuple of str
        A sentence for each pair; empty where nothing is suspect.
    """
    step = max(1, samples.count // _ROWS)
    torque = samples.torque[::step]
    columns = model.base_columns
    values = columns.kernel(samples.q[::step], samples.dq[::step], samples.ddq[::step])
    joints = range(model.dof)
    error = np.ones((len(joints), len(joints)))  # of the torque of joint j, fitted by the regressor of joint i
    for i, block in enumerate(np.split(values, np.cumsum([len(c) for c in columns.joints])[:-1], axis=1)):
        error[i] = _errors(block, torque)
    names = model.robot.joint_names
    return tuple(
        f"The torque columns of {names[i]} and {names[j]} look swapped: fitted alone, each suits the other "
        f"joint ({error[i, j]:.0%} and {error[j, i]:.0%} error) better than its own "
        f"({error[i, i]:.0%} and {error[j, j]:.0%})."
        for i in joints
        for j in joints
        if i < j and error[i, j] * error[j, i] < _RATIO * error[i, i] * error[j, j]
    )


def swapped_positions(model: Model, samples: Samples) -> tuple[str, ...]:
    """Name the pair of joints whose positions, exchanged, would explain the torques far better.

    Parameters
    ----------
    model : Model
    samples : Samples
        A few hundred are used.

    Returns
    -------
    tuple of str
        One sentence at most.
    """
    step = max(1, samples.count // _FEW_ROWS)
    motion = [array[::step] for array in (samples.q, samples.dq, samples.ddq)]
    torque = samples.torque[::step]
    if len(torque) <= 2 * model.base_parameters().count:
        return ()

    def error(order: list[int]) -> float:
        """Return the geometric mean of the joints' relative errors, with the motion of the joints in this order."""
        q, dq, ddq = (array[:, order] for array in motion)
        information = Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=torque))
        errors = information.joint_relative_error(least_squares(information, "joint").base)
        return float(np.exp(np.mean(np.log(np.maximum(errors[np.isfinite(errors)], 1e-3)))))

    joints = model.dof
    reach = joints if joints <= _ALL_PAIRS else 2
    fallen = {}
    given = error(list(range(joints)))
    for i in range(joints):
        for j in range(i + 1, min(i + reach, joints)):
            order = list(range(joints))
            order[i], order[j] = j, i
            fallen[i, j] = error(order) / given
    best = min(fallen, key=fallen.__getitem__, default=None)
    if best is None or fallen[best] > _FALLEN:
        return ()
    names = model.robot.joint_names
    return (
        f"The position columns of {names[best[0]]} and {names[best[1]]} look swapped: exchanged, the errors of the "
        f"joints would fall to {fallen[best]:.0%} of what they are, on average.",
    )


def _errors(columns: NDArray[np.float64], torque: NDArray[np.float64]) -> NDArray[np.float64]:
    norms = np.linalg.norm(torque, axis=0)
    if columns.shape[1] >= len(columns):
        return np.ones(len(norms))
    residual = columns @ np.linalg.lstsq(columns, torque, rcond=1e-9)[0] - torque
    # Errors below a percent count as equal, so that the little noise of such joints does not decide.
    return np.where(norms > 0.0, np.maximum(np.linalg.norm(residual, axis=0) / np.maximum(norms, 1e-300), 0.01), 1.0)


_OF_DESCRIPTION = 8.0
"""Largest ratio of the masses of the answer and of the description that CAD without drives or cables explains."""
_LIGHTEST, _HEAVIEST = 1.0, 1500.0
"""kg per m³ of the longest reach, cubed. Robots have 20 to 100 (a servo with a horn, a dog's leg, arms of 0.8 to 3 m);
the lightest possible answer may have a few times less, where the motion does not show all the masses."""
_GRAVITY_SEEN = 0.05
"""Share of the torques that gravity must have before a small mass is called implausible: without gravity (a vertical
axis, a balanced arm) torques hardly show masses, and the lightest answer is light."""
_SHORTEST = 0.05
"""m of reach below which the description does not show the robot's size."""
_SCALES = {"mN·m": 1e3}


def implausible_mass(model: Model, estimate: Estimate, samples: Samples) -> tuple[str, ...]:
    """Compare the total mass of an estimate with the description's, or else with what a robot of its reach has.

    Parameters
    ----------
    model : Model
    estimate : Estimate
        With parameters of every link.
    samples : Samples
        Of the motion that it comes from.

    Returns
    -------
    tuple of str
        One sentence at most.
    """
    parameters = estimate.parameters
    assert parameters is not None
    columns = [int(link[9]) for link in model.link_columns]
    mass = float(parameters[columns].sum())
    described = np.asarray(model.robot.parameters)[columns]
    if np.all(described > 0.0):
        expected = float(described.sum())
        low, high = expected / _OF_DESCRIPTION, expected * _OF_DESCRIPTION
        what = f"the description's {expected:.4g} kg"
    else:
        reach = reach_of(model.robot)
        if reach < _SHORTEST:
            return ()
        low, high = _LIGHTEST * reach**3, _HEAVIEST * reach**3
        what = f"the {low:.2g} to {high:.2g} kg of robots that reach {reach:.3g} m"
    if low <= mass <= high:
        return ()
    if mass < low:
        gravity = model.gravity(samples.q, parameters)
        if np.linalg.norm(gravity) < _GRAVITY_SEEN * np.linalg.norm(samples.torque):
            return ()
    units = [f'`torque_unit = "{unit}"`' for unit, scale in _SCALES.items() if low <= mass / scale <= high]
    remedy = f"{units[0]} in [log] would fit" if units else "check `torque_unit`, `gain` and gear ratios in [log]"
    return (f"The links weigh {mass:.4g} kg together by these torques, far from {what}: {remedy}.",)
