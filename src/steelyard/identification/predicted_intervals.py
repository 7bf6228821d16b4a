"""Prediction, before a robot makes a motion, of the interval of every parameter that the motion will give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError, SolverError
from steelyard.estimators.cross_validation import term_deviations
from steelyard.excitation import Trajectory
from steelyard.feasibility import FeasibleSet, check
from steelyard.feasibility.bounds.quantities import quantities
from steelyard.feasibility.constraints import Constraint
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.parameter_covariance import NORMAL

from .parameter_table import ParameterTable, parameter_table

__all__ = ["PredictedIntervals", "predicted_intervals"]

Array = NDArray[np.float64]

DEFAULT_NOISE = 0.05
"""Deviation of the torques from the model, relative to their root mean square in each joint, where nothing better is
known. Real arms are predicted to three to ten per cent; sensors alone would give far less, and intervals from that
would promise what no identification keeps."""
TIME_CONSTANT = 0.02
"""s, for which a deviation lasts: as cables, gears and friction make it. White noise at 1 kHz would give intervals six
times as narrow as this."""
THICKNESS = 0.003
"""m, by which flat bodies are spread: a body without thickness lies on the bound of what is possible."""
UNKNOWN_TERM = 1.0 / 3.0
"""The factor of `term_deviations` that makes three tenths of the torque of a joint: friction of which nothing is known
is taken to make a tenth."""


@dataclass(frozen=True, eq=False)
class PredictedIntervals:
    """The intervals that are to be expected of an identification with a motion.

    Attributes
    ----------
    table : ParameterTable or None
        Every number with its expected interval and what it will rest on; its values are those that were assumed. None
        where no possible parameters are known that could be assumed.
    expressions : tuple of str
        The base parameters.
    base : ndarray or None
        (n_b,) their assumed values.
    half_width : ndarray
        (n_b,) of their expected 95 % intervals, SI units; infinite for what the motion does not show.
    noise : ndarray
        (N,) standard deviation of the torques that was assumed, N·m or N.
    sentences : tuple of str
        What was assumed.
    """

    table: ParameterTable | None
    expressions: tuple[str, ...]
    base: Array | None
    half_width: Array
    noise: Array
    sentences: tuple[str, ...] = field(repr=False)


def predicted_intervals(
    model: Model,
    motion: Trajectory,
    *,
    parameters: ArrayLike | None = None,
    estimate: Estimate | None = None,
    noise: ArrayLike | None = None,
    rate: float = 1000.0,
    constraints: Sequence[Constraint] = (),
) -> PredictedIntervals:
    """Predict the 95 % interval of every parameter that a motion will give.

    The experiment is made in numbers: torques of assumed parameters, with deviations that are correlated in time and
    orthogonal to all that parameters explain, so that the intervals are about the assumed values. From there the way is
    that of an identification without a prior.

    Parameters
    ----------
    motion : Trajectory
        The whole motion that will be recorded.
    parameters : (n,), optional
        Assumed; by default those of the estimate, or else of the description.
    estimate : Estimate, optional
        Of an identification before, whose errors are those that are expected again.
    noise : (N,) or float, optional
        Standard deviation of the torques from the model, N·m or N.
    rate : float
        At which the motion will be recorded, Hz.
    constraints : sequence of Constraint
        What is known beforehand of the robot, as in identification.

    Raises
    ------
    InputError
        If `noise` is not as many positive numbers as there are joints, or cannot be assumed.

    Examples
    --------
    A pendulum of 2 kg whose torque deviates by 0.1 N·m for 20 ms at a time:

    >>> import steelyard as sy
    >>> rod = sy.Inertia.from_com(2.0, (0.0, 0.0, -0.5), np.diag([0.2, 0.2, 0.01])).parameters
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> move = sy.excitation.QuinticTrajectory.point_to_point([[-1.0], [1.0], [-1.0]], [2.0, 2.0])
    >>> found = predicted_intervals(model, move, parameters=rod, noise=0.1)
    >>> len(found.half_width), bool((found.half_width < 0.1).all())
    (3, True)
    """
    robot = model.robot
    _, q, dq, ddq = motion.sample(rate)
    feasible_set = FeasibleSet(model, "full", list(constraints))
    sentences: list[str] = []
    values, whose = _assumed(model, parameters, estimate)
    torque = None
    if values is not None:
        # A friction of exactly zero is that of a description which says nothing of it, too.
        links = set(feasible_set.link_columns.ravel().tolist())
        positive = [one for one in quantities(feasible_set) if one.never_negative and np.count_nonzero(one.row) == 1]
        open_terms = np.zeros(len(values), dtype=np.bool_)
        open_terms[[place for one in positive if (place := int(np.flatnonzero(one.row)[0])) not in links]] = True
        open_terms &= np.nan_to_num(values) == 0.0
        values = np.where(open_terms, np.nan, np.nan_to_num(values))
        if open_terms.any():
            known = model.inverse_dynamics(q, dq, ddq, np.nan_to_num(values))
            moved = Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=known), batch_means=False)
            values = np.where(open_terms, UNKNOWN_TERM * term_deviations(moved, feasible_set), values)
            sentences.append("Friction of which nothing is known is taken to make a tenth of the torque of its joint.")
        torque = model.inverse_dynamics(q, dq, ddq, values)
        sentences.insert(0, f"Assumed parameters: {whose}.")
    deviation, words = _noise(model, torque, noise, estimate)
    sentences.append(words)
    sentences.append(
        f"Deviations last for {1000.0 * TIME_CONSTANT:g} ms, as cables and gears make them; an interval that rests on "
        "a wrong model is wrong whatever the noise."
    )
    disturbance = _correlated(deviation, len(q), rate)
    weights = "joint" if robot.dof > 1 else None
    explained = least_squares(
        Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=disturbance), batch_means=False),
        weights=weights,
    ).base
    lifted = model.base_parameters().Pb @ np.nan_to_num(explained)
    unexplained = disturbance - model.inverse_dynamics(q, dq, ddq, lifted)
    whole = unexplained if torque is None else torque + unexplained
    info = Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=whole))
    plain = least_squares(info, weights=weights)
    half = NORMAL * plain.standard_error
    table = None
    if values is not None:
        assumed = replace(plain, parameters=values, parameter_names=tuple(model.parameter_names))
        table, reason = _table(info, feasible_set, assumed, plain)
        if reason:
            sentences.append(reason)
    else:
        sentences.append(
            f"{whose} Only base parameters are predicted, those combinations that motions can show; give an estimate "
            "of this robot, or a description with inertias, to see the links."
        )
    return PredictedIntervals(
        table, plain.base_expressions, None if values is None else plain.base, half, deviation, tuple(sentences)
    )


def _assumed(model: Model, parameters: ArrayLike | None, estimate: Estimate | None) -> tuple[Array | None, str]:
    """Return parameters that may stand for those of the robot, NaN for open terms, and whose they are."""
    if parameters is not None:
        return np.array(parameters, dtype=np.float64), "those that were given"
    if estimate is not None and estimate.parameters is not None:
        return np.array(estimate.parameters), "those of the estimate before"
    values = np.array(model.robot.parameters, dtype=np.float64)
    links = np.concatenate([np.asarray(columns, dtype=np.intp) for columns in model.link_columns])
    if np.isnan(values[links]).any():
        return None, f"The description of {model.robot.name} gives no inertia for some link."
    return values, "those of the description"


def _noise(model: Model, torque: Array | None, noise: ArrayLike | None, estimate: Estimate | None) -> tuple[Array, str]:
    """Return the deviation (N,) of the torques, and where it comes from."""
    count = model.dof
    if noise is not None:
        values = np.asarray(noise, dtype=np.float64)
        values = np.full(count, values.flat[0]) if values.size == 1 else values
        if values.shape != (count,) or not np.isfinite(values).all() or (values <= 0.0).any():
            raise InputError(
                f"noise must be a positive number of N·m (or N), or {count} of them, one for each joint, got {noise!r}."
            )
        return values, "Noise: the standard deviations of the torques that were given."
    if torque is None:
        effort = np.array([model.robot.joints[k].effort_limit for k in model.robot.driving_joints])
        if not np.isfinite(effort).all():
            return np.ones(count), "Noise: 1 N·m (or N) in each joint, since nothing is known of its torques."
        return 0.01 * effort, "Noise: a hundredth of the effort limit of each joint, since its torques are not known."
    size = np.sqrt(np.mean(torque**2, axis=0))
    size = np.maximum(size, 1e-3 * max(float(size.max()), 1e-9))
    errors = None if estimate is None else estimate.joint_relative_error
    if errors is not None and np.isfinite(errors).all() and (errors > 0.0).all():
        told = ", ".join(f"{100.0 * error:.2g} %" for error in errors)
        return size * errors, f"Noise: the errors of the estimate before, {told} of the torque of each joint."
    return (
        DEFAULT_NOISE * size,
        f"Noise: {DEFAULT_NOISE:.0%} of the torque of each joint, which is what models of real arms leave; give "
        "--noise or --estimate where better is known.",
    )


def _correlated(deviation: Array, count: int, rate: float) -> Array:
    """Return deviations (count, N) with exactly these standard deviations that last for `TIME_CONSTANT`."""
    from scipy.signal import lfilter

    decay = float(np.exp(-1.0 / (rate * TIME_CONSTANT)))
    white = np.random.default_rng(0).normal(size=(count, len(deviation)))
    raw = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], white, axis=0)
    return np.asarray(raw / np.sqrt(np.mean(raw**2, axis=0)) * deviation)


def _table(
    info: Information, feasible_set: FeasibleSet, assumed: Estimate, plain: Estimate
) -> tuple[ParameterTable | None, str]:
    """Return the table, or why there is none."""
    assert assumed.parameters is not None
    if not check(feasible_set, parameters=assumed.parameters).feasible:
        return None, (
            "No robot can have the assumed parameters, so that only base parameters are predicted; steelyard inspect "
            "says what is wrong with them, and --repair mends it."
        )
    scales, words = term_deviations(info, feasible_set), ""
    try:
        try:
            return parameter_table(info, feasible_set, assumed, plain, term_scales=scales), words
        except InputError:  # the search of an interval starts inside the set, and flat bodies lie on its bound
            words = f"Links are taken to be {1000.0 * THICKNESS:g} mm thicker, since some have no thickness."
            thick = _thickened(assumed.parameters, feasible_set)
            base = feasible_set.model.base_parameters().values(thick)
            shifted = replace(plain, base=base)
            moved = replace(assumed, parameters=thick, base=base)
            return parameter_table(info, feasible_set, moved, shifted, term_scales=scales), words
    except (InputError, SolverError) as error:
        return None, f"Intervals of single parameters could not be computed ({str(error).rstrip('.')})."


def _thickened(parameters: Array, feasible_set: FeasibleSet) -> Array:
    """Spread the mass of each link by a small ball about each of its points."""
    found = np.array(parameters)
    for columns in feasible_set.link_columns:
        found[columns[[0, 3, 5]]] += 2.0 * found[columns[9]] * THICKNESS**2
    return found
