"""A robot with scalars in the place of its motion and parameters: what the functions of a model are built from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from steelyard.robot import Robot

from .algorithms.kinematics import JointFrame, Vector3, joint_frames
from .algorithms.regrouping import regrouped
from .layout import ParameterLayout

__all__ = ["Scene", "Value"]


@dataclass(frozen=True)
class Value:
    """One array that a function computes: elements in row-major order."""

    name: str
    shape: tuple[int, ...]
    elements: list[Any]
    description: str


@dataclass(frozen=True)
class Scene:
    """A robot with scalars in the place of its motion and parameters.

    Attributes
    ----------
    layout : ParameterLayout
    algebra : module
        Brings ``sin``, ``cos`` and ``sign`` for the scalars.
    scalars : mapping
        For the names of arguments (``"q"``, ``"parameters"``, …) their scalars.
    regroups : bool
        Whether mass may move along joint axes from link to link, see :mod:`.regrouping`.
    link : int or None
        The moving link that a function is about.
    placement : sequence of sequence of float or None
        (4, 4) the frame that it is about in the frame of that link; None for the link's own.
    term : str or None
        The kind of the terms that a function is about; None for all.
    """

    layout: ParameterLayout
    algebra: Any
    scalars: Mapping[str, Sequence[Any]]
    regroups: bool = True
    link: int | None = None
    placement: Sequence[Sequence[float]] | None = None
    term: str | None = None

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.layout.robot

    @property
    def gravity(self) -> Vector3:
        """Acceleration of gravity in the base frame."""
        x, y, z = self.scalars.get("gravity") or [float(g) for g in self.robot.gravity]
        return (x, y, z)

    @cached_property
    def frames(self) -> list[JointFrame]:
        """The joints at their positions."""
        lengths = dict(zip(self.robot.lengths, self.scalars.get("lengths", ()), strict=False))
        return joint_frames(self.robot, self.scalars["q"], self.algebra, lengths)

    @cached_property
    def bodies(self) -> tuple[list[JointFrame], list[list[Any]]]:
        """Frames and the parameters of the links, mass moved where that is allowed."""
        links = self.layout.link_parameters(self.scalars["parameters"])
        return regrouped(self.frames, links) if self.regroups else (self.frames, links)

    @cached_property
    def still(self) -> list[Any]:
        """Zeros for the coordinates."""
        return [0.0 * x for x in self.scalars["q"]]

    @property
    def count(self) -> int:
        """Number N of coordinates."""
        return self.robot.dof

    def term_torques(self, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any]) -> list[Any]:
        """Return the N torques of the terms."""
        torques: list[Any] = [0.0] * self.count
        for row, column, value in self.layout.terms(q, dq, ddq, self.algebra, self.term):
            torques[row] = torques[row] + self.scalars["parameters"][column] * value
        return torques

    def term_inertias(self) -> list[list[Any]]:
        """Return what the terms add to the inertia matrix: rotors, coupled or not, (N, N)."""
        inertias: list[list[Any]] = [[0.0] * self.count for _ in range(self.count)]
        for k in range(self.count):
            for row, column, value in self.layout.term_inertias(self.scalars["q"], k, self.algebra):
                inertias[row][k] = inertias[row][k] + self.scalars["parameters"][column] * value
        return inertias
