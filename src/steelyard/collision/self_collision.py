"""Links of a robot that must keep clear of each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .configuration_constraint import DistanceConstraint, checked_margin
from .configurations import default_neutral_configuration
from .distances import PairDistances
from .pairs import DisabledPairs, LeftOut, read_srdf, watched_pairs
from .robot_geometry import RobotGeometry

__all__ = ["SelfCollision"]

Array = NDArray[np.float64]


class SelfCollision(DistanceConstraint):
    """The links of a robot keep a margin from each other.

    One clearance for each pair of moving links (and base), ``min(distance, horizon) - margin``, where the distance is
    that of their nearest shapes, negative where they overlap. Pairs of links of the source are left out that

    - are adjacent: no other link with a shape lies between them in the tree,
    - touch at the neutral configuration, or at 95% of 200 random configurations within the limits of the joints,
    - are excluded, or disabled by an SRDF.

    `left_out` names them with the reason; look at it once for a new robot. A pair that in none of the random
    configurations is as far apart as the margin (neighbours in a wrist) keeps half of its largest distance instead;
    `margins` has the margin of each clearance.

    Parameters
    ----------
    geometry : RobotGeometry
    margin : float
        Least distance, m. It should cover what hulls and meshes do not know (cables), and half of what bodies move
        between two samples.
    horizon : float, optional
        m, see `DistanceConstraint`; 0.1 m more than the margin by default.
    exclude : sequence
        Pairs of links of the source, or single links.
    srdf : str or Path, optional
        An SRDF file whose disabled pairs are left out.
    shapeless : sequence of str
        Links of the source that are solid although nothing is known of their shape: what lies on either side of one
        is not adjacent.
    neutral_configuration : (N,) array, optional
        By default zeros, or the middle of the limits of joints that exclude 0.

    Raises
    ------
    InputError
        When the robot has no shapes, a name is unknown, or the SRDF is that of another robot.
    MissingExtraError
        When coal is not installed (extra ``collision``).

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.collision import Capsule, PlacedShape, RobotGeometry
    >>> from steelyard.robot.placement import rotation_y
    >>> arm = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.5, 0, "q"), (0, 0.5, 0, "q")])
    >>> rod = rotation_y(np.pi / 2)
    >>> rod[0, 3] = -0.25  # from the origin of a link back to its joint
    >>> rods = [PlacedShape.on(arm, name, Capsule(radius=0.05, length=0.5), rod) for name in arm.link_names]
    >>> limit = SelfCollision(RobotGeometry(arm, rods), margin=0.02)
    >>> limit.labels
    ('link3 to link1',)
    >>> limit.distances([[0.0, np.pi / 2, np.pi / 2]]).round(3).tolist()  # the third rod lies beside the first
    [[0.4]]
    """

    name = "self-collision"

    def __init__(
        self,
        geometry: RobotGeometry,
        margin: float = 0.0,
        *,
        horizon: float | None = None,
        exclude: Iterable[str | Sequence[str]] = (),
        srdf: str | Path | None = None,
        neutral_configuration: ArrayLike | None = None,
        shapeless: Iterable[str] = (),
    ) -> None:
        if not geometry.shapes:
            raise InputError(
                f'robot "{geometry.robot.name}" has no collision geometry to watch; add <collision> elements to its '
                "URDF, or shapes"
            )
        least = checked_margin(margin, self.name)
        if neutral_configuration is None:
            neutral_configuration = default_neutral_configuration(geometry.robot)
        neutral = np.asarray(neutral_configuration, dtype=np.float64)
        if neutral.shape != (geometry.robot.dof,) or not np.isfinite(neutral).all():
            raise InputError(
                f"{self.name}: the neutral configuration must be {geometry.robot.dof} finite numbers, got "
                f"{neutral_configuration!r}"
            )
        disabled = DisabledPairs() if srdf is None else read_srdf(srdf)
        watched = watched_pairs(geometry, exclude, disabled, neutral, least, shapeless)
        pairs = PairDistances(geometry.shapes, watched.groups)
        super().__init__(geometry, pairs, watched.labels, np.array(watched.margins), least, horizon)
        self._left_out = watched.left_out
        self._watched = watched.links
        self._asked = least

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is not watched, or not as it was asked for: pairs that are left out, and margins that had to be less."""
        less = [
            f"{label} keeps {1000.0 * margin:.3g} mm"
            for label, margin in zip(self.labels, self.margins, strict=True)
            if margin < self._asked
        ]
        found = []
        if less:
            found.append(
                f"Not all links can be {1000.0 * self._asked:.3g} mm apart in any configuration, so that these are "
                "held to "
                f"half of the widest distance that they reach: {'; '.join(less)}."
            )
        if self._left_out:
            pairs = ", ".join(f"{pair.first} and {pair.second}" for pair in self._left_out)
            found.append(f"Not watched, because they are neighbours, touch at rest or were excluded: {pairs}.")
        return tuple(found)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """The pairs of links that are not watched, with the reasons."""
        return self._left_out

    @property
    def watched(self) -> tuple[tuple[tuple[str, str], ...], ...]:
        """For each clearance the pairs of links of the source that it is the least distance of."""
        return self._watched
