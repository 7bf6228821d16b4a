"""The section `[controller]` of a robot file, and the noise-free motions of logs that are simulated with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.control.closed_loop import ClosedLoop, without_standstill
from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files import TomlSection, shown
from steelyard.files.arguments import per_joint, positive
from steelyard.recording import Processing, Recording, Samples
from steelyard.recording.diagnosis.detectors import DETECTORS, noise_deviation
from steelyard.recording.even import evened
from steelyard.robot import RobotFile
from steelyard.simulation import Measurement

from .given import GivenLog, GivenSamples
from .log_reader import LogReader

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

    from steelyard.control import JointFeedback

__all__ = ["ControllerSettings", "motions_of_logs"]

Array = NDArray[np.float64]

AVERAGED = 0.1
"""s over which torques are averaged, to compare what a law commands with what was logged."""
OTHER_LAW = 0.1
"""Part of a joint's torque by which they may differ. On five arms that MuJoCo moved under laws at 2 kHz, with logs at
500 Hz, they differ by 0.3 to 1.9 % and once 4.5 %, and by 20 % where `kp` is stated 20 % too large."""
_OF_JOINTS = ("kp", "kd", "ki", "torque_limit", "velocity_threshold", "position_noise")

SMOOTH = "smooth"
"""The word for a reference that is not logged: the measured positions, filtered far more than they have to be."""


@dataclass(frozen=True)
class ControllerSettings(TomlSection):
    """The controller of a robot and the reference that it follows: the `[controller]` section of robot.toml.

    Parameters
    ----------
    reference
        Columns of the reference positions: a list of names, or a pattern as in `[log]`; ``"smooth"``: the measured
        positions, filtered at `reference_cutoff`.
    reference_cutoff
        Hz, for a smooth reference; as the data decides by default.
    kp, kd, ki
        Gains at the joints, a number or one for each; N·m/rad, N·m·s/rad and N·m/(rad·s). Without `kp` the law is
        unknown, and the reference itself is the motion.
    reference_velocity
        Whether the velocity of the reference is fed forward.
    velocity_cutoff
        Hz, of the filter of the velocities that the controller takes by differences; none by default.
    torque_limit
        N·m or N, a number or one for each.
    rate
        Hz of the controller, that of the log or a multiple of it; that of the log by default.
    velocity_threshold
        rad/s or m/s, below which rows of the motion are left out, a number or one for each; that of `[processing]` by
        default.
    position_noise
        Standard deviation of the noise of the positions that the controller reads, rad or m, a number or one for each;
        that of the logged positions by default. Output error simulates it, too.

    Examples
    --------
    >>> ControllerSettings.from_dict({"reference": "qd{}", "kp": 400.0, "kd": 40.0}).kp
    400.0
    """

    section_name = "[controller]"

    reference: str | tuple[str, ...] = SMOOTH
    reference_cutoff: float | None = None
    kp: float | tuple[float, ...] | None = None
    kd: float | tuple[float, ...] = 0.0
    ki: float | tuple[float, ...] = 0.0
    reference_velocity: bool = True
    velocity_cutoff: float | None = None
    torque_limit: float | tuple[float, ...] | None = None
    rate: float | None = None
    velocity_threshold: float | tuple[float, ...] | None = None
    position_noise: float | tuple[float, ...] | None = None

    def _clean(self, where: str) -> None:
        for name in _OF_JOINTS:
            value = getattr(self, name)
            if isinstance(value, list | tuple):
                object.__setattr__(self, name, tuple(value))
            value = getattr(self, name)
            if value is not None:
                count = len(value) if isinstance(value, tuple) else 1
                per_joint(value, count, f"{where}, key {name!r},", finite=True)
        for name in ("reference_cutoff", "velocity_cutoff", "rate"):
            if getattr(self, name) is not None:
                positive(getattr(self, name), f"{where}, key {name!r},", "Hz")
        if not isinstance(self.reference_velocity, bool):
            raise InputError(
                f"{where}, key 'reference_velocity', is {shown(self.reference_velocity)}; it must be true or false."
            )
        names = [self.reference] if isinstance(self.reference, str) else self.reference
        if (
            not isinstance(names, list | tuple)
            or not names
            or not all(isinstance(name, str) and name for name in names)
        ):
            raise InputError(
                f"{where}, key 'reference', is {shown(self.reference)}; it must be a list of column names, a pattern "
                'such as "qd{}", or "smooth".'
            )
        if not isinstance(self.reference, str):
            object.__setattr__(self, "reference", tuple(self.reference))

    @classmethod
    def of_file(cls, file: RobotFile, needs_controller: bool) -> ControllerSettings:
        """Read the section of a robot file.

        Parameters
        ----------
        needs_controller : bool
            Whether the reference and the gains have to be known.

        Raises
        ------
        InputError
            If something is missing or wrong.
        """
        where = f"{file.path}, [controller]"
        settings = cls.from_dict(file.section("controller"), where)
        if needs_controller and (settings.kp is None or settings.reference == SMOOTH):
            lacking = "kp" if settings.kp is None else "reference"
            raise InputError(
                f"{where} lacks {lacking!r}: output error simulates the robot under its controller. Give `reference` "
                "(the columns of the reference positions), `kp`, `kd` and `rate`, or take --estimator "
                "instrumental_variables, which can do without."
            )
        return settings


def motions_of_logs(
    reader: LogReader, logs: Sequence[GivenLog], model: Model, settings: ControllerSettings
) -> tuple[list[Samples], list[Samples | ClosedLoop]]:
    """Read logs whole, and return the samples of each and what makes its motion without noise, of which a remark tells.

    Parameters
    ----------
    reader : LogReader
        With the processing that was decided; it is told the remark.
    logs : sequence of logs

    Raises
    ------
    InputError
        If a log has no such columns, or gaps that would split it.
    """
    for name in _OF_JOINTS:
        value = getattr(settings, name)
        if isinstance(value, tuple) and len(value) != model.dof:
            raise InputError(
                f"[controller]: {name} has {len(value)} values, but {model.robot.name} has {model.dof} joints; give "
                "one each, or one number for all."
            )
    idle = np.asarray(0.0 if settings.kp is None else settings.kp) + np.asarray(settings.kd) == 0.0
    if settings.kp is not None and idle.any():
        raise InputError(
            "[controller]: a joint has neither `kp` nor `kd`, so that nothing drives it; state its gains, or leave "
            "out `kp`, where the reference itself is the motion."
        )
    found = [_motion_of_log(reader, log, model, settings) for log in logs]
    if settings.kp is not None:
        told = "the motion simulated under the controller of [controller]"
    elif settings.reference == SMOOTH:
        told = (
            "the measured positions filtered further, since [controller] names no reference: noise below that cutoff "
            "stays in them, and what it does to the estimate is not removed"
        )
    else:
        told = "the reference, which the robot is taken to follow, since [controller] states no gains"
    reader.remarks.append(f"The motion without noise is {told}.")
    return [samples for samples, _ in found], [motion for _, motion in found]


def _motion_of_log(
    reader: LogReader, log: GivenLog, model: Model, settings: ControllerSettings
) -> tuple[Samples, Samples | ClosedLoop]:
    if isinstance(log, GivenSamples):
        raise InputError(
            f"{log} is samples, which hold no reference; give the log itself, or call steelyard.instrumental_variables."
        )
    robot, processing = model.robot, reader.processing
    measured = _whole(Recording.read(log, reader.columns, robot), processing, log)
    samples = measured.process(processing, model)
    if settings.reference == SMOOTH:
        wanted = _smooth(measured, processing, model, settings.reference_cutoff)
    else:
        columns = replace(reader.columns, position=settings.reference, velocity="none", acceleration="none")
        try:
            wanted = _whole(Recording.read(log, columns, robot), processing, log)
        except InputError as error:
            raise InputError(f"{error} These are the columns that `reference` in [controller] names.") from None
    threshold: Any = (
        processing.velocity_threshold if settings.velocity_threshold is None else settings.velocity_threshold
    )
    threshold = 0.0 if threshold is None or isinstance(threshold, str) else threshold
    # Nothing in a simulation is late, clipped or stuck.
    sound: dict[str, Any] = {"delay": 0.0, **dict.fromkeys(DETECTORS, False)}
    alike = replace(processing, **sound, velocity="derive", velocity_threshold=None)

    def process(recording: Recording) -> Samples:
        return recording.process(alike, model)

    if settings.kp is None:
        return samples, without_standstill(process(wanted), threshold)
    noise: Any = noise_deviation(measured.q) if settings.position_noise is None else settings.position_noise
    times, path = np.asarray(wanted.t), _path(wanted)
    loop = ClosedLoop(
        model,
        _controller(path, times, settings, _steps_per_row(float(times[1]), settings)),
        times,
        wanted.q[0],
        path.derivative()(0.0),
        velocity_threshold=threshold,
        process=process,
        position_noise=noise,
    )
    if settings.reference == SMOOTH:
        return samples, loop
    apart = _law_apart(_controller(path, times, settings, 1), measured)
    worst = int(np.argmax(apart))
    if apart[worst] > OTHER_LAW:
        reader.remarks.append(
            f"{log}: for the positions as measured, the law of [controller] commands torques that differ from the "
            f"logged ones by {apart[worst]:.0%} at joint {robot.joint_names[worst]!r} (root mean square of averages "
            f"over {AVERAGED:g} s): its gains, reference or rate are not those of the robot, or the robot feeds "
            "torques forward. Output error is wrong by about as much; instrumental variables need the law only roughly."
        )
    return samples, loop


def _path(wanted: Recording) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.asarray(wanted.t), wanted.q)


def _steps_per_row(period: float, settings: ControllerSettings) -> int:
    if settings.rate is None:
        return 1
    every = round(settings.rate * period)
    if every < 1 or abs(settings.rate * period - every) > 0.01 * every:
        raise InputError(
            f"[controller]: rate is {settings.rate:g} Hz; it must be a whole multiple of that of the log, "
            f"{1.0 / period:.6g} Hz."
        )
    return every


def _controller(path: CubicSpline, times: Array, settings: ControllerSettings, every: int) -> JointFeedback:
    """Return the controller that follows a path, so many steps in each row of the log."""
    from steelyard.control import FilteredDifference, JointFeedback

    assert settings.kp is not None
    slope, bend = path.derivative(), path.derivative(2)

    def reference(t: float) -> tuple[Array, Array, Array]:
        at = min(max(t, 0.0), float(times[-1]))
        return path(at), slope(at), bend(at)

    cutoff = settings.velocity_cutoff
    options: dict[str, Any] = {} if cutoff is None else {"velocity": FilteredDifference(cutoff)}
    if settings.torque_limit is not None:
        options["torque_limit"] = settings.torque_limit
    return JointFeedback(
        reference,
        kp=settings.kp,
        kd=settings.kd,
        ki=settings.ki,
        count=len(path(0.0)),
        reference_velocity=settings.reference_velocity,
        sample_time=float(times[1]) / every,
        **options,
    )


def _law_apart(controller: JointFeedback, measured: Recording) -> Array:
    """Return how far commands of a controller that reads the measured positions are from the logged torques.

    The root mean square of each joint (N,), relative to its torque, of averages: in these neither the noise of the
    torques counts nor that of the positions that the controller read between the rows. 0 where no torque was logged.
    """
    times = np.asarray(measured.t)
    readings = [Measurement(t=float(t), q=q) for t, q in zip(times, measured.q, strict=True)]
    controller.start(readings[0])
    commands = np.array([controller.torque(one) for one in readings])
    window = np.ones(max(min(round(AVERAGED / float(times[1])), len(times)), 1))
    apart, size = (
        np.sqrt([np.mean(np.convolve(column, window, "valid") ** 2) for column in torques.T])
        for torques in (commands - measured.torque, np.asarray(measured.torque))
    )
    return np.divide(apart, size, out=np.zeros_like(apart), where=size > 0.0)


def _whole(recording: Recording, processing: Processing, log: GivenLog) -> Recording:
    """Place the rows on an even clock from zero, that of the simulation; refuse gaps."""
    parts, _ = evened(recording, processing.resample, processing.longest_gap, True)
    if len(parts) > 1:
        gaps = "a gap" if len(parts) == 2 else f"{len(parts) - 1} gaps"
        raise InputError(
            f"{log}: has {gaps} too long to be filled, over which no motion without noise is known; cut it there into "
            "several logs."
        )
    one = parts[0]
    # Stamps since 1970 round to 0.2 µs, by which filters and trims of a simulation from zero would differ.
    times = np.asarray(one.t)
    return replace(
        one, t=np.arange(len(times), dtype=np.float64) * (float(times[-1] - times[0]) / max(len(times) - 1, 1))
    )


def _smooth(recording: Recording, processing: Processing, model: Model, cutoff: float | None) -> Recording:
    options: dict[str, Any] = {"cutoff": "auto" if cutoff is None else cutoff, "trim": 0.0, "velocity_threshold": None}
    smooth = recording.process(Processing.from_dict({**options, "resample": processing.resample}), model)
    return replace(recording, q=smooth.q, velocity=None, acceleration=None)
