"""Self-collision: the links of a robot keep clear of each other, and the choice of the pairs that are watched."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot.described_inertia import described_bodies
from steelyard.robot.xml_document import parse_xml

from .configuration_constraint import DistanceConstraint, checked_margin
from .configurations import default_neutral_configuration, place_links, random_configurations
from .distances import PairDistances
from .robot_geometry import RobotGeometry

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["MARGIN", "DisabledPairs", "LeftOut", "SelfCollision", "WatchedPairs", "read_srdf", "watched_pairs"]

Array = NDArray[np.float64]
LinkPair = tuple[str, str]

MARGIN = 0.01
"""Distance between the links of a robot in motions where nobody states one, m. It is several times what a point moves
at 2 m/s between two samples at 1 kHz, and about the tracking error of controllers of arms in fast motions."""
CONFIGURATIONS = 200  # random configurations that are examined; with 200, shares of 95 % are known to about 3 %
# A pair that touches in at least this share of random configurations is not watched: its shapes overlap by
# construction, as those of neighbours in a wrist do. The rest of the configurations would hardly leave room for a
# motion.
ALWAYS = 0.95
SELDOM = 0.5
"""Pairs that touch at zeros, but in a smaller share of random configurations, can be apart and hit each other, as in
the folded rest of an arm. On nine descriptions, pairs that touch at zeros touch in 0 to 8 % of random configurations
(the gripper and the upper arm of a Z1, the hand and the forearm of a Panda, closed fingers), or in 72 to 100 % (shapes
that overlap by construction). On 70, pairs that are nowhere 10 mm apart touch in 0 to 36 % (neighbours in a wrist or a
finger), or in 52 to 83 % (trunk and thighs of a HyQ, shoulder and elbow of a Baxter), which leaves no motion."""
TOUCHING = 1e-6  # m, about the accuracy of the distances


class SelfCollision(DistanceConstraint):
    """The links of a robot keep a margin from each other.

    There is one clearance for each pair of moving links (and the base), ``min(distance, horizon) - margin``, where the
    distance is that of their nearest shapes, and negative where they overlap. Pairs of links of the description are
    left out if they

    - are adjacent: no other link with a shape or a mass lies between them in the tree,
    - touch at 95 % of 200 random configurations within the limits of the joints, or at the neutral configuration: where
      nobody states it, if they also touch at half of the random ones,
    - touch at half of the random configurations, and are at none of them as far apart as the margin,
    - are excluded, or disabled by an SRDF.

    `left_out` lists these pairs with the reasons; check it once for a new robot. A pair that is not as far apart as the
    margin in any of the random configurations (neighbours in a wrist) keeps half of its largest distance instead;
    `margins` has the margin of each clearance.

    Parameters
    ----------
    geometry : RobotGeometry
    margin : float
        Least distance, m. It should cover parts that the shapes do not have (cables), and half of the distance that
        bodies move between two samples.
    horizon : float, optional
        See `DistanceConstraint`, m; 0.1 m more than the margin by default.
    exclude : sequence
        Pairs of links of the description that are not watched, or single links.
    srdf : str or Path, optional
        An SRDF file whose disabled pairs are left out.
    shapeless : sequence of str
        Links of the description that have a body of unknown shape, so that the links on either side are not adjacent.
    neutral_configuration : (N,) array, optional
        A configuration without collisions. By default zeros, with the middle of the limits of joints that exclude 0.

    Raises
    ------
    InputError
        If the robot has no shapes, a name is unknown, or the SRDF is that of another robot.
    MissingExtraError
        If coal is not installed (extra ``collision``).

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
        stated = neutral_configuration is not None
        if neutral_configuration is None:
            neutral_configuration = default_neutral_configuration(geometry.robot)
        neutral = np.asarray(neutral_configuration, dtype=np.float64)
        if neutral.shape != (geometry.robot.dof,) or not np.isfinite(neutral).all():
            raise InputError(
                f"{self.name}: the neutral configuration must be {geometry.robot.dof} finite numbers, got "
                f"{neutral_configuration!r}"
            )
        disabled = DisabledPairs() if srdf is None else read_srdf(srdf)
        watched = watched_pairs(geometry, exclude, disabled, neutral, least, shapeless, 0.0 if stated else SELDOM)
        pairs = PairDistances(geometry.shapes, watched.groups)
        super().__init__(geometry, pairs, watched.labels, np.array(watched.margins), least, horizon)
        self._left_out = watched.left_out
        self._watched = watched.links
        self._asked = least

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on pairs that are left out, and on margins that are smaller than asked for."""
        less = [
            f"{label} keeps {1000.0 * margin:.3g} mm"
            for label, margin in zip(self.labels, self.margins, strict=True)
            if margin < self._asked
        ]
        found = []
        if less:
            found.append(
                f"Not all links can be {1000.0 * self._asked:.3g} mm apart in any configuration, so that these are "
                f"held to half of the widest distance that they reach: {'; '.join(less)}."
            )
        if self._left_out:
            pairs = ", ".join(f"{pair.first} and {pair.second}" for pair in self._left_out)
            found.append(
                "Not watched, because they are neighbours, touch at rest or in most configurations, or were excluded: "
                f"{pairs}."
            )
        return tuple(found)

    @property
    def remedies(self) -> tuple[str, ...]:
        """For each clearance, what to do where no motion keeps it."""
        found = []
        for margin, pairs in zip(self.margins, self._watched, strict=True):
            named = ", ".join(f'["{first}", "{second}"]' for first, second in pairs)
            closer = f"give a margin below {margin:.3g} (m) or" if margin > 0.0 else "give"
            found.append(
                f"in [collision] of the limits file, {closer} exclude = [{named}], which is right where only the "
                "shapes touch and not the links"
            )
        return tuple(found)

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """The pairs of links that are not watched, with the reasons."""
        return self._left_out

    @property
    def watched(self) -> tuple[tuple[tuple[str, str], ...], ...]:
        """For each clearance the pairs of links of the description whose smallest distance it is."""
        return self._watched


@dataclass(frozen=True)
class LeftOut:
    """A pair of links that is not watched.

    Attributes
    ----------
    first, second : str
        Links of the description.
    reason : str
        Why the pair is not watched.
    """

    first: str
    second: str
    reason: str

    def __str__(self) -> str:
        return f"{self.first} and {self.second}: {self.reason}"


@dataclass(frozen=True)
class WatchedPairs:
    """The watched pairs in groups that share a clearance, and the pairs that are left out.

    Attributes
    ----------
    labels : tuple of str
        (m,) names of the groups.
    groups : tuple of tuple of (int, int)
        Pairs of shapes in each group.
    links : tuple of tuple of (str, str)
        Pairs of links of the description in each group.
    margins : tuple of float
        Margin of each group, m.
    """

    labels: tuple[str, ...]
    groups: tuple[tuple[tuple[int, int], ...], ...]
    links: tuple[tuple[LinkPair, ...], ...]
    margins: tuple[float, ...]
    left_out: tuple[LeftOut, ...]


def watched_pairs(
    geometry: RobotGeometry,
    exclude: Iterable[str | Sequence[str]],
    disabled: DisabledPairs,
    configuration: Array,
    margin: float,
    shapeless: Iterable[str] = (),
    seldom: float = 0.0,
) -> WatchedPairs:
    """Choose the pairs of links that can collide; see `SelfCollision`.

    Pairs that touch at the configuration are watched where they touch in less than the share `seldom` of random ones.
    """
    excluded = _excluded(geometry, exclude)
    if disabled.links and disabled.links.isdisjoint(geometry.parents.keys() | set(geometry.parents.values())):
        raise InputError(
            f'the SRDF names no link of the robot "{geometry.robot.name}" (it names '
            f"{', '.join(sorted(disabled.links)[:4])}); give the SRDF of this robot"
        )
    left_out: list[LeftOut] = []
    open_pairs: list[LinkPair] = []
    carrier = {one.link: one.body for one in geometry.shapes}
    solid = {*carrier, *shapeless, *_heavy_links(geometry)}
    for first, second in combinations(geometry.links, 2):
        if carrier[first] == carrier[second]:
            continue  # they do not move relative to each other
        if excluded(first, second):
            left_out.append(LeftOut(first, second, "excluded"))
        elif disabled.disables(first, second):
            left_out.append(LeftOut(first, second, "disabled by the SRDF"))
        elif solid.isdisjoint(geometry.between(first, second)):
            left_out.append(LeftOut(first, second, "adjacent"))
        else:
            open_pairs.append((first, second))
    distances = _distances(geometry, open_pairs, configuration, margin)
    margins, touching = _margins(distances, margin, seldom)
    # Links on the same moving link share a clearance, except those whose margin had to be reduced.
    together: dict[tuple[int, int, LinkPair | None], list[LinkPair]] = {}
    nearest: dict[tuple[int, int, LinkPair | None], Array] = {}
    for (first, second), least in margins.items():
        pair = (first, second) if carrier[first] < carrier[second] else (second, first)
        key = (carrier[pair[0]], carrier[pair[1]], None if least == margin else pair)
        together.setdefault(key, []).append(pair)
        nearest[key] = np.minimum(nearest.get(key, np.inf), distances[first, second])
    for key, found in nearest.items():
        # Of links that can each be apart, all may never be at once: those of a gripper whose linkage is held.
        if _overlap(found, margin):
            touching += [LeftOut(*pair, _always_near(found)) for pair in together.pop(key)]
    order = sorted(together, key=lambda key: (key[:2], key[2] or ("", "")))
    groups = [together[key] for key in order]
    return WatchedPairs(
        tuple(_label(geometry, group) for group in groups),
        tuple(tuple(pair for links in group for pair in _shape_pairs(geometry, links)) for group in groups),
        tuple(tuple(group) for group in groups),
        tuple(_reachable(nearest[key], margin) for key in order),
        (*left_out, *touching),
    )


def _heavy_links(geometry: RobotGeometry) -> list[str]:
    """Return the links of the description whose mass can be believed: bodies, and no mere frames."""
    bodies = [part for parts in described_bodies(geometry.robot) for part in parts]
    return [part.name for part in bodies if part.is_usable and part.inertia is not None and part.inertia.mass > 0.0]


def _label(geometry: RobotGeometry, group: Sequence[LinkPair]) -> str:
    """Return the label of a group: its links, or the moving links that carry them where there are several."""
    carrier = {one.link: one.body for one in geometry.shapes}
    names = []
    for side in (1, 0):
        links = {pair[side] for pair in group}
        names.append(min(links) if len(links) == 1 else geometry.body_name(carrier[group[0][side]]))
    return f"{names[0]} to {names[1]}"


class _Excluded:
    def __init__(self, links: frozenset[str], pairs: frozenset[frozenset[str]]) -> None:
        self.links, self.pairs = links, pairs

    def __call__(self, first: str, second: str) -> bool:
        pair = frozenset((first, second))
        return pair in self.pairs or not pair.isdisjoint(self.links)


def _excluded(geometry: RobotGeometry, exclude: Iterable[str | Sequence[str]]) -> _Excluded:
    links, pairs = set(), set()
    for entry in exclude:
        names = [entry] if isinstance(entry, str) else list(entry)
        if len(names) not in (1, 2) or not all(isinstance(name, str) for name in names):
            raise InputError(f"exclude: an entry is a link or a pair of links, got {entry!r}")
        for name in names:
            geometry.robot.frame(name)
        if len(set(names)) == 1:
            links.add(names[0])
        else:
            pairs.add(frozenset(names))
    return _Excluded(frozenset(links), frozenset(pairs))


def _shape_pairs(geometry: RobotGeometry, links: LinkPair) -> list[tuple[int, int]]:
    first, second = ([i for i, one in enumerate(geometry.shapes) if one.link == link] for link in links)
    return [(i, j) for i in first for j in second]


def _distances(
    geometry: RobotGeometry, pairs: list[LinkPair], configuration: Array, margin: float
) -> dict[LinkPair, Array]:
    """Return the distances of pairs of links, at the configuration and at random ones."""
    if not pairs:
        return {}
    configurations = np.vstack([configuration, random_configurations(geometry.robot, CONFIGURATIONS)])
    measured = PairDistances(geometry.shapes, [_shape_pairs(geometry, pair) for pair in pairs])
    # Distances beyond the margin are not needed.
    distances = measured.distances(place_links(geometry.robot, configurations), margin + TOUCHING)
    return dict(zip(pairs, distances.T, strict=True))


def _margins(
    distances: dict[LinkPair, Array], margin: float, seldom: float
) -> tuple[dict[LinkPair, float], list[LeftOut]]:
    """Return the margins of the watched pairs, and the pairs that are left out because they touch."""
    margins: dict[LinkPair, float] = {}
    left_out: list[LeftOut] = []
    for pair, found in distances.items():
        share = _touching(found)
        if share >= ALWAYS:
            left_out.append(LeftOut(*pair, f"touch in {share:.0%} of random configurations"))
        elif found[0] <= TOUCHING / 2 and share >= seldom:
            left_out.append(LeftOut(*pair, f"touch in the neutral configuration, and in {share:.0%} of random ones"))
        elif _overlap(found, margin):
            left_out.append(LeftOut(*pair, _always_near(found)))
        else:
            margins[pair] = _reachable(found, margin)
    return margins, left_out


def _touching(distances: Array) -> float:
    """Return the share of random configurations in which links touch."""
    return float((distances[1:] <= TOUCHING / 2).mean())


def _overlap(distances: Array, margin: float) -> bool:
    """Whether shapes are nowhere as far apart as the margin, and touch in most configurations: links would not turn."""
    return bool(distances.max() < margin and _touching(distances) >= SELDOM)


def _always_near(distances: Array) -> str:
    return (
        f"nowhere farther apart than {1000.0 * max(distances.max(), 0.0):.2g} mm, and touch in "
        f"{_touching(distances):.0%} of random configurations"
    )


def _reachable(distances: Array, margin: float) -> float:
    """Return the margin, or half of the largest distance where that is less."""
    widest = float(distances.max())
    return margin if widest >= margin else widest / 2


@dataclass(frozen=True)
class DisabledPairs:
    """The pairs of links whose collisions an SRDF disables.

    Attributes
    ----------
    disabled : frozenset
        Pairs of ``<disable_collisions>``.
    silent : frozenset
        Links of ``<disable_default_collisions>``: their pairs are disabled unless they are enabled explicitly.
    enabled : frozenset
        Pairs of ``<enable_collisions>``.

    Examples
    --------
    >>> pairs = DisabledPairs(frozenset({frozenset({"hand", "arm"})}))
    >>> "hand" in pairs.links, pairs.disables("arm", "hand"), pairs.disables("arm", "foot")
    (True, True, False)
    """

    disabled: frozenset[frozenset[str]] = frozenset()
    silent: frozenset[str] = frozenset()
    enabled: frozenset[frozenset[str]] = frozenset()

    @property
    def links(self) -> frozenset[str]:
        """All links that the SRDF names."""
        return self.silent.union(*self.disabled, *self.enabled)

    def disables(self, first: str, second: str) -> bool:
        """Return whether a pair of links is disabled."""
        pair = frozenset((first, second))
        return pair in self.disabled or (pair not in self.enabled and not pair.isdisjoint(self.silent))


def read_srdf(path: str | Path) -> DisabledPairs:
    """Read which pairs of links an SRDF disables.

    Raises
    ------
    InputError
        If the file is not an SRDF, or an element does not name its links.
    """
    path = Path(path)
    try:
        root = parse_xml(path)
    except InputError as error:
        raise InputError(str(error).replace("a URDF", "an SRDF").replace("not URDF", "not SRDF")) from None
    if root.tag != "robot":
        raise InputError(f"{path}: an SRDF begins with <robot>, found <{root.tag}>; give an SRDF file")

    def text(element: etree._Element, key: str) -> str:
        value = element.get(key)
        if not value:
            raise InputError(f"{path}, line {element.sourceline}: <{element.tag}> has no {key}; add the name of a link")
        return value

    def pairs(tag: str) -> frozenset[frozenset[str]]:
        found = root.findall(tag)
        return frozenset(frozenset((text(one, "link1"), text(one, "link2"))) for one in found)

    silent = frozenset(text(one, "link") for one in root.findall("disable_default_collisions"))
    return DisabledPairs(pairs("disable_collisions"), silent, pairs("enable_collisions"))
