"""The terms that Steelyard brings: friction, offset and rotor inertia, at the joints and at coupled motors."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import graph
from steelyard.errors import InputError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import made_from_table, shown, suggestion
from steelyard.robot import Joint, Robot, Term, TermParameter
from steelyard.robot.robot import Channels, Columns, Scalars

from .layout import columns_of

__all__ = [
    "TERMS",
    "Coulomb",
    "MotorSide",
    "Offset",
    "RotorInertia",
    "ShapedTerm",
    "Viscous",
    "check_term",
    "described_values",
    "is_known_term",
    "term_from_dict",
    "weighted_sum",
]


def described_values(term: Term, joint: Joint) -> tuple[float, ...]:
    """Return what the description says of a joint's own friction, rotor and offset, one a parameter; NaN where unknown.

    It is the `nominal` of terms whose parameters are those of the joint, and not of a motor or a screw.
    """
    said = {name: getattr(joint, name) for name in ("damping", "friction", "rotor_inertia")}
    said["offset"] = joint.torque_offset
    return tuple(said.get(parameter.described_as or "", math.nan) for parameter in term.parameters)


class _JointTerm(Term):
    """A term of one parameter that acts on its own joint alone."""

    nominal = described_values

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other)

    def __hash__(self) -> int:
        return hash(type(self))


class Viscous(_JointTerm):
    """Viscous friction on the joint side, ``Fv dq`` (thesis eq. 4.10).

    Examples
    --------
    >>> Viscous().columns(1, [0.0, 0.0], [0.0, 0.5], [0.0, 0.0], None)
    ({1: 0.5},)
    """

    kind = "viscous"
    parameters = (
        TermParameter("Fvj", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=True, described_as="damping"),
    )

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the velocity of the joint."""
        return ({k: dq[k]},)


class Coulomb(_JointTerm):
    """Coulomb friction on the joint side, ``Fc sign(dq)`` (thesis eq. 4.10).

    Examples
    --------
    >>> import numpy
    >>> Coulomb().columns(0, [0.0], [-0.5], [0.0], numpy)[0][0].item()
    -1.0
    """

    kind = "coulomb"
    parameters = (TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=True, described_as="friction"),)

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the sign of the velocity of the joint."""
        return ({k: algebra.sign(dq[k])},)


class Offset(_JointTerm):
    """Constant torque on the joint side: an offset of friction or of the torque measurement (thesis eq. 4.10).

    Examples
    --------
    >>> Offset().columns(0, [0.0], [0.0], [0.0], None)
    ({0: 1.0},)
    """

    kind = "offset"
    parameters = (TermParameter("Foj", "N·m", "N", "torque offset", nonnegative=False, described_as="offset"),)

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the column of ones at the joint."""
        return ({k: 1.0},)


class RotorInertia(_JointTerm):
    """Inertia of the rotor as the joint feels it, ``Ia ddq`` (thesis eq. 2.19); gyroscopic effects are left out.

    Examples
    --------
    >>> RotorInertia().columns(0, [0.0], [0.0], [2.0], None)
    ({0: 2.0},)
    """

    kind = "rotor_inertia"
    parameters = (TermParameter("Ia", "kg·m²", "kg", "rotor inertia", nonnegative=True, described_as="rotor_inertia"),)

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the acceleration of the joint."""
        return ({k: ddq[k]},)


class MotorSide(Term):
    """Friction, offset and inertia of motors that are coupled to the joints (thesis eq. 4.1 to 4.12).

    Joint torques and motor velocities are ``tau = T tau_m`` and ``dq_m = T' dq``, so that motor k adds
    ``T (Fvm dq_m + Fcm sign(dq_m) + Fom + Iam ddq_m)``. With ratios of one in T, as in thesis eq. 4.12, the
    parameters are in joint units; with the true ratios they are those of the motor shaft.

    Parameters
    ----------
    coupling : array_like
        T, (N, N): row = joint, column = motor.

    Examples
    --------
    >>> wrist = MotorSide(coupling=[[1, 1], [0, 1]])
    >>> import numpy
    >>> viscous, coulomb, offset, inertia = wrist.columns(1, [0, 0], [0.5, 2.0], [0, 0], numpy)
    >>> viscous
    {0: 2.5, 1: 2.5}
    """

    kind = "motor_side"
    parameters = (
        TermParameter(
            "Fvm", "N·m·s/rad", "N·s/m", "viscous friction of the motor", nonnegative=True, described_as="damping"
        ),
        TermParameter("Fcm", "N·m", "N", "Coulomb friction of the motor", nonnegative=True, described_as="friction"),
        TermParameter("Fom", "N·m", "N", "torque offset of the motor", nonnegative=False, described_as="offset"),
        TermParameter("Iam", "kg·m²", "kg", "inertia of the motor", nonnegative=True, described_as="rotor_inertia"),
    )

    def __init__(self, coupling: ArrayLike) -> None:
        try:
            matrix = np.array(coupling, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"The coupling of the motor-side term must be a matrix of numbers: {error}.") from None
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
            raise InputError(
                "The coupling of the motor-side term must be a square matrix of finite numbers, "
                f"got shape {matrix.shape}."
            )
        if np.linalg.matrix_rank(matrix) < len(matrix):
            raise InputError(
                "The coupling of the motor-side term is singular, so that some joint is driven by no motor; "
                "check its rows."
            )
        matrix.flags.writeable = False
        self.coupling: NDArray[np.float64] = matrix

    def __repr__(self) -> str:
        return f"MotorSide(coupling={self.coupling.tolist()})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MotorSide) and np.array_equal(self.coupling, other.coupling)

    def __hash__(self) -> int:
        return hash(self.coupling.tobytes())

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the four columns of motor `k`."""
        ratios = [(joint, float(ratio)) for joint, ratio in enumerate(self.coupling[:, k]) if ratio != 0.0]
        velocity, acceleration = weighted_sum(ratios, dq), weighted_sum(ratios, ddq)
        direction = algebra.sign(velocity)
        return tuple({i: r * value for i, r in ratios} for value in (velocity, direction, 1.0, acceleration))

    def check(self, robot: Robot) -> None:
        """Refuse a matrix of another size than the robot's number of joints."""
        if len(self.coupling) != robot.dof:
            raise InputError(
                f"The coupling of the motor-side term is {len(self.coupling)} x {len(self.coupling)}, but {robot.name} "
                f"has {robot.dof} joints: give one row for each joint and one column for each motor."
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the term as it stands in robot.toml."""
        return {"kind": self.kind, "coupling": self.coupling.tolist()}


PerJoint = float | Sequence[float]
"""A number for all joints, or one for each."""
JointNumbers = Sequence[int] | None


class ShapedTerm(Term):
    """A term of the joints with a shape: numbers that its columns depend on, and that are no parameters.

    A subclass hands its shape to the constructor of this class by name, and gives `values`, the torque by each
    parameter at the joint itself.

    Parameters
    ----------
    joints : sequence of int, optional
        Numbers of the joints, from 1, where the term acts; all where it is not given. Its parameters of the others have
        no effect.
    **shape : float, sequence of float or None
        Numbers by name; None is one that is not set.
    """

    def __init__(self, *, joints: JointNumbers = None, **shape: Any) -> None:
        if joints is not None:
            whole = isinstance(joints, Sequence) and all(type(one) is int and one >= 1 for one in joints)
            if not whole or not joints or len(set(joints)) < len(joints):
                raise InputError(
                    f"The joints of a term of kind {self.kind!r} must be numbers of joints, from 1, no two of them "
                    f"equal, got {shown(joints)}; leave them out where it acts at all joints."
                )
            joints = tuple(joints)
        self.shape: dict[str, Any] = {name: self._numbers(name, given) for name, given in shape.items()}
        self.joints = joints

    def _numbers(self, name: str, given: Any) -> Any:
        if given is None:
            return None
        several = isinstance(given, (Sequence, np.ndarray)) and not isinstance(given, str)
        if several and name in self.one_number:
            raise InputError(f"The {name} of a term of kind {self.kind!r} must be one number, got {shown(given)}.")
        values = list(given) if several else [given]
        if not values or not all(
            isinstance(x, (int, float, np.integer, np.floating)) and not isinstance(x, bool) and np.isfinite(x)
            for x in values
        ):
            raise InputError(
                f"The {name} of a term of kind {self.kind!r} must be a finite number, or such numbers, got "
                f"{shown(given)}."
            )
        numbers = tuple(int(x) if isinstance(x, (int, np.integer)) else float(x) for x in values)
        return numbers if several else numbers[0]

    def __repr__(self) -> str:
        parts = [f"{name}={value!r}" for name, value in self.to_dict().items() if name != "kind"]
        return f"{type(self).__name__}({', '.join(parts)})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash((type(self), repr(self)))

    def with_shape(self, **changes: Any) -> Self:
        """Return the same term with other numbers for some of its shape.

        Raises
        ------
        InputError
            If it has no such number, or cannot have that value.
        """
        known = {**self.shape, "joints": self.joints}
        wrong = next((name for name in changes if name not in known), None)
        if wrong is not None:
            raise InputError(f"A term of kind {self.kind!r} has no {wrong!r}; {suggestion(wrong, known)}")
        return type(self)(**{name: value for name, value in {**known, **changes}.items() if value is not None})

    def at(self, name: str, k: int) -> float:
        """Return a number of the shape at a joint, from 0."""
        value = self.shape[name]
        return float(value[k] if isinstance(value, tuple) else value)

    def every(self, name: str) -> tuple[float, ...]:
        """Return all the numbers of a name, each once."""
        value = self.shape[name]
        return tuple(dict.fromkeys(float(x) for x in (value if isinstance(value, tuple) else (value,))))

    def require_positive(self, *names: str) -> None:
        """Refuse numbers of these names that are not positive."""
        for name in names:
            if self.shape[name] is not None and min(self.every(name)) <= 0.0:
                raise InputError(
                    f"The {name} of a term of kind {self.kind!r} must be positive, got {shown(self.shape[name])}."
                )

    def check(self, robot: Robot) -> None:
        """Refuse joints that the robot does not have, and other numbers of values than it has joints."""
        beyond = max(self.joints or (0,))
        if beyond > robot.dof:
            raise InputError(
                f"The term {self.kind!r} is to act at joint {beyond}, but {robot.name} has {robot.dof} joints; "
                "correct `joints`."
            )
        for name in self.per_joint:
            value = self.shape.get(name)
            if isinstance(value, tuple) and len(value) != robot.dof:
                raise InputError(
                    f"The {name} of the term {self.kind!r} has {len(value)} numbers, but {robot.name} has {robot.dof} "
                    "joints: give one number for each, or one for all."
                )

    per_joint: ClassVar[tuple[str, ...]] = ()
    """What of the shape may be one number for each joint."""
    one_number: ClassVar[tuple[str, ...]] = ()
    """What of the shape is one number in any case."""

    def acts_at(self, k: int) -> bool:
        """Return whether joint `k`, from 0, is one of its joints."""
        return self.joints is None or k + 1 in self.joints

    @abstractmethod
    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Torque at joint `k` for each parameter at the value 1; None where it is 0."""

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the torque of each parameter at the joint itself."""
        if not self.acts_at(k):
            return tuple({} for _ in self.parameters)
        return tuple({} if value is None else {k: value} for value in self.values(k, q, dq, ddq, algebra))

    def logged_at(self, k: int, name: str, channels: Channels | None, otherwise: str) -> Any:
        """Return what a channel holds for joint `k`; raise InputError, with what else helps, where it is not given."""
        if channels is None or name not in channels:
            raise InputError(
                f"The term {self.kind!r} needs the channel {name!r}, which was not given; give it as channels=, "
                f"{otherwise}."
            )
        return channels[name][k]

    def energies(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Potential energy of joint `k` for each parameter at the value 1; 0 where it stores no energy."""
        return (0.0,) * len(self.parameters)

    def potential(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the potential energy where the term acts."""
        if not self.acts_at(k):
            return (0.0,) * len(self.parameters)
        return self.energies(k, q, algebra)

    def to_dict(self) -> dict[str, Any]:
        """Return the term as it stands in robot.toml."""
        given = {**self.shape, "joints": self.joints}
        return {
            "kind": self.kind,
            **{
                name: list(value) if isinstance(value, tuple) else value
                for name, value in given.items()
                if value is not None
            },
        }


def weighted_sum(ratios: Sequence[tuple[int, float]], values: Sequence[Any]) -> Any:
    """Return the sum of the values of some joints, each times its ratio."""
    total: Any = 0.0
    for joint, ratio in ratios:
        total = total + ratio * values[joint]
    return total


def _checked_term(name: str, offered: object) -> type[Term]:
    if not (isinstance(offered, type) and issubclass(offered, Term)):
        raise TypeError(f"expected a class derived from steelyard.Term, got {shown(offered)}")
    kind = getattr(offered, "kind", None)
    if not isinstance(kind, str) or not (":" in name or kind == name):
        raise TypeError(f"expected a class whose kind is {name!r}, got one with {shown(kind)}")
    return offered


_FRICTION, _SPRINGS = "steelyard.dynamics.friction_terms", "steelyard.dynamics.spring_terms"
_OWN: dict[str, type[Term] | str] = {
    **{one.kind: one for one in (Viscous, Coulomb, Offset, RotorInertia, MotorSide)},
    "coulomb_by_direction": f"{_FRICTION}:CoulombByDirection",
    "viscous_by_direction": f"{_FRICTION}:ViscousByDirection",
    "stribeck": f"{_FRICTION}:Stribeck",
    "coulomb_smooth": f"{_FRICTION}:SmoothCoulomb",
    "friction_polynomial": f"{_FRICTION}:PolynomialFriction",
    "friction_piecewise": f"{_FRICTION}:PiecewiseFriction",
    "friction_by_load": f"{_FRICTION}:LoadFriction",
    "friction_by_channel": f"{_FRICTION}:ChannelFriction",
    "dahl": "steelyard.dynamics.presliding:Dahl",
    "lugre": "steelyard.dynamics.presliding:LuGre",
    "spring": f"{_SPRINGS}:Spring",
    "counterbalance": f"{_SPRINGS}:Counterbalance",
    "cogging": f"{_SPRINGS}:Cogging",
    "tendon": f"{_SPRINGS}:Tendon",
    "screw": f"{_SPRINGS}:Screw",
    "by_joint": "steelyard.dynamics.by_joint:ByJoint",
    "transmission": "steelyard.dynamics.elastic_robot:Transmission",
    "at_coordinates": "steelyard.dynamics.elastic_robot:AtCoordinates",
}
TERMS: Extensions[type[Term]] = Extensions("terms", "term", _OWN, _checked_term)
"""By the kind that stands in robot.toml."""


def is_known_term(term: Term) -> bool:
    """Tell whether a term is one of those defined here, which `to_dict` describes completely."""
    own, kind = TERMS.own.get(getattr(term, "kind", "")), type(term)
    return own is kind or own == f"{kind.__module__}:{kind.__qualname__}"


def term_from_dict(section: Mapping[str, Any], where: str = "[[terms]]", *, allow_extensions: bool = False) -> Term:
    """Build a term from a ``[[terms]]`` table of robot.toml.

    Parameters
    ----------
    section : mapping
        Holds ``kind``, the name of a term or ``"module:Class"``, and the arguments of its class, such as ``coupling``
        for ``"motor_side"``.
    where : str
        Named in messages.
    allow_extensions : bool
        Whether a class that the table names by its import path may be imported.

    Raises
    ------
    InputError
        If the kind is unknown or not allowed, or a key is missing or too many.

    Examples
    --------
    >>> term_from_dict({"kind": "viscous"})
    Viscous()
    """
    options = dict(section)
    kind = options.pop("kind", None)
    if isinstance(kind, str) and ":" in kind:
        found: type[Term] | None = TERMS.at(kind, where, allow_extensions)
    else:
        found = TERMS.get(kind) if isinstance(kind, str) else None
    if found is None:
        raise InputError(f"{where}: kind is {shown(kind)}; {suggestion(str(kind), TERMS.names())}")
    return made_from_table(found, options, f"{where}, a term of kind {kind!r}")


def check_term(term: Term, robot: Robot) -> None:
    """Refuse a term whose columns or conditions are not what a term of a robot must give.

    Its columns are tried at a moving and at a resting robot.

    Raises
    ------
    InputError
        If it does not give one column for each parameter, with finite elements at joints of the robot that depend
        linearly on the accelerations, or conditions on its own parameters.
    """
    with faults_told(f"The term {term.kind!r} cannot be used", "mend its class"):
        recorder, count = graph.Graph(), robot.dof
        q, dq, ddq = (recorder.inputs(name, count) for name in ("q", "dq", "ddq"))
        values = _trials(count) | {f"{name}[{k}]": np.full(7, 1.5) for name in term.channels for k in range(count)}
        for k in range(count):
            logged = {name: recorder.inputs(name, count) for name in term.channels}
            columns = columns_of(term, k, (q, dq, ddq), graph, logged)
            potential = term.potential(k, q, graph)
            for what, given in (("columns", columns), ("potentials", potential)):
                if not isinstance(given, tuple) or len(given) != len(term.parameters):
                    raise TypeError(f"expected a tuple of {len(term.parameters)} {what}, got {shown(given)}")
            for column, parameter in zip(columns, term.parameters, strict=True):
                rows = set(column) - set(range(count))
                if rows:
                    raise ValueError(f"a column of {parameter.symbol} names the joint {rows.pop()!r} of {count}")
                nodes = [recorder.node(element) for element in column.values()]
                with np.errstate(all="ignore"):
                    found = graph.evaluate(nodes, values)
                for value in found:
                    _check_column(np.broadcast_to(value, (7,)), parameter.symbol)
        symbols = [parameter.symbol for parameter in term.parameters]
        for condition in term.conditions():
            for symbol in condition.coefficients:
                if symbol not in symbols:
                    raise ValueError(f"the condition {condition.name!r} is about {symbol!r}, which it has not")


_MIX = 0.3


def _trials(count: int) -> dict[str, NDArray[np.float64]]:
    """Return seven motions by the names of inputs: twice two accelerations and a mixture of them, and rest.

    The second pair is of opposite signs and of other sizes, which odd functions tell from linear ones.
    """
    random = np.random.default_rng(0)
    q, dq, one, other = random.uniform(-2.0, 2.0, (4, count))
    rest = np.zeros(count)
    pairs = ((one, other), (one, -2.0 * one))
    accelerations = [row for a, b in pairs for row in (a, b, _MIX * a + (1.0 - _MIX) * b)]
    rows = {"q": [q] * 6, "dq": [dq] * 6, "ddq": accelerations}
    return {
        f"{name}[{k}]": np.array([row[k] for row in (*given, rest)])
        for name, given in rows.items()
        for k in range(count)
    }


def _check_column(values: NDArray[np.float64], symbol: str) -> None:
    """Refuse an element of a column by its values at the trials."""
    if not np.isfinite(values).all():
        raise ValueError(f"the column of {symbol} is not finite{' at rest' if np.isfinite(values[:6]).all() else ''}")
    for one, other, mixed in values[:6].reshape(2, 3):
        if abs(_MIX * one + (1.0 - _MIX) * other - mixed) > 1e-9 * (abs(one) + abs(other) + 1e-3):
            raise ValueError(f"the column of {symbol} does not depend linearly on the accelerations")
