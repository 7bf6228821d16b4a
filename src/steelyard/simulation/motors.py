"""Elastic joints in a simulation: torques of motors, controllers that see motors, and rest under gravity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model, Transmission
from steelyard.dynamics.functions import given_parameters
from steelyard.errors import InputError

from .controller import Controller, Measurement

__all__ = ["MotorControl", "at_rest", "motor_coordinates"]

Array = NDArray[np.float64]


def motor_coordinates(model: Model) -> NDArray[np.intp]:
    """Return for each of the N joints the coordinate that its motor drives: its own, or that of an elastic joint.

    Parameters
    ----------
    model : Model
        Of :func:`steelyard.dynamics.elastic_robot`, or another.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.dynamics import elastic_robot
    >>> robot = sy.Robot.from_dh([(0, 0.3, 0, "q"), (0, 0.3, 0, "q")])
    >>> motor_coordinates(sy.Model(elastic_robot(robot, [2]))).tolist()
    [0, 2]
    """
    found = np.arange(model.dof)
    for term in model.robot.terms:
        if isinstance(term, Transmission):
            found = np.arange(model.dof - len(term.motors))
            found[np.array(term.joints) - 1] = np.array(term.motors) - 1
    return found


def at_rest(model: Model, parameters: ArrayLike, q: ArrayLike) -> Array:
    """Return links and motors (N + J,) with the links at `q` (N,), and each transmission bent by what it holds there.

    Damping and friction exert nothing at rest, so that the deflection is the torque of gravity and of springs over the
    stiffness; the motors then hold the links.

    Parameters
    ----------
    model : Model
        Of :func:`steelyard.dynamics.elastic_robot`.
    parameters : array_like
        (n,).
    q : array_like
        (N,) positions of the links.

    Raises
    ------
    InputError
        If a stiffness is not positive.

    Examples
    --------
    A mass of 2 kg, half a metre from an axis with a spring of 981 N·m/rad, bends it by a hundredth:

    >>> import steelyard as sy
    >>> from steelyard.dynamics import elastic_robot
    >>> model = sy.Model(elastic_robot(sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0)), [1]))
    >>> delta = [{"m1": 2.0, "Kej1": 981.0}.get(name, 0.0) for name in model.parameter_names]
    >>> at_rest(model, delta, [0.0]).round(6).tolist()
    [0.0, 0.01]
    """
    given, delta = np.asarray(q, dtype=np.float64), given_parameters(model, parameters)
    found = np.concatenate([given, np.zeros(model.dof - len(given))])
    for place, motor in enumerate(motor_coordinates(model)):
        found[motor] = given[place]
    still = np.zeros(model.dof)
    held = np.asarray(model.inverse_dynamics(found, still, still, delta))
    for term in model.robot.terms:
        if not isinstance(term, Transmission):
            continue
        for joint, motor in zip(term.joints, term.motors, strict=True):
            number = model.robot.driving_joints[joint - 1] + 1
            stiffness = float(delta[model.parameter_names.index(f"Kej{number}")])
            if not stiffness > 0.0:
                raise InputError(
                    f"Kej{number} must be positive, so that the transmission holds its link, got {stiffness:g}."
                )
            found[motor - 1] += held[joint - 1] / stiffness
    return found


class MotorControl:
    """A controller of a robot with rigid joints, which drives the motors of one with elastic joints, and sees them.

    That is what a real drive does: its encoder is at the motor.

    Parameters
    ----------
    controller : Controller
        Of N joints.
    model : Model
        Of :func:`steelyard.dynamics.elastic_robot`.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.dynamics import elastic_robot
    >>> class Holder:
    ...     sample_time = 0.001
    ...
    ...     def start(self, measurement): ...
    ...     def torque(self, measurement):
    ...         return -100.0 * measurement.q
    >>> model = sy.Model(elastic_robot(sy.Robot.from_dh([(0, 0.3, 0, "q")]), [1]))
    >>> MotorControl(Holder(), model).torque(Measurement(0.0, np.array([0.2, 0.3]))).tolist()
    [0.0, -30.0]
    """

    def __init__(self, controller: Controller, model: Model) -> None:
        self._controller, self._places, self._count = controller, motor_coordinates(model), model.dof
        self.sample_time = controller.sample_time

    def _seen(self, measurement: Measurement) -> Measurement:
        parts = {
            name: None if values is None else values[..., self._places]
            for name, values in (("q", measurement.q), ("dq", measurement.dq), ("torque", measurement.torque))
        }
        return replace(measurement, **parts)  # type: ignore[arg-type]

    def start(self, measurement: Measurement) -> None:
        """Begin at the motors' positions."""
        self._controller.start(self._seen(measurement))

    def torque(self, measurement: Measurement) -> Array:
        """Return the torques of the motors; nothing acts at their links."""
        own = self._controller.torque(self._seen(measurement))
        found = np.zeros((*np.shape(own)[:-1], self._count))
        found[..., self._places] = own
        return found
