"""Adaptive force control with an active observer and an estimated stiffness (thesis section 2.4.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files.arguments import positive
from steelyard.simulation import Measurement

from .active_observer import ActiveObserver
from .sampled_loop import Feedback
from .stiffness import StiffnessEstimator
from .task_dynamics import applied
from .task_space import TaskControl, TaskOptions, symmetric_gains
from .tool import Tool, require_force

__all__ = ["AdaptiveForceControl", "ForceControlOptions", "ForceLoop", "force_loop"]

Array = NDArray[np.float64]

# An innovation of the force beyond this many standard deviations is a change of the environment. Noise does not reach
# it; with the default noise of 0.05 N it is 1 N, which an impact or a sudden change of the stiffness exceeds.
_JUMP = 20.0
# Noise of the force (N) that needs no smoothing: the least increment of the stiffness estimator, half a newton, is ten
# times as large.
_QUIET = 0.05
# Largest time constant over which force and position are smoothed, s. The estimated stiffness and the decision whether
# there is contact lag by it.
_LONGEST_SMOOTHING = 0.1
# On its approach the tool follows a moving point, which may be ahead of it by at most this distance, m. The bound
# limits the command, and so the impact, where friction has held the tool back.
_LEAD = 0.05


@dataclass(frozen=True, eq=False)
class ForceLoop:
    """The plant ``f'' = Ks u - K2 f'`` in sampled time for a stiffness Ks of 1 N/m, and its state feedback.

    Attributes
    ----------
    transition : ndarray
        (2, 2) transition matrix of force (N) and its rate (N/s).
    control : ndarray
        (2,) input vector; it is proportional to Ks.
    gains : ndarray
        (2,) feedback gains of force and rate that place both poles; they are inversely proportional to Ks.
    """

    transition: Array
    control: Array
    gains: Array


def force_loop(bandwidth: float, velocity_gain: float, sample_time: float) -> ForceLoop:
    """Discretise the plant, with u held between samples, and place its poles.

    Parameters
    ----------
    bandwidth : float
        Both poles of the closed loop are at minus this value, rad/s.
    velocity_gain : float
        Damping K2 along the normal, 1/s.
    sample_time : float
        s.

    Examples
    --------
    >>> loop = force_loop(20.0, 40.0, 0.001)
    >>> closed = loop.transition - np.outer(loop.control, loop.gains)
    >>> bool(np.allclose(np.linalg.eigvals(closed), np.exp(-0.02), atol=1e-6))
    True
    """
    decay = float(np.exp(-velocity_gain * sample_time))
    travel = -float(np.expm1(-velocity_gain * sample_time)) / velocity_gain
    transition = np.array([[1.0, travel], [0.0, decay]])
    control = np.array([(sample_time - travel) / velocity_gain, travel])
    # Ackermann: the last row of the inverse controllability matrix, times the wanted polynomial of the transition.
    pole = float(np.exp(-bandwidth * sample_time))
    shifted = transition - pole * np.eye(2)
    reach = np.column_stack((control, transition @ control))
    gains = np.linalg.solve(reach.T, np.array([0.0, 1.0])) @ shifted @ shifted
    return ForceLoop(transition, control, gains)


@dataclass(frozen=True, kw_only=True)
class ForceControlOptions:
    """The tuning of the force loop of :class:`AdaptiveForceControl`.

    Attributes
    ----------
    bandwidth : float
        Both poles of the force loop are placed at minus this value, rad/s.
    velocity_gain : float, optional
        Damping along the normal, 1/s; twice the bandwidth by default.
    stiffness : StiffnessEstimator, optional
        Estimator of the stiffness; by default one that starts with 1000 N/m and fits the noise of the force.
    force_noise : float
        Standard deviation of the measured force, N.
    disturbance_rate : float
        Standard deviation by which the disturbance changes in one second, m/s²; it grows with the square root of time.
    order : int
        Order of the disturbance model, see :class:`ActiveObserver`.
    contact_force : float
        The tool is in contact above this force, and no longer in contact below half of it, N.
    approach_speed : float
        Speed along the normal while the tool touches nothing, m/s.
    """

    bandwidth: float = 20.0
    velocity_gain: float | None = None
    stiffness: StiffnessEstimator | None = None
    force_noise: float = 0.05
    disturbance_rate: float = 5.0
    order: int = 1
    contact_force: float = 0.5
    approach_speed: float = 0.02


class AdaptiveForceControl(TaskControl):
    """Presses with a desired force on an environment of unknown stiffness, and follows poses along the other axes.

    The scheme is that of Cortesão, Park and Khatib (2006), figure 2.2 of the thesis. Task-space computed torque makes
    the tool a double integrator. The `velocity_gain` K2 of the options damps it along the normal, so that an
    environment of stiffness Ks makes it the plant ``f'' = Ks u - K2 f'``. State feedback places both poles of the force
    loop according to the `bandwidth`, with gains that are inversely proportional to the estimated stiffness. An active
    observer estimates the force, its rate and a disturbance, which stands for errors of the model and is subtracted
    from the command. Out of contact the tool approaches at the `approach_speed`.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    tool : Tool
    force : float or callable
        Desired force of the tool on the environment, N: a number, an array for several runs, or a function of time (s).
    normal : array_like
        (3,) direction from the tool into the environment, base frame.
    reference : object
        As in :class:`TaskSpaceControl`; its component along the normal is not used.
    kp, kd : array_like
        As in :class:`TaskSpaceControl`, for the axes that follow the pose.
    options : ForceControlOptions, optional
        How the force loop is tuned; the defaults suit a quiet sensor.

    Other Parameters
    ----------------
    null_space, base, compensate_drives, sign_width, largest_mass, length, sample_time, velocity : optional
        As in :class:`TaskSpaceControl`.

    Attributes
    ----------
    reference : PoseReference
    observer : ActiveObserver
    stiffness : ndarray
        (...,) the estimated stiffness, N/m.
    contact : ndarray
        (...,) of bool, whether the tool is in contact.

    References
    ----------
    R. Cortesão, J. Park and O. Khatib, Real-time adaptive control for haptic telemanipulation with Kalman active
    observers, IEEE Transactions on Robotics 22(5), 2006.
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        tool: Tool,
        force: float | Array | Callable[[float], Any],
        *,
        normal: ArrayLike,
        reference: Any,
        kp: ArrayLike,
        kd: ArrayLike,
        options: ForceControlOptions | None = None,
        **task: Unpack[TaskOptions],
    ) -> None:
        super().__init__(model, parameters, tool, reference, "pose" if model.dof >= 6 else "position", **task)
        tuning = ForceControlOptions() if options is None else options
        count = len(self._task.rows)
        self._kp, self._kd = symmetric_gains(kp, count, "kp"), symmetric_gains(kd, count, "kd")
        self._normal = np.zeros(count)
        self._normal[:3] = _direction(normal)
        self._wanted = force if callable(force) else _constant(force)
        bandwidth = positive(tuning.bandwidth, "bandwidth", "rad/s")
        self._damping = (
            2.0 * bandwidth if tuning.velocity_gain is None else positive(tuning.velocity_gain, "velocity_gain", "1/s")
        )
        loop = force_loop(bandwidth, self._damping, self.sample_time)
        self._gains = loop.gains
        self.observer = ActiveObserver(
            loop.transition,
            loop.control,
            [1.0, 0.0],
            measurement_noise=tuning.force_noise,
            disturbance_noise=positive(tuning.disturbance_rate, "disturbance_rate", "m/s²/√s")
            * float(np.sqrt(self.sample_time)),
            order=tuning.order,
        )
        # The mean of so many samples has the noise `_QUIET`; a first-order filter with time constant T averages over
        # about 1 + 2 T / sample_time of them.
        samples = max((tuning.force_noise / _QUIET) ** 2, 1.0)
        smoothing = min(0.5 * self.sample_time * (samples - 1.0), _LONGEST_SMOOTHING)
        self._keep = float(np.exp(-self.sample_time / smoothing)) if smoothing else 0.0
        quiet = tuning.force_noise * float(np.sqrt((1.0 - self._keep) / (1.0 + self._keep)))
        # Ten increments of ten standard deviations each give the stiffness within about 5 %. Forces of five standard
        # deviations are contact: noise exceeds them less than once in a million samples.
        self._estimator = (
            StiffnessEstimator(smallest_force=max(0.5, 10.0 * quiet), smoothing=smoothing)
            if tuning.stiffness is None
            else tuning.stiffness
        )
        self._jump = _JUMP * tuning.force_noise
        contact_force = positive(tuning.contact_force, "contact_force", "N")
        self._threshold = max(contact_force, 5.0 * quiet)
        self._obvious = max(contact_force, 5.0 * tuning.force_noise)
        self._speed = positive(tuning.approach_speed, "approach_speed", "m/s")
        self.contact = self._jumped = np.zeros((), dtype=np.bool_)
        self._smooth: Array = np.zeros(())
        self._wrench: Array = np.zeros(6)
        self._pushed, self._steady, self._ahead, self._time = np.zeros(()), np.zeros(()), np.zeros(()), 0.0
        self._check_gains(self._part.configurations(), share=0.5)

    @property
    def stiffness(self) -> Array:
        """The estimated stiffness of the environment (...,), N/m."""
        return self._estimator.stiffness

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement, out of contact."""
        super().start(measurement)
        force = -(require_force(measurement)[..., :3] @ self._normal[:3])
        self._estimator.start(force.shape)
        self.observer.start(np.asarray(force))
        self.contact = self._jumped = np.zeros(force.shape, dtype=np.bool_)
        self._pushed, self._steady = np.zeros(force.shape), np.zeros(force.shape)
        self._smooth, self._wrench = np.zeros(force.shape), require_force(measurement).copy()
        self._ahead = np.asarray(self._task.pose(measurement.q)[..., :3, 3] @ self._normal[:3])
        self._time = measurement.t

    def _feedback(self, q: Array) -> Feedback:
        # This is the loop out of contact; in contact the poles are placed in sampled time.
        along = np.outer(self._normal, self._normal)
        across = np.eye(len(along)) - along
        stiffness, damping = across @ self._kp, across @ self._kd
        return self._task.feedback(
            q, stiffness + 0.25 * self._damping**2 * along, damping + self._damping * along, self._null_space
        )

    def _command(self, measurement: Measurement) -> Array:
        q, dq = measurement.q, self._velocity.velocity(measurement)
        task, normal = self._task, self._normal
        wrench = require_force(measurement)
        state, target = task.state(q, dq), self.reference.target(measurement.t)
        speed = state.velocity @ normal
        along = self._acceleration(measurement.t, state.pose[..., :3, 3] @ normal[:3], speed, -(wrench @ _six(normal)))
        free = task.chosen(target.acceleration) + applied(self._kp, task.error(state, target))
        free = free + applied(self._kd, task.chosen(target.twist) - state.velocity)
        wanted = free + (along - free @ normal)[..., None] * normal
        torque = task.torque(state, task.acceleration(state, wanted, self._null_space.acceleration(q, dq)))
        torque -= applied(np.swapaxes(state.full, -1, -2), self._cancelled(wrench))
        return torque

    def _cancelled(self, wrench: Array) -> Array:
        """Return the wrench that is compensated (..., 6): observed along the normal, and smoothed otherwise."""
        self._wrench = self._keep * self._wrench + (1.0 - self._keep) * wrench
        normal = _six(self._normal)
        observed = np.where(self.contact, self.observer.state[..., 0], -(wrench @ normal))
        return self._wrench - (observed + self._wrench @ normal)[..., None] * normal

    def _acceleration(self, t: float, position: Array, speed: Array, force: Array) -> Array:
        """Return the acceleration along the normal (...,), m/s²."""
        before = self.contact
        self._smooth = self._keep * self._smooth + (1.0 - self._keep) * force
        # A force far above the noise of one sample is contact at once, a smaller one when the smoothed force shows it.
        self.contact = self._smooth > np.where(before, 0.5 * self._threshold, self._threshold)
        self.contact = self.contact | (force > self._obvious)
        self._smooth = np.where(self.contact & ~before, np.maximum(force, self._smooth), self._smooth)
        wanted = np.asarray(self._wanted(t) if callable(self._wanted) else self._wanted, dtype=np.float64)
        state, disturbance = self.observer.update(force, self._pushed, self._estimator.stiffness)
        # A jump of the force is a change of the environment, which neither the plant of the observer nor the estimator
        # of a constant stiffness describes.
        jumps = np.abs(self.observer.innovation) > self._jump
        stiffness = self._estimator.update(t, position, force, self.contact & ~(jumps & ~self._jumped))
        self._jumped = jumps
        begins = ~(before & self.contact) | jumps
        if begins.any():
            # The disturbance cancelled the part of the command that exceeded the damping of a steady motion.
            taken = np.where(before & jumps, self._steady, self._damping * speed - self._pushed)
            fresh = np.stack((force, np.where(self.contact, stiffness * speed, 0.0)), axis=-1)
            self.observer.start(force, fresh, np.where(self.contact, taken, 0.0), where=begins)
            state, disturbance = self.observer.state, self.observer.disturbance
        self._steady = disturbance
        feedback = (self._gains[0] * (wanted - state[..., 0]) - self._gains[1] * state[..., 1]) / stiffness
        self._pushed = np.where(self.contact, feedback - disturbance, self._approach(t, wanted, position))
        return self._pushed - self._damping * speed

    def _approach(self, t: float, wanted: Array, position: Array) -> Array:
        """Return the command (...,) out of contact, with which the tool follows a point that moves along the normal."""
        speed = np.where(wanted > 0.0, self._speed, 0.0)
        step = speed * max(t - self._time, 0.0)
        self._time = t
        # In contact the point stays with the tool. Out of contact its lead is bounded, because friction may hold the
        # tool back.
        self._ahead = np.where(self.contact, position, np.minimum(self._ahead + step, position + _LEAD))
        # The stiffness that gives critical damping with the damping K2.
        return self._damping * speed + 0.25 * self._damping**2 * (self._ahead - position)


def _direction(normal: ArrayLike) -> Array:
    vector = np.array(normal, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise InputError(f"normal must be a direction (3,) other than zero, got {normal!r}.")
    return vector / np.linalg.norm(vector)


def _constant(force: ArrayLike) -> Array:
    wanted = np.array(force, dtype=np.float64)
    if not np.isfinite(wanted).all():
        raise InputError(f"force must be finite, in N, got {force!r}.")
    return wanted


def _six(normal: Array) -> Array:
    return np.concatenate((normal[:3], np.zeros(3)))
