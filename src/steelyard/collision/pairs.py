"""Which pairs of links of a robot are watched for collisions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.robot.urdf_document import parse_urdf as parse_xml

from .configurations import place_links, random_configurations
from .distances import PairDistances
from .robot_geometry import RobotGeometry

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["DisabledPairs", "LeftOut", "WatchedPairs", "read_srdf", "watched_pairs"]


@dataclass(frozen=True)
class DisabledPairs:
    """What an SRDF says about collisions.

    Attributes
    ----------
    disabled : frozenset
        Pairs of ``<disable_collisions>``.
    silent : frozenset
        Links of ``<disable_default_collisions>``: disabled with every link that is not enabled explicitly.
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
        """All the links that are named."""
        return self.silent.union(*self.disabled, *self.enabled)

    def disables(self, first: str, second: str) -> bool:
        """Tell whether a pair of links is disabled."""
        pair = frozenset((first, second))
        return pair in self.disabled or (pair not in self.enabled and not pair.isdisjoint(self.silent))


def read_srdf(path: str | Path) -> DisabledPairs:
    """Read which pairs of links an SRDF disables.

    Raises
    ------
    InputError
        When the file is no SRDF, or an element names no links.
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


# Which pairs of links of a robot are watched for collisions.

Array = NDArray[np.float64]
LinkPair = tuple[str, str]

CONFIGURATIONS = 200
ALWAYS = 0.95  # of the random configurations
TOUCHING = 1e-6  # m, about the tolerance of the distances


@dataclass(frozen=True)
class LeftOut:
    """A pair of links that is not watched.

    Attributes
    ----------
    first, second : str
        Links of the source.
    reason : str
    """

    first: str
    second: str
    reason: str

    def __str__(self) -> str:
        return f"{self.first} and {self.second}: {self.reason}"


@dataclass(frozen=True)
class WatchedPairs:
    """The pairs that are watched, in groups that share a clearance, and those that are left out.

    Attributes
    ----------
    labels : tuple of str
        (m,) names of the groups.
    groups : tuple of tuple of (int, int)
        Pairs of shapes.
    links : tuple of tuple of (str, str)
        Pairs of links of the source.
    margins : tuple of float
        m.
    left_out : tuple of LeftOut
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
) -> WatchedPairs:
    """Choose the pairs of links that can collide; see `SelfCollision`."""
    excluded = _excluded(geometry, exclude)
    if disabled.links and disabled.links.isdisjoint(geometry.parents.keys() | set(geometry.parents.values())):
        raise InputError(
            f'the SRDF names no link of the robot "{geometry.robot.name}" (it names '
            f"{', '.join(sorted(disabled.links)[:4])}); give the SRDF of this robot"
        )
    left_out: list[LeftOut] = []
    open_pairs: list[LinkPair] = []
    carrier = {one.link: one.body for one in geometry.shapes}
    solid = {*carrier, *shapeless}
    for first, second in combinations(geometry.links, 2):
        if carrier[first] == carrier[second]:
            continue  # They do not move against each other.
        if excluded(first, second):
            left_out.append(LeftOut(first, second, "excluded"))
        elif disabled.disables(first, second):
            left_out.append(LeftOut(first, second, "disabled by the SRDF"))
        elif solid.isdisjoint(geometry.between(first, second)):
            left_out.append(LeftOut(first, second, "adjacent"))
        else:
            open_pairs.append((first, second))
    margins, touching = _margins(geometry, open_pairs, configuration, margin)
    # Links that move together share a clearance, save those whose margin had to be reduced.
    together: dict[tuple[int, int, LinkPair | None], list[LinkPair]] = {}
    for (first, second), least in margins.items():
        pair = (first, second) if carrier[first] < carrier[second] else (second, first)
        key = (carrier[pair[0]], carrier[pair[1]], None if least == margin else pair)
        together.setdefault(key, []).append(pair)
    groups = [together[key] for key in sorted(together, key=lambda key: (key[:2], key[2] or ("", "")))]
    return WatchedPairs(
        tuple(_label(geometry, group) for group in groups),
        tuple(tuple(pair for links in group for pair in _shape_pairs(geometry, links)) for group in groups),
        tuple(tuple(group) for group in groups),
        tuple(margins.get(group[0], margins.get(group[0][::-1], margin)) for group in groups),
        (*left_out, *touching),
    )


def _label(geometry: RobotGeometry, group: Sequence[LinkPair]) -> str:
    """Name a group by its links, or by the moving links that carry them where there are several."""
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


def _margins(
    geometry: RobotGeometry, pairs: list[LinkPair], configuration: Array, margin: float
) -> tuple[dict[LinkPair, float], list[LeftOut]]:
    """Return the margins of the pairs that can be free, and those that touch at the neutral configuration or always."""
    if not pairs:
        return {}, []
    configurations = np.vstack([configuration, random_configurations(geometry.robot, CONFIGURATIONS)])
    measured = PairDistances(geometry.shapes, [_shape_pairs(geometry, pair) for pair in pairs])
    # Beyond the margin nothing needs to be known.
    distances = measured.distances(place_links(geometry.robot, configurations), margin + TOUCHING)
    margins: dict[LinkPair, float] = {}
    left_out: list[LeftOut] = []
    for column, (first, second) in enumerate(pairs):
        share = float((distances[1:, column] <= TOUCHING / 2).mean())
        widest = float(distances[:, column].max())
        if share >= ALWAYS:
            left_out.append(LeftOut(first, second, f"touch in {share:.0%} of random configurations"))
        elif distances[0, column] <= TOUCHING / 2:
            reason = f"touch in the neutral configuration, and in {share:.0%} of random ones"
            left_out.append(LeftOut(first, second, reason))
        else:
            margins[first, second] = margin if widest >= margin else widest / 2
    return margins, left_out
