"""Writing identified parameters into a copy of the URDF that the robot was read from."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from steelyard.errors import InputError
from steelyard.files import write_bytes

from .description_changes import description_changes, moment_texts, require_robot, require_target
from .drive_extension import write_extension
from .inertia import Inertia
from .joint import Drives
from .references import moved_reference
from .robot import Robot
from .urdf_document import read_document, urdf_content
from .xml_edit import XmlEdit, XmlElement, attribute_text, number_text, tag_text

__all__ = ["write_urdf"]

FRICTION = ("damping", "friction")
FILES = {"mesh": "filename", "texture": "filename", "compiler": "meshdir"}
"""Attributes that name files; the last is of the element ``<mujoco>``, by which MuJoCo reads a URDF."""


def write_urdf(
    robot: Robot,
    parameters: ArrayLike,
    damping: ArrayLike,
    friction: ArrayLike,
    source: str | Path,
    target: str | Path,
    *,
    rotor_inertia: ArrayLike | None = None,
    offset: ArrayLike | None = None,
    **more: ArrayLike,
) -> None:
    """Write a copy of a URDF with other inertias and joint friction; all else stays, byte for byte.

    What the parameters do not change stays as it is, too, so that a copy with the robot's own parameters is the same.

    The whole inertia of a moving link is written into that link; links that are fixed to it lose their `<inertial>`, so
    that the total is the estimate. Links that hang on *locked* joints keep theirs, which is taken from the estimate, or
    a part of it where no possible body would remain. Links fixed to the base do not change, but for `base_mended` of
    the robot. Friction goes into `<dynamics>`, and into `<gazebo reference="joint">` and `<ros2_control>` where these
    state damping or friction a second time; what the format has no place for, as rotor inertia, offsets and springs,
    into `<steelyard:drives>`. A xacro is written as the URDF that it describes. Where the target is in another folder,
    relative paths of files that are there are made absolute. The target is written beside and renamed, so it is whole
    or not there.

    Parameters
    ----------
    robot : Robot
        The robot that was read from `source`.
    parameters : (n,) array
        Values of `robot.parameter_names`.
    damping, friction : (N,) array
        Viscous (N m s/rad or N s/m) and Coulomb friction (N m or N) of each coordinate; NaN leaves the attribute as it
        was. They include what the mimic joints of the coordinate add, so these joints get 0 where they had a value.
    rotor_inertia, offset : (N,) array, optional
        Inertia of the rotors as the joints feel it (kg m² or kg) and constant torques (N m or N), likewise.
    **more : (N,) array
        More of `Drives`, such as ``spring_stiffness``, likewise.
    source : str or Path
        The URDF to copy.
    target : str or Path
        The file to write; an existing file is replaced.

    Raises
    ------
    InputError
        When an array has the wrong size, a link's mass is not positive, a link with others on locked joints is no
        possible body, a friction value is negative, `source` is not the robot's URDF, or `target` is `source`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> text = '''<robot name="door"><link name="frame"/><link name="leaf"/>
    ... <joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/></joint>
    ... </robot>'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     source, target = Path(folder) / "door.urdf", Path(folder) / "weighed.urdf"
    ...     _ = source.write_text(text)
    ...     robot = Robot.from_urdf(source)
    ...     leaf = Inertia.from_com(mass=12.0, com=(0.4, 0.0, 1.0), about_com=np.diag([4.0, 4.6, 0.64]))
    ...     write_urdf(robot, leaf.parameters, [0.3], [np.nan], source, target)
    ...     weighed = Robot.from_urdf(target)
    >>> weighed.links[0], weighed.joints[0].damping
    (Link('leaf', 12 kg), 0.3)
    """
    source, target = Path(source), Path(target)
    drives = Drives.unknown(robot.dof).with_known(
        damping=damping,
        friction=friction,
        rotor_inertia=rotor_inertia,
        offset=offset,
        **more,
    )
    changes = description_changes(robot, parameters, drives.held_by_joints())
    document = read_document(source, robot.xacro_arguments)
    require_robot(source, robot, "URDF", document.links, document.joints)
    require_target(source, target, robot, "URDF")
    edit = XmlEdit(urdf_content(source, robot.xacro_arguments), source)
    if edit.root.tag != "robot":
        raise InputError(
            f"{source}: <{edit.root.tag}> cannot be edited in place; write the URDF's elements without prefix"
        )
    links = {element.attributes.get("name"): element for element in edit.root.all("link")}
    joints = {element.attributes.get("name"): element for element in edit.root.all("joint")}
    for name, inertia in changes.inertias.items():
        _set_inertial(edit, links[name], inertia)
    for name in changes.emptied:
        inertial = links[name].find("inertial")
        if inertial is not None:
            edit.remove(inertial)
    for name, known in changes.drives.items():
        _set_dynamics(edit, joints[name], {key: known[key] for key in FRICTION if key in known})
        _set_elsewhere(edit, name, known)
    write_extension(edit, edit.root, robot, drives, changes.drives)
    for element in edit.root.iterate() if edit.edited else ():
        key = FILES.get(element.tag, "")
        path = moved_reference(element.attributes.get(key, ""), source, target)
        if path is not None:
            edit.set_attributes(element, {key: attribute_text(path)})
    write_bytes(edit.result(), target)


def _set_inertial(edit: XmlEdit, link: XmlElement, inertia: Inertia) -> None:
    origin = {"xyz": " ".join(number_text(value) for value in inertia.com), "rpy": "0 0 0"}
    mass = {"value": number_text(inertia.mass)}
    moments = moment_texts(inertia)
    inertial = link.find("inertial")
    if inertial is None:
        lines = (tag_text("origin", origin), tag_text("mass", mass), tag_text("inertia", moments))
        edit.insert_first(link, "<inertial>", *(f"  {line}" for line in lines), "</inertial>")
        return
    for tag, values in (("origin", origin), ("mass", mass), ("inertia", moments)):
        element = inertial.find(tag)
        if element is None:
            edit.insert_first(inertial, tag_text(tag, values))
        else:
            edit.set_attributes(element, values)


def _set_dynamics(edit: XmlEdit, joint: XmlElement, known: dict[str, float]) -> None:
    element = joint.find("dynamics")
    if not known:
        return
    values = {key: number_text(value) for key, value in known.items()}
    if element is None:
        edit.insert_last(joint, tag_text("dynamics", values))
    else:
        edit.set_attributes(element, values)


def _set_elsewhere(edit: XmlEdit, joint: str, known: dict[str, float]) -> None:
    """Set friction that the extensions of Gazebo and of ROS 2 control state a second time."""
    found = []
    for element in edit.root.all("gazebo"):
        if element.attributes.get("reference") == joint:
            dynamics = [
                *element.all("dynamics"),
                *(one for axis in element.all("axis") for one in axis.all("dynamics")),
            ]
            found += [(child.tag, child) for parent in (element, *dynamics) for child in parent.children]
    for control in edit.root.all("ros2_control"):
        for element in control.all("joint"):
            if element.attributes.get("name") == joint:
                found += [(child.attributes.get("name", ""), child) for child in element.all("param")]
    for name, element in found:
        if name in FRICTION and name in known and not element.children:
            edit.set_text(element, number_text(known[name]))
