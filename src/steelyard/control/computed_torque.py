"""Computed torque: the robot becomes a double integrator at every joint (thesis section 2.4.1)."""

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
from .sensing import ForceSensing
from .tool import Tool
from .velocities import VelocityEstimator

__all__ = ["ComputedTorque"]

Array = NDArray[np.float64]


class ComputedTorque(ControlBlock):
    """Linearises the robot by nonlinear feedback and tracks a motion (thesis eq. 2.23 to 2.27).

    ``tau = M a + C dq + g (+ h) (- J' force)`` with ``a = ddq_r + Kd (dq_r - dq) + Kp (q_r - q) + Ki integral``. With
    the robot's true parameters and `drives` the joints obey ``ddq = a`` and the error decays as
    ``e'' + Kd e' + Kp e = 0``.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    reference : object
        A trajectory, joint positions, a function from a time to q, dq and ddq, or a :class:`JointReference`.
    kp, kd, ki : array_like
        A number or (N,): 1/s², 1/s and 1/s³.
    base : bool
        Whether `parameters` are base parameters.
    drives : bool
        Whether friction, rotors and other terms, ``h`` of eq. 2.9, are compensated. The sign of a velocity is hard to
        know near rest, where compensation of Coulomb friction makes a joint chatter (thesis section 5.2).
    sign_width : float
        With `drives`, speed within which the sign of Coulomb friction changes smoothly, rad/s or m/s; 0 for the exact
        sign.
    tool : Tool, optional
        Where a force sensor sits, whose wrench is compensated, ``tau_e`` of eq. 2.25; needs measured forces.
    period : float
        s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given.

    Attributes
    ----------
    reference : JointReference

    See Also
    --------
    PositionTracking : With positions as the only reference (thesis eq. 5.8).

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> delta[model.parameter_names.index("Lzz1")] = 0.5
    >>> controller = ComputedTorque(model, delta, [0.1], kp=100.0, kd=20.0)
    >>> here = Measurement(t=0.0, q=np.zeros(1))
    >>> controller.start(here)
    >>> controller.torque(here).round(9).tolist()
    [44.62]
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        reference: Any,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike = 0.0,
        base: bool = False,
        drives: bool = False,
        sign_width: float = 0.01,
        tool: Tool | None = None,
        period: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        self._dynamics = "inverse_dynamics" if drives else "computed_torque"
        functions = (self._dynamics,) if tool is None else (self._dynamics, tool.jacobian)
        point = (0.0, 0.0, 0.0) if tool is None else tool.point
        super().__init__(
            ModelPart(model, parameters, functions, base=base, point=point, sign_width=sign_width if drives else 0.0),
            period,
            velocity,
        )
        self.reference = joint_reference(reference, model.joint_count, period=self.period)
        self._kp = joint_gains(kp, model.joint_count, "kp")
        self._kd = joint_gains(kd, model.joint_count, "kd")
        self._ki = joint_gains(ki, model.joint_count, "ki")
        self._tool = tool
        self._sensor = ForceSensing()
        self._integrates = bool(self._ki.any())
        self._integral: Array | float = 0.0
        self._time = 0.0

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement."""
        super().start(measurement)
        if self._tool is not None:
            self._sensor.start(measurement)
        self._integral, self._time = 0.0, measurement.t

    def torque(self, measurement: Measurement) -> Array:
        """Return the joint torques (..., N), N·m or N."""
        q, dq = measurement.q, self._velocity.velocity(measurement)
        wanted, speed, acceleration = self.reference.at(measurement.t)
        error = wanted - q
        command = acceleration + self._kp * error + self._kd * (speed - dq)
        if self._integrates:
            self._integral = self._integral + (measurement.t - self._time) * error
            self._time = measurement.t
            command = command + self._ki * self._integral
        torque = self._part(self._dynamics, q, dq, command)
        if self._tool is not None:
            force = self._sensor.wrench(measurement)
            jacobian = self._part.matrix(self._tool.jacobian, (6, self._part.joint_count), q)
            torque -= (force[..., None, :] @ jacobian)[..., 0, :]
        return torque
