"""Terms that depend on positions alone: springs, counterbalances and the ripple of motors; each has a potential energy.

Also couplings: tendons, and joints that a screw drives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.once import cached_property
from steelyard.robot import Robot, Term, TermParameter
from steelyard.robot.robot import Columns, Scalars

from .terms import JointNumbers, PerJoint, ShapedTerm, weighted_sum

__all__ = ["Cogging", "Counterbalance", "Screw", "Spring", "Tendon"]


class Spring(ShapedTerm):
    """A linear spring at a joint, ``Ks (q - rest)``, with the energy ``Ks (q - rest)² / 2``.

    Where the position of rest is not known, `Offset` beside it stands for ``-Ks`` times what is missing of it.

    Parameters
    ----------
    rest : float or sequence of float
        Position at which the spring exerts no torque, rad or m; one for all joints, or one for each.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> term = Spring(rest=0.25)
    >>> term.columns(0, [1.0], [0.0], [0.0], None), term.potential(0, [1.0], None)
    (({0: 0.75},), (0.28125,))
    """

    kind = "spring"
    parameters = (
        TermParameter("Ksj", "N·m/rad", "N/m", "stiffness of the spring", nonnegative=True, described_as="stiffness"),
    )
    per_joint = ("rest",)

    def __init__(self, rest: PerJoint = 0.0, joints: JointNumbers = None) -> None:
        super().__init__(rest=rest, joints=joints)

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the deflection."""
        return (q[k] - self.at("rest", k),)

    def energies(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return half of the square of the deflection."""
        deflection = q[k] - self.at("rest", k)
        return (0.5 * deflection * deflection,)


class Counterbalance(ShapedTerm):
    """A gas, hydraulic or coil spring between a point of a link and a point of the next.

    The points are at the distances `fixed` and `moving` from the axis of the joint, and the length between them is
    ``s = sqrt(fixed² + moving² - 2 fixed moving cos(q - aligned))``. A spring that pulls with ``Pc + Kc (s - length)``
    adds ``(Pc + Kc (s - length)) ds/dq`` to the torque of the joint. One that pushes has a negative ``Pc``. The pull of
    a gas that the motion compresses is ``Pc / (1 - (s - length) / gas)``.

    About an axis that is not vertical, ``Kc`` acts as the weight of the link does, and what is identified of the two
    is ``Pc - length Kc``.

    Parameters
    ----------
    fixed, moving : float
        Distances of the points from the axis, m; not equal, since the points would meet.
    aligned : float
        Position of the joint at which the two points are nearest to each other, rad.
    length : float
        Length of the spring at which its force is ``Pc``, m; at its nearest without it.
    gas : float, optional
        Volume of the gas at `length` over the area of the piston, m: positive where extension compresses the gas, as in
        a hydraulic cylinder that pulls, negative where it expands, as in a gas spring that pushes. No gas without it.
    joints : sequence of int
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    The torque is the derivative of the energy by the position of the joint:

    >>> import numpy
    >>> term = Counterbalance(fixed=0.8, moving=0.2, aligned=-0.1, length=0.6, joints=[2])
    >>> column = term.columns(1, [0.0, 0.7], [0.0, 0.0], [0.0, 0.0], numpy)[1][1]
    >>> above, below = (term.potential(1, [0.0, q], numpy)[1] for q in (0.7001, 0.6999))
    >>> bool(abs(column - (above - below) / 2e-4) < 1e-9)
    True
    """

    kind = "counterbalance"
    parameters = (
        TermParameter("Pcj", "N", "N", "pull of the counterbalance at its reference length", nonnegative=False),
        TermParameter("Kcj", "N/m", "N/m", "stiffness of the counterbalance", nonnegative=True),
    )
    one_number = ("fixed", "moving", "aligned", "length", "gas")

    def __init__(
        self,
        fixed: float,
        moving: float,
        aligned: float = 0.0,
        length: float | None = None,
        gas: float | None = None,
        joints: JointNumbers = None,
    ) -> None:
        super().__init__(fixed=fixed, moving=moving, aligned=aligned, length=length, gas=gas, joints=joints)
        self.require_positive("fixed", "moving")
        if self.shape["fixed"] == self.shape["moving"]:
            raise InputError(
                "The points of a counterbalance are at the same distance from the axis, so that they would meet where "
                "they are aligned; give `fixed` and `moving` as they are on the robot, in m."
            )

        ends = self.shape["fixed"] + self.shape["moving"], abs(self.shape["fixed"] - self.shape["moving"])
        if gas is not None and (gas == 0.0 or min(1.0 - (end - self.reference) / gas for end in ends) <= 0.0):
            raise InputError(
                f"The gas of a counterbalance must have a volume at every position, but with gas = {gas:g} m it has "
                f"none at some length between {ends[1]:g} and {ends[0]:g} m; give its volume at `length` over the "
                "area of the piston."
            )

    def _length(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, Any]:
        """Return the length of the spring, and its product with the derivative of the length by the position."""
        fixed, moving = float(self.shape["fixed"]), float(self.shape["moving"])
        angle = q[k] - float(self.shape["aligned"])
        square = fixed * fixed + moving * moving - (2.0 * fixed * moving) * algebra.cos(angle)
        return algebra.sqrt(square), (fixed * moving) * algebra.sin(angle)

    @property
    def reference(self) -> float:
        """Length at which the force is ``Pc``, m."""
        given = self.shape["length"]
        return abs(self.shape["fixed"] - self.shape["moving"]) if given is None else float(given)

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the lever arm, with the growth of the pull of a gas, and the lever arm times the extension."""
        length, product = self._length(k, q, algebra)
        arm, extension, gas = product / length, length - self.reference, self.shape["gas"]
        pull = arm if gas is None else arm / (1.0 - extension / float(gas))
        return (pull, arm * extension)

    def energies(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the work of a pull of 1 N, and half of the square of the extension."""
        extension, gas = self._length(k, q, algebra)[0] - self.reference, self.shape["gas"]
        work = extension if gas is None else -float(gas) * algebra.log(1.0 - extension / float(gas))
        return (work, 0.5 * extension * extension)

    def check(self, robot: Robot) -> None:
        """Refuse joints that slide."""
        super().check(robot)
        for k, joint in enumerate(robot.joints[i] for i in robot.driving_joints):
            if joint.kind == "prismatic" and self.acts_at(k):
                raise InputError(
                    f"A counterbalance acts about a joint that turns, but {joint.name} slides; name the joints where "
                    "it acts, such as joints = [2]."
                )


class Cogging(ShapedTerm):
    """Torque ripple with the position: ``sum(Ts_i sin(n_i q) + Tc_i cos(n_i q))`` over the given harmonics.

    Parameters
    ----------
    harmonics : sequence of float
        Periods n in a turn of the joint, or in 2 π m: the pole pairs or slots of a motor times its gear ratio, or the
        balls of a bearing; n need not be whole.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> term = Cogging(harmonics=[6, 12])
    >>> [parameter.symbol for parameter in term.parameters]
    ['Ts1j', 'Tc1j', 'Ts2j', 'Tc2j']
    >>> [round(column[0].item(), 4) for column in term.columns(0, [0.25], [0.0], [0.0], numpy)]
    [0.9975, 0.0707, 0.1411, -0.99]
    """

    kind = "cogging"

    def __init__(self, harmonics: Sequence[float], joints: JointNumbers = None) -> None:
        super().__init__(harmonics=harmonics, joints=joints)
        given = self.shape["harmonics"]
        if not isinstance(given, tuple) or min(given) <= 0.0 or len(set(given)) < len(given):
            raise InputError(
                "The harmonics of cogging must be positive numbers of periods in a turn, no two of them equal, got "
                f"{shown(harmonics)}."
            )

    @cached_property
    def parameters(self) -> tuple[TermParameter, ...]:
        """A sine and a cosine for each harmonic."""
        return tuple(
            TermParameter(f"T{letter}{i}j", "N·m", "N", f"{name} of {n:g} q of the ripple", nonnegative=False)
            for i, n in enumerate(self.shape["harmonics"], start=1)
            for letter, name in (("s", "sine"), ("c", "cosine"))
        )

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return sines and cosines."""
        angles = [float(n) * q[k] for n in self.shape["harmonics"]]
        return tuple(function(angle) for angle in angles for function in (algebra.sin, algebra.cos))

    def energies(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the integrals of sines and cosines."""
        result = []
        for n in map(float, self.shape["harmonics"]):
            result += [(-1.0 / n) * algebra.cos(n * q[k]), (1.0 / n) * algebra.sin(n * q[k])]
        return tuple(result)


class Tendon(Term):
    """Tendons over several joints with constant moment arms: friction, elasticity and tension along their lengths.

    The length of tendon t is ``l = sum(arms[t][i] q_i)``, and its pull ``Fvt dl + Fct sign(dl) + Kt (l - rest) + Pt``
    acts at joint i with the arm ``arms[t][i]``.

    Parameters
    ----------
    arms : array_like
        (T, N): row = tendon, column = joint; m at a joint that turns. At most as many tendons as joints: the parameters
        of tendon t bear the number t + 1, as if they were those of that joint.
    rest : float or sequence of float
        Length at which the elasticity exerts no force, m; one for all tendons, or one for each.

    Examples
    --------
    >>> import numpy
    >>> term = Tendon(arms=[[0.02, -0.02]])
    >>> viscous, coulomb, stiffness, tension = term.columns(0, [0.0, 1.0], [0.5, 1.0], [0.0, 0.0], numpy)
    >>> {joint: round(value, 6) for joint, value in viscous.items()}
    {0: -0.0002, 1: 0.0002}
    """

    kind = "tendon"
    parameters = (
        TermParameter("Fvt", "N·s/m", "N·s/m", "viscous friction along the tendon", nonnegative=True),
        TermParameter("Fct", "N", "N", "Coulomb friction along the tendon", nonnegative=True),
        TermParameter("Kt", "N/m", "N/m", "stiffness of the tendon", nonnegative=True),
        TermParameter("Pt", "N", "N", "tension of the tendon", nonnegative=False),
    )

    def __init__(self, arms: ArrayLike, rest: PerJoint = 0.0) -> None:
        try:
            matrix = np.array(arms, dtype=np.float64)
            lengths = np.array(rest, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"The arms of tendons must be rows of numbers, in m, got {shown(arms)}.") from None
        usual = matrix.ndim == 2 and matrix.size > 0 and bool(np.isfinite(matrix).all())
        if not usual or not matrix.any(axis=1).all() or len(matrix) > matrix.shape[1]:
            raise InputError(
                "The arms of tendons must be one row of finite numbers for each tendon, with one number for each joint "
                f"and not all of them 0, and no more rows than joints, got {shown(matrix.tolist())}."
            )
        if lengths.shape not in ((), (len(matrix),)) or not np.isfinite(lengths).all():
            raise InputError(
                f"The rest of tendons must be one length, or one for each of {len(matrix)}, in m, got {shown(rest)}."
            )
        matrix.flags.writeable = False
        self.arms, self.rest = matrix, lengths

    def __repr__(self) -> str:
        rest = f", rest={self.rest.tolist()}" if self.rest.any() else ""
        return f"Tendon(arms={self.arms.tolist()}{rest})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Tendon) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(repr(self))

    def _arms(self, k: int) -> list[tuple[int, float]]:
        row = self.arms[k] if k < len(self.arms) else ()
        return [(joint, float(arm)) for joint, arm in enumerate(row) if arm]

    def _deflection(self, k: int, q: Scalars) -> Any:
        return weighted_sum(self._arms(k), q) - float(np.broadcast_to(self.rest, (len(self.arms),))[k])

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        """Return the four columns of tendon `k`."""
        arms = self._arms(k)
        if not arms:
            return ({}, {}, {}, {})
        speed = weighted_sum(arms, dq)
        pulls = (speed, algebra.sign(speed), self._deflection(k, q), 1.0)
        return tuple({joint: arm * pull for joint, arm in arms} for pull in pulls)

    def potential(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the energy of elasticity and tension."""
        if not self._arms(k):
            return (0.0, 0.0, 0.0, 0.0)
        deflection = self._deflection(k, q)
        return (0.0, 0.0, 0.5 * deflection * deflection, deflection)

    def check(self, robot: Robot) -> None:
        """Refuse arms for another number of joints."""
        if self.arms.shape[1] != robot.dof:
            raise InputError(
                f"The arms of the tendons are given for {self.arms.shape[1]} joints, but {robot.name} has {robot.dof}: "
                "give one number for each joint in each row."
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the term as it stands in robot.toml."""
        rest = {"rest": self.rest.tolist()} if self.rest.any() else {}
        return {"kind": self.kind, "arms": self.arms.tolist(), **rest}


class Screw(ShapedTerm):
    """Friction, offset and inertia of the screw that drives a joint that slides, in units of the screw.

    The screw turns by ``2 π / pitch`` for each metre, so that a torque of the screw is ``2 π / pitch`` times as much
    force at the joint.

    Parameters
    ----------
    pitch : float or sequence of float
        Metres that the joint moves in one turn of the screw; negative for a screw of the other hand.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> term = Screw(pitch=0.02, joints=[1])
    >>> [round(float(column[0]), 3) for column in term.columns(0, [0.0], [0.01], [0.0], numpy)[:2]]
    [986.96, 314.159]
    """

    kind = "screw"
    parameters = (
        TermParameter(
            "Fvw", "N·m·s/rad", "N·m·s/rad", "viscous friction of the screw", nonnegative=True, described_as="damping"
        ),
        TermParameter("Fcw", "N·m", "N·m", "Coulomb friction of the screw", nonnegative=True, described_as="friction"),
        TermParameter("Fow", "N·m", "N·m", "torque offset of the screw", nonnegative=False, described_as="offset"),
        TermParameter("Iaw", "kg·m²", "kg·m²", "inertia of the screw", nonnegative=True, described_as="rotor_inertia"),
    )
    per_joint = ("pitch",)

    def __init__(self, pitch: PerJoint, joints: JointNumbers = None) -> None:
        super().__init__(pitch=pitch, joints=joints)
        if 0.0 in self.every("pitch"):
            raise InputError("The pitch of a screw must not be 0; give the metres that the joint moves in one turn.")

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the torque of the screw by each parameter, as a force at the joint."""
        ratio = 2.0 * math.pi / self.at("pitch", k)
        return (ratio * (ratio * dq[k]), ratio * algebra.sign(ratio * dq[k]), ratio, ratio * (ratio * ddq[k]))

    def check(self, robot: Robot) -> None:
        """Refuse joints that turn."""
        super().check(robot)
        for k, joint in enumerate(robot.joints[i] for i in robot.driving_joints):
            if joint.kind != "prismatic" and self.acts_at(k):
                raise InputError(
                    f"A screw drives a joint that slides, but {joint.name} turns; name the joints that it drives, such "
                    "as joints = [1]."
                )
