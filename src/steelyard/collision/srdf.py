"""Pairs of links that an SRDF file disables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from steelyard.errors import InputError
from steelyard.robot.urdf_document import parse_urdf as parse_xml

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["DisabledPairs", "read_srdf"]


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
