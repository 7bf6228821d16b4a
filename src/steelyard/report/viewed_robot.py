"""The robot that the 3D view shows: its links, their shapes and their inertia, and what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.collision.configurations import default_neutral_configuration, place_links
from steelyard.collision.robot_geometry import visual_shapes
from steelyard.collision.shapes import PlacedShape
from steelyard.dynamics import Model
from steelyard.errors import InputError, MissingExtraError
from steelyard.files import listed
from steelyard.identification.default_terms import model_of_estimate
from steelyard.identification.parameter_table import Basis, LinkRows, ParameterTable, weakest
from steelyard.identification.saved import matching_estimate
from steelyard.identification.saved_result import SavedResult
from steelyard.once import cached_property
from steelyard.robot import RobotFile

from .link_bodies import LinkBody, link_body

__all__ = ["KNOWN_OF", "TOO_LARGE", "KnownOf", "ViewedRobot", "basis_of", "load_viewed_robot"]

Array = NDArray[np.float64]
KnownOf = Literal["mass", "centre of mass", "inertia", "all of these"]
KNOWN_OF: tuple[KnownOf, ...] = ("mass", "centre of mass", "inertia", "all of these")

# Bytes of a mesh above which it is left out: a browser gets all of them.
LARGEST_MESH = 60_000_000
TOO_LARGE = "ellipsoids larger than the robot"


def basis_of(link: LinkRows, of: KnownOf) -> Basis:
    """On what the least known of these numbers of a link rests: data, physics or the prior."""
    groups = {"mass": (link.mass,), "centre of mass": link.center, "inertia": link.moments}
    return weakest([row for key, group in groups.items() if of in (key, "all of these") for row in group])


@dataclass(frozen=True, eq=False)
class ViewedRobot:
    """A robot as it is drawn.

    Attributes
    ----------
    result : SavedResult or None
        What was identified, where that is shown.
    identified, described : ndarray or None
        (n,) standard parameters, as identified and of the description, with NaN where it says nothing; None where there
        are none.
    shapes : tuple of PlacedShape
        What the description shows, on moving links and on the base.
    known : tuple of LinkRows
        What the numbers of each link rest on; empty where there is no table of parameters.
    remarks : tuple of str
        What cannot be shown, and why, in sentences.
    """

    file: RobotFile
    model: Model
    result: SavedResult | None
    identified: Array | None
    described: Array
    shapes: tuple[PlacedShape, ...] = ()
    known: tuple[LinkRows, ...] = ()
    remarks: tuple[str, ...] = field(default=(), repr=False)

    def bodies(self, parameters: Array | None) -> tuple[LinkBody | None, ...]:
        """Return for each link the body that its ten parameters make; None where they make none."""
        if parameters is None:
            return (None,) * len(self.model.robot.links)
        return tuple(link_body(parameters[start : start + 10]) for start in self.model.robot.link_starts)

    @cached_property
    def neutral(self) -> Array:
        """Configuration (N,) in which the robot is first drawn: zeros, where the limits do not exclude them."""
        return default_neutral_configuration(self.model.robot)

    @cached_property
    def extent(self) -> tuple[Array, float]:
        """The middle (3,) of what is drawn in the neutral configuration, and half of its diagonal, m."""
        places = place_links(self.model.robot, self.neutral[None])
        points = [np.zeros(3), *places.positions[:, 0]]
        for one in self.shapes:
            rotation, position = (part[0] for part in places.of(one.body, one.placement))
            for sign in (1.0, -1.0):
                points.extend(position + one.shape.lowest(sign * rotation) @ rotation.T)
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        farthest = 2.0 * max(float(np.linalg.norm(high - low)), 0.05)  # a centre of mass may lie anywhere
        for parameters in (self.identified, self.described):
            for index, body in enumerate(self.bodies(parameters)):
                if body is not None and np.linalg.norm(body.center) < farthest:
                    points.append(places.positions[index, 0] + places.rotations[index, 0] @ body.center)
        low, high = np.min(points, axis=0), np.max(points, axis=0)
        return (low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, 1e-3)

    def is_too_large(self, body: LinkBody) -> bool:
        """Whether the ellipsoid of a link is larger than the robot, as placeholders for an unknown inertia make it."""
        return bool(body.possible and body.semi_axes.max() > self.extent[1])

    @cached_property
    def rods(self) -> tuple[tuple[int, Array, Array], ...]:
        """The robot without its shapes: rods as the index of a link, and two ends (3,) in its frame, m.

        Each goes from the joint of a link to a joint that stands on it; that of a last link to its own frame, or to its
        centre of mass where that is the same place. The base has the index -1.
        """
        robot = self.model.robot
        places = place_links(robot, np.zeros((1, robot.dof)))
        rotations, positions = places.rotations[:, 0], places.positions[:, 0]
        centers = [body.center if body is not None else None for body in self.bodies(self.identified)]
        described = [body.center if body is not None else None for body in self.bodies(self.described)]
        stands = [np.asarray(frame.base_point, dtype=np.float64) for frame in places.frames]  # on the link before
        found, carried = [], set()
        starts = []
        for index, joint in enumerate(robot.joints):
            parent = joint.parent
            place = positions[parent] + rotations[parent] @ stands[index]
            starts.append(rotations[index].T @ (place - positions[index]))
            found.append((parent, starts[parent] if parent >= 0 else np.zeros(3), stands[index]))
            carried.add(parent)
        for index in set(range(len(robot.links))) - carried:
            ends = [np.zeros(3), centers[index], described[index]]
            apart = [end for end in ends if end is not None and np.linalg.norm(end - starts[index]) > 1e-6]
            found.append((index, starts[index], apart[0] if apart else starts[index]))
        return tuple(found)


def load_viewed_robot(
    given: str | Path, robot: str | Path | None = None, *, allow_extensions: bool = False
) -> ViewedRobot:
    """Read what is to be looked at: a robot, or what was identified of one.

    Parameters
    ----------
    given : str or Path
        A URDF or robot.toml; or a folder that ``steelyard identify`` wrote, or an ``estimate.json``.
    robot : str or Path, optional
        The robot file of results; by default the one that their record names.
    allow_extensions : bool
        See :meth:`steelyard.RobotFile.load`.

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate is of another robot.
    """
    path = Path(given)
    result = SavedResult.load(path) if path.is_dir() or path.suffix.lower() == ".json" else None
    source: str | Path | None = given if robot is None else robot
    if result is None and robot is not None:
        raise InputError(f"{given} is a robot itself; give --robot beside a folder of results alone.")
    if result is not None and robot is None:
        source = result.robot_file
        if source is None:
            raise InputError(
                f"{given}: the robot that it was identified with is not where its record says, or has changed since; "
                "give the robot file with --robot."
            )
    assert source is not None
    file = RobotFile.load(source, allow_extensions=allow_extensions)
    model = model_of_estimate(None if result is None else result.estimate, file)
    remarks: list[str] = []
    identified: Array | None = None
    known: tuple[LinkRows, ...] = ()
    if result is not None:
        identified = matching_estimate(model, result.path).parameters
        if identified is None:
            remarks.append(f"{result.path} holds base parameters alone, which are no bodies that could be shown.")
        else:
            known = _knowledge(result, model, identified, remarks)
    described = np.asarray(model.robot.parameters)
    shapes = _shapes(model, remarks)
    viewed = ViewedRobot(file, model, result, identified, described, shapes, known)
    return replace(viewed, remarks=(*remarks, *_odd(viewed)))


def _knowledge(result: SavedResult, model: Model, identified: Array, remarks: list[str]) -> tuple[LinkRows, ...]:
    """Return what the numbers of each link rest on, as the estimate tells it."""
    told = result.estimate.parameter_table
    if not told:
        remarks.append(f"{result.path} does not tell what its numbers rest on; identify anew for the colours.")
        return ()
    table = ParameterTable.from_list(told, f"{result.path}, parameter_table")
    links = table.links
    masses = identified[[start + 9 for start in model.robot.link_starts]]
    same = len(links) == len(masses) and np.array_equal([link.mass.value for link in links], masses)
    if not same:
        remarks.append(f"{result.path}: its table has other masses than its parameters; identify anew.")
        return ()
    if table.confidence is None:
        remarks.append(table.counts)
    return links


def _shapes(model: Model, remarks: list[str]) -> tuple[PlacedShape, ...]:
    """Return what the description shows; what cannot be read is told in the remarks."""
    robot = model.robot
    if robot.source is None:
        remarks.append(f"{robot.name} was not read from a description with shapes; links are drawn as rods.")
        return ()
    skipped: list[tuple[str, str]] = []
    try:
        found = tuple(visual_shapes(robot, robot.source, skipped, LARGEST_MESH))
    except (InputError, MissingExtraError) as error:
        remarks.append(f"No shapes are drawn: {error}")
        return ()
    if skipped:
        links = list(dict.fromkeys(link for link, _ in skipped))
        remarks.append(f"Shapes of {listed(links, 3)} are left out: {skipped[0][1].rstrip('.')}.")
    elif not found:
        remarks.append(f"{robot.source.name} has neither visual nor collision shapes; links are drawn as rods.")
    return found


def _odd(viewed: ViewedRobot) -> Sequence[str]:
    """Sentences on links whose inertia no ellipsoid can show."""
    names = viewed.model.robot.link_names
    found = []
    for words, parameters in (("CAD", viewed.described), ("the estimate", viewed.identified)):
        bodies = [(name, body) for name, body in zip(names, viewed.bodies(parameters), strict=True) if body is not None]
        odd = [name for name, body in bodies if not body.possible]
        if odd:
            found.append(
                f"No body of positive density has the inertia that {words} gives {listed(odd, 3)}, so that only the "
                "centre of mass is drawn."
            )
        large = [name for name, body in bodies if viewed.is_too_large(body)]
        if large:
            found.append(
                f"The inertia that {words} gives {listed(large, 3)} belongs to a body larger than the robot; its "
                f"ellipsoid is hidden at first (layer: {TOO_LARGE})."
            )
    return found
