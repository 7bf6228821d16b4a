"""One call that plays a trajectory on a simulated robot, under a controller and with sensors (thesis section 4.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.control import FeedforwardTracking, FilteredDifference, TrajectoryReference
from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.motion import Trajectory
from steelyard.recording import Recording
from steelyard.simulation import Actuators, Controller, Environment, Safety, Sensors, SimulationResult, Status, simulate

__all__ = ["play"]

Array = NDArray[np.float64]
# Natural frequency of the default controller, rad/s, and the filter of its velocities, Hz: enough against friction, and
# little noise from encoders in a loop of 1 kHz.
_FREQUENCY, _CUTOFF = 40.0, 30.0


def play(
    model: Model,
    parameters: ArrayLike,
    trajectory: Trajectory,
    *,
    controller: Controller | Callable[[TrajectoryReference], Controller] | None = None,
    believed: ArrayLike | None = None,
    base: bool = False,
    periods: float = 1.0,
    rate: float = 1000.0,
    sensors: Sensors | None = None,
    actuators: Actuators | None = None,
    environment: Environment | None = None,
    safety: Safety | None = None,
    sign_width: float = 0.0,
    seed: int = 0,
) -> Recording:
    """Play a trajectory on a simulated robot and return the log that its sensors leave.

    The robot starts on the trajectory, at its velocity. Without sensors the log is the truth: positions, velocities,
    accelerations and torques that fit each other to rounding, so that what identification makes of it can be compared
    with `parameters`.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`: the truth.
    trajectory : Trajectory
        What the robot is to follow.
    controller : Controller or callable, optional
        A controller that follows the trajectory already, or a function that makes one of a
        :class:`~steelyard.control.TrajectoryReference`. Where not given, PD control with feed-forward (thesis eq. 4.16
        to 4.18), with gains that follow from the inertia matrix.
    believed : array_like, optional
        Like `parameters`: what that default controller believes; the truth where not given.
    base : bool
        Whether `parameters` and `believed` are base parameters.
    periods : float
        How many times a periodic trajectory is played; one that does not end as it begins is played once.
    rate : float
        Hz, of the control loop and of the log.
    sensors, actuators, environment, safety
        See :func:`steelyard.simulate`.
    sign_width : float
        rad/s or m/s, of the smooth sign of Coulomb friction; 0 for the exact sign, as the model of the identification
        has it.
    seed : int
        Of the sensors' noise.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        If something does not fit, or the robot does not get to the end: the controller cannot hold it, or `parameters`
        are not physically possible.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> point_mass = np.zeros(10)
    >>> point_mass[9] = 2.0
    >>> wave = sy.FourierTrajectory(a=[[1.0]], b=[[0.5]], center=[0.0], frequency=0.5)
    >>> log = play(model, point_mass, wave)
    >>> log.count, log.joint_count
    (2000, 1)
    """
    for name, value, unit in (("periods", periods, ""), ("rate", rate, " Hz")):
        if not 0.0 < value < np.inf:
            raise InputError(f"{name} must be positive, got {value!r}{unit}.")
    if trajectory.joint_count != model.joint_count:
        raise InputError(
            f"The trajectory moves {trajectory.joint_count} joints, but {model.robot.name} has {model.joint_count}."
        )
    _check_periods(trajectory, periods)
    reference = TrajectoryReference(trajectory, repeat=periods > 1.0, period=1.0 / rate)
    start, speed, _ = reference.at(0.0)
    if controller is None:
        controller = _default_controller(
            model, parameters if believed is None else believed, reference, base, 1.0 / rate
        )
    elif not isinstance(controller, Controller):
        controller = controller(reference)
    result = simulate(
        model,
        parameters,
        start,
        speed,
        trajectory.duration * periods,
        controller,
        base=base,
        sensors=sensors,
        actuators=actuators,
        environment=environment,
        safety=safety,
        sign_width=sign_width,
        rate=rate,
        seed=seed,
    )
    return _log(result, trajectory, periods)


def _check_periods(trajectory: Trajectory, periods: float) -> None:
    """Refuse to repeat a motion that does not end where it began."""
    if periods <= 1.0:
        return
    ends = [signal[[0, -1]] for signal in trajectory.motion(np.array([0.0, trajectory.duration]))[:2]]
    if any(np.abs(end[1] - end[0]).max() > 1e-6 for end in ends):
        raise InputError(
            "The trajectory does not end as it begins, so that it cannot be played again and again; design it with "
            "several periods, or play it once."
        )


def _default_controller(
    model: Model, believed: ArrayLike, reference: TrajectoryReference, base: bool, period: float
) -> FeedforwardTracking:
    """Return PD control with the gains of critically damped joints, each by itself."""
    postures = reference.trajectory.motion(np.linspace(0.0, reference.duration, 50))[0]
    kernel = model.kernel("total_inertia_matrix", base=base)
    matrices = kernel(postures, np.asarray(believed, dtype=np.float64))
    inertia = np.diagonal(matrices.reshape(len(postures), model.joint_count, -1), axis1=1, axis2=2).mean(axis=0)
    if not (inertia > 0.0).all():
        joint = model.robot.joint_names[int(np.argmin(inertia))]
        raise InputError(
            f"The inertia that the joint {joint!r} feels is not positive with these parameters, so no gains follow "
            "from it; give a controller."
        )
    gains = {"kp": _FREQUENCY**2 * inertia, "kd": 2.0 * _FREQUENCY * inertia}
    return FeedforwardTracking(
        model, believed, reference, base=base, period=period, velocity=FilteredDifference(_CUTOFF), **gains
    )


def _log(result: SimulationResult, trajectory: Trajectory, periods: float) -> Recording:
    if result.status is not Status.FINISHED:
        remedy = (
            "check the parameters with steelyard.check, or give another controller"
            if result.status is Status.DIVERGED
            else "give another controller, or other limits"
        )
        raise InputError(f"The robot did not get to the end of the trajectory ({result.message}); {remedy}.")
    log = replace(result.recording(), source=f"simulated {type(trajectory).__name__}")
    count = log.count - 1  # the end of a period is the beginning of the next one
    rows = {name: getattr(log, name)[:count] for name in ("t", "q", "torque")}
    velocity = None if log.velocity is None else log.velocity[:count]
    acceleration = result.ddq[:count] if result.measured is None else None
    wanted = trajectory.motion(
        np.minimum(rows["t"] % trajectory.duration if periods > 1.0 else rows["t"], trajectory.duration)
    )[0]
    remarks = _tracking(rows["q"], wanted, result.joint_names)
    return replace(log, velocity=velocity, acceleration=acceleration, remarks=(*log.remarks, *remarks), **rows)


def _tracking(q: Array, wanted: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """Say which joints did not do what they were to do, as far as a tenth of their range."""
    away, span = np.abs(q - wanted).max(axis=0), np.ptp(wanted, axis=0)
    lost = [f"{names[k]} by up to {away[k]:.3g}" for k in np.flatnonzero(away > 0.1 * np.maximum(span, 1e-3))]
    return (f"The robot did not follow the trajectory: {', '.join(lost)} (rad or m).",) if lost else ()
