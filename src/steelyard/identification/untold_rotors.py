"""Rotors that may turn with joints, of which nobody says anything and no motion tells them from links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model, RotorInertia
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.bounds.quantities import Quantity
from steelyard.files import listed
from steelyard.robot.robot import Columns, Scalars

__all__ = ["MOST_NAMED", "UntoldRotors"]

Array = NDArray[np.float64]

ROUNDING = 1e-8
"""Shares this much smaller than the largest are none: they are computed to some 1e-12."""
MOST_NAMED = 3
"""Numbers, or combinations of them, that a sentence names: more are not read."""


class UntoldRotors(NamedTuple):
    """Rotors whose torques links can make, too, as one at the first joint, and that the model does not have.

    They are not seen by how well the model explains the log: where nobody says what their inertias are, the links'
    numbers hold them.

    Attributes
    ----------
    feasible_set : FeasibleSet
        Of the model without them.
    names : list of str
        Of all rotors that the model lacks, as their inertias are named.
    shares : (n, N)
        How much of each parameter the inertia of a rotor would make; zero for rotors that a motion tells.
    """

    feasible_set: FeasibleSet
    names: list[str]
    shares: Array

    @classmethod
    def of(cls, feasible_set: FeasibleSet) -> UntoldRotors:
        """Return those of a model; none where it has rotors."""
        model = feasible_set.model
        nothing = cls(feasible_set, [], np.zeros((feasible_set.parameter_count, 0)))
        if not isinstance(model, Model) or "rotor_inertia" in model.described_as:
            return nothing
        wider = model.with_rotors
        narrow = {str(name): column for column, name in enumerate(wider.parameter_names)}
        K = np.asarray(wider.base_parameters().K, dtype=float)
        own = K[:, [narrow.pop(str(name)) for name in model.parameter_names]]
        rotors = K[:, list(narrow.values())]
        shares = np.asarray(np.linalg.lstsq(own, rotors, rcond=None)[0])
        told_apart = np.abs(own @ shares - rotors).max(axis=0) > ROUNDING * np.abs(rotors).max(axis=0)
        return nothing if told_apart.all() else cls(feasible_set, list(narrow), np.where(told_apart, 0.0, shares))

    def share(self, quantity: Quantity, parameters: Array) -> Array:
        """Return how much of a number is that of each rotor, (N,)."""
        share = np.asarray(quantity.slope(parameters) @ self.shares)
        return np.where(np.abs(share) < ROUNDING * np.abs(self.shares).max(initial=0.0), 0.0, share)

    def with_rotors(self) -> FeasibleSet:
        """Return the set of the model with these rotors; that of the model where there are none.

        Physics confines links by what they hold of rotors, too: of a pan-tilt head of 0.3 kg whose moment about its
        axis was half a rotor's, two other moments were at least 1.5 times the true ones. *Measured* on eight such heads
        without inertials: of 75 numbers that are bounded by data and physics 64 held the truth, and 70 of 71 do.
        """
        model, plain = self.feasible_set.model, self.feasible_set
        each = zip(self.names, self.shares.T, strict=True)
        joints = [int(name.removeprefix("Ia")) - 1 for name, share in each if share.any()]
        if not joints or not isinstance(model, Model):
            return plain
        wider = Model(model.robot.with_terms(*model.robot.terms, _RotorsOf(joints)))
        K, own = np.asarray(wider.base_parameters().K, dtype=float), plain.K
        # Base parameters are those of the links and of other terms, with what the rotors add to them.
        if len(K) != len(own) or not np.allclose(K[:, self._places(wider)], own, atol=ROUNDING):
            return plain
        return FeasibleSet(wider, plain.consistency, plain.constraints, plain.margin)

    def within(
        self, wider_set: FeasibleSet, parameters: Array, asked: Sequence[Quantity]
    ) -> tuple[Array, list[Quantity]]:
        """Return parameters and quantities of the model as those of `with_rotors`, where rotors are next to nothing."""
        wider = wider_set.model
        if wider is self.feasible_set.model or not isinstance(wider, Model):
            return parameters, list(asked)
        places, count = self._places(wider), wider.parameter_count

        def of_wider(row: Array, others: float = 0.0) -> Array:
            found = np.full(count, others)
            found[places] = row
            return found

        moments = parameters[self.feasible_set.link_columns[:, [0, 3, 5]]]
        least = 1e-6 * float(np.abs(moments).min())  # inside of what cannot be negative
        quantities_within = [
            replace(
                one,
                row=of_wider(one.row),
                mass=None if one.mass is None else of_wider(one.mass),
                moments=tuple(of_wider(moment) for moment in one.moments),
            )
            for one in asked
        ]
        return of_wider(parameters, least), quantities_within

    def in_sums(self, row: Array) -> NDArray[np.intp]:
        """Return which rotors are a part of a sum of parameters that data tell."""
        share, size = row @ self.shares, np.abs(row) @ np.abs(self.shares)
        return np.flatnonzero(np.abs(share) > ROUNDING * size)

    def summands(self, row: Array) -> str:
        """Write what rotors add to a sum of parameters."""
        share = row @ self.shares

        def summand(rotor: int) -> str:
            times = "" if abs(abs(share[rotor]) - 1.0) < ROUNDING else f"{abs(share[rotor]):.4g}*"
            return f" {'-' if share[rotor] < 0.0 else '+'} {times}{self.names[rotor]}"

        return "".join(map(summand, self.in_sums(row)))

    def sentence(self, held: Iterable[tuple[str, NDArray[np.intp]]]) -> str:
        """Say of numbers which rotors they would hold."""
        robot, found = self.feasible_set.model.robot, list(held)
        joints = sorted({int(joint) for _, used in found for joint in used})
        shown = ", ".join(f"{robot.joints[robot.driving_joints[joint]].name} ({self.names[joint]})" for joint in joints)
        return (
            f"{listed([name for name, _ in found], MOST_NAMED)} would hold the inertia of a rotor at {shown}, of which "
            'nobody says anything and which no motion tells apart: add [[terms]] with kind = "rotor_inertia", and its '
            "value by [[constraints.linear_bound]], 0 where torques are sensed behind the gear."
        )

    def _places(self, wider: Model) -> list[int]:
        """Return where the parameters of the model stand in the wider one."""
        return [wider.parameter_names.index(str(name)) for name in self.feasible_set.model.parameter_names]


class _RotorsOf(RotorInertia):
    """The inertia of rotors at some joints; those of the others move no torque."""

    kind = "rotors_of"

    def __init__(self, joints: Sequence[int]) -> None:
        self._joints = frozenset(joints)

    def columns(self, k: int, q: Scalars, dq: Scalars, ddq: Scalars, algebra: Any) -> Columns:
        return super().columns(k, q, dq, ddq, algebra) if k in self._joints else ({},)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _RotorsOf) and self._joints == other._joints

    def __hash__(self) -> int:
        return hash(self._joints)
