"""PD control with feed-forward of the reference and partial feedback linearisation (thesis section 4.3.1)."""

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
from .task_dynamics import applied
from .velocities import VelocityEstimator

__all__ = ["FeedforwardTracking"]

Array = NDArray[np.float64]


class FeedforwardTracking(ControlBlock):
    """Tracks a motion for identification by PD control with feed-forward (thesis eq. 4.16 to 4.18).

    The torque is ``tau = c + g + M ddq_r + Kp (q_r - q) + Kd (dq_r - dq)``. The products of gains and errors are
    torques: they do not pass through the inertia matrix, so that each joint can be tuned by itself. Where the inertia
    matrix couples the joints strongly, the combined motion of least inertia limits the gains of all joints; with
    `coupled` the gains pass through the inertia matrix of links and rotors, which removes this limit. Friction is not
    compensated by default, because it is not known before an identification. Where it is known, `compensate_drives`
    feeds it forward along the reference, which does not change the feedback and its stability margins.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`, for instance the values from CAD.
    reference : object
        A trajectory, joint positions, a function from a time to q, dq and ddq, or a :class:`JointReference`.
    kp, kd : array_like
        A number or (N,): N·m/rad or N/m, and N·m·s/rad or N·s/m; with `coupled` 1/s² and 1/s. Thesis table
        4.3 has the gains that were used on the WAM.
    coupled : bool
        Whether gains times errors are accelerations, which the inertia matrix of links and rotors turns into torques.
    base : bool
        Whether `parameters` are base parameters.
    compensate_drives : bool
        Whether the torques of friction, rotors and other terms along the reference are added.
    sample_time : float
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
        coupled: bool = False,
        base: bool = False,
        compensate_drives: bool = False,
        sample_time: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        functions = ("computed_torque", *["total_inertia_matrix"] * coupled, *["drive_torque"] * compensate_drives)
        super().__init__(ModelPart(model, parameters, functions, base=base), sample_time, velocity)
        self._coupled, self._compensates = bool(coupled), bool(compensate_drives)
        self.reference = joint_reference(reference, model.dof, sample_time=self.sample_time)
        self._kp = per_joint(kp, model.dof, "kp", finite=True)
        self._kd = per_joint(kd, model.dof, "kd", finite=True)
        self._check_gains(configurations_of(self.reference))

    def _feedback(self, q: Array) -> Feedback:
        if self._coupled:
            inertia = self._part.nominal("total_inertia_matrix", q)
            return Feedback(inertia * self._kp, inertia * self._kd)
        kp, kd = (np.tile(np.diag(gains), (len(q), 1, 1)) for gains in (self._kp, self._kd))
        return Feedback(kp, kd)

    def _command(self, measurement: Measurement) -> Array:
        q, dq = measurement.q, self._velocity.velocity(measurement)
        wanted, speed, acceleration = self.reference.at(measurement.t)
        torque = self._part("computed_torque", q, dq, acceleration)
        feedback = self._kp * (wanted - q) + self._kd * (speed - dq)
        if self._coupled:
            count = self._part.dof
            feedback = applied(self._part.matrix("total_inertia_matrix", (count, count), q), feedback)
        torque += feedback
        if self._compensates:
            if not wanted.shape == speed.shape == acceleration.shape == q.shape:
                wanted, speed, acceleration, _ = np.broadcast_arrays(wanted, speed, acceleration, q)
            torque += self._part("drive_torque", wanted, speed, acceleration)
        return torque
