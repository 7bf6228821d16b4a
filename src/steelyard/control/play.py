"""One call that plays a trajectory on a simulated robot, under a controller and with sensors (thesis section 4.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.functions import given_parameters
from steelyard.errors import InputError
from steelyard.excitation import Trajectory
from steelyard.files import listed
from steelyard.recording import Recording
from steelyard.simulation import (
    Actuators,
    Controller,
    Environment,
    Sensors,
    SimulationResult,
    Status,
    StoppingConditions,
    simulate,
)
from steelyard.simulation.simulation_result import IMPOSSIBLE

from .feedforward_tracking import FeedforwardTracking
from .joint_references import TrajectoryReference
from .sampled_loop import Feedback, SampledLoop
from .velocities import FilteredDifference, MeasuredVelocity

__all__ = ["play"]

Array = NDArray[np.float64]
# Natural frequency that the default controller aims at, rad/s: enough against friction, and little noise from encoders
# in a loop of 1 kHz. Velocities come from encoders through a filter of 30 Hz.
_FREQUENCY, _CUTOFF = 40.0, 30.0
_SLOWEST = 2.0  # rad/s; a slower controller does not hold a robot against friction
_PEAK = 2.0  # of the sensitivity: a gain margin of 2 and a phase margin of 29 degrees
_LOOKED_AT = 200  # configurations along the motion
_SMALL = 0.1  # rad or m; smaller ranges count as this when it is asked whether a joint followed


def play(
    model: Model,
    parameters: ArrayLike,
    trajectory: Trajectory,
    *,
    controller: Controller | Callable[[TrajectoryReference], Controller] | None = None,
    nominal: ArrayLike | None = None,
    base: bool = False,
    periods: float = 1.0,
    rate: float = 1000.0,
    sensors: Sensors | None = None,
    actuators: Actuators | None = None,
    environment: Environment | None = None,
    stopping_conditions: StoppingConditions | None = None,
    tolerance: float = 0.1,
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
        to 4.18) of links, rotors and friction. Its gains pass through the inertia matrix, at a natural frequency of 40
        rad/s, or less where the inertia over the motion, the rate and the filter of the velocities leave no margin for
        it (a sensitivity of at most 2 in sampled time). It reads exact velocities where there are any, otherwise
        differences of the positions, filtered at 30 Hz.
    nominal : array_like, optional
        As `parameters`: the parameters of the default controller's model; those of the robot where not given.
    base : bool
        Whether `parameters` and `nominal` are base parameters.
    periods : float
        How many times a periodic trajectory is played; one that does not end as it begins is played once.
    rate : float
        Hz, of the control loop and of the log.
    sensors, actuators, environment, stopping_conditions
        See :func:`steelyard.simulate`.
    tolerance : float
        How far a joint may be from the trajectory, as a share of its range (of 0.1 rad or m, where that is smaller);
        infinite for a log of whatever happens.
    sign_width : float
        rad/s or m/s, of the smooth sign of Coulomb friction; 0 for the exact sign, as the model of the identification
        has it.
    seed : int
        Of the sensors' noise.

    Raises
    ------
    InputError
        If something does not fit, or the robot does not get to the end, or does not follow the trajectory: its drives
        are too weak, the controller cannot hold it, or `parameters` are not physically possible.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> point_mass = np.zeros(10)
    >>> point_mass[9] = 2.0
    >>> wave = sy.excitation.FourierTrajectory(a=[[1.0]], b=[[0.5]], center=[0.0], frequency=0.5)
    >>> log = play(model, point_mass, wave)
    >>> log.count, log.joint_count
    (2000, 1)
    """
    if not tolerance > 0.0:
        raise InputError(f"tolerance must be above 0, a share of each joint's range, got {tolerance!r}.")
    for name, value, unit in (("periods", periods, ""), ("rate", rate, " Hz")):
        if not 0.0 < value < np.inf:
            raise InputError(f"{name} must be positive, got {value!r}{unit}.")
    if trajectory.dof != model.dof:
        raise InputError(f"The trajectory moves {trajectory.dof} joints, but {model.robot.name} has {model.dof}.")
    _check_periods(trajectory, periods)
    reference = TrajectoryReference(trajectory, repeat=periods > 1.0, sample_time=1.0 / rate)
    start, speed, _ = reference.at(0.0)
    slowed = None
    if controller is None:
        exact = sensors is None or sensors.velocity == "exact"
        velocity = MeasuredVelocity() if exact else FilteredDifference(_CUTOFF)
        own = parameters if nominal is None else nominal
        controller, frequency = _default_controller(model, parameters, own, reference, base, 1.0 / rate, velocity)
        if frequency < _FREQUENCY:
            filtered = "" if exact else f" with velocities that are filtered at {_CUTOFF:g} Hz"
            slowed = (
                f"a control loop of {rate:g} Hz{filtered} allows the default controller a natural frequency of no more "
                f"than {frequency:.2g} rad/s, so that a higher rate helps"
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
        stopping_conditions=stopping_conditions,
        sign_width=sign_width,
        rate=rate,
        seed=seed,
    )
    causes = _causes(result, actuators, slowed, nominal is not None)
    return _log(result, trajectory, periods, tolerance, causes)


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
    model: Model,
    parameters: ArrayLike,
    nominal: ArrayLike,
    reference: TrajectoryReference,
    base: bool,
    sample_time: float,
    velocity: FilteredDifference | MeasuredVelocity,
) -> tuple[FeedforwardTracking, float]:
    """Return PD control through the inertia matrix that is nominal, and its natural frequency, rad/s.

    Near a configuration the gains ``w² B`` and ``2 w B`` with the nominal inertia B act on the true inertia M in modes
    of their own, as w² and 2 w times an eigenvalue of ``M⁻¹ B``. The largest of them over the motion decides how fast
    the loop may be in sampled time, and the smallest whether it is damped.
    """
    q = reference.trajectory.motion(np.linspace(0.0, reference.duration, _LOOKED_AT))[0]
    ratios = _ratios(*(_inertia(model, given_parameters(model, p, base=base), q, base) for p in (nominal, parameters)))
    modes = 1.0 / np.array([ratios.min(), ratios.max()]).reshape(2, 1, 1)
    loop = SampledLoop(modes, 0.0 * modes, sample_time, velocity.transfer(sample_time))
    frequency = _FREQUENCY
    while (
        loop.sensitivity_peak(Feedback(np.full((2, 1, 1), frequency**2), np.full((2, 1, 1), 2.0 * frequency))) > _PEAK
    ):
        frequency *= 0.9
        if frequency < _SLOWEST:
            raise InputError(
                f"No gains of the default controller have a margin along this trajectory, at {1.0 / sample_time:g} Hz "
                f"and with an inertia that is believed to be {ratios.min():.3g} to {ratios.max():.3g} times the true "
                "one; raise the rate, give other nominal parameters, or a controller."
            )
    gains = {"kp": frequency**2, "kd": 2.0 * frequency}
    controller = FeedforwardTracking(
        model,
        nominal,
        reference,
        coupled=True,
        compensate_drives=True,
        base=base,
        sample_time=sample_time,
        velocity=velocity,
        **gains,
    )
    return controller, frequency


def _inertia(model: Model, parameters: Array, q: Array, base: bool) -> Array:
    """Return the inertia matrices (P, N, N) of links and rotors; they must be positive definite."""
    n = model.dof
    matrices = np.asarray(model.kernel("total_inertia_matrix", base=base)(q, parameters)).reshape(-1, n, n)
    values, vectors = np.linalg.eigh(matrices)
    worst = int(np.argmin(values[:, 0]))
    if not values[worst, 0] > 0.0:
        joint = model.robot.joint_names[int(np.argmax(np.abs(vectors[worst, :, 0])))]
        raise InputError(
            f"The inertia that the joint {joint!r} feels is not positive with these parameters (the inertia matrix has "
            f"the eigenvalue {values[worst, 0]:.3g} on the trajectory), so no gains follow from it; check the "
            "parameters with steelyard.check, or give a controller."
        )
    return matrices


def _ratios(matrix: Array, other: Array) -> Array:
    """Return the eigenvalues (P, N) of ``other⁻¹ matrix``, both symmetric and positive definite."""
    inverse = np.linalg.inv(np.linalg.cholesky(other))
    return np.asarray(np.linalg.eigvalsh(inverse @ matrix @ np.swapaxes(inverse, -1, -2)))


def _causes(
    result: SimulationResult, actuators: Actuators | None, slowed: str | None, believes: bool
) -> tuple[str, ...]:
    """Return the known reasons why the robot left its trajectory."""
    causes = []
    if actuators is not None:
        limit = np.broadcast_to(np.asarray(actuators.saturation, dtype=np.float64), result.torque.shape)
        share = (np.abs(result.torque) >= 0.999 * limit).mean(axis=0)
        weak = [f"joint {result.joint_names[k]!r} for {share[k]:.0%} of the time" for k in np.flatnonzero(share > 0.01)]
        if weak:
            causes.append(f"torques were at the saturation of the actuators, {listed(weak, 3)}")
    if slowed is not None:
        causes.append(slowed)
    if believes:
        causes.append("the controller believes other parameters than those of the robot")
    return tuple(causes)


def _log(
    result: SimulationResult, trajectory: Trajectory, periods: float, tolerance: float, causes: tuple[str, ...]
) -> Recording:
    """Return the log, if the robot followed the trajectory to its end."""
    because = f": {'; '.join(causes)}" if causes else ""
    if result.status is not Status.FINISHED:
        remedy = "give other limits, or another controller"
        if result.status is Status.DIVERGED and not causes:
            remedy = (
                "mend these"
                if IMPOSSIBLE in result.message
                else "lower the gains of the controller, or shorten its sample time"
            )
        raise InputError(f"The robot did not get to the end of the trajectory ({result.message}){because}; {remedy}.")
    wanted = trajectory.motion(
        np.minimum(result.t % trajectory.duration if periods > 1.0 else result.t, trajectory.duration)
    )[0]
    away = np.abs(result.q - wanted).max(axis=0)
    allowed = tolerance * np.maximum(np.ptp(wanted, axis=0), _SMALL)
    lost = np.flatnonzero(~(away <= allowed))
    if len(lost):
        texts = [f"{result.joint_names[k]} by up to {away[k]:.3g} ({allowed[k]:.3g} allowed)" for k in lost]
        raise InputError(
            f"The robot did not follow the trajectory, in rad or m: {listed(texts, 3)}{because}. Give it another "
            "controller or trajectory, or allow a larger tolerance."
        )
    log = replace(result.recording(), source=f"simulated {type(trajectory).__name__}")
    count = log.count - 1  # the end of a period is the beginning of the next one
    rows = {name: getattr(log, name)[:count] for name in ("t", "q", "torque")}
    velocity = None if log.velocity is None else log.velocity[:count]
    acceleration = result.ddq[:count] if result.measured is None else None
    return replace(log, velocity=velocity, acceleration=acceleration, **rows)
