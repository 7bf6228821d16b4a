"""Friction that remembers the motion: Dahl's and LuGre's."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.robot import Condition, TermParameter
from steelyard.robot.robot import PRESLIDING, Channels, Columns, Scalars

from .friction_terms import linear
from .terms import JointNumbers, PerJoint, ShapedTerm, described_values

__all__ = ["Dahl", "LuGre"]

Array = NDArray[np.float64]

BEYOND = 1e-6
"""By how much the state of a bristle may be beyond the deflection at which it breaks away, by rounding."""


class _BristleFriction(ShapedTerm):
    """Friction with a state, which is the channel `PRESLIDING`, or as in steady sliding."""

    per_joint = ("displacement", "ratio", "velocity")
    nominal = described_values

    def __init__(self, *, sliding: bool, joints: JointNumbers, **shape: Any) -> None:
        if not isinstance(sliding, bool):
            raise InputError(f"`sliding` of a term of kind {self.kind!r} must be true or false, got {shown(sliding)}.")
        super().__init__(joints=joints, **shape)
        self.require_positive(*(name for name in shape if name != "ratio"))
        self.shape["sliding"] = True if sliding else None

    @property
    def channels(self) -> tuple[str, ...]:
        """The state of the bristles, unless they slide at all times."""
        return () if self.shape["sliding"] else (PRESLIDING,)

    def without_channels(self) -> _BristleFriction:
        """Return the term as in steady sliding, with the same parameters."""
        return self if self.shape["sliding"] else self.with_shape(sliding=True)

    def bristles(self, k: int) -> tuple[float, float, float] | None:
        """Return displacement, ratio and velocity at a joint."""
        return None if self.shape["sliding"] or not self.acts_at(k) else self._numbers_at(k)

    @property
    def _largest_ratio(self) -> float:
        return max(self.every("ratio")) if "ratio" in self.shape else 0.0

    def _numbers_at(self, k: int) -> tuple[float, float, float]:
        return self.at("displacement", k), 0.0, 1.0

    def check_channel(self, name: str, values: Array) -> None:
        """Refuse states that bristles cannot have: they break away."""
        largest, limit = float(np.abs(values).max(initial=0.0)), 1.0 + self._largest_ratio
        if largest > limit * (1.0 + BEYOND):
            raise InputError(
                f"The channel {name!r} goes to {largest:.6g}, but the bristles of the term {self.kind!r} break away at "
                f"{limit:g}; `Model.presliding` computes it from a motion."
            )

    def columns(
        self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any, channels: Channels | None = None
    ) -> Columns:
        """Return the torque of each parameter, by the state of the bristles."""
        if not self.acts_at(k):
            return tuple({} for _ in self.parameters)
        state = None
        if not self.shape["sliding"]:
            state = self.logged_at(k, PRESLIDING, channels, "as `Model.presliding` computes it, or state `sliding`")
        values = self._torques(k, dq[k], state, algebra)
        return tuple({} if value is None else {k: value} for value in values)

    def _torques(self, k: int, speed: Any, state: Any, algebra: Any) -> tuple[Any, ...]:
        raise NotImplementedError

    def values(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the columns in steady sliding."""
        return self._torques(k, dq[k], None, algebra)


class Dahl(_BristleFriction):
    """Dahl's friction, ``Fc u``: Coulomb friction that builds up over a presliding displacement.

    The state u follows ``du/dt = (dq - |dq| u) / d``: it is the deflection of bristles between the surfaces, and is the
    sign of the speed once the joint has slid by some displacements d. It takes the place of `Coulomb`, with which it
    shares the parameter.

    A term gives the torque of one instant, so that the state is a *channel* beside the motion. From logs it is
    computed as they are read, and rows before which a joint has not yet moved enough for it to be known are left out;
    `Model.presliding` computes it for a motion in memory. It dissipates if and only if ``Fc >= 0``.

    Parameters
    ----------
    displacement : float or sequence of float
        The presliding displacement d, rad or m, over which 63 % of the friction is built up; one for all joints, or one
        for each.
    sliding : bool
        Whether u is the sign of the speed at all times, as in steady sliding: Coulomb friction, for what remembers no
        motion.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    References
    ----------
    P. R. Dahl, A solid friction model, Aerospace Corporation, 1968.

    Examples
    --------
    >>> term = Dahl(displacement=0.01)
    >>> term.columns(0, [0.0], [-0.5], [0.0], np, {"presliding": [0.3]})
    ({0: 0.3},)
    >>> term.without_channels()
    Dahl(displacement=0.01, sliding=True)
    """

    kind = "dahl"
    parameters = (TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=True, described_as="friction"),)

    def __init__(self, displacement: PerJoint, sliding: bool = False, joints: JointNumbers = None) -> None:
        super().__init__(displacement=displacement, sliding=sliding, joints=joints)

    def _torques(self, k: int, speed: Any, state: Any, algebra: Any) -> tuple[Any, ...]:
        return (algebra.sign(speed) if state is None else state,)


class LuGre(_BristleFriction):
    """LuGre friction, ``Fc u + Fb d du/dt + Fv dq``: presliding, Stribeck's curve and damped bristles.

    The state u follows ``d du/dt = dq - |dq| u / g(dq)`` with ``g(dq) = 1 + r exp(-(dq / v)²)``, so that a joint which
    slides steadily has the friction ``Fc g(dq) sign(dq) + Fv dq``. It takes the place of `Coulomb` and `Viscous`, with
    which it shares parameters. In the usual numbers, ``sigma0 = Fc / d``, ``sigma1 = Fb``, ``sigma2 = Fv`` and
    ``Fs = (1 + r) Fc``.

    The state is a channel beside the motion, as that of `Dahl`. Friction dissipates in every motion if and only if
    ``Fc >= 0``, ``Fb >= 0`` and ``Fv >= r Fb`` (Barahanov and Ortega).

    Parameters
    ----------
    displacement : float or sequence of float
        The presliding displacement d, rad or m; one for all joints, or one for each; likewise the others.
    ratio : float or sequence of float
        What breaks away above Coulomb friction, relative to that (r).
    velocity : float or sequence of float
        Stribeck velocity v, rad/s or m/s.
    sliding : bool
        Whether the joint slides steadily at all times, for what remembers no motion.
    joints : sequence of int, optional
        Numbers of the joints, from 1, where it acts; all where it is not given.

    References
    ----------
    C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, A new model for control of systems with friction, IEEE
    Transactions on Automatic Control 40, 1995. N. Barahanov and R. Ortega, Necessary and sufficient conditions for
    passivity of the LuGre friction model, IEEE Transactions on Automatic Control 45, 2000.

    Examples
    --------
    >>> term = LuGre(displacement=0.01, ratio=0.5, velocity=0.1)
    >>> columns = term.columns(0, [0.0], [-0.2], [0.0], np, {"presliding": [0.3]})
    >>> [round(float(column[0]), 4) for column in columns]
    [0.3, -0.2595, -0.2]
    >>> [condition.name for condition in term.conditions()]
    ['Fcj >= 0', 'Fbj >= 0', 'Fvj - 0.5 Fbj >= 0']
    """

    kind = "lugre"
    parameters = (
        TermParameter("Fcj", "N·m", "N", "Coulomb friction", nonnegative=True, described_as="friction"),
        TermParameter("Fbj", "N·m·s/rad", "N·s/m", "damping of the bristles of friction", nonnegative=True),
        TermParameter("Fvj", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=True, described_as="damping"),
    )

    def __init__(
        self,
        displacement: PerJoint,
        ratio: PerJoint,
        velocity: PerJoint,
        sliding: bool = False,
        joints: JointNumbers = None,
    ) -> None:
        super().__init__(displacement=displacement, ratio=ratio, velocity=velocity, sliding=sliding, joints=joints)
        if min(self.every("ratio")) < 0.0:
            raise InputError(
                f"The ratio of a term of kind {self.kind!r} must not be negative, got {shown(self.shape['ratio'])}: it "
                "is what breaks away above Coulomb friction, relative to that."
            )

    @property
    def speeds(self) -> tuple[float, ...]:
        """The speeds at which the curve falls."""
        return self.every("velocity")

    def _numbers_at(self, k: int) -> tuple[float, float, float]:
        return self.at("displacement", k), self.at("ratio", k), self.at("velocity", k)

    def _torques(self, k: int, speed: Any, state: Any, algebra: Any) -> tuple[Any, ...]:
        x, sign = speed / self.at("velocity", k), algebra.sign(speed)
        bound = 1.0 + self.at("ratio", k) * algebra.exp(-(x * x))
        if state is None:
            return (sign * bound, None, speed)
        return (state, speed - sign * speed * state / bound, speed)

    def conditions(self) -> tuple[Condition, ...]:
        """Return those of the joint where the most breaks away."""
        return self._conditions(max(self.every("ratio")))

    def conditions_at(self, k: int) -> tuple[Condition, ...]:
        """Return that the friction of a joint dissipates in every motion."""
        return self._conditions(self.at("ratio", k) if self.acts_at(k) else None)

    def _conditions(self, ratio: float | None) -> tuple[Condition, ...]:
        own = (linear(Fcj=1.0), linear(Fbj=1.0))
        if ratio is None:  # of parameters without an effect, the viscous friction may be that of another law
            return own
        return (*own, linear(Fvj=1.0, Fbj=-ratio))
