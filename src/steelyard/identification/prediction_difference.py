"""Differences between the torques that several estimates predict, on logs or on random motions within the limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import text_table
from steelyard.dynamics import Model
from steelyard.regression import Information
from steelyard.robot import Robot

__all__ = ["PredictionDifference", "difference_on_logs", "difference_on_random_motion", "random_motion"]

Array = NDArray[np.float64]

SAMPLES = 2000
"""The number of samples of a random motion: root mean squares have a standard error of some 2 % then."""

UNLIMITED_ANGLE, UNLIMITED_TRAVEL, UNLIMITED_VELOCITY = np.pi, 0.5, 2.0
"""rad, m, and rad/s or m/s, either way, of joints whose description names no limit."""

STARTING_TIME = 0.5
"""s in which a joint comes from rest to its limit of velocity: accelerations are drawn up to that of it."""


@dataclass(frozen=True, eq=False)
class PredictionDifference:
    """Differences of predicted torques, and their errors where they were measured.

    Attributes
    ----------
    source : str
        Of what torques, in words.
    names : tuple of str
        The k estimates; differences are those to the first.
    joint_names : tuple of str
    joint_torque : ndarray
        (N,) root mean square of the measured torques of the logs, otherwise of what the first predicts, N·m or N.
    joint_difference : ndarray
        (k - 1, N) root mean square of the differences to the first, N·m or N.
    relative_difference : ndarray
        (k - 1,) over all the joints, relative to `joint_torque`; 0.05 means 5 %.
    joint_error : ndarray or None
        (k, N) root mean square of the errors on the logs; None where there are none.
    relative_error : ndarray or None
        (k,) over all the joints; likewise.
    torque_units : tuple of str
        (N,) of the torques of the joints.
    """

    source: str
    names: tuple[str, ...]
    joint_names: tuple[str, ...]
    torque_units: tuple[str, ...]
    joint_torque: Array = field(repr=False)
    joint_difference: Array = field(repr=False)
    relative_difference: Array
    joint_error: Array | None = field(default=None, repr=False)
    relative_error: Array | None = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """The findings as sentences."""
        found = [
            f"On {self.source}, the torques that {name} predicts differ from those of {self.names[0]} by "
            f"{relative:.2%}{self._most(difference)}."
            for name, relative, difference in zip(
                self.names[1:], self.relative_difference, self.joint_difference, strict=True
            )
        ]
        if self.relative_error is not None:
            errors = ", ".join(f"{e:.2%} of {name}" for name, e in zip(self.names, self.relative_error, strict=True))
            found.append(f"Their errors there: {errors}.")
        return tuple(found)

    @property
    def caption(self) -> str:
        """What stands in the table, with its unit."""
        return f"Root mean squares, {' or '.join(dict.fromkeys(self.torque_units))}"

    def table(self) -> tuple[list[str], list[tuple[str, ...]]]:
        """Return heads and rows: root mean squares of each joint, in the unit of its torque."""
        short = labels(len(self.names))
        heads, columns = ["joint", "torque"], [self.joint_torque]
        if self.joint_error is not None:
            heads += [f"error of {label}" for label in short]
            columns += list(self.joint_error)
        heads += [f"{label} - {short[0]}" for label in short[1:]]
        columns += list(self.joint_difference)
        rows = [(name, *(f"{column[k]:.3g}" for column in columns)) for k, name in enumerate(self.joint_names)]
        return heads, rows

    def __str__(self) -> str:
        heads, rows = self.table()
        drawn = text_table(heads, rows, numbers=range(1, len(heads)))
        return "\n".join((*self.sentences, f"{self.caption}:", drawn))

    def _most(self, difference: Array) -> str:
        torque = self.joint_torque
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(torque > 0.0, difference / torque, 0.0)
        most = int(np.argmax(relative))
        if len(self.joint_names) < 2 or relative[most] == 0.0:
            return ""
        size = f"{difference[most]:.3g} {self.torque_units[most]}"
        return f", most at {self.joint_names[most]} ({relative[most]:.2%}, {size})"

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: dictionaries, lists, texts and numbers."""
        names = ("source", "names", "joint_names", "joint_torque", "joint_difference", "relative_difference")
        return {name: getattr(self, name) for name in (*names, "joint_error", "relative_error")}


def labels(count: int) -> list[str]:
    """Return short names of so many estimates.

    Examples
    --------
    >>> labels(3)
    ['A', 'B', 'C']
    """
    return [chr(ord("A") + k) if count <= 26 else f"#{k + 1}" for k in range(count)]


def difference_on_logs(
    model: Model, info: Information, names: Sequence[str], bases: Sequence[ArrayLike], source: str
) -> PredictionDifference:
    """Compare what base parameters predict for the samples of logs, and with what was measured.

    Parameters
    ----------
    info : Information
        Of the logs, all together.
    names : sequence of str
        The k estimates.
    bases : sequence of (n_b,)
        Their base parameters.
    source : str
        Names the logs.
    """
    given, units = [np.asarray(base, dtype=float) for base in bases], model.robot.torque_units
    factors = info.measured
    counts = np.maximum([f.count for f in factors], 1)
    torque = np.array([f.norm2 for f in factors])
    errors = np.array([[f.residual2(base) for f in factors] for base in given])
    differences = np.array([[f.prediction2(base - given[0]) for f in factors] for base in given[1:]])
    return PredictionDifference(
        source=source,
        names=tuple(names),
        joint_names=tuple(info.joint_names) if info.has_joint_errors else ("all",),
        torque_units=units if info.has_joint_errors else (" or ".join(dict.fromkeys(units)),),
        joint_torque=np.sqrt(torque / counts),
        joint_difference=np.sqrt(differences / counts),
        relative_difference=_relative(differences, torque),
        joint_error=np.sqrt(errors / counts),
        relative_error=_relative(errors, torque),
    )


def difference_on_random_motion(
    model: Model, names: Sequence[str], bases: Sequence[ArrayLike], *, count: int = SAMPLES, seed: int = 0
) -> PredictionDifference:
    """Compare what base parameters predict for random positions, velocities and accelerations within the limits.

    Parameters
    ----------
    names : sequence of str
        The k estimates.
    bases : sequence of (n_b,)
        Their base parameters.
    count : int
        Of the samples.
    seed : int
        Other seeds give other samples, and the same seed the same.
    """
    motion = random_motion(model.robot, count, seed)
    pick = model.base_parameters().Pb  # parameters Pb beta move the robot as beta does
    parameters = [pick @ np.asarray(base, dtype=float) for base in bases]
    if model.robot.channels:  # the torques are those at the reference of each signal
        parameters = [model.parameters_without_channels(own) for own in parameters]
        model = model.without_channels
    torques = [model.inverse_dynamics(*motion, own) for own in parameters]
    own = np.sum(torques[0] ** 2, axis=0)
    differences = np.array([np.sum((torque - torques[0]) ** 2, axis=0) for torque in torques[1:]])
    robot = model.robot
    return PredictionDifference(
        source=f"{count} random positions, velocities and accelerations within the limits",
        names=tuple(names),
        joint_names=tuple(robot.joint_names),
        torque_units=robot.torque_units,
        joint_torque=np.sqrt(own / count),
        joint_difference=np.sqrt(differences / count),
        relative_difference=_relative(differences, own),
    )


def _relative(squares: Array, torque: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.nan_to_num(np.sqrt(squares.sum(axis=-1) / torque.sum())))


def random_motion(robot: Robot, count: int = SAMPLES, seed: int = 0) -> tuple[Array, Array, Array]:
    """Draw positions, velocities and accelerations, uniformly and independently, within what the joints may do.

    Positions are drawn between the limits of the description, velocities up to theirs either way, and accelerations up
    to those that reach the limit of velocity in half a second. Joints without limits get half a turn (0.5 m) either way
    and 2 rad/s (2 m/s).

    Returns
    -------
    q, dq, ddq : ndarray
        (count, N) each, SI units.

    Examples
    --------
    >>> import steelyard as sy
    >>> q, dq, ddq = random_motion(sy.Robot.from_dh([(0, 0.3, 0, "q")]), count=5, seed=1)
    >>> q.shape, bool(abs(q).max() <= np.pi), bool(abs(dq).max() <= 2.0)
    ((5, 1), True, True)
    """
    random = np.random.default_rng(seed)
    joints = [robot.joints[i] for i in robot.driving_joints]
    lower, upper, fastest = [], [], []
    for joint in joints:
        reach = UNLIMITED_TRAVEL if joint.kind == "prismatic" else UNLIMITED_ANGLE
        # A joint with one limit moves from it.
        low = joint.lower if np.isfinite(joint.lower) else min(-reach, joint.upper - 2.0 * reach)
        high = joint.upper if np.isfinite(joint.upper) else max(reach, joint.lower + 2.0 * reach)
        lower.append(low if np.isfinite(low) else -reach)
        upper.append(high if np.isfinite(high) else reach)
        given = np.isfinite(joint.velocity_limit) and joint.velocity_limit > 0.0
        fastest.append(joint.velocity_limit if given else UNLIMITED_VELOCITY)
    shape = (count, len(joints))
    velocity = np.array(fastest)
    q = random.uniform(lower, upper, shape)
    dq = random.uniform(-velocity, velocity, shape)
    ddq = random.uniform(-velocity, velocity, shape) / STARTING_TIME
    return q, dq, ddq
