"""Gravity compensation: the robot floats, so that it can be guided by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.files.arguments import per_joint
from steelyard.simulation import Measurement

from .block import ControlBlock
from .model_part import ModelPart
from .sampled_loop import Feedback
from .velocities import VelocityEstimator

__all__ = ["GravityCompensation"]

Array = NDArray[np.float64]


class GravityCompensation(ControlBlock):
    """Compensates gravity, ``tau = g(q) + C(q, dq) dq - damping dq``, as in the first stage of thesis section 5.2.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`.
    base : bool
        Whether `parameters` are base parameters.
    coriolis : bool
        Whether Coriolis and centripetal torques are compensated as well.
    damping : array_like
        Viscous damping that is added at each joint: a number or (N,), N·m·s/rad or N·s/m.
    sample_time : float
        s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> delta = np.zeros(model.parameter_count)
    >>> delta[model.parameter_names.index("m1")] = 2.0
    >>> controller = GravityCompensation(model, delta)
    >>> here = Measurement(t=0.0, q=np.zeros(1))
    >>> controller.start(here)
    >>> controller.torque(here).round(9).tolist()
    [19.62]
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        *,
        base: bool = False,
        coriolis: bool = False,
        damping: ArrayLike = 0.0,
        sample_time: float = 0.001,
        velocity: VelocityEstimator | None = None,
    ) -> None:
        functions = ("gravity", "coriolis") if coriolis else ("gravity",)
        super().__init__(ModelPart(model, parameters, functions, base=base), sample_time, velocity)
        self._coriolis = coriolis
        self._damping = per_joint(damping, model.dof, "damping", finite=True)
        self._damps = bool(self._damping.any())
        self._check_gains(self._part.configurations(), share=0.5)

    def _feedback(self, q: Array) -> Feedback:
        damping = np.tile(np.diag(self._damping), (len(q), 1, 1))
        return Feedback(0.0 * damping, damping)

    def _command(self, measurement: Measurement) -> Array:
        q = measurement.q
        torque = self._part("gravity", q)
        if self._coriolis or self._damps:
            dq = self._velocity.velocity(measurement)
            torque -= self._damping * dq
            if self._coriolis:
                torque += self._part("coriolis", q, dq)
        return torque
