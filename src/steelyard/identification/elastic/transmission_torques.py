"""Torques that the transmissions of an identified robot carry, and the motion of the links behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.elastic_robot import motor_symbols
from steelyard.estimators.joint_stiffness import JointStiffness, Motion, motion_behind

from ..result import Identification
from .second_encoders import TwoEncoders

__all__ = ["Transmissions", "unseen_motions"]

Array = NDArray[np.float64]


class Transmissions:
    """A model of the torques that the transmissions of an identified robot carry.

    `errors` are the standard errors of parameters that torques alone determine, by their names.
    """

    def __init__(self, model: Model, parameters: Array, errors: Mapping[str, float] | None = None) -> None:
        self.model, self.parameters = model, parameters
        self.errors = errors or {}
        self.motor_side, self.rotors = _motor_side(model), _rotors(model)
        # What depends on a channel, such as a temperature, is friction, which the transmission does not carry.
        self.plain = model.without_channels

    @classmethod
    def of(cls, result: Identification) -> Transmissions:
        """Return the transmissions of a robot whose links were all identified."""
        estimate = result.estimate
        assert estimate.parameters is not None
        told = zip(estimate.base_names, estimate.base_expressions, estimate.standard_error, strict=True)
        errors = {name: float(error) for name, expression, error in told if name == expression}
        return cls(result.model, np.asarray(estimate.parameters), errors)

    def torques(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(S, N) torques of the links alone."""
        return self._at_references(q, dq, ddq, np.where(self.motor_side, 0.0, self.parameters))

    def drive_torques(self, q: Array, dq: Array, ddq: Array, channels: Mapping[str, Array] | None = None) -> Array:
        """(S, N) torques of what is on the motor's side alone, with channels as logged, or else at their references."""
        drives = np.where(self.motor_side, self.parameters, 0.0)
        if channels is None or not self.model.robot.channels:
            return self._at_references(q, dq, ddq, drives)
        return np.asarray(self.model.inverse_dynamics(q, dq, ddq, drives, channels=channels))

    def _at_references(self, q: Array, dq: Array, ddq: Array, parameters: Array) -> Array:
        return np.asarray(self.plain.inverse_dynamics(q, dq, ddq, self.model.parameters_without_channels(parameters)))

    def missing_rotor(self, joint: int, stiffness: JointStiffness) -> float:
        """Return by how much the inertia of a joint's motor exceeds that of its rotor among the parameters.

        Torques alone do not tell the two apart from the links where the joint is the first or the second of an arm.
        """
        return stiffness.motor_inertia - self.rotor(joint) if np.isfinite(stiffness.motor_inertia) else 0.0

    def rotor(self, joint: int) -> float:
        """The inertia of a joint's rotor among the parameters; zero where there is none."""
        place = self.rotors[joint]
        return 0.0 if place < 0 else float(self.parameters[place])

    def rotor_error(self, joint: int) -> float:
        """Standard error of a joint's rotor, infinite where torques alone do not tell it from the links; 0 without one.

        On simulated arms (MuJoCo) it was 0.3 to 4 % of the rotor with clean torques, and 7 to 73 % with noisy ones.
        """
        place = self.rotors[joint]
        if place < 0:
            return 0.0
        error = self.errors.get(self.model.parameter_names[place], np.inf)
        return error if error > 0.0 else np.inf


def _motor_side(model: Model) -> NDArray[np.bool_]:
    """Return which parameters are those of terms on the motor's side of the transmission."""
    robot = model.robot
    kinds = [
        one.symbol in symbols
        for term, symbols in ((term, motor_symbols(term, robot.dof)) for term in robot.terms)
        for one in term.parameters
    ]
    flags = np.zeros(model.parameter_count, dtype=bool)
    links = np.zeros(model.parameter_count, dtype=bool)
    for columns in model.link_columns:
        links[list(columns)] = True
    # The terms of each driving joint stand together, in the order of the robot's terms.
    terms = np.flatnonzero(~links)
    flags[terms] = np.resize(np.array(kinds, dtype=bool), len(terms)) if kinds else False
    return flags


def _rotors(model: Model) -> NDArray[np.intp]:
    """Return for each coordinate the place of its rotor inertia among the parameters, -1 where there is none."""
    found = np.full(model.dof, -1)
    names = list(model.parameter_names)
    for k, joint in enumerate(model.robot.driving_joints):  # whose number parameters bear, with joints that mimic too
        name = f"Ia{joint + 1}"
        if name in names:
            found[k] = names.index(name)
    return found


def unseen_motions(
    one: TwoEncoders, joints: Sequence[JointStiffness], transmissions: Transmissions
) -> tuple[Motion, Motion]:
    """The motion of links and of motors in a log by its first encoders, those of the other side by deflections.

    What is predicted is the position of the side that the first encoders do not see.
    """
    motion = one.motion
    torque = transmissions.torques(*motion)
    carried = zip(one.places, joints, strict=True)
    shape = np.column_stack([joint.deflections(torque[:, place]) for place, joint in carried])
    if one.settings.side == "motor":  # the first encoders are those of the links
        return motion, motion_behind(motion, one.t, one.places, -shape)
    return motion_behind(motion, one.t, one.places, shape), motion
