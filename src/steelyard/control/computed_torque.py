"""Computed torque: feedback that makes every joint of the robot a double integrator (thesis section 2.4.1)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.files.arguments import per_joint
from steelyard.simulation import Measurement

from .block import ControlBlock
from .joint_references import configurations_of, joint_reference
from .model_part import ModelPart
from .sampled_loop import Feedback
from .tool import ForceSensing, Tool
from .velocities import VelocityEstimator

__all__ = ["ComputedTorque"]

Array = NDArray[np.float64]


class ComputedTorque(ControlBlock):
    """Linearises the robot by nonlinear feedback and tracks a motion (thesis eq. 2.23 to 2.27).

    The torque is ``tau = M a + C dq + g (+ h) (- J' force)`` with the commanded acceleration
    ``a = ddq_r + Kd (dq_r - dq) + Kp (q_r - q) + Ki integral``. With the robot's true parameters and
    `compensate_drives` the joints obey ``ddq = a`` and the error decays as ``e'' + Kd e' + Kp e = 0``.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    reference : object
        A trajectory, joint positions, a function from a time to q, dq and ddq, or a :class:`JointReference`.
    kp, kd, ki : array_like
        A number or (N,): 1/s², 1/s and 1/s³.
    integral_limit : array_like
        A number or (N,), rad or m. Errors above this limit are not integrated, and the integral commands at most the
        acceleration ``kp`` times the limit. A distant target therefore causes no windup, while disturbances that would
        leave an error of up to the limit are still compensated.
    torque_limit : array_like, optional
        Largest torques of the drives: a number or (N,), N·m or N. Where a torque would exceed its limit, the commanded
        acceleration is scaled down as a whole and keeps its direction, while gravity, Coriolis torques and friction
        stay compensated. Clipping each torque by itself would change the direction, and the joints would disturb each
        other. By default the effort limits of the description are used with `ki`, and no limits without.
    base : bool
        Whether `parameters` are base parameters.
    compensate_drives : bool
        Whether friction, rotors and other terms, ``h`` of eq. 2.9, are compensated. The sign of a velocity is uncertain
        near rest, where compensation of Coulomb friction makes a joint chatter (thesis section 5.2).
    sign_width : float
        With `compensate_drives`, the velocity within which the sign of Coulomb friction changes smoothly, rad/s or m/s;
        0 for the exact sign.
    tool : Tool, optional
        The frame of a force sensor whose measured wrench is compensated, ``tau_e`` of eq. 2.25.
    sample_time : float
        s.
    velocity : VelocityEstimator, optional
        How velocities are obtained; by numerical differences by default.

    Attributes
    ----------
    reference : JointReference

    See Also
    --------
    PositionTracking : Uses only the positions of the reference (thesis eq. 5.8).

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
        integral_limit: ArrayLike = 0.2,
        torque_limit: ArrayLike | None = None,
        base: bool = False,
        compensate_drives: bool = False,
        sign_width: float = 0.01,
        tool: Tool | None = None,
        sample_time: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        self._compensates = bool(compensate_drives)
        self._dynamics = "inverse_dynamics" if compensate_drives else "computed_torque"
        functions = (self._dynamics,) if tool is None else (self._dynamics, tool.jacobian)
        point = (0.0, 0.0, 0.0) if tool is None else tool.point
        super().__init__(
            ModelPart(
                model,
                parameters,
                functions,
                base=base,
                point=point,
                sign_width=sign_width if compensate_drives else 0.0,
            ),
            sample_time,
            velocity,
        )
        self.reference = joint_reference(reference, model.dof, sample_time=self.sample_time)
        self._kp = per_joint(kp, model.dof, "kp", finite=True)
        self._kd = per_joint(kd, model.dof, "kd", finite=True)
        self._ki = per_joint(ki, model.dof, "ki", finite=True)
        self._band = per_joint(integral_limit, model.dof, "integral_limit", finite=True)
        self._largest = self._kp * self._band / np.where(self._ki > 0.0, self._ki, 1.0)
        if torque_limit is None:
            robot = model.robot
            efforts = [robot.joints[k].effort_limit for k in robot.driving_joints]
            torque_limit = efforts if self._ki.any() else np.inf
        self._torque_limit = per_joint(torque_limit, model.dof, "torque_limit", zero=False)
        self._limited = bool(np.isfinite(self._torque_limit).any())
        self._tool = tool
        self._sensor = ForceSensing()
        self._integrates = bool(self._ki.any())
        self._integral: Array | float = 0.0
        self._time = 0.0
        self._check_gains(configurations_of(self.reference))

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement."""
        super().start(measurement)
        if self._tool is not None:
            self._sensor.start(measurement)
        self._integral, self._time = 0.0, measurement.t

    def _feedback(self, q: Array) -> Feedback:
        inertia = self._part.nominal("total_inertia_matrix" if self._compensates else "inertia_matrix", q)
        damping = inertia * self._kd
        if self._compensates:  # compensation of friction cancels its damping
            damping = damping - self._part.resistance(q)[1]
        return Feedback(inertia * self._kp, damping, inertia * self._ki if self._integrates else None)

    def _command(self, measurement: Measurement) -> Array:
        q, dq = measurement.q, self._velocity.velocity(measurement)
        wanted, speed, acceleration = self.reference.at(measurement.t)
        error = wanted - q
        command = acceleration + self._kp * error + self._kd * (speed - dq)
        if self._integrates:
            near = np.where(np.abs(error) <= self._band, error, 0.0)
            grown = self._integral + (measurement.t - self._time) * near
            self._integral, self._time = np.clip(grown, -self._largest, self._largest), measurement.t
            command = command + self._ki * self._integral
        torque = self._part(self._dynamics, q, dq, command)
        if self._limited and (np.abs(torque) > self._torque_limit).any():
            torque = self._within_limits(torque, self._part(self._dynamics, q, dq, 0.0 * command))
        if self._tool is not None:
            force = self._sensor.wrench(measurement)
            jacobian = self._part.matrix(self._tool.jacobian, (6, self._part.dof), q)
            torque -= (force[..., None, :] @ jacobian)[..., 0, :]
        return torque

    def _within_limits(self, torque: Array, carried: Array) -> Array:
        """Return torques (..., N) whose part beyond `carried` is scaled down until all are within their limits.

        A joint whose limit is below the torque in `carried` gives its limit, and does not reduce the others.
        """
        limit, beyond = self._torque_limit, torque - carried
        room = np.where(beyond > 0.0, limit - carried, limit + carried)
        counts = (beyond != 0.0) & (np.abs(carried) < limit)
        share = np.divide(room, np.abs(beyond), out=np.full_like(beyond, np.inf), where=counts)
        reduced = carried + np.clip(share.min(axis=-1, keepdims=True), 0.0, 1.0) * beyond
        return np.asarray(np.clip(reduced, -limit, limit))
