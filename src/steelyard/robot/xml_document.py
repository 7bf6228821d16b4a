"""The XML of descriptions, read strictly: no entities, every number checked, every complaint with its line."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, cast

from steelyard.errors import InputError
from steelyard.files import read_bytes, shown
from steelyard.files.arguments import LARGEST, is_name

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["DRIVES", "DRIVES_NAMESPACE", "SHORTEST_AXIS", "XmlReader", "line_of", "parse_xml", "with_known_version"]

_VERSION = re.compile(rb"""^(<\?xml\s+version\s*=\s*["'])[02-9]\.\d(?=["'])""")
DRIVES_NAMESPACE = "urn:steelyard:drives:1"
DRIVES = f"{{{DRIVES_NAMESPACE}}}drives"
"""The extension for what formats have no place for, see `drive_extension`."""

# The length below which an axis is taken for a zero vector, whose direction would be rounding error.
SHORTEST_AXIS = 1e-9


def parse_xml(path: Path, kind: str = "a URDF", content: bytes | None = None) -> etree._Element:
    """Read the XML of a description, without entities and network.

    Parameters
    ----------
    kind : str
        What the file should be, for messages.
    content : bytes, optional
        What stands in the file; by default it is read.

    Raises
    ------
    InputError
        With the line where it is bad; for a DOCTYPE; and for xacro, which must be expanded.
    """
    from lxml import etree

    data = read_bytes(path, remedy=f"give the path of {kind}") if content is None else content
    # A description needs neither entities nor a network, and both are ways to harm whoever opens it.
    data = with_known_version(data)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        line = error.position[0] or 1
        if "namespace prefix" in str(error).lower() and "xacro" in str(error):
            raise InputError(_xacro_message(path, line)) from None
        raise InputError(
            f"{path}, line {line}: not well-formed XML ({' '.join(error.msg.split())[:200]}); mend the file"
        ) from None
    tree = root.getroottree()
    if tree.docinfo.internalDTD is not None:
        raise InputError(f"{path}: it has a DOCTYPE declaration, which {kind} does not need; remove it")
    for element in root.iter(etree.Element):
        if "xacro" in (etree.QName(element).namespace or ""):
            raise InputError(_xacro_message(path, line_of(element)))
    return root


def with_known_version(content: bytes) -> bytes:
    """Return the content with the version 1.0 of XML in the place of one that does not exist, of the same length.

    Collections of robots begin with ``<?xml version="0.0" ?>``, over which readers of URDF pass.
    """
    return _VERSION.sub(rb"\g<1>1.0", content, count=1)


def _xacro_message(path: Path, line: int) -> str:
    return f"{path}, line {line}: this is xacro, not URDF; expand it first (xacro {path.name} > robot.urdf)"


def line_of(element: etree._Element) -> int:
    """Return the line of an element in its file."""
    # The stubs give this property the type of an ellipsis.
    return cast("int", element.sourceline)


class XmlReader:
    """Reads attributes and children; knows the file, to say where something is wrong."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.place = str(path)
        self.namespace = ""

    def of_drives(self, parent: etree._Element) -> dict[str, dict[str, float]]:
        """Return what the extension `<steelyard:drives>` says, by the names of joints and of their fields."""
        found = {}
        for element in parent.iterfind(f"{DRIVES}/{{{DRIVES_NAMESPACE}}}joint"):
            name = self.text(element, "name", "a <steelyard:joint>")
            inertia, offset = (
                self.number(element, key, f'joint "{name}"', math.nan) for key in ("rotor_inertia", "offset")
            )
            if inertia < 0.0:
                raise self.error(element, f'joint "{name}": its rotor_inertia is {inertia:g}, but no rotor has that')
            found[name] = {"rotor_inertia": inertia, "torque_offset": offset}
        return found

    def children(self, element: etree._Element, tag: str) -> list[etree._Element]:
        """Return the children with a tag."""
        return element.findall(self.namespace + tag)

    def only(self, element: etree._Element, tag: str, owner: str) -> etree._Element | None:
        """Return the child with a tag, None where there is none; two are an error."""
        found = self.children(element, tag)
        if len(found) > 1:
            raise self.error(found[1], f"{owner} has {len(found)} <{tag}> elements; keep one")
        return found[0] if found else None

    def text(self, element: etree._Element, key: str, owner: str) -> str:
        """Return an attribute that must be there."""
        value = element.get(key)
        if not value:
            raise self.error(element, f"{owner} has no {key}; add the attribute {key}")
        return self.one_line(element, value, f"the {key} of {owner}")

    def one_line(self, element: etree._Element, text: str, what: str) -> str:
        """Return a name that fits into a message, as that of every robot does."""
        if not is_name(text):
            raise self.error(element, f"{what} is {shown(text)}; give a name of one line")
        return text

    def number(
        self, element: etree._Element, key: str, owner: str, default: float | None = None, infinite: bool = False
    ) -> float:
        """Return an attribute as a finite number."""
        text = element.get(key)
        if text is None:
            if default is None:
                raise self.error(element, f"{owner}: <{self.tag(element)}> has no {key}; add the attribute {key}")
            return default
        return self.numbers(element, key, text, owner, 1, infinite)[0]

    def vector(
        self, element: etree._Element, key: str, owner: str, default: tuple[float, float, float]
    ) -> tuple[float, ...]:
        """Return an attribute as three finite numbers."""
        text = element.get(key)
        return default if text is None else self.numbers(element, key, text, owner, 3)

    def numbers(
        self, element: etree._Element, key: str, text: str, owner: str, count: int, infinite: bool = False
    ) -> tuple[float, ...]:
        """Return an attribute as finite numbers, so many."""
        expected = "one number" if count == 1 else f"{count} numbers"
        fits: Callable[[float], bool] = (lambda value: not math.isnan(value)) if infinite else math.isfinite
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        # `float` reads "1_000", which no other reader of URDF does.
        if len(values) != count or "_" in text or not all(map(fits, values)):
            remedy = "expand the xacro first" if re.search(r"\$[{(]", text) else f"write {expected}"
            finite = "" if infinite else ", finite"
            raise self.error(
                element,
                f"{owner}: {key} of <{self.tag(element)}> must be {expected}{finite}, got {shown(text)}; {remedy}",
            )
        if not infinite and max(map(abs, values)) > LARGEST:
            raise self.error(
                element, f"{owner}: {key} of <{self.tag(element)}> is beyond {LARGEST:g}, which no robot has; mend it"
            )
        return values

    def tag(self, element: etree._Element) -> str:
        """Return the tag without its namespace."""
        return str(element.tag).removeprefix(self.namespace)

    def error(self, element: etree._Element, message: str) -> InputError:
        """Return an error that names the file and the line."""
        return InputError(f"{self.place}, line {line_of(element)}: {message}")
