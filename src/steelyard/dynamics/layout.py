"""Where the parameters of links and terms stand, and their regressor over generic scalars."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.robot import Robot

from . import newton_euler

__all__ = ["ParameterLayout"]

Entries = dict[tuple[int, int], Any]


class ParameterLayout:
    """The order of a robot's parameters: for each link ten, then those of the terms at its joint (thesis eq. 4.13).

    Parameters
    ----------
    robot : Robot
    """

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

    def regressor(self, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any) -> Entries:
        """Return the regressor of links and terms as scalars by (row, column); what is missing is 0."""
        entries: Entries = {
            (row, int(self.links[column // 10][column % 10])): value
            for (row, column), value in newton_euler.regressor(self.robot, q, dq, ddq, algebra).items()
        }
        for row, column, value in self.terms(q, dq, ddq, algebra):
            entries[row, column] = value
        return entries

    def terms(
        self, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> list[tuple[int, int, Any]]:
        """Return the regressor of the terms alone, as (row, column, scalar)."""
        entries: list[tuple[int, int, Any]] = []
        for k, first in enumerate(self._columns[1]):
            column = first
            for term in self.robot.terms:
                for values in term.columns(k, q, dq, ddq, algebra):
                    entries.extend((row, column, value) for row, value in values.items())
                    column += 1
        return entries
