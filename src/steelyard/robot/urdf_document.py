"""The elements of a URDF file, read strictly: every number checked, every complaint with its line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import read_bytes, suggestion

from .described_tree import ONE_DOF, DescribedJoint, DescribedLink, DescribedMimic, DescribedTree, with_extension
from .inertia import Inertia, inertia_tensor
from .placement import rpy_rotation
from .xml_document import SHORTEST_AXIS, XmlReader, line_of, parse_xml

if TYPE_CHECKING:
    from lxml import etree

__all__ = ["UrdfReader", "is_xacro", "parse_urdf", "read_document", "urdf_content"]

Matrix = NDArray[np.float64]


def read_document(path: str | Path, xacro_arguments: Mapping[str, str] | None = None) -> DescribedTree:
    """Read a URDF file, or a xacro, which is expanded; raise InputError, with the line, where it is not one."""
    path = Path(path)
    content, is_expanded = _content(path, xacro_arguments)
    reader = UrdfReader(path)
    remarks: tuple[str, ...] = ()
    if is_expanded:
        reader.place = f"{path}, expanded"
        reader.no_link = "it may hold macros alone; give the file that uses them"
        given = ", ".join(f"{key} = {value}" for key, value in (xacro_arguments or {}).items())
        given = f" with {given}" if given else ""
        remarks = (f"{path.name} was expanded{given}; what is identified is written as plain URDF.",)
    return replace(reader.document(parse_xml(path, content=content)), remarks=remarks)


def parse_urdf(path: Path, xacro_arguments: Mapping[str, str] | None = None) -> etree._Element:
    """Return the root of a URDF, or of the URDF that a xacro describes; see `parse_xml`."""
    return parse_xml(path, content=urdf_content(path, xacro_arguments))


def urdf_content(path: Path, xacro_arguments: Mapping[str, str] | None = None) -> bytes:
    """Return the bytes of a URDF, or of the URDF that a xacro describes.

    A file is a xacro by its suffix, or by elements with the prefix ``xacro:``.
    """
    return _content(path, xacro_arguments)[0]


def _content(path: Path, xacro_arguments: Mapping[str, str] | None) -> tuple[bytes, bool]:
    """Return the bytes of a URDF, and whether they were expanded from a xacro."""
    content = read_bytes(path, remedy="give the path of a URDF")
    if is_xacro(path, content):
        from .xacro import expand_xacro  # what expands is loaded when it is needed

        return expand_xacro(path, xacro_arguments), True
    if xacro_arguments:
        raise InputError(f"{path}: it is no xacro, so it takes no arguments; remove xacro_arguments")
    return content, False


def is_xacro(path: Path, content: bytes) -> bool:
    """Return whether a file is a xacro.

    Examples
    --------
    >>> is_xacro(Path("arm.urdf"), b'<robot xmlns:xacro="x"><xacro:macro name="link"/></robot>')
    True
    """
    return path.suffix.lower() == ".xacro" or b"<xacro:" in content


class UrdfReader(XmlReader):
    """Reads the elements of a URDF."""

    no_link = "give a complete URDF"

    def document(self, root: etree._Element) -> DescribedTree:
        """Read the element ``robot``."""
        from lxml import etree

        name = etree.QName(root)
        if name.localname != "robot":
            raise self.error(root, f"a URDF begins with <robot>, found <{name.localname}>; give a URDF file")
        # Elements of foreign namespaces (old sensor and controller tags) are neither links nor joints of the robot.
        self.namespace = f"{{{name.namespace}}}" if name.namespace else ""
        links: dict[str, DescribedLink] = {}
        for element in self.children(root, "link"):
            link = self.link(element)
            if link.name in links:
                raise self.error(
                    element, f'the link "{link.name}" was already on line {links[link.name].line}; names must differ'
                )
            links[link.name] = link
        if not links:
            raise self.error(root, f"the robot has no <link>; {self.no_link}")
        joints: dict[str, DescribedJoint] = {}
        for element in self.children(root, "joint"):
            joint = self.joint(element, links)
            if joint.name in joints:
                raise self.error(
                    element,
                    f'the joint "{joint.name}" was already on line {joints[joint.name].line}; names must differ',
                )
            joints[joint.name] = joint
        joints = with_extension(joints, self.of_drives(root))
        return DescribedTree(str(self.path), root.get("name") or self.path.stem, links, joints, self.path)

    def link(self, element: etree._Element) -> DescribedLink:
        """Read a link."""
        name = self.text(element, "name", "a link")
        inertial = self.only(element, "inertial", f'link "{name}"')
        return DescribedLink(
            name, line_of(element), None if inertial is None else self.inertial(inertial, f'link "{name}"')
        )

    def inertial(self, element: etree._Element, owner: str) -> Inertia:
        """Read the element ``inertial`` of a link."""
        mass_element, inertia_element = (self.only(element, tag, owner) for tag in ("mass", "inertia"))
        if mass_element is None:
            raise self.error(element, f"{owner}: its <inertial> has no <mass>; add one or remove the <inertial>")
        if inertia_element is None:
            raise self.error(element, f"{owner}: its <inertial> has no <inertia>; add one or remove the <inertial>")
        mass = self.number(mass_element, "value", owner)
        elements = [self.number(inertia_element, key, owner) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
        return Inertia.from_inertial_frame(mass, self.origin(element, owner), inertia_tensor(elements))

    def joint(self, element: etree._Element, links: dict[str, DescribedLink]) -> DescribedJoint:
        """Read a joint; `links` are those of the document."""
        name = self.text(element, "name", "a joint")
        owner = f'joint "{name}"'
        kind = self.text(element, "type", owner)
        ends = []
        for tag in ("parent", "child"):
            end = self.only(element, tag, owner)
            if end is None:
                raise self.error(element, f'{owner} has no <{tag}>; add <{tag} link="..."/>')
            link = self.text(end, "link", f"{owner}, <{tag}>")
            if link not in links:
                raise self.error(end, f'{owner}: its {tag} link "{link}" is not in the file; {suggestion(link, links)}')
            ends.append(link)
        axis_element = self.only(element, "axis", owner)
        axis = (1.0, 0.0, 0.0) if axis_element is None else self.vector(axis_element, "xyz", owner, (1.0, 0.0, 0.0))
        if kind in ONE_DOF and math.hypot(*axis) < SHORTEST_AXIS:
            given = " ".join(f"{value:g}" for value in axis)
            raise self.error(element, f'{owner}: its axis is "{given}"; give the direction of the motion')

        limit = self.only(element, "limit", owner)
        lower, upper = -math.inf, math.inf
        if limit is not None and kind != "continuous" and (limit.get("lower") or limit.get("upper")):
            # The format gives 0 to the bound that is not written.
            lower, upper = (self.number(limit, key, owner, 0.0, infinite=True) for key in ("lower", "upper"))
        if lower > upper:
            raise self.error(
                element, f"{owner}: its lower limit {lower:g} is above its upper limit {upper:g}; exchange them"
            )
        velocity, effort = (
            math.inf if limit is None else self.number(limit, key, owner, math.inf, infinite=True)
            for key in ("velocity", "effort")
        )
        dynamics = self.only(element, "dynamics", owner)
        damping, friction = (
            math.nan if dynamics is None else self.number(dynamics, key, owner, math.nan)
            for key in ("damping", "friction")
        )
        mimic_element = self.only(element, "mimic", owner)
        mimic = None
        if mimic_element is not None:
            mimic = DescribedMimic(
                self.text(mimic_element, "joint", f"{owner}, <mimic>"),
                self.number(mimic_element, "multiplier", owner, 1.0),
                self.number(mimic_element, "offset", owner, 0.0),
            )
        return DescribedJoint(
            name, line_of(element), kind, ends[0], ends[1], self.origin(element, owner), axis, mimic=mimic,
            lower=lower, upper=upper, velocity_limit=velocity, effort_limit=effort, damping=damping, friction=friction,
        )  # fmt: skip

    def origin(self, element: etree._Element, owner: str) -> Matrix:
        """Return the placement (4, 4) of the element ``origin`` in an element; the identity where there is none."""
        origin = self.only(element, "origin", owner)
        if origin is None:
            return np.eye(4)
        roll, pitch, yaw = self.vector(origin, "rpy", owner, (0.0, 0.0, 0.0))
        placement = rpy_rotation(roll, pitch, yaw)
        placement[:3, 3] = self.vector(origin, "xyz", owner, (0.0, 0.0, 0.0))
        return placement
