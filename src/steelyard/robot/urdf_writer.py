"""Writing identified parameters into a copy of the URDF that the robot was read from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files import write_bytes

from .inertia import Inertia
from .joint import Link
from .robot import Robot
from .urdf_document import read_document, urdf_content
from .xml_edit import XmlEdit, XmlElement

__all__ = ["write_urdf"]

Matrix = NDArray[np.float64]


def write_urdf(
    robot: Robot,
    parameters: ArrayLike,
    damping: ArrayLike,
    friction: ArrayLike,
    source: str | Path,
    target: str | Path,
) -> None:
    """Write a copy of a URDF with other inertias and joint friction; all else stays, byte for byte.

    The whole inertia of a moving link is written into that link; links that are fixed to it lose their `<inertial>`, so
    that the total is the estimate. Links that hang on *locked* joints keep theirs, which is taken from the estimate.
    Links fixed to the base do not change. The target is written beside and renamed, so it is whole or not there.

    Parameters
    ----------
    robot : Robot
        The robot that was read from `source`.
    parameters : (n,) array
        Values of `robot.parameter_names`.
    damping, friction : (N,) array
        Viscous (N m s/rad or N s/m) and Coulomb friction (N m or N) of each coordinate; NaN leaves the attribute as it
        was. They include what the mimic joints of the coordinate add, so these joints get 0 where they had a value.
    source : str or Path
        The URDF to copy.
    target : str or Path
        The file to write; an existing file is replaced.

    Raises
    ------
    InputError
        When an array has the wrong size, a link's mass is not positive, what remains of a link without its locked links
        is no possible body, a friction value is negative, `source` is not the robot's URDF, or `target` is `source`.

    Examples
    --------
    >>> import tempfile
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
    values = _vector(parameters, len(robot.parameter_names), "parameters")
    viscous = _vector(damping, robot.dof, "damping")
    coulomb = _vector(friction, robot.dof, "friction")
    _check_files(robot, source, target)
    inertias = [
        _remainder(link, values[start : start + 10]) for link, start in zip(robot.links, robot.link_starts, strict=True)
    ]

    edit = XmlEdit(urdf_content(source, robot.xacro_arguments), source)
    if edit.root.tag != "robot":
        raise InputError(
            f"{source}: <{edit.root.tag}> cannot be edited in place; write the URDF's elements without prefix"
        )
    links = {element.attributes.get("name"): element for element in edit.root.all("link")}
    joints = {element.attributes.get("name"): element for element in edit.root.all("joint")}
    for link, inertia in zip(robot.links, inertias, strict=True):
        _set_inertial(edit, links[link.name], inertia)
        for attachment in link.attachments:
            inertial = links[attachment.name].find("inertial")
            if not attachment.locked and inertial is not None:
                edit.remove(inertial)
    for joint in robot.joints:
        new = {"damping": viscous[joint.coordinate], "friction": coulomb[joint.coordinate]}
        known = {key: float(value) for key, value in new.items() if not np.isnan(value)}
        for key, value in known.items():
            if not 0.0 <= value < np.inf:
                raise InputError(
                    f'joint "{joint.name}": its {key} is {value:g}, but it must be finite and at least 0; '
                    "constrain it when fitting, or give NaN to leave the URDF's value"
                )
        _set_dynamics(edit, joints[joint.name], known, drives=joint.mimics is None)
    write_bytes(edit.result(), target)


def _vector(values: ArrayLike, size: int, name: str) -> Matrix:
    array = np.asarray(values, dtype=float)
    if array.shape != (size,):
        raise InputError(f"{name} must have shape ({size},), got {array.shape}")
    return array


def _check_files(robot: Robot, source: Path, target: Path) -> None:
    document = read_document(source, robot.xacro_arguments)
    for what, names, known in (
        ("link", [name for link in robot.links for name in (link.name, *link.absorbed)], document.links),
        ("joint", [joint.name for joint in robot.joints], document.joints),
    ):
        absent = next((name for name in names if name not in known), None)
        if absent is not None:
            raise InputError(
                f'{source}: it has no {what} "{absent}" of robot "{robot.name}"; '
                "give the URDF that the robot was read from"
            )
    for given in {source, robot.source or source}:
        if target.resolve() == given.resolve() or (target.exists() and given.exists() and target.samefile(given)):
            raise InputError(f"{target}: this is the URDF that was read, which is never changed; give another target")
    if target.is_dir():
        raise InputError(f"{target}: this is a folder; give the name of a file")
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist; make it first")


def _remainder(link: Link, parameters: Matrix) -> Inertia:
    """The inertia to write into the link's own element: the estimate without what locked links bring themselves."""
    if not np.isfinite(parameters).all():
        raise InputError(f'link "{link.name}": its parameters must be finite, got {parameters.tolist()}')
    inertia = Inertia.from_parameters(parameters)
    if inertia.mass <= 0.0:
        raise InputError(
            f'link "{link.name}": its mass is {inertia.mass:g} kg, which no body has; '
            "write the estimate of a feasible fit or correction"
        )
    held = [one for one in link.attachments if one.locked and one.inertia is not None]
    for one in held:
        if one.inertia is not None:
            inertia = inertia - one.inertia.moved(one.placement)
    if held:
        names = ", ".join(f'"{one.name}"' for one in held)
        smallest = float(np.linalg.eigvalsh(inertia.pseudo_inertia)[0])
        if inertia.mass <= 0.0 or smallest <= 0.0:
            reason = (
                f"mass {inertia.mass:g} kg"
                if inertia.mass <= 0.0
                else f"a pseudo-inertia with the eigenvalue {smallest:g}"
            )
            raise InputError(
                f'link "{link.name}": without {names}, which hang on locked joints and keep their inertia, its '
                f"estimate would have {reason}, which no body has; mend their CAD inertia, or make the joints fixed"
            )
    return inertia


def _set_inertial(edit: XmlEdit, link: XmlElement, inertia: Inertia) -> None:
    second = inertia.about_com
    origin = {"xyz": " ".join(_text(value) for value in inertia.com), "rpy": "0 0 0"}
    mass = {"value": _text(inertia.mass)}
    moments = {
        f"i{'xyz'[row]}{'xyz'[column]}": _text((second[row, column] + second[column, row]) / 2)
        for row in range(3)
        for column in range(row, 3)
    }
    inertial = link.find("inertial")
    if inertial is None:
        lines = (_tag("origin", origin), _tag("mass", mass), _tag("inertia", moments))
        edit.insert_first(link, "<inertial>", *(f"  {line}" for line in lines), "</inertial>")
        return
    for tag, values in (("origin", origin), ("mass", mass), ("inertia", moments)):
        element = inertial.find(tag)
        if element is None:
            edit.insert_first(inertial, _tag(tag, values))
        else:
            edit.set_attributes(element, values)


def _set_dynamics(edit: XmlEdit, joint: XmlElement, known: dict[str, float], drives: bool) -> None:
    element = joint.find("dynamics")
    if not drives:
        # The values of the coordinate hold the whole friction, that of the mimic joints too.
        known = {key: 0.0 for key in known if element is not None and key in element.attributes}
    if not known:
        return
    values = {key: _text(value) for key, value in known.items()}
    if element is None:
        edit.insert_last(joint, _tag("dynamics", values))
    else:
        edit.set_attributes(element, values)


def _tag(tag: str, values: dict[str, str]) -> str:
    attributes = "".join(f' {key}="{value}"' for key, value in values.items())
    return f"<{tag}{attributes}/>"


def _text(value: float) -> str:
    return repr(float(value) + 0.0)
