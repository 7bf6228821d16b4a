"""Excitation on the fly, tried in the simulator on the robot of a file whose masses the controller is not told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError, SteelyardError
from steelyard.excitation import MotionConstraint, MotionLimits, limits_from_file
from steelyard.identification.default_terms import model_of_estimate
from steelyard.identification.saved import parameters_of_description, parameters_of_estimate
from steelyard.regression import Estimate
from steelyard.robot import RobotFile
from steelyard.simulation import Event, Measurement, Sensors, SimulationResult, simulate
from steelyard.simulation.simulation_result import IMPOSSIBLE

from .active_excitation import STILL, ActiveExcitation
from .credible_robots import CredibleRobots, random_motions

__all__ = ["SimulatedExcitation", "excite_on_the_fly"]

Array = NDArray[np.float64]

ENCODER = 2.0 * np.pi / 2**17  # rad or m between two readings, as of the usual encoders of 17 bits
NOISE = 0.01  # of the root mean square torque of each joint, where nothing else is said
WEAK = 0.2  # of the time until a limit was exceeded, at the limit of torque, from which on the drive is called too weak
LAST_STOP = 2.0  # s of simulation beyond `longest`, for a motion that is broken off near the end


@dataclass(frozen=True, eq=False)
class SimulatedExcitation:
    """The motion that :func:`excite_on_the_fly` made and the estimates that came of it.

    Attributes
    ----------
    excitation : ActiveExcitation
        The controller, with `steps`, `interruptions` and `recording`.
    result : SimulationResult
        The true motion.
    estimate : Estimate
        Of all that was measured, proved to be possible.
    truth : str
        Which robot was simulated, in words.
    torque_error : float
        Root mean square error of the torques that the estimate predicts for random motions within the limits, relative
        to the true torques.
    noise : ndarray
        (N,) standard deviation of the noise of the torques, N·m or N.
    options : dict
    """

    excitation: ActiveExcitation
    result: SimulationResult
    estimate: Estimate
    truth: str
    torque_error: float
    noise: Array
    options: dict[str, Any]

    @property
    def reached(self) -> bool:
        """Whether the expected error came down to the accuracy that was asked for."""
        return self.excitation.expected_error <= self.excitation.accuracy

    @property
    def limit_notes(self) -> tuple[str, ...]:
        """What was not checked, and which limits are wider than those of the description, a sentence each."""
        excitation = self.excitation
        return (*excitation.unchecked, *excitation.limits.widening(excitation.model.robot))

    @property
    def use(self) -> dict[str, float]:
        """The largest part of each limit that the true motion used, 1 at the limit."""
        return {name: float(np.nanmax(part)) for name, part in self._parts.items()}

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Which limit the true motion exceeded at which joint, by how much and when, a sentence each."""
        found = []
        for name, part in self._parts.items():
            for joint, most in enumerate(np.nan_to_num(part).max(axis=0)):
                if most > 1.0:
                    index = int(np.nanargmax(part[:, joint]))
                    pulled = self._parts.get("torque")
                    weak = pulled is not None and float(np.mean(pulled[: index + 1, joint] > 0.999)) > WEAK
                    swung = self.result.joint_names[joint] in [swinging for _, swinging in self.excitation.taken_back]
                    remedy = (
                        f"Do not move a robot so: state limits of {name} that are lower by as much, or begin where "
                        "gravity pulls less at that joint."
                    )
                    if swung:
                        remedy = (
                            "It swung, since its inertia is far from what its kinematics suggest: design a motion from "
                            "the masses that it has instead, without --on-the-fly."
                        )
                    if weak:
                        remedy = (
                            "Its drive was at its limit of torque by then and could not hold it: state the torque that "
                            "the drive has, or begin where gravity pulls less at that joint."
                        )
                    found.append(
                        f"The motion exceeds a limit: {self.result.joint_names[joint]} uses {most:.1%} of its limit of "
                        f"{name}, at {self.result.t[index]:.1f} s. {remedy}"
                    )
        return tuple(found)

    @property
    def _parts(self) -> dict[str, Array]:
        """(S, N) each, the parts of the limits that the true motion used, of those that there are; NaN of the others.

        A position counts from the middle of the range, which a joint with a single limit has as well.
        """
        limits, result = self.excitation.limits, self.result
        lower, upper = limits.ranges
        place = (result.q - 0.5 * (lower + upper)) / (0.5 * (upper - lower))
        below, above = np.where(np.isfinite([limits.lower, limits.upper]), 1.0, np.nan)
        found = {
            "position": np.fmax(-place * below, place * above),
            "velocity": np.abs(result.dq) / limits.velocity,
            "torque": np.abs(result.torque) / np.where(np.isfinite(limits.torque), limits.torque, np.nan),
        }
        return {name: part for name, part in found.items() if np.isfinite(part).any()}


def excite_on_the_fly(
    robot: str | Path | RobotFile,
    limits: str | Path | None = None,
    *,
    estimate: str | Path | None = None,
    accuracy: float = 0.02,
    longest: float = 60.0,
    criterion: Literal["prediction", "d", "a"] = "prediction",
    noise: ArrayLike | None = None,
    rate: float = 1000.0,
    starts: int = 1,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> SimulatedExcitation:
    """Let a simulated robot be excited on the fly by a controller that knows its kinematics, shapes and limits alone.

    The masses and the friction of the description belong to the simulated robot; :class:`ActiveExcitation` is not told
    of them. Where the description has no masses, the simulated robot is one of those that its kinematics make credible.

    Parameters
    ----------
    robot : str, Path or RobotFile
    limits : str or Path, optional
        A limits file (TOML), with obstacles; what it does not name is taken from the robot.
    estimate : str or Path, optional
        ``estimate.json``, whose parameters the simulated robot has.
    accuracy, longest, criterion, starts, seed
        See :class:`ActiveExcitation`.
    noise : float or (N,), optional
        Standard deviation of the noise of the measured torques, N·m or N; one per cent of the torques of random motions
        where not given.
    rate : float
        Of the control loop, Hz.
    progress : callable, optional
        Called with a few words after every five seconds of motion.

    Raises
    ------
    InputError
        If a file or an option cannot be used, or a joint has no limit of velocity or acceleration.
    SteelyardError
        If the simulated motion diverged, or ended before anything was learned.

    Examples
    --------
    >>> import tempfile
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([(0, 0.5, 0, "q")], name="arm")
    >>> excite_on_the_fly(sy.robot.RobotFile.of(arm))
    Traceback (most recent call last):
    steelyard.errors.InputError: joint1 has no limit of velocity or acceleration, ...
    """
    say = progress or (lambda _: None)
    file = RobotFile.load(robot)
    given = model_of_estimate(estimate, file)
    given.refuse_presliding("excited on the fly")
    whole = given.without_channels
    constraints: tuple[MotionConstraint, ...] = ()
    asked: dict[str, Any] | None = None
    if limits is not None:
        asked, sections = limits_from_file(limits)
        if sections:
            from steelyard.collision import geometry_from_dict

            constraints = tuple(geometry_from_dict(sections, whole.robot, Path(limits).parent, where=str(limits)))
    bounds = MotionLimits.for_robot(whole.robot, asked, str(limits))
    if not (np.isfinite(rate) and rate >= 100.0):
        raise InputError(f"rate must be at least 100 Hz for a control loop, got {rate:g} Hz.")
    links = tuple(replace(link, inertia=None, own_inertia=None) for link in whole.robot.links)
    model = Model(replace(whole.robot, links=links))
    excitation = ActiveExcitation(
        model,
        bounds,
        accuracy=accuracy,
        longest=longest,
        criterion=criterion,
        constraints=constraints,
        sample_time=1.0 / rate,
        starts=starts,
        seed=seed,
    )
    truth, words = _truth(whole, model, bounds, estimate, seed)
    motions = random_motions(bounds, 400, 1)
    torques = np.asarray(model.inverse_dynamics(*motions, truth))
    deviations = _deviations(noise, torques)
    lower, upper = bounds.ranges
    # The feedback catches the robot where it stands; a zero position may be a stretched arm at the end of a range.
    begin = 0.5 * (lower + upper)
    at_rest = Event(
        lambda t, q, dq: max(t - excitation.end - 0.5 * STILL, -1.0), "the excitation has finished", direction=1
    )
    result = simulate(
        model,
        truth,
        begin,
        np.zeros(model.dof),
        longest + LAST_STOP,
        _Told(excitation, say),
        sensors=Sensors(encoder_resolution=ENCODER, velocity="none", torque_noise=deviations),
        events=(at_rest,),
        seed=seed,
    )
    if result.status == "diverged":
        remedy = "give every moving link its mass" if IMPOSSIBLE in result.message else "give it lower limits"
        raise SteelyardError(f"The simulated robot went out of control: {result.message}; {remedy}.")
    found = excitation.estimate
    if found is None or found.parameters is None:
        why = "; ".join(f"at {t:.1f} s {reason}" for t, reason in excitation.interruptions[-2:]) or "no motion was made"
        raise SteelyardError(f"Nothing was learned: {why}; widen the limits, or give more time with --longest.")
    predicted = np.asarray(model.inverse_dynamics(*motions, found.parameters))
    error = float(np.linalg.norm(predicted - torques) / np.linalg.norm(torques))
    options = {
        "accuracy": accuracy,
        "longest": longest,
        "criterion": criterion,
        "rate": rate,
        "starts": starts,
        "seed": seed,
        "limits": bounds.to_dict(),
    }
    return SimulatedExcitation(excitation, result, found, words, error, deviations, options)


def _truth(
    whole: Model, model: Model, bounds: MotionLimits, estimate: str | Path | None, seed: int
) -> tuple[Array, str]:
    """Return the parameters (n,) of the simulated robot, and whose they are."""
    if estimate is not None:
        return parameters_of_estimate(whole, estimate), f"that of {estimate}"
    if not np.isnan(whole.robot.parameters[np.concatenate([np.asarray(c) for c in whole.link_columns])]).any():
        return parameters_of_description(whole), "that of the description; the controller was not told its masses"
    drawn = CredibleRobots.of(model, bounds).drawn
    return drawn[seed % len(drawn)], (
        "a random one with these kinematics, since the description does not give the inertia of every link; another "
        "with another --seed"
    )


def _deviations(noise: ArrayLike | None, torques: Array) -> Array:
    if noise is None:
        return np.asarray(NOISE * np.sqrt(np.mean(torques**2, axis=0)))
    values = np.asarray(noise, dtype=np.float64)
    count = torques.shape[1]
    if values.size not in (1, count) or not np.isfinite(values).all() or (values < 0.0).any():
        raise InputError(f"noise must be one number, or {count} for the joints, none below zero, got {noise!r}.")
    return np.broadcast_to(values, (count,)).copy()


class _Told:
    """The controller, with a word about every five seconds of motion."""

    def __init__(self, excitation: ActiveExcitation, say: Callable[[str], None]) -> None:
        self.sample_time = excitation.sample_time
        self._excitation, self._say, self._next = excitation, say, 0.0

    def start(self, measurement: Measurement) -> None:
        """Begin."""
        self._excitation.start(measurement)

    def torque(self, measurement: Measurement) -> Array:
        """Return the torques (N,)."""
        if measurement.t >= self._next:
            self._next += 5.0
            self._say(f"{measurement.t:.0f} s of motion, expected error {self._excitation.expected_error:.2%}")
        return self._excitation.torque(measurement)
