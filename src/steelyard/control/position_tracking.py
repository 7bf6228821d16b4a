"""Computed torque with positions as the only reference, turned on in stages (thesis section 5.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files.arguments import per_joint, positive
from steelyard.simulation import Measurement

from .block import ControlBlock
from .joint_references import configurations_of, joint_reference
from .model_part import ModelPart
from .sampled_loop import Feedback
from .velocities import VelocityEstimator

__all__ = ["PositionTracking"]

Array = NDArray[np.float64]


class PositionTracking(ControlBlock):
    """Follows a reference whose velocity and acceleration are not known in advance (thesis eq. 5.8 and figure 5.5).

    The torque is ``tau = C dq + g + M a`` with ``a = Kp (q_r - q) - Kd dq``. Since velocity and acceleration of the
    reference are not used, a joint lags behind a moving reference by about ``Kd / Kp`` seconds. Any error beyond this
    lag comes from errors of the parameters.

    The controller is turned on in the three stages of the thesis's experiment: from the start only ``C dq + g`` acts;
    at `control_start` the PD control begins, with the reference held at its first position; at `reference_start` the
    reference begins to move.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    reference : object
        As in :class:`FeedforwardTracking`; its time counts from `reference_start`. Only positions are used.
    kp, kd : array_like
        A number or (N,), 1/s² and 1/s. Thesis tables 5.1 and 5.2 have the gains that were used on the WAM.
    control_start, reference_start : float
        When the PD control and the reference begin, s. Where both are 0, everything is turned on at once.
    base : bool
        Whether `parameters` are base parameters.
    sample_time : float
        s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given, as in the thesis.

    Attributes
    ----------
    reference : JointReference
    control_start, reference_start : float

    Raises
    ------
    InputError
        If the reference starts before the control.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> delta[model.parameter_names.index("Lzz1")] = 0.5
    >>> controller = PositionTracking(model, delta, [0.1], kp=100.0, kd=20.0, control_start=2.0, reference_start=4.0)
    >>> controller.start(Measurement(t=0.0, q=np.zeros(1)))
    >>> [controller.torque(Measurement(t=t, q=np.zeros(1))).round(9).tolist() for t in (0.0, 2.0)]
    [[19.62], [44.62]]
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        reference: Any,
        *,
        kp: ArrayLike,
        kd: ArrayLike,
        control_start: float = 0.0,
        reference_start: float = 0.0,
        base: bool = False,
        sample_time: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        super().__init__(ModelPart(model, parameters, ("computed_torque",), base=base), sample_time, velocity)
        self.reference = joint_reference(reference, model.dof, sample_time=self.sample_time)
        self._kp = per_joint(kp, model.dof, "kp", finite=True)
        self._kd = per_joint(kd, model.dof, "kd", finite=True)
        self.control_start = positive(control_start, "control_start", "s", zero=True)
        self.reference_start = positive(reference_start, "reference_start", "s", zero=True)
        if self.reference_start < self.control_start:
            raise InputError(
                f"The reference must not start before the control: control_start is {self.control_start:g} s and "
                f"reference_start {self.reference_start:g} s."
            )
        self._check_gains(configurations_of(self.reference))

    def _feedback(self, q: Array) -> Feedback:
        inertia = self._part.nominal("inertia_matrix", q)
        return Feedback(inertia * self._kp, inertia * self._kd)

    def _command(self, measurement: Measurement) -> Array:
        q, dq = measurement.q, self._velocity.velocity(measurement)
        if measurement.t < self.control_start:
            return self._part("computed_torque", q, dq, np.zeros_like(q))
        wanted = self.wanted(measurement.t)
        return self._part("computed_torque", q, dq, self._kp * (wanted - q) - self._kd * dq)

    def wanted(self, t: float) -> Array:
        """Return the reference positions (..., N) at time t (s), rad or m."""
        return self.reference.at(max(t - self.reference_start, 0.0))[0]
