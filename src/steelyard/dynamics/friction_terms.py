"""Friction beyond Coulomb's and a viscous one: by direction, Stribeck's, smooth, polynomial and piecewise linear.

Each is linear in its parameters; what is not (the velocity of Stribeck's curve, an exponent, the nodes) is its shape,
which is given. Each has the exact condition that it dissipates at every speed, as linear matrix inequalities.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import combination
from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.graph.expression import is_zero
from steelyard.once import cached_property
from steelyard.robot import Condition, Robot, TermParameter
from steelyard.robot.robot import PRESLIDING, Channels, Columns, Scalars

from .terms import JointNumbers, PerJoint, ShapedTerm, described_values

__all__ = [
    "ChannelFriction",
    "CoulombByDirection",
    "LoadFriction",
    "PiecewiseFriction",
    "PolynomialFriction",
    "SmoothCoulomb",
    "Stribeck",
    "ViscousByDirection",
]

_TINY = 1e-300
"""Added to the square of a speed before its logarithm is taken, which is finite then; no speed that is measured is
changed by it."""
_NEAR = 1e-16
"""Added to the square of a number of which the hyperbolic tangent is taken, where x / |x| would be 0 / 0 at rest. The
tangent is exact to 5e-17."""


class _ByDirection(ShapedTerm):
    """Friction with two parameters, forward and backward, which the description has as one."""

    nominal = described_values

    def __init__(self, joints: JointNumbers = None) -> None:
        super().__init__(joints=joints)

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the law where the speed is positive, and where it is negative."""
        sign = algebra.sign(dq[k])
        law = sign if self.parameters[0].described_as == "friction" else dq[k]
        return (0.5 * (law + law * sign), 0.5 * (law - law * sign))


class CoulombByDirection(_ByDirection):
    """Coulomb friction that differs by direction, ``Fcp`` forward and ``Fcn`` backward.

    In motion it is a Coulomb friction of their mean and an offset of half their difference, so that beside the term
    ``offset`` the two are not told apart. It says more than these two: neither direction drives the joint, so that the
    offset is at most the friction.

    Parameters
    ----------
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> term = CoulombByDirection()
    >>> [column[0].item() for column in term.columns(0, [0.0], [-0.5], [0.0], numpy)]
    [0.0, -1.0]
    """

    kind = "coulomb_by_direction"
    parameters = (
        TermParameter("Fcpj", "N·m", "N", "Coulomb friction forward", nonnegative=True, described_as="friction"),
        TermParameter("Fcnj", "N·m", "N", "Coulomb friction backward", nonnegative=True, described_as="friction"),
    )


class ViscousByDirection(_ByDirection):
    """Viscous friction that differs by direction, ``Fvp dq`` forward and ``Fvn dq`` backward.

    Parameters
    ----------
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> term = ViscousByDirection()
    >>> [column[0].item() for column in term.columns(0, [0.0], [-0.5], [0.0], numpy)]
    [0.0, -0.5]
    """

    kind = "viscous_by_direction"
    parameters = (
        TermParameter(
            "Fvpj", "N·m·s/rad", "N·s/m", "viscous friction forward", nonnegative=True, described_as="damping"
        ),
        TermParameter(
            "Fvnj", "N·m·s/rad", "N·s/m", "viscous friction backward", nonnegative=True, described_as="damping"
        ),
    )


class Stribeck(ShapedTerm):
    """Coulomb friction that differs near rest: ``(Fc + Fs exp(-|dq / velocity| ** exponent)) sign(dq)``.

    It takes the place of `Coulomb`, with which it shares the parameter. ``Fc + Fs`` is the friction of a joint that
    just begins to move. It dissipates at every speed if and only if ``Fc >= 0`` and ``Fc + Fs >= 0``.

    Parameters
    ----------
    velocity : float or sequence of float
        Speed at which the difference has fallen to 37 %, rad/s or m/s; one for all joints, or one for each.
    exponent : float or sequence of float
        1 (Tustin) or 2 (Gauss) as a rule.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    References
    ----------
    B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, "A survey of models, analysis tools and compensation methods
    for the control of machines with friction", Automatica 30 (1994), equation 6.

    Examples
    --------
    >>> import numpy
    >>> term = Stribeck(velocity=0.1)
    >>> [round(column[0].item(), 4) for column in term.columns(0, [0.0], [-0.2], [0.0], numpy)]
    [-1.0, -0.0183]
    >>> term.with_shape(exponent=1.0)
    Stribeck(velocity=0.1, exponent=1.0)
    >>> [condition.name for condition in term.conditions()]
    ['Fcj >= 0', 'Fcj + Fsj >= 0']
    """

    kind = "stribeck"
    nominal = described_values
    parameters = (
        TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=True, described_as="friction"),
        TermParameter("Fsj", "N·m", "N", "friction near rest beyond Coulomb's", nonnegative=False),
    )

    per_joint = ("velocity", "exponent")

    def __init__(self, velocity: PerJoint, exponent: PerJoint = 2.0, joints: JointNumbers = None) -> None:
        super().__init__(velocity=velocity, exponent=exponent, joints=joints)
        self.require_positive("velocity", "exponent")

    @property
    def speeds(self) -> tuple[float, ...]:
        """The speeds at which the curve falls."""
        return self.every("velocity")

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the sign of the speed, and that sign times the curve."""
        sign, x, exponent = algebra.sign(dq[k]), dq[k] / self.at("velocity", k), self.at("exponent", k)
        if exponent == 2.0:
            power = x * x
        elif exponent == 1.0:
            power = x * sign
        else:
            power = algebra.exp((0.5 * exponent) * algebra.log(x * x + _TINY))
        return (sign, sign * algebra.exp(-power))

    def conditions(self) -> tuple[Condition, ...]:
        """Return that friction is not negative at high speed and near rest."""
        return (linear(Fcj=1.0), linear(Fcj=1.0, Fsj=1.0))


class SmoothCoulomb(ShapedTerm):
    """Coulomb friction that turns its sign smoothly, ``Fc tanh(dq / velocity)``.

    It takes the place of `Coulomb`. The torques of a joint at rest are then part of the model: none. Simulations and
    controllers have a slope instead of a jump.

    Parameters
    ----------
    velocity : float or sequence of float
        Speed at which 76 % of the friction is reached, rad/s or m/s; one for all joints, or one for each.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> round(SmoothCoulomb(velocity=0.1).columns(0, [0.0], [0.1], [0.0], numpy)[0][0].item(), 6)
    0.761594
    """

    kind = "coulomb_smooth"
    nominal = described_values
    parameters = (TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=True, described_as="friction"),)

    per_joint = ("velocity",)

    def __init__(self, velocity: PerJoint, joints: JointNumbers = None) -> None:
        super().__init__(velocity=velocity, joints=joints)
        self.require_positive("velocity")

    @property
    def speeds(self) -> tuple[float, ...]:
        """The speeds at which the sign turns."""
        return self.every("velocity")

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the smooth sign.

        It is (1 - e) / (1 + e) with e = exp(-2 |x|), which neither overflows nor has a kink at rest, as x + |x| has.
        """
        x = dq[k] / self.at("velocity", k)
        size = algebra.sqrt(x * x + _NEAR)
        e = algebra.exp(-2.0 * size)
        return (x * ((1.0 - e) / (size * (1.0 + e))),)


class PolynomialFriction(ShapedTerm):
    """Friction that is a polynomial of the speed, ``sum(F_p |dq| ** p) sign(dq)``.

    With the powers 1 and 3 it is the viscous friction and its cube; with 0, 1 and 2, Coulomb friction, a viscous one
    and a quadratic one. It takes the place of `Coulomb` and `Viscous` where it has the powers 0 and 1, with which it
    shares their parameters.

    It dissipates where the polynomial is not negative at any speed, from 0 to the given one or of any size. Single
    coefficients may be negative then. The condition is exact: a polynomial in one variable that is nowhere negative is
    a sum of squares, whose matrices must be positive semidefinite. Where these are not determined by the coefficients,
    as with three powers, the term has parameters ``Fx1j`` … without a torque, which are the rest of the matrices.

    Parameters
    ----------
    powers : sequence of int
        Ascending, from 0 to 9.
    speed : float, optional
        Up to which the friction must dissipate, rad/s or m/s; all speeds where it is not given.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    References
    ----------
    G. Blekherman, P. Parrilo and R. Thomas, "Semidefinite Optimization and Convex Algebraic Geometry", SIAM 2012,
    section 3.1.

    Examples
    --------
    >>> cubic = PolynomialFriction(powers=[1, 3], speed=2.0)
    >>> [parameter.symbol for parameter in cubic.parameters]
    ['Fvj', 'Fv3j']
    >>> [condition.name for condition in cubic.conditions()]
    ['Fvj + 4 Fv3j >= 0', 'Fvj >= 0']
    >>> [parameter.symbol for parameter in PolynomialFriction(powers=[0, 1, 2]).parameters]
    ['Fcj', 'Fvj', 'Fv2j', 'Fx1j']
    """

    kind = "friction_polynomial"
    nominal = described_values
    one_number = ("speed",)

    def __init__(self, powers: Sequence[int], speed: float | None = None, joints: JointNumbers = None) -> None:
        given: list[Any] = list(powers) if isinstance(powers, Sequence) else [None]
        whole = all(isinstance(p, int) and not isinstance(p, bool) and 0 <= p <= 9 for p in given)
        if not given or not whole or any(b <= a for a, b in pairwise(given)):
            raise InputError(
                f"The powers of a friction polynomial must be ascending whole numbers from 0 to 9, got {shown(powers)}."
            )
        super().__init__(powers=tuple(given), speed=speed, joints=joints)
        self.require_positive("speed")
        self.powers = tuple(given)

    @cached_property
    def parameters(self) -> tuple[TermParameter, ...]:
        """One parameter for each power, and one for each number that the sums of squares leave open."""
        result = []
        for power in self.powers:
            what = {0: "Coulomb friction", 1: "viscous friction"}.get(power, f"friction by the speed to the {power}")
            described = {0: "friction", 1: "damping", 2: "quadratic_damping", 3: "cubic_damping"}.get(power)
            # Alone, a coefficient of either sign may dissipate; the conditions say what must hold.
            result.append(
                TermParameter(_symbol(power), *_units(power), what, nonnegative=False, described_as=described)  # type: ignore[arg-type]
            )
        return (*result, *(TermParameter(s, *_units(self.powers[0]), _SLACK, nonnegative=False) for s in self._slack))

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the odd powers of the speed, and the even ones with its sign."""
        x, result = dq[k], []
        for power in self.powers:
            value = x if power % 2 else algebra.sign(x)
            for _ in range(power // 2):
                value = x * x * value
            result.append(value)
        return (*result, *(None for _ in self._slack))

    def conditions(self) -> tuple[Condition, ...]:
        """Return that the polynomial is not negative at any speed."""
        return self._squares[1]

    @property
    def _slack(self) -> tuple[str, ...]:
        return self._squares[0]

    @cached_property
    def _squares(self) -> tuple[tuple[str, ...], tuple[Condition, ...]]:
        first = self.powers[0]
        step = math.gcd(*(power - first for power in self.powers)) or 1
        symbols = {(power - first) // step: _symbol(power) for power in self.powers}
        speed = self.shape["speed"]
        return nonnegative_polynomial(symbols, None if speed is None else float(speed) ** step)


class PiecewiseFriction(ShapedTerm):
    """Friction that is linear in the speed between given speeds; its parameters are the torques at these speeds.

    Below the first speed it falls to 0 at rest, unless that speed is 0: the torque there is the Coulomb friction then,
    of which `Coulomb` is left out. Above the last speed it stays as it is there. It dissipates at every speed if and
    only if none of the torques is negative.

    Parameters
    ----------
    speeds : sequence of float
        Ascending and not negative, rad/s or m/s; the last is the fastest of the motion, as a rule.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> term = PiecewiseFriction(speeds=[0.0, 1.0, 2.0])
    >>> [column[0].item() for column in term.columns(0, [0.0], [-1.25], [0.0], numpy)]
    [-0.0, -0.75, -0.25]
    """

    kind = "friction_piecewise"

    def __init__(self, speeds: Sequence[float], joints: JointNumbers = None) -> None:
        try:
            nodes = tuple(float(x) for x in speeds)
        except (TypeError, ValueError):
            nodes = ()
        usual = all(math.isfinite(x) for x in nodes) and all(a < b for a, b in pairwise(nodes))
        if not nodes or not usual or nodes[0] < 0.0 or nodes[-1] <= 0.0:
            raise InputError(
                "The speeds of piecewise linear friction must be ascending numbers of at least 0, the last one above "
                f"0, in rad/s or m/s, got {shown(speeds)}."
            )
        super().__init__(speeds=nodes, joints=joints)

    @property
    def speeds(self) -> tuple[float, ...]:
        """The speeds between which the friction is linear."""
        return tuple(self.shape["speeds"])

    @cached_property
    def parameters(self) -> tuple[TermParameter, ...]:
        """The torque at each of the speeds."""
        return tuple(
            TermParameter(f"Fn{i}j", "N·m", "N", f"friction at {speed:g} rad/s or m/s", nonnegative=True)
            for i, speed in enumerate(self.speeds, start=1)
        )

    @property
    def stands_for(self) -> frozenset[str]:
        """Viscous friction, and from a first speed of 0 on Coulomb friction, too."""
        return frozenset({"damping", "friction"} if self.speeds[0] == 0.0 else {"damping"})

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the share of each torque in the friction, with the sign of the speed."""
        sign = algebra.sign(dq[k])
        size, nodes = dq[k] * sign, [0.0, *(node for node in self.speeds if node > 0.0)]
        beyond = []  # by how much the speed is above each node
        for node in nodes:
            above = size - node
            beyond.append(0.5 * (above + above * algebra.sign(above)) if node else size)
        passed = [(a - b) / (y - x) for (a, b), (x, y) in zip(pairwise(beyond), pairwise(nodes), strict=True)]
        shares = [1.0 - passed[0], *(a - b for a, b in pairwise(passed)), passed[-1]]
        return tuple(sign * share for share in shares[len(nodes) - len(self.speeds) :])


class LoadFriction(ShapedTerm):
    """Coulomb and viscous friction that grow with the load: ``(Fc + Fl load) sign(dq) + (Fv + Fvl load) dq``.

    The load is ``|g| ** power``, where g is the torque of gravity at the joint by the inertias of the description. It
    takes the place of `Coulomb` and `Viscous`, with which it shares parameters. Where the description is poor, identify
    without it first, and then with it and the description that was written.

    It dissipates at every speed and every load up to `largest` if and only if friction does without a load and with the
    largest.

    Parameters
    ----------
    power : float
        1 as a rule, or 2.
    largest : float, optional
        The largest torque of gravity, N·m or N; any without it.
    moments : sequence of float, optional
        By which the loads are computed, in the place of the inertias of the description: four numbers for each link in
        its frame, the first moment (kg m) and the mass (kg), as a fit to logs found them. Only the torques of gravity
        that follow from them count, so that they need not be those of a body.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    References
    ----------
    A. C. Bittencourt and S. Gunnarsson, "Static friction in a robot joint: modeling and identification of load and
    temperature effects", Journal of Dynamic Systems, Measurement, and Control 134 (2012). L. Madsen, O. S. Rosenlund,
    A. Brandt and X. Zhang, "Comprehensive modeling and identification of nonlinear joint dynamics for collaborative
    industrial robot manipulators", Control Engineering Practice 101 (2020).

    Examples
    --------
    >>> import numpy
    >>> import steelyard as sy
    >>> link = sy.Inertia.from_com(mass=2.0, com=(0.3, 0.0, 0.0), about_com=numpy.eye(3) * 0.01)
    >>> robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), inertias={"link1": link})
    >>> (term,) = robot.with_terms(LoadFriction()).terms
    >>> round(float(term.columns(0, [0.0], [0.5], [0.0], numpy)[1][0]), 3)
    15.696
    """

    kind = "friction_by_load"
    nominal = described_values
    parameters = (
        TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=False, described_as="friction"),
        TermParameter("Flj", "1", "1", "Coulomb friction by the load", nonnegative=False),
        TermParameter("Fvj", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=False, described_as="damping"),
        TermParameter("Fvlj", "s/rad", "s/m", "viscous friction by the load", nonnegative=False),
    )
    one_number = ("power", "largest")

    def __init__(
        self,
        power: float = 1.0,
        largest: float | None = None,
        moments: Sequence[float] | None = None,
        joints: JointNumbers = None,
    ) -> None:
        super().__init__(power=power, largest=largest, moments=moments, joints=joints)
        if self.shape["power"] not in (1.0, 2.0):
            raise InputError(f"The power of a friction by the load must be 1 or 2, got {shown(power)}.")
        self.require_positive("largest")
        self._robot: Robot | None = None

    def on(self, robot: Robot) -> LoadFriction:
        """Return the term with the loads of a robot.

        Raises
        ------
        InputError
            If the inertia of a link is not known.
        """
        moments = self.shape["moments"]
        if moments is not None and (not isinstance(moments, tuple) or len(moments) != 4 * len(robot.links)):
            raise InputError(
                f"The moments of the term {self.kind!r} must be four numbers for each of the {len(robot.links)} links "
                f"of {robot.name}, the first moment and the mass, got {shown(moments)}."
            )
        unknown = next((link.name for link in robot.links if link.inertia is None), None) if moments is None else None
        if unknown is not None:
            raise InputError(
                f"The term {self.kind!r} needs the torques of gravity, but the inertia of {unknown} is not known; "
                "state it in the description, or identify without the term and use the description that is written."
            )
        bound = self.with_shape()
        bound._robot = replace(robot, terms=())
        return bound

    @property
    def identity(self) -> Mapping[str, Any]:
        """The shape, and the inertias that make the load."""
        robot = self._robot
        plain = robot is None or self.shape["moments"] is not None
        inertias = (
            [] if robot is None or plain else [one.inertia.parameters.tolist() for one in robot.links if one.inertia]
        )
        return {**self.to_dict(), "inertias": inertias}

    def load(self, k: int, q: Scalars, algebra: Any) -> Any:
        """Return the load of a joint."""
        from .algorithms.kinematics import joint_frames
        from .algorithms.newton_euler import inverse_dynamics

        robot = self._robot
        if robot is None:
            raise InputError(f"The term {self.kind!r} has no loads; give it to a robot with `with_terms`.")
        given = self.shape["moments"]
        if given is not None:
            links = [[0.0] * 6 + [float(x) for x in given[i : i + 4]] for i in range(0, len(given), 4)]
        else:
            links = [list(map(float, link.inertia.parameters)) for link in robot.links if link.inertia is not None]
        x, y, z = (float(value) for value in robot.gravity)
        still = [0.0 * value for value in q]
        torque = inverse_dynamics(joint_frames(robot, q, algebra), still, still, links, (x, y, z))[k]
        if is_zero(torque):  # about a vertical axis
            return 0.0 * q[k]
        return torque * (torque if self.shape["power"] == 2.0 else algebra.sign(torque))

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return sign and speed, each without the load and times the load."""
        load, sign = self.load(k, q, algebra), algebra.sign(dq[k])
        return (sign, load * sign, dq[k], load * dq[k])

    def conditions(self) -> tuple[Condition, ...]:
        """Return that friction is not negative without a load and with the largest."""
        largest = self.shape["largest"]
        return affine_conditions(
            (("Fcj", "Flj"), ("Fvj", "Fvlj")), 0.0, None if largest is None else float(largest) ** self.shape["power"]
        )


class ChannelFriction(ShapedTerm):
    """Friction by a logged signal: ``(Fc + Fcs (s - reference)) sign(dq) + (Fv + Fvs (s - reference)) dq``.

    s is what a channel of the log holds for the joint, such as the temperature of its gear, or the time since the robot
    was started. It takes the place of `Coulomb` and `Viscous`, with which it shares parameters.

    It dissipates at every speed and every s of the range if and only if friction does at both ends of the range. A log
    with a signal outside of it is refused.

    Parameters
    ----------
    channel : str
        Name of the channel, a key of `channels` in [log].
    range : (float, float)
        The least and the greatest signal.
    reference : float
        Signal at which friction is ``Fc`` and ``Fv``, within the range.
    held : float, optional
        A signal within the range that is the same at all times, in the place of the channel: for simulation and
        generated code.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    Examples
    --------
    >>> import numpy
    >>> term = ChannelFriction("temperature", range=[15.0, 60.0], reference=25.0)
    >>> columns = term.columns(0, [0.0], [-0.5], [0.0], numpy, {"temperature": [35.0]})
    >>> [float(column[0]) for column in columns]
    [-1.0, -10.0, -0.5, -5.0]
    >>> [condition.name for condition in term.conditions()][:2]
    ['Fcj - 10 Fcsj >= 0', 'Fcj + 35 Fcsj >= 0']
    """

    kind = "friction_by_channel"
    nominal = described_values
    parameters = (
        TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=False, described_as="friction"),
        TermParameter("Fcsj", "N·m", "N", "change of Coulomb friction by the signal", nonnegative=False),
        TermParameter("Fvj", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=False, described_as="damping"),
        TermParameter("Fvsj", "N·m·s/rad", "N·s/m", "change of viscous friction by the signal", nonnegative=False),
    )
    one_number = ("reference", "held")

    def __init__(
        self,
        channel: str,
        range: Sequence[float],
        reference: float = 0.0,
        held: float | None = None,
        joints: JointNumbers = None,
    ) -> None:
        super().__init__(range=range, reference=reference, held=held, joints=joints)
        ends = self.shape["range"]
        if not isinstance(channel, str) or not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", channel):
            raise InputError(
                f"The channel of a friction by a channel must be a name of letters, digits and _, got {shown(channel)}."
            )
        if channel == PRESLIDING:
            raise InputError(
                f"The channel {channel!r} is the state of Dahl's and LuGre's friction, which follows from the motion; "
                "give the column another name in [log] and in the term."
            )
        if not isinstance(ends, tuple) or len(ends) != 2 or not ends[0] < ends[1]:
            raise InputError(
                f"The range of the channel {channel!r} must be the least and the greatest of its values, got "
                f"{shown(range)}."
            )
        for name in ("reference", "held"):
            value = self.shape[name]
            if value is not None and not ends[0] <= value <= ends[1]:
                raise InputError(
                    f"The {name} of the channel {channel!r} is {value:g}, beyond the range {ends[0]:g} to {ends[1]:g} "
                    f"in which its friction is proved to dissipate; give a {name} within it, or widen `range`."
                )
        self.shape = {"channel": channel, **self.shape}

    @property
    def channels(self) -> tuple[str, ...]:
        """The channel, unless its value is held."""
        return (self.shape["channel"],) if self.shape["held"] is None else ()

    def without_channels(self) -> ChannelFriction:
        """Return the term with the signal at its reference."""
        return self if self.shape["held"] is not None else self.with_shape(held=self.shape["reference"])

    def columns(
        self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any, channels: Channels | None = None
    ) -> Columns:
        """Return sign and speed, each without the signal and times what it is beyond its reference."""
        if not self.acts_at(k):
            return ({}, {}, {}, {})
        held = self.shape["held"]
        if held is None:
            held = self.logged_at(k, self.shape["channel"], channels, "or hold it at one value with `held`")
        beyond = held - float(self.shape["reference"])
        sign = algebra.sign(dq[k])
        return ({k: sign}, {k: beyond * sign}, {k: dq[k]}, {k: beyond * dq[k]})

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the columns at the held signal."""
        return tuple(column.get(k) for column in self.columns(k, q, dq, ddq, algebra))

    def check_channel(self, name: str, values: NDArray[np.float64]) -> None:
        """Refuse values of the channel beyond the range in which the friction is proved to dissipate."""
        low, high = self.shape["range"]
        least, greatest = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
        if least < low or greatest > high:
            raise InputError(
                f"The channel {name!r} goes from {least:.6g} to {greatest:.6g}, beyond the range {low:g} to {high:g} "
                f"of the term {self.kind!r}, in which its friction is proved to dissipate; widen `range`."
            )

    def conditions(self) -> tuple[Condition, ...]:
        """Return that friction is not negative at both ends of the range."""
        low, high = (float(end) - float(self.shape["reference"]) for end in self.shape["range"])
        return affine_conditions((("Fcj", "Fcsj"), ("Fvj", "Fvsj")), low, high)


def affine_conditions(pairs: Sequence[tuple[str, str]], low: float, high: float | None) -> tuple[Condition, ...]:
    """Return that ``a + b x`` is not negative from `low` on to `high`, or from `low` on, for each pair of symbols."""
    found = []
    for constant, slope in pairs:
        for x in (low,) if high is None else (low, high):
            found.append(linear(**{constant: 1.0, slope: x}))
        if high is None:
            found.append(linear(**{slope: 1.0}))
    return tuple(found)


_SLACK = "element of a sum of squares that shows that the friction dissipates; no torque depends on it"


def _symbol(power: int) -> str:
    """Symbol of the coefficient of a power of the speed."""
    return {0: "Fcj", 1: "Fvj"}.get(power, f"Fv{power}j")


def _units(power: int) -> tuple[str, str]:
    """Units of a torque, and of a force, by a power of the speed."""
    if power == 0:
        return "N·m", "N"
    if power == 1:
        return "N·m·s/rad", "N·s/m"
    digits = str(power).translate(str.maketrans("23456789", "²³⁴⁵⁶⁷⁸⁹"))
    return f"N·m·s{digits}/rad{digits}", f"N·s{digits}/m{digits}"


def linear(**coefficients: float) -> Condition:
    """Return the condition that a combination of parameters is not negative, such as ``"Fvj - 0.5 Fbj >= 0"``."""
    held = {symbol: value for symbol, value in coefficients.items() if value}
    matrices = {symbol: np.array([[value]]) for symbol, value in held.items()}
    return Condition(f"{combination(held.values(), list(held), digits=6)} >= 0", 1, np.zeros((1, 1)), matrices)


def nonnegative_polynomial(
    symbols: Mapping[int, str], bound: float | None
) -> tuple[tuple[str, ...], tuple[Condition, ...]]:
    """Return the conditions that a polynomial is not negative from 0 to a bound, or from 0 on.

    The polynomial is ``m0 s0 + m1 s1`` with sums of squares s0 and s1, where m0 and m1 are 1 and w from 0 on; on an
    interval [0, 1] they are 1 and w (1 - w) where its degree is even, and w and 1 - w where it is odd.

    Parameters
    ----------
    symbols : mapping
        From powers of the variable to the symbols of their coefficients; the lowest power is 0.
    bound : float, optional
        Positive.

    Returns
    -------
    slack : tuple of str
        Symbols of further parameters, which are the elements of the matrices that the coefficients leave open.
    conditions : tuple of Condition
    """
    degree = max(symbols)
    half = degree // 2
    if bound is None:
        factors = ((half + 1, {0: 1.0}), ((degree + 1) // 2, {1: 1.0}))
    elif degree % 2:
        factors = ((half + 1, {1: 1.0}), (half + 1, {0: 1.0, 1: -1.0}))
    else:
        factors = ((half + 1, {0: 1.0}), (half, {1: 1.0, 2: -1.0}))
    entries = [(which, i, j) for which, (size, _) in enumerate(factors) for i in range(size) for j in range(i, size)]
    given = np.zeros((degree + 1, len(entries)))
    for column, (which, i, j) in enumerate(entries):
        for power, factor in factors[which][1].items():
            given[i + j + power, column] += factor * (1.0 if i == j else 2.0)
    pivots = _pivots(given)
    others = [k for k in range(len(entries)) if k not in pivots]
    slack = tuple(f"Fx{k}j" for k in range(1, len(others) + 1))
    solved = np.linalg.inv(given[:, pivots])
    scale = 1.0 if bound is None else bound
    # Each element of the matrices as a combination of coefficients, which count in units of the bound, and of slack.
    elements = np.zeros((len(entries), len(symbols) + len(slack)))
    elements[pivots, : len(symbols)] = np.round(solved, 12)[:, list(symbols)] * [scale**power for power in symbols]
    elements[pivots, len(symbols) :] = -np.round(solved @ given[:, others], 12)
    elements[others, len(symbols) + np.arange(len(slack))] = 1.0
    names, conditions = (*symbols.values(), *slack), []
    for which, (size, _) in enumerate(factors):
        rows = [k for k, entry in enumerate(entries) if entry[0] == which]
        if not rows:
            continue
        matrices: dict[str, NDArray[np.float64]] = {}
        for column, name in enumerate(names):
            matrix = np.zeros((size, size))
            for k in rows:
                _, i, j = entries[k]
                matrix[i, j] = matrix[j, i] = elements[k, column]
            if matrix.any():
                matrices[name] = matrix
        if size == 1:
            conditions.append(linear(**{name: float(value) for name, ((value,),) in matrices.items()}))
        else:
            conditions.append(Condition("friction dissipates", size, np.zeros((size, size)), matrices))
    return slack, tuple(conditions)


def _pivots(matrix: NDArray[np.float64]) -> list[int]:
    """Return columns that make a square matrix with an inverse, the last ones that do."""
    chosen: list[int] = []
    for column in reversed(range(matrix.shape[1])):
        if np.linalg.matrix_rank(matrix[:, [*chosen, column]]) > len(chosen):
            chosen.append(column)
    return sorted(chosen)
