"""Checks of a motion against collisions that apply by default, and remarks on what was not checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, MissingExtraError, install_command
from steelyard.robot import Robot

from .configuration_constraint import SAMPLES_AT_ONCE
from .configurations import place_links, upward
from .robot_geometry import RobotGeometry, described_shapes
from .self_collision import MARGIN, SelfCollision
from .shapes import coal_or_none
from .workspace import TablePlane

__all__ = ["MARGIN", "Surroundings"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The collision checks of a design that apply by default; made by `Surroundings.of`.

    Attributes
    ----------
    own : SelfCollision or None
        The constraint that is added by default; None where self-collision was specified, or cannot be checked.
    geometry : RobotGeometry or None
        The collision shapes of the robot, where they are known.
    unchecked : tuple of str
        Sentences on self-collisions that are not checked, with the reason and the remedy.
    remarks : tuple of str
        Further remarks, in sentences.
    has_table : bool
        Whether a plane is given above which the links stay.
    shapeless : tuple of str
        Links whose shapes cannot be read.
    """

    robot: Robot
    own: SelfCollision | None
    geometry: RobotGeometry | None
    unchecked: tuple[str, ...]
    remarks: tuple[str, ...]
    has_table: bool
    shapeless: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, robot: Robot, constraints: Sequence[object], sections: Mapping[str, Any], self_collision: bool
    ) -> Surroundings:
        """Add self-collision where the description has collision geometry and nothing was specified.

        Parameters
        ----------
        constraints : sequence
            The constraints that the user gave.
        sections : mapping
            The tables of the limits file.
        self_collision : bool
            Whether self-collision is to be checked by default.
        """
        has_table = any(isinstance(one, TablePlane) for one in constraints)
        given = next((one.geometry for one in constraints if isinstance(one, SelfCollision | TablePlane)), None)
        asked = "collision" in sections and sections["collision"].get("self", True)
        if asked or any(isinstance(one, SelfCollision) for one in constraints):
            return cls(robot, None, given, (), (), has_table)
        problems: list[str] = []
        skipped: list[tuple[str, str]] = []
        geometry = _geometry(robot, problems, skipped) if given is None else given
        own = None
        remarks: tuple[str, ...] = ()
        if not self_collision or "collision" in sections:
            problems = [_unchecked("it is turned off")]
        elif geometry is not None and coal_or_none() is None:
            problems = [_unchecked(f"the package coal is not installed; {install_command('collision')}")]
        elif geometry is not None:
            try:
                own = SelfCollision(geometry, MARGIN, shapeless=[link for link, _ in skipped])
            except InputError as error:
                problems = [_unchecked(str(error))]
        if own is not None and not own.labels:
            remarks = own.remarks if problems else (*own.remarks, "No two links are left that could hit each other.")
            own = None
        shapeless = tuple(dict.fromkeys(link for link, _ in skipped))
        return cls(robot, own, geometry, tuple(problems), remarks, has_table, shapeless)

    def missing(self, q: Array) -> tuple[str, ...]:
        """Return sentences on what was not checked of a motion (S, N); without a table they say how low it reaches."""
        if self.has_table:
            return self.unchecked
        up = np.round(upward(self.robot), 12) + 0.0
        what, height = self._lowest(q, up)
        normal = "" if up.tolist() == [0.0, 0.0, 1.0] else f" and normal = {[round(x, 6) for x in up.tolist()]}"
        side = "below" if height < 0.0 else "above"
        shaped = "" if self.geometry is not None else "once links have shapes, "
        return (
            *self.unchecked,
            f"Floor and table were NOT checked: {what} comes down to {abs(height):.3f} m {side} the origin of the "
            f"base; {shaped}the lines [table] and offset = HEIGHT (in m){normal} in the limits file keep all links "
            "above it.",
        )

    def _lowest(self, q: Array, up: Array) -> tuple[str, float]:
        """Return the lowest link, and its height above the origin of the base, m."""
        shapes = [] if self.geometry is None else [one for one in self.geometry.shapes if one.body >= 0]
        # Of links without shapes only the positions of their frames are known.
        frames = self.shapeless
        if not shapes:
            frames = tuple(
                name for link in self.robot.links for name in (link.name, *(part.name for part in link.attachments))
            )
        best = ("", np.inf)
        for start in range(0, len(q), SAMPLES_AT_ONCE):
            places = place_links(self.robot, q[start : start + SAMPLES_AT_ONCE])
            for one in shapes:
                rotation, position = places.of(one.body, one.placement)
                inside = one.shape.lowest(up @ rotation)
                height = float(((position + np.einsum("sij,sj->si", rotation, inside)) @ up).min())
                best = min(best, (one.link, height), key=lambda found: found[1])
            for name in frames:
                body, placement = self.robot.frame(name)
                if body >= 0:
                    height = float((places.of(body, placement)[1] @ up).min())
                    best = min(best, (f"the origin of {name}", height), key=lambda found: found[1])
        return best


def _geometry(robot: Robot, problems: list[str], skipped: list[tuple[str, str]]) -> RobotGeometry | None:
    """Return the shapes of the description that can be read, or None where there are none.

    Sentences on shapes that cannot be read are appended to `problems`, and their links, with the reason, to `skipped`.
    """
    if robot.source is None:
        problems.append(
            _unchecked("the robot comes without collision geometry; add [[collision.shapes]] to the limits file")
        )
        return None
    try:
        shapes, parents = described_shapes(robot, robot.source, "hull", (), skipped)
    except (InputError, MissingExtraError) as error:
        problems.append(_unchecked(str(error)))
        return None
    if skipped:
        links = ", ".join(dict.fromkeys(link for link, _ in skipped))
        problems.append(_unchecked(skipped[0][1], f" of {links}"))
    if not shapes:
        if not skipped:
            problems.append(
                _unchecked(
                    "the description has no collision geometry; add <collision> elements or geoms to it, or "
                    "[[collision.shapes]] to the limits file"
                )
            )
        return None
    return RobotGeometry(robot, shapes, parents)


def _unchecked(reason: str, of: str = "") -> str:
    return f"Self-collision{of} was NOT checked: {reason.rstrip('.')}."
