"""Robots with elastic joints: a second set of coordinates, those of the motors behind springs.

The model is that of M. W. Spong (Modeling and control of elastic joint robots, J. Dyn. Syst. Meas. Control 109, 1987),
with the damper of the transmission::

    M(q) ddq + C(q, dq) dq + g(q) = K (theta - q) + D (dtheta - dq)       links
    J ddtheta + friction(dtheta) + K (theta - q) + D (dtheta - dq) = tau  motors, on the joint side of the gear

The robot stays a tree of joints with one coordinate each: the motor of an elastic joint is one more joint about the
same axis, that carries a rotor, and the transmission is a term between the two coordinates. So whatever a model does,
it does for elastic joints: inverse and forward dynamics, energy, simulation, base parameters, conditions and their
proof, generated code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown, suggestion
from steelyard.robot import Condition, Joint, Link, Robot, Term, TermParameter
from steelyard.robot.robot import Channels, Columns, Scalars

from .by_joint import ByJoint
from .layout import columns_of
from .terms import RotorInertia, term_from_dict

__all__ = ["AtCoordinates", "Transmission", "acts_on_motors", "elastic_robot", "motor_symbols"]


class Transmission(Term):
    """The spring and the damper between a motor and its link, ``Kej (theta - q) + Dej (dtheta - dq)``.

    Its parameters bear the number of the elastic joint. See :func:`elastic_robot`, which makes the motors.

    Parameters
    ----------
    joints, motors : sequence of int
        Numbers of the coordinates of the elastic joints, from 1, and of their motors in the same order.

    Examples
    --------
    >>> stiffness, damping = Transmission(joints=[1], motors=[2]).columns(0, [0.25, 0.75], [0.0, 1.0], [0, 0], None)
    >>> stiffness, damping
    ({0: -0.5, 1: 0.5}, {0: -1.0, 1: 1.0})
    """

    kind = "transmission"
    parameters = (
        TermParameter("Kej", "N·m/rad", "N/m", "stiffness of the transmission", nonnegative=True),
        TermParameter("Dej", "N·m·s/rad", "N·s/m", "damping of the transmission", nonnegative=True),
    )

    def __init__(self, joints: Sequence[int], motors: Sequence[int]) -> None:
        for name, given in (("joints", joints), ("motors", motors)):
            if not isinstance(given, Sequence) or not given or not all(type(one) is int and one >= 1 for one in given):
                raise InputError(
                    f"The {name} of a term of kind {self.kind!r} must be numbers of coordinates, from 1, got "
                    f"{shown(given)}."
                )
        if len(joints) != len(motors) or len({*joints, *motors}) < 2 * len(joints):
            raise InputError(
                f"A term of kind {self.kind!r} needs one motor for each of its joints, and no number twice, got joints "
                f"{shown(list(joints))} and motors {shown(list(motors))}."
            )
        self.joints, self.motors = tuple(joints), tuple(motors)

    def __repr__(self) -> str:
        return f"Transmission(joints={list(self.joints)}, motors={list(self.motors)})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transmission) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(repr(self))

    def acts_at(self, k: int) -> bool:
        """Return whether joint `k`, from 0, is elastic."""
        return k + 1 in self.joints

    def motor(self, k: int) -> int:
        """Return the coordinate, from 0, of the motor of the elastic joint `k`."""
        return self.motors[self.joints.index(k + 1)] - 1

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return what spring and damper exert on motor and link."""
        if not self.acts_at(k):
            return ({}, {})
        motor = self.motor(k)
        return tuple({k: values[k] - values[motor], motor: values[motor] - values[k]} for values in (q, dq))

    def potential(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return half of the square of the deflection."""
        if not self.acts_at(k):
            return (0.0, 0.0)
        deflection = q[self.motor(k)] - q[k]
        return (0.5 * deflection * deflection, 0.0)

    def check(self, robot: Robot) -> None:
        """Refuse coordinates that the robot does not have."""
        beyond = max(*self.joints, *self.motors)
        if beyond > robot.dof:
            raise InputError(
                f"The term {self.kind!r} is to act at coordinate {beyond}, but {robot.name} has {robot.dof}; make the "
                "robot with elastic_robot, which gives it the motors."
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the term as it stands in robot.toml."""
        return {"kind": self.kind, "joints": list(self.joints), "motors": list(self.motors)}


class AtCoordinates(Term):
    """A term of a robot with rigid joints, at those coordinates of one with elastic joints where it acts.

    Parameters
    ----------
    term : Term or mapping
        Or its table in robot.toml.
    coordinates : sequence of int
        For each of its coordinates the number of that of this robot, from 1.

    Examples
    --------
    >>> import steelyard as sy
    >>> term = AtCoordinates(sy.Viscous(), coordinates=[2])
    >>> term.columns(0, [0, 0], [0.5, 0.7], [0, 0], None), term.columns(1, [0, 0], [0.5, 0.7], [0, 0], None)
    (({},), ({1: 0.7},))
    """

    kind = "at_coordinates"

    def __init__(self, term: Term | Mapping[str, Any], coordinates: Sequence[int]) -> None:
        if not isinstance(term, (Term, Mapping)):
            raise InputError(f"The term of one of kind {self.kind!r} must be a term or its table, got {shown(term)}.")
        listed = list(coordinates) if isinstance(coordinates, Sequence) else []
        if not listed or not all(type(one) is int and one >= 1 for one in listed) or len(set(listed)) < len(listed):
            raise InputError(
                f"The coordinates of a term of kind {self.kind!r} must be numbers from 1, no two of them equal, got "
                f"{shown(coordinates)}."
            )
        self.term = term if isinstance(term, Term) else term_from_dict(term, f"the term of one of kind {self.kind!r}")
        self.coordinates = tuple(one - 1 for one in listed)

    @property
    def parameters(self) -> tuple[TermParameter, ...]:  # type: ignore[override]
        """The parameters of the term."""
        return self.term.parameters

    @property
    def speeds(self) -> tuple[float, ...]:
        """The speeds that the term names."""
        return self.term.speeds

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that the term needs."""
        return self.term.channels

    def check_channel(self, name: str, values: NDArray[np.float64]) -> None:
        """Refuse values for which the term was not made."""
        self.term.check_channel(name, values[..., list(self.coordinates)])

    def without_channels(self) -> Term | None:
        """Return this term with one that needs no channels."""
        plain = self.term.without_channels()
        return None if plain is None else self if plain is self.term else AtCoordinates(plain, self._numbers)

    @property
    def _numbers(self) -> list[int]:
        return [one + 1 for one in self.coordinates]

    def __repr__(self) -> str:
        return f"AtCoordinates({self.term!r}, coordinates={self._numbers})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, AtCoordinates) and (self.term, self.coordinates) == (other.term, other.coordinates)

    def __hash__(self) -> int:
        return hash((self.term, self.coordinates))

    def acts_at(self, k: int) -> bool:
        """Return whether the term acts at coordinate `k`, from 0."""
        return k in self.coordinates and self.term.acts_at(self.coordinates.index(k))

    def columns(
        self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any, channels: Channels | None = None
    ) -> Columns:
        """Return the columns of the term at its own coordinates."""
        if k not in self.coordinates:
            return tuple({} for _ in self.parameters)
        motion = [[values[one] for one in self.coordinates] for values in (q, dq, ddq)]
        logged = {name: [v[one] for one in self.coordinates] for name, v in (channels or {}).items()}
        found = columns_of(self.term, self.coordinates.index(k), (motion[0], motion[1], motion[2]), algebra, logged)
        return tuple({self.coordinates[row]: value for row, value in column.items()} for column in found)

    def potential(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the potential energy of the term."""
        if k not in self.coordinates:
            return (0.0,) * len(self.parameters)
        return self.term.potential(self.coordinates.index(k), [q[one] for one in self.coordinates], algebra)

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Return what the description says of the joint."""
        return self.term.nominal(joint)

    def conditions(self) -> tuple[Condition, ...]:
        """Return those of the term."""
        return self.term.conditions()

    def conditions_at(self, k: int) -> tuple[Condition, ...]:
        """Return those of the term at its own coordinate."""
        return self.term.conditions_at(self.coordinates.index(k)) if k in self.coordinates else self.conditions()

    def bristles(self, k: int) -> tuple[float, float, float] | None:
        """Return what tells the state that the friction of a coordinate needs."""
        return self.term.bristles(self.coordinates.index(k)) if k in self.coordinates else None

    def check(self, robot: Robot) -> None:
        """Refuse coordinates that the robot does not have."""
        if max(self.coordinates) >= robot.dof:
            raise InputError(
                f"The term {self.kind!r} is to act at coordinate {max(self.coordinates) + 1}, but {robot.name} has "
                f"{robot.dof} coordinates; correct `coordinates`."
            )

    @property
    def identity(self) -> Mapping[str, Any]:
        """What tells this term from others: the term and its coordinates."""
        return {"kind": self.kind, "term": dict(self.term.identity), "coordinates": self._numbers}

    def to_dict(self) -> dict[str, Any]:
        """Return the term as it stands in robot.toml."""
        return {"kind": self.kind, "term": self.term.to_dict(), "coordinates": self._numbers}


def acts_on_motors(term: Term, dof: int) -> bool:
    """Tell whether a term acts on the motor's side of a transmission: all terms that store no energy, and cogging.

    Springs and counterbalances act on the link, and what they hold the transmission need not carry; the ripple of a
    motor is its own.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.dynamics import Spring
    >>> acts_on_motors(sy.Viscous(), 2), acts_on_motors(Spring(), 2)
    (True, False)
    """
    q = list(np.linspace(0.3, 0.7, dof))
    stores = (np.any(np.asarray(one) != 0.0) for k in range(dof) for one in term.potential(k, q, np))
    return term.kind == "cogging" or not any(stores)


def motor_symbols(term: Term, dof: int) -> frozenset[str]:
    """Return the symbols of those parameters of a term that act on the motor's side of a transmission.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.dynamics import ByJoint, Spring
    >>> sorted(motor_symbols(ByJoint([Spring(), sy.Coulomb()]), 2))
    ['Fcj']
    """
    return frozenset(one.symbol for part in _at_motors(term, dof) for one in part.parameters)


def _at_motors(term: Term, dof: int) -> tuple[Term, ...]:
    """What of a term acts on the motor's side: all, nothing, or of laws that differ from joint to joint some."""
    return _parts(term, [acts_on_motors(law, dof) for law in term.laws])


def _at_links(term: Term, dof: int) -> tuple[Term, ...]:
    """What of a term acts on the link."""
    return _parts(term, [not acts_on_motors(law, dof) for law in term.laws])


def _parts(term: Term, taken: Sequence[bool]) -> tuple[Term, ...]:
    kept = [law for law, is_taken in zip(term.laws, taken, strict=True) if is_taken]
    if not kept:
        return ()
    return (ByJoint(kept),) if isinstance(term, ByJoint) else (term,)


def elastic_robot(robot: Robot, joints: Sequence[str | int]) -> Robot:
    """Return a robot some of whose joints are elastic, with a second set of coordinates: those of their motors.

    The coordinates of the links come first, as in `robot`, then those of the motors, each on the joint side of its
    gear, named after their joints. Friction, offsets, ripple and rotor inertia act at the motors; springs and
    counterbalances at the links. The links of the motors are rotors, whose ten parameters may be zero: what turns
    about the axis is the rotor inertia, ``Ia``, and what else a rotor weighs is part of the link that carries it.

    Parameters
    ----------
    robot : Robot
        With its terms.
    joints : sequence of str or int
        Names of the elastic joints, or numbers of their coordinates from 1.

    Returns
    -------
    Robot
        Of N + J coordinates, with the term :class:`Transmission`, whose stiffness ``Kej`` and damping ``Dej`` bear the
        numbers of the elastic joints, and :class:`RotorInertia`, if it was not there.

    Raises
    ------
    InputError
        If the robot has no such joint, or its joints are elastic already.

    References
    ----------
    Spong 1987, Modeling and control of elastic joint robots.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.3, 0, "q")]).with_terms(sy.Viscous(), sy.RotorInertia())
    >>> both = elastic_robot(robot, ["joint1"])
    >>> both.joint_names, both.parameter_names[10:14], both.parameter_names[-4:-2]
    (('joint1', 'joint1_motor'), ('Fvj1', 'Ia1', 'Kej1', 'Dej1'), ('Fvj2', 'Ia2'))

    A motor that turns by 0.1 rad more than its link pulls at it with a tenth of the stiffness:

    >>> model = sy.Model(both)
    >>> delta = [float(name == "Kej1") * 700.0 for name in model.parameter_names]
    >>> model.inverse_dynamics([0.0, 0.1], [0.0, 0.0], [0.0, 0.0], delta).tolist()
    [-70.0, 70.0]
    """
    if any(isinstance(term, Transmission) for term in robot.terms):
        raise InputError(f'robot "{robot.name}" has elastic joints already; name all of them at once.')
    places = _places(robot, joints)
    count, driving = robot.dof, robot.driving_joints
    motors = {place: count + order for order, place in enumerate(places)}
    names = {*robot.joint_names, *robot.link_names}
    own = [robot.joints[driving[place]] for place in places]
    more = [(f"{joint.name}_motor", f"{joint.name}_rotor") for joint in own]
    taken = next((name for pair in more for name in pair if name in names), None)
    if taken is not None:
        raise InputError(f'robot "{robot.name}": the name "{taken}" is that of a motor; name its joint otherwise.')
    rotors = [
        replace(
            joint, name=name, coordinate=motors[place], after=np.eye(4), after_lengths={}, lower=-np.inf, upper=np.inf
        )
        for place, joint, (name, _) in zip(places, own, more, strict=True)
    ]
    links = [Link(name) for _, name in more]
    at_links = range(1, count + 1)
    at_motors = [motors.get(place, place) + 1 for place in range(count)]
    terms: list[Term] = []
    for term in robot.terms:
        terms.extend(AtCoordinates(part, at_motors) for part in _at_motors(term, count))
        terms.extend(AtCoordinates(part, at_links) for part in _at_links(term, count))
    if not any(isinstance(term, RotorInertia) for term in robot.terms):
        terms.append(AtCoordinates(RotorInertia(), at_motors))
    terms.append(Transmission([place + 1 for place in places], [motors[place] + 1 for place in places]))
    whole = replace(
        robot,
        joints=(*robot.joints, *rotors),
        links=(*robot.links, *links),
        terms=(),
        source=None,
        read_with={},
        described_joints=(),
    )
    return whole.with_terms(*terms)


def _places(robot: Robot, joints: Sequence[str | int]) -> tuple[int, ...]:
    """The coordinates of joints, in the order of the robot."""
    names = list(robot.joint_names)
    found = []
    for one in joints:
        if type(one) is int and 1 <= one <= robot.dof:
            found.append(one - 1)
        elif isinstance(one, str) and one in names:
            found.append(names.index(one))
        else:
            raise InputError(
                f"{shown(one)} is no joint of {robot.name} that could be elastic; {suggestion(str(one), names)}"
            )
    if not found or len(set(found)) < len(found):
        raise InputError(f"The elastic joints must be named, each once, got {shown(list(joints))}.")
    return tuple(sorted(found))
