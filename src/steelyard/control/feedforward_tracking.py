"""PD control with feed-forward of the reference and partial feedback linearisation (thesis section 4.3.1)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.simulation import Measurement

from .block import ControlBlock
from .gains import joint_gains
from .model_part import ModelPart
from .references import joint_reference
from .velocities import VelocityEstimator

__all__ = ["FeedforwardTracking"]

Array = NDArray[np.float64]


class FeedforwardTracking(ControlBlock):
    """Tracks a motion for identification, ``tau = c + g + M ddq_r + Kp (q_r - q) + Kd (dq_r - dq)``.

    Thesis eq. 4.16 to 4.18. The gains are torques: they do not pass through the inertia matrix, so that each joint can
    be tuned by itself. Friction is not compensated, since before an identification nobody knows it.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`; from CAD, for instance.
    reference : object
        A trajectory, joint positions, a function from a time to q, dq and ddq, or a :class:`JointReference`.
    kp, kd : array_like
        A number or (N,): N·m/rad or N/m, and N·m·s/rad or N·s/m; those of thesis table 4.3 for the WAM.
    base : bool
        Whether `parameters` are base parameters.
    period : float
        s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given, as in the thesis.

    Attributes
    ----------
    reference : JointReference

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> controller = FeedforwardTracking(model, delta, [0.1], kp=50.0, kd=5.0)
    >>> here = Measurement(t=0.0, q=np.zeros(1))
    >>> controller.start(here)
    >>> controller.torque(here).round(9).tolist()
    [24.62]
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        reference: Any,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        base: bool = False,
        period: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        super().__init__(ModelPart(model, parameters, ("computed_torque",), base=base), period, velocity)
        self.reference = joint_reference(reference, model.joint_count, period=self.period)
        self._kp = joint_gains(kp, model.joint_count, "kp")
        self._kd = joint_gains(kd, model.joint_count, "kd")

    def torque(self, measurement: Measurement) -> Array:
        """Return the joint torques (..., N), N·m or N."""
        q, dq = measurement.q, self._velocity.velocity(measurement)
        wanted, speed, acceleration = self.reference.at(measurement.t)
        torque = self._part("computed_torque", q, dq, acceleration)
        torque += self._kp * (wanted - q)
        torque += self._kd * (speed - dq)
        return torque
