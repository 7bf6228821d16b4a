"""Terms that differ from joint to joint, under one set of parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import joint_label
from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.once import cached_property
from steelyard.robot import Condition, Joint, Robot, Term, TermParameter
from steelyard.robot.robot import Channels, Columns, Scalars

from .layout import columns_of
from .terms import term_from_dict

__all__ = ["ByJoint"]


class ByJoint(Term):
    """Laws of friction that differ from joint to joint, such as Stribeck's at two joints and Coulomb's at the others.

    A law acts at its `joints`, or at all. Viscous friction at a joint comes from the first law there that has one, and
    so does Coulomb friction; so those that stand last act where nothing else does. Piecewise linear friction stands
    for viscous friction, and from a first speed of 0 on for Coulomb friction, too. A parameter that no law has at a
    joint has no effect there.

    Parameters
    ----------
    laws : sequence of Term or mapping
        Terms that act at single joints, or their tables in robot.toml.

    Examples
    --------
    >>> import numpy
    >>> from steelyard.dynamics import Coulomb, Stribeck, Viscous
    >>> term = ByJoint([Stribeck(velocity=0.1, joints=[2]), Coulomb(), Viscous()])
    >>> [parameter.symbol for parameter in term.parameters]
    ['Fcj', 'Fsj', 'Fvj']
    >>> [len(column) for column in term.columns(0, [0.0, 0.0], [0.1, 0.1], [0.0, 0.0], numpy)]
    [1, 0, 1]
    >>> round(term.columns(1, [0.0, 0.0], [0.1, 0.1], [0.0, 0.0], numpy)[1][1].item(), 4)
    0.3679
    """

    kind = "by_joint"

    def __init__(self, laws: Sequence[Term | Mapping[str, Any]]) -> None:
        if isinstance(laws, (str, Mapping)) or not isinstance(laws, Sequence) or not laws:
            raise InputError(f"The laws of a term of kind 'by_joint' must be a list of terms, got {shown(laws)}.")
        wrong = next((one for one in laws if not isinstance(one, (Term, Mapping))), None)
        if wrong is not None:
            raise InputError(f"A law of a term of kind 'by_joint' must be a term or its table, got {shown(wrong)}.")
        self._laws = tuple(
            one if isinstance(one, Term) else term_from_dict(one, f"law {number} of a term of kind 'by_joint'")
            for number, one in enumerate(laws, start=1)
        )

    @property
    def laws(self) -> tuple[Term, ...]:
        """The terms that act at single joints."""
        return self._laws

    def __repr__(self) -> str:
        return f"ByJoint({list(self.laws)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByJoint) and self.laws == other.laws

    def __hash__(self) -> int:
        return hash(self.laws)

    @cached_property
    def parameters(self) -> tuple[TermParameter, ...]:
        """The parameters of all the laws, each symbol once."""
        found: dict[str, TermParameter] = {}
        for law in self.laws:
            for one in law.parameters:
                known = found.setdefault(one.symbol, one)
                if known.description != one.description:  # such as the speeds of nodes
                    found[one.symbol] = replace(known, description=f"{known.description.split(' at ')[0]} at a node")
        return tuple(found.values())

    @property
    def speeds(self) -> tuple[float, ...]:
        """The speeds that any of the laws names."""
        return tuple(speed for law in self.laws for speed in law.speeds)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of a log that any of the laws needs."""
        return tuple(dict.fromkeys(name for law in self.laws for name in law.channels))

    def without_channels(self) -> Term | None:
        """Return the same with laws that need no channels; None where every law needs some."""
        plain = tuple(law for law in (one.without_channels() for one in self.laws) if law is not None)
        return self if plain == self.laws else ByJoint(plain) if plain else None

    def check_channel(self, name: str, values: NDArray[np.float64]) -> None:
        """Refuse values for which a law that needs them was not made, at the joints where it acts."""
        for law in self.laws:
            if name in law.channels:
                law.check_channel(name, values[..., [k for k in range(values.shape[-1]) if law in self.at_joint(k)]])

    def on(self, robot: Robot) -> Term:
        """Return the same with laws that know the robot."""
        laws = tuple(law.on(robot) for law in self.laws)
        return self if all(a is b for a, b in zip(laws, self.laws, strict=True)) else ByJoint(laws)

    @property
    def identity(self) -> Mapping[str, Any]:
        """What tells this term from others of its kind: the identities of its laws."""
        return {"kind": self.kind, "laws": [dict(law.identity) for law in self.laws]}

    def at_joint(self, k: int) -> tuple[Term, ...]:
        """Return the laws that act at joint `k`, from 0."""
        found: list[Term] = []
        taken: set[str] = set()
        for law in self.laws:
            if law.acts_at(k) and not law.stands_for & taken:
                found.append(law)
                taken |= law.stands_for
        return tuple(found)

    def columns(
        self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any, channels: Channels | None = None
    ) -> Columns:
        """Return the columns of the laws that act at the joint."""
        return self._of_first(
            self.at_joint(k), lambda law: columns_of(law, k, (q, dq, ddq), algebra, channels), dict[int, Any]()
        )

    def potential(self, k: int, q: Scalars, algebra: Any) -> tuple[Any, ...]:
        """Return the energies of the laws that act at the joint."""
        return self._of_first(self.at_joint(k), lambda law: law.potential(k, q, algebra), 0.0)

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Return what the description says, as the first law that has a parameter reads it."""
        return self._of_first(self.laws, lambda law: law.nominal(joint), math.nan)

    def _of_first(self, laws: Iterable[Term], values: Callable[[Term], Sequence[Any]], other: Any) -> tuple[Any, ...]:
        """Return a value of each parameter, as the first of some laws that has it gives it; another where none has."""
        given: dict[str, Any] = {}
        for law in laws:
            for parameter, value in zip(law.parameters, values(law), strict=True):
                given.setdefault(parameter.symbol, value)
        return tuple(given.get(parameter.symbol, other) for parameter in self.parameters)

    def conditions(self) -> tuple[Condition, ...]:
        """Return those of all the laws: what a law asks of parameters that have no effect is no restriction."""
        return _each_once(condition for law in self.laws for condition in law.conditions())

    def conditions_at(self, k: int) -> tuple[Condition, ...]:
        """Return those of all the laws at a joint."""
        return _each_once(condition for law in self.laws for condition in law.conditions_at(k))

    def bristles(self, k: int) -> tuple[float, float, float] | None:
        """Return what tells the state that the friction of a joint needs, where a law with one acts there."""
        return next((shape for law in self.at_joint(k) if (shape := law.bristles(k)) is not None), None)

    def check(self, robot: Robot) -> None:
        """Refuse laws that do not fit the robot, and two at a joint with the same parameter."""
        for law in self.laws:
            law.check(robot)
        for k in range(robot.dof):
            symbols = [parameter.symbol for law in self.at_joint(k) for parameter in law.parameters]
            twice = next((symbol for symbol in symbols if symbols.count(symbol) > 1), None)
            if twice is not None:
                raise InputError(
                    f"Two laws of a term of kind 'by_joint' have the parameter {twice!r} at "
                    f"{joint_label(k, robot.joint_names)}; let only one of them act there."
                )

    def to_dict(self) -> dict[str, Any]:
        """Return the term as it stands in robot.toml."""
        return {"kind": self.kind, "laws": [law.to_dict() for law in self.laws]}


def _each_once(conditions: Iterable[Condition]) -> tuple[Condition, ...]:
    found: dict[tuple[str, tuple[str, ...]], Condition] = {}
    for condition in conditions:
        found.setdefault((condition.name, tuple(condition.coefficients)), condition)
    return tuple(found.values())
