"""The terms that Steelyard brings: friction, offset and rotor inertia, at the joints and at coupled motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard import graph
from steelyard.errors import InputError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import made_from_table, shown, suggestion
from steelyard.robot import Joint, Robot, Term, TermParameter

__all__ = [
    "TERMS",
    "Coulomb",
    "MotorSide",
    "Offset",
    "RotorInertia",
    "Viscous",
    "check_term",
    "is_known_term",
    "term_from_dict",
]


class _JointTerm(Term):
    """A term of one parameter that acts on its own joint alone."""

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

    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
        """Return the velocity of the joint."""
        return ({k: dq[k]},)

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Return the damping of the description."""
        return (joint.damping,)


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

    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
        """Return the sign of the velocity of the joint."""
        return ({k: algebra.sign(dq[k])},)

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Return the friction of the description."""
        return (joint.friction,)


class Offset(_JointTerm):
    """Constant torque on the joint side: an offset of friction or of the torque measurement (thesis eq. 4.10).

    Examples
    --------
    >>> Offset().columns(0, [0.0], [0.0], [0.0], None)
    ({0: 1.0},)
    """

    kind = "offset"
    parameters = (TermParameter("Foj", "N·m", "N", "torque offset", nonnegative=False, described_as="offset"),)

    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
        """Return one."""
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

    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
        """Return the acceleration of the joint."""
        return ({k: ddq[k]},)

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Return the rotor inertia of the description."""
        return (joint.rotor_inertia,)


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

    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
        """Return the four columns of motor `k`."""
        ratios = [(joint, float(ratio)) for joint, ratio in enumerate(self.coupling[:, k]) if ratio != 0.0]
        velocity, acceleration = _weighted(ratios, dq), _weighted(ratios, ddq)
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


def _weighted(ratios: Sequence[tuple[int, float]], values: Sequence[Any]) -> Any:
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


TERMS: Extensions[type[Term]] = Extensions(
    "terms", "term", {one.kind: one for one in (Viscous, Coulomb, Offset, RotorInertia, MotorSide)}, _checked_term
)
"""By the kind that stands in robot.toml."""


def is_known_term(term: Term) -> bool:
    """Tell whether a term is one of those defined here, which `to_dict` describes completely."""
    return type(term) in TERMS.own.values()


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

    Returns
    -------
    Term

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
        values = _trials(count)
        for k in range(count):
            columns = term.columns(k, q, dq, ddq, graph)
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
