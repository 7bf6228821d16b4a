"""The model of a robot with elastic joints that an identification makes, and the proof that such a robot can exist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model, RotorInertia, elastic_robot
from steelyard.dynamics.elastic_robot import motor_symbols
from steelyard.errors import InputError, SolverError
from steelyard.estimators.joint_stiffness import JointStiffness
from steelyard.feasibility import FeasibilityCertificate, FeasibleSet, Verdict, check, correct, verify_document
from steelyard.feasibility.certificates import speaks_of
from steelyard.feasibility.certificates.certificate import LAST_DIGITS
from steelyard.files import is_number
from steelyard.regression import Estimate
from steelyard.robot import Inertia

__all__ = ["ElasticModel", "elastic_model", "elastic_model_of", "elastic_verdict"]

Array = NDArray[np.float64]

_ROTOR_MASSES, _ROTOR_RADIUS = (1e-3, 1e-5, 1e-7), 1e-3
"""kg, tried in turn, and m. A rotor is a body, and bodies have mass; what an identification tells of it is its inertia
about the axis alone, and the rest is that of the link that carries it. So this little is taken from that link: its
spin, 2e-9 kg·m², is a millionth of the inertia of the smallest motors behind their gears."""
_ALIKE, _UNSEEN = 1e6, 1e-4
"""Weight of base parameters beside parameters in the search for the nearest robot, and how much of all base parameters
together it may change: a tenth of what the best logs tell."""
_TOLD_APART = 1e-8
"""Part of a rotor's column that the columns of links leave, above which motions tell the rotor from the links."""


@dataclass(frozen=True, eq=False)
class ElasticModel:
    """A model with the coordinates of links and of motors, its parameters, and what is proved of them.

    Attributes
    ----------
    model : Model
        Of :func:`steelyard.dynamics.elastic_robot`.
    joints : tuple of str
        The elastic joints; those whose stiffness has a lower bound alone are rigid here.
    parameters : ndarray
        (n,) feasible where the verdict says so.
    verdict : Verdict
        On links, drives, stiffness, damping and motors together.
    link_motion : bool
        Whether links were identified with their own motion, and not with that of the motors.
    """

    model: Model
    joints: tuple[str, ...]
    parameters: Array
    verdict: Verdict = field(repr=False)
    link_motion: bool = False

    @property
    def is_proved(self) -> bool:
        """Whether the parameters are proved to be feasible, with stiffnesses and motor inertias above zero."""
        names = list(self.model.parameter_names)
        places = [self.model.robot.joint_names.index(name) for name in self.joints]
        numbers = [self.model.robot.driving_joints[place] + 1 for place in places]
        stiff = all(self.parameters[names.index(f"Kej{number}")] > 0.0 for number in numbers)
        return self.verdict.status == "feasible" and stiff and not self.without_inertia

    @property
    def without_inertia(self) -> tuple[str, ...]:
        """The elastic joints whose motors have no inertia, with which nothing can be simulated."""
        drives, count = self.model.drives(self.parameters), self.model.dof - len(self.joints)
        return tuple(name for k, name in enumerate(self.joints) if not drives.rotor_inertia[count + k] > 1e-9)

    @property
    def sentence(self) -> str:
        """What is proved, in a sentence."""
        named = ", ".join(self.joints)
        if self.is_proved:
            return (
                f"Links and drives with the stiffness, damping and motor inertia of {named} are physically possible "
                "together, which is proved in exact arithmetic."
            )
        if self.without_inertia:
            return (
                f"The log does not determine the motor inertia of {', '.join(self.without_inertia)}, without which "
                "they cannot be simulated; state motor_inertia in [elastic]."
            )
        return (
            f"Links and drives are physically possible, but not together with the stiffness, damping and motor inertia "
            f"of {named}: {self.verdict.sentences()[0]}"
        )

    def write_mjcf(self, estimate: Estimate, source: str | Path, target: str | Path) -> None:
        """Write a copy of an MJCF with all that was identified, in which motors drive the elastic joints.

        See :func:`steelyard.robot.mjcf_motors.add_motors`.

        Parameters
        ----------
        estimate : Estimate
            Of links and drives.

        Raises
        ------
        InputError
            If the estimate does not belong to the file.
        """
        from steelyard.robot.mjcf_motors import MjcfMotor, add_motors  # loaded where it is written

        delta = _without_rotors(self.model, self.parameters, len(self.joints))
        robot, names = self.model.robot, list(self.model.parameter_names)
        drives, values = self.model.drives(delta), dict(zip(names, delta, strict=True))
        spin = dict(zip(names, self.parameters, strict=True))
        given = estimate.rotor_inertia
        motors = {}
        inertias = np.full(len(estimate.joint_names), np.nan) if given is None else np.array(given)
        for name in self.joints:
            place, motor = (robot.joint_names.index(one) for one in (name, f"{name}_motor"))
            number = robot.driving_joints[place] + 1
            inertia = drives.rotor_inertia[motor] + spin[f"Lzz{robot.driving_joints[motor] + 1}"]
            kept = (inertia, *np.nan_to_num((drives.damping[motor], drives.friction[motor])))
            motors[name] = MjcfMotor(values[f"Kej{number}"], values[f"Dej{number}"], *map(float, kept))
            inertias[place] = inertia
        links = np.array([values[name] for name in estimate.parameter_names])
        rigid = replace(estimate, parameters=links, rotor_inertia=inertias)
        rigid.write_description(source, target)
        add_motors(target, target, motors)

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in estimate.json."""
        proof = self.verdict.certificate
        certificate = proof.document() if self.is_proved and isinstance(proof, FeasibilityCertificate) else None
        return {
            "joints": list(self.joints),
            "parameter_names": list(self.model.parameter_names),
            "parameters": self.parameters.tolist(),
            "consistency": self.verdict.consistency if self.is_proved else None,
            "certificate": certificate,
            "link_motion": self.link_motion,
        }


def elastic_model(
    model: Model, parameters: Array, joints: Sequence[JointStiffness], consistency: str = "full"
) -> ElasticModel | None:
    """Make the model with elastic joints of what was identified, and prove that such a robot can exist.

    Parameters
    ----------
    model : Model
        Of links and drives.
    parameters : ndarray
        (n,) its parameters.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.

    Returns
    -------
    ElasticModel or None
        None where no stiffness was measured.
    """
    found = {one.joint: one for one in joints if one.verdict == "measured" and np.isfinite(one.stiffness)}
    if not found:
        return None
    given = dict(zip(model.parameter_names, parameters, strict=True))
    own_rotors = any(isinstance(term, RotorInertia) for term in model.robot.terms)
    if not own_rotors:  # the links of the fit hold the motors' inertias, which elastic joints have beside them
        model = Model(model.robot.with_terms(*model.robot.terms, RotorInertia()))
        given = {name: given.get(name, 0.0) for name in model.parameter_names}
    robot = elastic_robot(model.robot, list(found))
    whole = Model(robot)
    names = list(robot.joint_names)
    for name, joint in found.items():  # what torques alone do not tell: how much of the inertia is that of the motor
        if np.isfinite(joint.motor_inertia):
            symbol = f"Ia{_number(model, name)}"
            _move_inertia(model, given, symbol, joint.motor_inertia)
            if not own_rotors:
                given[symbol] = joint.motor_inertia
    values = dict.fromkeys(whole.parameter_names, 0.0)
    on_motor = frozenset[str]().union(*(motor_symbols(term, model.dof) for term in model.robot.terms))
    motor_of = {_number(model, name): names.index(f"{name}_motor") + _extra(model) + 1 for name in found}
    for k in range(model.dof):
        number = model.robot.driving_joints[k] + 1
        for term in model.robot.terms:
            for one in term.parameters:
                place = motor_of.get(number, number) if one.symbol in on_motor else number
                values[f"{one.symbol}{place}"] = given[f"{one.symbol}{number}"]
    for index in range(len(model.robot.links)):
        for column in model.link_columns[index]:
            name = model.parameter_names[column]
            values[name] = given[name]
    for name, joint in found.items():
        number = _number(model, name)
        values[f"Kej{number}"], values[f"Dej{number}"] = joint.stiffness, joint.damping
    delta = np.array([values[name] for name in whole.parameter_names])
    feasible_set = FeasibleSet(whole, "inertia" if consistency == "inertia" else "full")
    delta = _with_rotors(feasible_set, whole, delta, len(found))
    if not feasible_set.contains(delta):
        delta = _nearest(feasible_set, delta)
    verdict = check(feasible_set, parameters=delta)
    return ElasticModel(whole, tuple(found), delta, verdict)


def _extra(model: Model) -> int:
    """Return how many joints of a robot mimic others."""
    return len(model.robot.joints) - model.dof


def _number(model: Model, name: str) -> int:
    """The number that the parameters of a driving joint bear."""
    robot = model.robot
    return robot.driving_joints[list(robot.joint_names).index(name)] + 1


def _move_inertia(model: Model, given: dict[str, float], name: str, inertia: float) -> None:
    """Give a rotor an inertia, and take what it has more from the links in a way that no motion of theirs shows.

    Where motions tell the rotor from the links, it keeps what they say.
    """
    names = list(model.parameter_names)
    base = np.asarray(model.base_parameters().K)
    links = np.concatenate([np.asarray(columns) for columns in model.link_columns])
    column = base[:, names.index(name)]
    change = -np.linalg.lstsq(base[:, links], column, rcond=None)[0]
    if np.linalg.norm(base[:, links] @ change + column) > _TOLD_APART * np.linalg.norm(column):
        return
    more = inertia - given[name]
    given[name] = inertia
    for place, one in zip(links, change, strict=True):
        given[names[place]] += more * float(one)


def _rotor(mass: float) -> Inertia:
    return Inertia.from_com(mass=mass, com=np.zeros(3), about_com=2.0 * mass * _ROTOR_RADIUS**2 * np.eye(3))


def _with_rotors(feasible_set: FeasibleSet, model: Model, delta: Array, count: int) -> Array:
    """Give the rotors bodies, taken from the links that carry them; none where these have not enough."""
    robot = model.robot
    for mass in _ROTOR_MASSES:
        found = np.array(delta)
        for index in range(len(robot.links) - count, len(robot.links)):
            joint = robot.joints[index]
            found[list(model.link_columns[index])] += _rotor(mass).parameters
            if joint.parent >= 0:
                moved = _rotor(mass).moved(joint.placement(0.0))
                found[list(model.link_columns[joint.parent])] -= moved.parameters
        if feasible_set.contains(found):
            return found
    return delta


def _nearest(feasible_set: FeasibleSet, delta: Array) -> Array:
    """The nearest feasible parameters that move alike; as they were, where there are none."""
    map_to_base = np.asarray(feasible_set.K)
    metric = np.eye(len(delta)) + _ALIKE * map_to_base.T @ map_to_base
    try:
        found = correct(feasible_set, parameters=delta, metric=metric)
    except SolverError:
        return delta
    change = map_to_base @ (found.parameters - delta)
    return found.parameters if np.linalg.norm(change) < _UNSEEN * np.linalg.norm(map_to_base @ delta) else delta


def _without_rotors(model: Model, delta: Array, count: int) -> Array:
    """Put the bodies of the rotors back to the links that carry them."""
    robot, found = model.robot, np.array(delta)
    for index in range(len(robot.links) - count, len(robot.links)):
        joint, columns = robot.joints[index], list(model.link_columns[index])
        body = Inertia.from_parameters(found[columns])
        found[columns] = 0.0
        if joint.parent >= 0:
            found[list(model.link_columns[joint.parent])] += body.moved(joint.placement(0.0)).parameters
    return found


def elastic_model_of(model: Model, estimate: Estimate, where: str) -> ElasticModel | None:
    """Return the model with elastic joints of a saved estimate, proved anew; None where it has none.

    Parameters
    ----------
    model : Model
        Of links and drives.
    where : str
        Named in messages.

    Raises
    ------
    InputError
        If it belongs to another robot, or is not proved to be as feasible as it says.
    """
    saved = estimate.elastic_model
    if not saved:
        return None
    joints, names, numbers = (saved.get(key) for key in ("joints", "parameter_names", "parameters"))
    if not (isinstance(joints, list) and isinstance(names, list) and isinstance(numbers, list)):
        raise InputError(
            f"{where}: its elastic_model lacks joints, parameter_names or parameters; identify the robot anew."
        )
    whole = Model(elastic_robot(model.robot, joints))
    if tuple(names) != tuple(whole.parameter_names) or not (
        len(numbers) == len(names) and all(is_number(one) for one in numbers)
    ):
        raise InputError(f"{where}: its elastic_model belongs to another robot than {model.robot.name}; identify anew.")
    delta = np.array(numbers, dtype=np.float64)
    feasible_set = FeasibleSet(whole, "inertia" if saved.get("consistency") == "inertia" else "full")
    if saved.get("consistency") is not None:
        proved = FeasibilityCertificate.of_parameters(feasible_set, delta).verify()
        certificate = saved.get("certificate")
        if proved and isinstance(certificate, Mapping):
            proved = verify_document(certificate, where)
            base = FeasibilityCertificate.of_parameters(feasible_set, delta).base
            different = speaks_of(certificate, feasible_set, base, rounding=LAST_DIGITS)
            if proved and different:
                raise InputError(
                    f"{where}: the certificate of its elastic joints speaks of another robot: its {different}."
                )
        if not proved:
            raise InputError(
                f"{where}: says that its elastic joints are physically possible, which is not proved. {proved.sentence}"
            )
    return ElasticModel(whole, tuple(joints), delta, check(feasible_set, parameters=delta))


def elastic_verdict(model: Model, estimate: Estimate, where: str, consistency: str = "full") -> Verdict:
    """Judge links, drives and elastic joints of a saved estimate together, without trusting what it says of them."""
    bare = replace(estimate, elastic_model={**estimate.elastic_model, "consistency": None, "certificate": None})
    found = elastic_model_of(model, bare, where)
    if found is None:
        raise InputError(f"{where}: has no model with elastic joints; identify the robot anew.")
    verdict = found.verdict
    if consistency != "full":
        verdict = check(FeasibleSet(found.model, "inertia"), parameters=found.parameters)
    return replace(verdict, remarks=(*verdict.remarks, f"Judged with the elastic joints: {found.sentence}"))
