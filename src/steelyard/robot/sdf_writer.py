"""Writing identified parameters into a copy of the SDF that the robot was read from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import unescape
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from steelyard.errors import InputError
from steelyard.files import read_bytes, write_bytes

from .description_changes import SAME, description_changes, moment_texts, require_target
from .drive_extension import write_extension
from .inertia import Inertia
from .joint import Drives, Link
from .placement import inverse
from .references import moved_reference
from .robot import Robot
from .xml_edit import XmlEdit, XmlElement, attribute_text, number_text

__all__ = ["write_sdf"]

FRICTION = ("damping", "friction")
LEAST_SHARE = 1e-3
"""The least share of a body that is distributed among links: a simulator refuses links without mass."""


def write_sdf(robot: Robot, parameters: ArrayLike, drives: Drives, source: str | Path, target: str | Path) -> None:
    """Write a copy of an SDF with other inertias and joint friction; all else stays, byte for byte.

    A link must have a mass in SDF, so links that are fixed to a moving link keep theirs, which is taken from the
    estimate; where no possible body would remain, the estimate is shared among the links by the masses that they had.
    Links on *locked* joints keep theirs, too, or a part of it where no possible body would remain.
    A body that is as the SDF has it does not change. Friction goes into `<dynamics>` of the axis; rotor inertia and
    offset, for which the format has no place, into `<steelyard:drives>` of the model. Where the target is in another
    folder, relative paths of files that are there are made absolute.

    Parameters
    ----------
    robot : Robot
        The robot that was read from `source`.
    parameters : (n,) array
        Values of `robot.parameter_names`.
    drives : Drives
        Of each coordinate; NaN leaves what is there. They include what the mimic joints of the coordinate add, so these
        joints get 0 where they had a value.
    source, target : str or Path
        The SDF to copy, and the file to write.

    Raises
    ------
    InputError
        When an array has the wrong size, a link's mass is not positive, a friction value is negative, `source` is not
        the robot's SDF or includes its links from other files, or `target` is `source`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> text = '''<sdf version="1.9"><model name="door"><link name="frame"/><link name="leaf"/>
    ... <joint name="hinge" type="revolute"><parent>frame</parent><child>leaf</child><axis/></joint></model></sdf>'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     source, target = Path(folder) / "door.sdf", Path(folder) / "weighed.sdf"
    ...     _ = source.write_text(text)
    ...     robot = Robot.from_sdf(source)
    ...     leaf = Inertia.from_com(mass=12.0, com=(0.4, 0.0, 1.0), about_com=np.diag([4.0, 4.6, 0.64]))
    ...     write_sdf(robot, leaf.parameters, Drives.unknown(1).with_known(damping=[0.3]), source, target)
    ...     weighed = Robot.from_sdf(target)
    >>> weighed.links[0], weighed.joints[0].damping
    (Link('leaf', 12 kg), 0.3)
    """
    source, target = Path(source), Path(target)
    changes = description_changes(robot, parameters, drives.held_by_joints())
    require_target(source, target, robot, "SDF")
    edit = XmlEdit(read_bytes(source, remedy="give the path of an SDF"), source)
    model, links, joints = _robot_model(edit, robot, source)
    moving = {link.name: link for link in robot.links}
    for name, inertia in changes.inertias.items():
        parts = _shared(moving[name], inertia) if name in moving else {name: inertia}
        for one, part in parts.items():
            _set_inertial(edit, links[one], part)
    for name, known in changes.drives.items():
        _set_dynamics(edit, joints[name], {key: number_text(known[key]) for key in FRICTION if key in known})
    write_extension(edit, model, robot, drives, changes.drives)
    for element in edit.root.iterate() if edit.edited else ():
        path = moved_reference(unescape(edit.text(element)), source, target) if element.tag == "uri" else None
        if path is not None:
            edit.set_text(element, attribute_text(path))
    write_bytes(edit.result(), target)


def _shared(link: Link, body: Inertia) -> dict[str, Inertia]:
    """Share an inertia among a link and what is fixed to it: by the name of the link, in its own frame.

    What is fixed keeps its inertia where what remains for the link is a possible body. Otherwise each gets a part of
    the whole body, by the masses of the description: the total is the same in either case.
    """
    fixed = [(one, one.inertia) for one in link.attachments if not one.locked and one.inertia is not None]
    rest = body
    for one, inertia in fixed:
        rest = rest - inertia.moved(one.placement)
    values = np.linalg.eigvalsh(rest.pseudo_inertia)
    if rest.mass > 0.0 and values[0] > SAME * values[-1]:
        return {link.name: rest}
    own = 0.0 if link.own_inertia is None else link.own_inertia.mass
    masses = np.maximum([own, *(inertia.mass for _, inertia in fixed)], 0.0)
    shares = np.maximum(masses / (masses.sum() or 1.0), LEAST_SHARE)
    shares /= shares.sum()
    places = [(link.name, np.eye(4)), *((one.name, inverse(one.placement)) for one, _ in fixed)]
    parts = [Inertia.from_parameters(share * body.parameters) for share in shares]
    return {name: part.moved(place) for (name, place), part in zip(places, parts, strict=True)}


def _robot_model(
    edit: XmlEdit, robot: Robot, source: Path
) -> tuple[XmlElement, dict[str, XmlElement], dict[str, XmlElement]]:
    """The element of the robot, and of its links and joints by the names that the robot has for them."""
    needed = {name for link in robot.links for name in (link.name, *link.absorbed)}
    needed_joints = {joint.name for joint in robot.joints}
    places = [edit.root, *edit.root.all("world")]
    missing: set[str] = set()
    for model in (model for place in places for model in place.all("model")):
        links = dict(_named(model, "link", ""))
        joints = dict(_named(model, "joint", ""))
        missing = (needed - links.keys()) | (needed_joints - joints.keys())
        if not missing:
            return model, links, joints
    first = f' "{sorted(missing)[0]}"' if missing else ""
    raise InputError(
        f'{source}: it does not hold{first or " all"} of robot "{robot.name}"; give the SDF that the robot was read '
        "from, or, where it includes models, identify the robot from the file of the model"
    )


def _named(model: XmlElement, tag: str, prefix: str) -> Iterator[tuple[str, XmlElement]]:
    for element in model.all(tag):
        yield prefix + element.attributes.get("name", ""), element
    for inner in model.all("model"):
        yield from _named(inner, tag, f"{prefix}{inner.attributes.get('name', '')}::")


def _set_inertial(edit: XmlEdit, link: XmlElement, inertia: Inertia) -> None:
    center = " ".join(number_text(value) for value in inertia.com)
    moments = moment_texts(inertia)
    inertial = link.find("inertial")
    inner = [f"  <{key}>{value}</{key}>" for key, value in moments.items()]
    whole = {"pose": [f"<pose>{center} 0 0 0</pose>"], "mass": [f"<mass>{number_text(inertia.mass)}</mass>"]}
    whole["inertia"] = ["<inertia>", *inner, "</inertia>"]
    if inertial is None:
        lines = [f"  {line}" for lines in whole.values() for line in lines]
        edit.insert_first(link, "<inertial>", *lines, "</inertial>")
        return
    if inertial.attributes.get("auto"):
        edit.set_attributes(inertial, {"auto": "false"})
    missing = [line for tag, lines in whole.items() if inertial.find(tag) is None for line in lines]
    if missing:
        edit.insert_first(inertial, *missing)
    pose, mass, tensor = (inertial.find(tag) for tag in whole)
    if pose is not None:
        still = "0 0 0 1" if pose.attributes.get("rotation_format") == "quat_xyzw" else "0 0 0"
        edit.set_text(pose, f"{center} {still}")
    if mass is not None:
        edit.set_text(mass, number_text(inertia.mass))
    if tensor is not None:
        _set_children(edit, tensor, moments)


def _set_dynamics(edit: XmlEdit, joint: XmlElement, values: Mapping[str, str]) -> None:
    axis = joint.find("axis")
    if not values or axis is None:
        return
    dynamics = axis.find("dynamics")
    if dynamics is None:
        lines = (f"  <{tag}>{value}</{tag}>" for tag, value in values.items())
        edit.insert_last(axis, "<dynamics>", *lines, "</dynamics>")
    else:
        _set_children(edit, dynamics, values)


def _set_children(edit: XmlEdit, parent: XmlElement, values: Mapping[str, str]) -> None:
    """Give children these texts; those that are not there are added."""
    missing = [f"<{tag}>{value}</{tag}>" for tag, value in values.items() if parent.find(tag) is None]
    if missing:
        edit.insert_last(parent, *missing)
    for tag, value in values.items():
        child = parent.find(tag)
        if child is not None:
            edit.set_text(child, value)
