"""The terms that Steelyard brings: friction, offset and rotor inertia, at the joints and at coupled motors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files import shown, suggestion
from steelyard.robot import Joint, Robot, Term, TermParameter

__all__ = ["Coulomb", "MotorSide", "Offset", "RotorInertia", "Viscous", "is_known_term", "term_from_dict"]


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
    parameters = (TermParameter("Fvj", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=True),)

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
    parameters = (TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=True),)

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
    parameters = (TermParameter("Foj", "N·m", "N", "torque offset", nonnegative=False),)

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
    parameters = (TermParameter("Ia", "kg·m²", "kg", "rotor inertia", nonnegative=True),)

    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
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
        TermParameter("Fvm", "N·m·s/rad", "N·s/m", "viscous friction of the motor", nonnegative=True),
        TermParameter("Fcm", "N·m", "N", "Coulomb friction of the motor", nonnegative=True),
        TermParameter("Fom", "N·m", "N", "torque offset of the motor", nonnegative=False),
        TermParameter("Iam", "kg·m²", "kg", "inertia of the motor", nonnegative=True),
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


_KINDS: dict[str, type[Term]] = {t.kind: t for t in (Viscous, Coulomb, Offset, RotorInertia, MotorSide)}


def is_known_term(term: Term) -> bool:
    """Tell whether a term is one of those defined here, which `to_dict` describes completely."""
    return type(term) in _KINDS.values()


def term_from_dict(section: Mapping[str, Any], where: str = "[[terms]]") -> Term:
    """Build a term from a ``[[terms]]`` table of robot.toml.

    Parameters
    ----------
    section : mapping
        Holds ``kind`` and, for ``"motor_side"``, ``coupling``.
    where : str
        Named in messages.

    Returns
    -------
    Term

    Raises
    ------
    InputError
        If the kind is unknown, or a key is missing or too many.

    Examples
    --------
    >>> term_from_dict({"kind": "viscous"})
    Viscous()
    """
    options = dict(section)
    kind = options.pop("kind", None)
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"{where}: kind is {shown(kind)}; {suggestion(str(kind), _KINDS)}")
    known = {"coupling"} if kind == "motor_side" else set()
    if set(options) != known:
        raise InputError(
            f"{where}: a term of kind {kind!r} takes {sorted(known) if known else 'no other keys'}, "
            f"got {sorted(options)}."
        )
    return _KINDS[kind](**options)
