"""Control of each joint by itself, without a model: what most drives do with the reference that they are sent."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.files.arguments import per_joint, positive
from steelyard.simulation import Measurement

from .joint_references import joint_reference
from .velocities import NumericalDifference, VelocityEstimator

__all__ = ["JointFeedback"]

Array = NDArray[np.float64]


class JointFeedback:
    """Proportional, integral and derivative control of each joint, without a model of the robot.

    The torque is ``tau = Kp (q_r - q) + Kd (dq_r - dq) + Ki sum (q_r - q) dt``. A position loop around a velocity loop,
    with gains k_p and k_v, is the same with ``Kp = k_p k_v`` and ``Kd = k_v``.

    Parameters
    ----------
    reference : object
        A trajectory, joint positions, a function from a time to q, dq and ddq, or a :class:`JointReference`.
    kp, kd, ki : array_like
        (N,): N·m/rad or N/m, N·m·s/rad or N·s/m, N·m/(rad·s) or N/(m·s); a number for all joints.
    count : int
        Number N of joints.
    reference_velocity : bool
        Whether the velocity of the reference is fed forward; without it, the damping acts on dq alone.
    torque_limit : array_like, optional
        (N,) or a number, N·m or N.
    sample_time : float
        s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given.

    Examples
    --------
    >>> controller = JointFeedback([0.1], kp=50.0, kd=5.0, count=1)
    >>> here = Measurement(t=0.0, q=np.zeros(1))
    >>> controller.start(here)
    >>> controller.torque(here).round(9).tolist()
    [5.0]
    """

    def __init__(
        self,
        reference: Any,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        count: int,
        ki: ArrayLike = 0.0,
        reference_velocity: bool = True,
        torque_limit: ArrayLike = np.inf,
        sample_time: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        self.sample_time = positive(sample_time, "sample_time", "s")
        self.reference = joint_reference(reference, count, sample_time=self.sample_time)
        self._kp, self._kd = per_joint(kp, count, "kp", finite=True), per_joint(kd, count, "kd", finite=True)
        self._ki = per_joint(ki, count, "ki", finite=True)
        self._limit = per_joint(torque_limit, count, "torque_limit")
        self._forward = bool(reference_velocity)
        self._velocity = NumericalDifference() if velocity is None else velocity
        self._integral: Array = np.zeros(count)

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement."""
        self._velocity.start(measurement)
        self._integral = np.zeros_like(measurement.q)

    def torque(self, measurement: Measurement) -> Array:
        """Return the commanded joint torques (..., N), N·m or N."""
        wanted, speed, _ = self.reference.at(measurement.t)
        error = wanted - measurement.q
        damped = (speed if self._forward else 0.0) - self._velocity.velocity(measurement)
        torque = self._kp * error + self._kd * damped + self._ki * self._integral
        self._integral = self._integral + self.sample_time * error
        return np.clip(torque, -self._limit, self._limit)
