"""The order of the parameters of links and terms, and their regressor over generic scalars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.graph.expression import is_zero
from steelyard.once import cached_property
from steelyard.robot import INERTIA_SYMBOLS, Robot, Term
from steelyard.robot.robot import Channels, Columns, Scalars

__all__ = ["ParameterLayout", "columns_of"]


def columns_of(
    term: Term,
    k: int,
    motion: tuple[Scalars, Scalars, Scalars],
    algebra: Any,
    channels: Channels | None,
) -> Columns:
    """Return the columns of a term, which is given the channels that it names."""
    if not term.channels:
        return term.columns(k, *motion, algebra)
    given = {name: values for name, values in (channels or {}).items() if name in term.channels}
    return term.columns(k, *motion, algebra, given)  # type: ignore[call-arg]


Entries = dict[tuple[int, int], Any]
_INERTIAL = {
    "L": ("element {} of the inertia about the origin of the frame (as i{} in URDF)", "kg·m²"),
    "l": ("mass times {} of the centre of mass in the frame", "kg·m"),
    "m": ("mass", "kg"),
}


class ParameterLayout:
    """The order of a robot's parameters: for each link ten, then those of the terms at its joint (thesis eq. 4.13)."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.names = tuple(robot.parameter_names)

    @cached_property
    def _columns(self) -> tuple[tuple[NDArray[np.intp], ...], tuple[int, ...]]:
        robot = self.robot
        links: list[NDArray[np.intp]] = []
        firsts = [0] * robot.dof
        driving = {joint: k for k, joint in enumerate(robot.driving_joints)}
        width = sum(len(term.parameters) for term in robot.terms)
        column = 0
        for index in range(len(robot.links)):
            links.append(np.arange(column, column + 10))
            column += 10
            if index in driving:
                firsts[driving[index]] = column
                column += width
        return tuple(links), tuple(firsts)

    @property
    def links(self) -> tuple[NDArray[np.intp], ...]:
        """For each link the indices of its ten parameters."""
        return self._columns[0]

    def link_parameters(self, parameters: Sequence[Any]) -> list[list[Any]]:
        """Pick the ten parameters of each link."""
        return [[parameters[c] for c in columns] for columns in self.links]

    def with_links(self, entries: Entries) -> Entries:
        """Renumber a regressor of the links from (row, 10 * link + parameter) to (row, column of all parameters)."""
        return {(row, int(self.links[k // 10][k % 10])): value for (row, k), value in entries.items()}

    def terms(
        self,
        q: Scalars,
        dq: Scalars,
        ddq: Scalars,
        algebra: Any,
        kind: str | None = None,
        channels: Sequence[Any] | None = None,
    ) -> list[tuple[int, int, Any]]:
        """Return the regressor of the terms alone, or of those of one kind, as (row, column, scalar).

        `channels` are N scalars for each channel of the robot, one channel after the other; zeros without them.
        """
        entries: list[tuple[int, int, Any]] = []
        logged = self._by_name(q, channels)
        for k, first in enumerate(self._columns[1]):
            column = first
            for term in self.robot.terms:
                for values in columns_of(term, k, (q, dq, ddq), algebra, logged):
                    if kind is None or term.kind == kind:
                        entries.extend((row, column, value) for row, value in values.items())
                    column += 1
        return entries

    def _by_name(self, q: Scalars, channels: Sequence[Any] | None) -> Channels:
        if not self.robot.channels:
            return {}
        given = [0.0 * x for _ in self.robot.channels for x in q] if channels is None else channels
        return {name: given[k * len(q) : (k + 1) * len(q)] for k, name in enumerate(self.robot.channels)}

    def random_channels(self, random: np.random.Generator, rows: int) -> list[NDArray[np.float64]]:
        """Return random values of the channels, in the order of `terms`."""
        return list(random.uniform(0.0, 100.0, (len(self.robot.channels) * self.robot.dof, rows)))

    def random_speeds(self, random: np.random.Generator, rows: int) -> NDArray[np.float64]:
        """Return random speeds (rows, N) to 3 rad/s or m/s, some of them about the speeds that its terms name."""
        scales = np.resize(self.speeds_of_terms, rows) / self.speeds_of_terms[0]
        return random.uniform(-3.0, 3.0, (rows, self.robot.dof)) * scales[:, None]

    @cached_property
    def speeds_of_terms(self) -> tuple[float, ...]:
        """Typical speeds of random motions, and those at which the columns of terms change."""
        own = {speed for term in self.robot.terms for speed in term.speeds if speed > 0.0}
        return (1.5, *sorted(own))

    def term_momenta(self, q: Scalars, dq: Scalars, algebra: Any) -> Entries:
        """Return what the terms add to the momentum regressor: their torques, linear in ddq, with dq in its place."""
        still = [0.0 * x for x in q]
        at_rest = {(row, column): value for row, column, value in self.terms(q, still, still, algebra)}
        moving = {(row, column): value for row, column, value in self.terms(q, still, dq, algebra)}
        return {key: value - at_rest[key] if key in at_rest else value for key, value in moving.items()}

    def term_inertias(self, q: Scalars, k: int, algebra: Any) -> list[tuple[int, int, Any]]:
        """Return what the terms add to column k of the inertia matrix, as (row, column of the parameter, scalar)."""
        unit = [0.0 * x + (1.0 if i == k else 0.0) for i, x in enumerate(q)]
        momenta = self.term_momenta(q, unit, algebra)
        return [(row, column, value) for (row, column), value in momenta.items() if not is_zero(value)]

    def term_potentials(self, q: Scalars, algebra: Any) -> list[tuple[int, Any]]:
        """Return the potential energy of the terms by their parameters, as (column, scalar)."""
        entries: list[tuple[int, Any]] = []
        for k, first in enumerate(self._columns[1]):
            column = first
            for term in self.robot.terms:
                entries.extend((column + i, value) for i, value in enumerate(term.potential(k, q, algebra)))
                column += len(term.parameters)
        return entries

    @cached_property
    def described_as(self) -> tuple[str, ...]:
        """As what a robot description holds each parameter, see `TermParameter`; empty where it has no place for it."""
        kinds = [parameter.described_as or "" for term in self.robot.terms for parameter in term.parameters]
        result = [""] * len(self.names)
        for first in self._columns[1]:
            result[first : first + len(kinds)] = kinds
        return tuple(result)

    @cached_property
    def descriptions(self) -> tuple[str, ...]:
        """What each parameter is, with its unit."""
        robot = self.robot
        driving = {joint: k for k, joint in enumerate(robot.driving_joints)}
        texts: list[str] = []
        for index, link in enumerate(robot.links):
            carried = f" with {', '.join(map(repr, link.absorbed))} fixed to it" if link.absorbed else ""
            for symbol in INERTIA_SYMBOLS:
                what, unit = _INERTIAL[symbol[0]]
                axes = symbol[1:]
                texts.append(f"{what.format(axes, axes)} of link {link.name!r}{carried}, {unit}")
            if index in driving:
                joint = robot.joints[index]
                for term in robot.terms:
                    for p in term.parameters:
                        unit = p.unit_prismatic if joint.kind == "prismatic" else p.unit
                        texts.append(f"{p.description} at joint {joint.name!r}, {unit}")
        return tuple(f"{name}: {text}" for name, text in zip(self.names, texts, strict=True))
