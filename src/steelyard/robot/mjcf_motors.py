"""Motors behind springs in an MJCF: rotors with joints of their own, and tendons to the joints that they drive."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files import write_bytes

from .description_changes import DescriptionChanges
from .mjcf_compiled import BALL, FREE, OF_ACTUATORS, SLIDE
from .mjcf_document import MjcfElement, new_name
from .mjcf_tree import MjcfTree, read_mjcf_tree
from .mjcf_writer import MjcfWriter
from .xml_edit import attribute_text, number_text, tag_text

__all__ = ["MjcfMotor", "add_motors"]

MASS, MOMENT = 1e-6, 1e-9
"""kg and kg·m² of a rotor's body beside its armature: MuJoCo wants both above 1e-15, and a rotor that hangs on the
world and turns about its centre of mass adds nothing but its inertia about the axis."""
_SIZES = {FREE: (7, 6), BALL: (4, 3)}


@dataclass(frozen=True)
class MjcfMotor:
    """The motor of a joint and the transmission between them, all values on the joint side of the gear.

    Parameters
    ----------
    stiffness, transmission_damping : float
        Of the transmission, N·m/rad and N·m·s/rad, or N/m and N·s/m.
    rotor_inertia : float
        kg·m² or kg.
    damping, friction : float
        Viscous and Coulomb friction of the motor, N·m·s/rad and N·m, or N·s/m and N.
    """

    stiffness: float
    transmission_damping: float
    rotor_inertia: float
    damping: float = 0.0
    friction: float = 0.0


def add_motors(source: str | Path, target: str | Path, motors: Mapping[str, MjcfMotor]) -> None:
    """Write a copy of an MJCF in which motors drive some joints through springs.

    Each of these joints gets a rotor, a body at the end of the last ``<worldbody>`` with one joint named after it and
    ``_motor``, and a fixed tendon between both, whose length is the deflection and whose stiffness and damping are
    those of the transmission. Damping, friction loss and armature are those of the motor, and 0 at the joint; actuators
    of the joint with the bound of their force, and sensors of it, act at the motor. Keyframes are made longer, each
    motor at the position of its joint. All else stays as it is.

    Parameters
    ----------
    source, target : str or Path
        The MJCF to copy, and the file to write.
    motors : mapping from str to MjcfMotor
        By the names of hinge and slide joints.

    Raises
    ------
    InputError
        If a joint is not there, or `source` cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> text = '<mujoco><worldbody><body name="a"><joint name="j"/><geom size="1"/></body></worldbody></mujoco>'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (Path(folder) / "a.xml").write_text(text)
    ...     add_motors(Path(folder) / "a.xml", Path(folder) / "b.xml", {"j": MjcfMotor(700.0, 1.0, 0.25)})
    ...     print((Path(folder) / "b.xml").read_text().partition("<tendon>")[2].partition("</tendon>")[0])
    <fixed name="j_transmission" stiffness="700.0" damping="1.0" springlength="0" limited="false"
    frictionloss="0"><joint joint="j_motor" coef="1"/><joint joint="j" coef="-1"/></fixed>
    """
    source, target = Path(source), Path(target)
    read = read_mjcf_tree(source)
    writer = MjcfWriter(read, DescriptionChanges({}, (), {}))
    _put_motors(read, motors)
    for name in motors:
        writer.take_from_actuators(name, OF_ACTUATORS)
    data = writer.edited(source.resolve().parent, target.resolve().parent)
    read_mjcf_tree(target, data)  # refused here and not by whoever opens it
    write_bytes(data, target)


def _put_motors(read: MjcfTree, motors: Mapping[str, MjcfMotor]) -> None:
    document = read.document
    rows = dict(zip(read.joint_names, read.compiled.joints, strict=True))
    missing = next((name for name in motors if name not in document.joints or rows[name]["type"] in _SIZES), None)
    if missing is not None:
        raise InputError(f'{document.path}: "{missing}" is no hinge or slide joint with an element of its own.')
    bodies = {*read.body_names, "world"}
    tendons = {one.attributes.get("name", "") for section in document.root.all("tendon") for one in section.children}
    joints = {*read.joint_names}
    bound = {key: float(document.setting("compiler", key) or 0.0) for key in ("boundmass", "boundinertia")}
    of_motor: dict[str, str] = {}
    lines, ties = [], []
    for name, motor in motors.items():
        element, row = document.joints[name], rows[name]
        own_drive = {"name": attribute_text(name), "damping": "0", "armature": "0", "frictionloss": "0"}
        force = {"actuatorfrclimited": "false"}
        if row["actfrclimited"]:  # of the drive, wherever it acts
            own_drive |= force
            force = {"actuatorfrclimited": "true", "actuatorfrcrange": " ".join(map(number_text, row["actfrcrange"]))}
        element.file.edit.set_attributes(element.place, own_drive)
        of_motor[name] = new_name(f"{name}_motor", joints)
        slides = row["type"] == SLIDE
        degrees = not slides and document.setting("compiler", "angle") != "radian"
        own = max(MASS, bound["boundmass"]) if slides else max(MOMENT, bound["boundinertia"])
        joint = {
            "name": attribute_text(of_motor[name]),
            "type": "slide" if slides else "hinge",
            "pos": "0 0 0",
            "axis": "0 0 1",
            "ref": number_text(math.degrees(row["ref"]) if degrees else row["ref"]),
            "limited": "false",
            **force,
            "stiffness": "0",
            "springdamper": "0 0",
            "armature": number_text(max(motor.rotor_inertia - own, 0.0)),
            "damping": number_text(motor.damping),
            "frictionloss": number_text(motor.friction),
        }
        body = {"name": attribute_text(new_name(f"{name}_rotor", bodies)), **({"gravcomp": "1"} if slides else {})}
        inertial = {"pos": "0 0 0", "mass": number_text(MASS), "diaginertia": " ".join([number_text(MOMENT)] * 3)}
        lines.append(f"{_opened('body', body)}{tag_text('inertial', inertial)}{tag_text('joint', joint)}</body>")
        tie = {
            "name": attribute_text(new_name(f"{name}_transmission", tendons)),
            "stiffness": number_text(motor.stiffness),
            "damping": number_text(motor.transmission_damping),
            "springlength": "0",
            "limited": "false",
            "frictionloss": "0",
        }
        ends = ((of_motor[name], "1"), (name, "-1"))
        inner = "".join(tag_text("joint", {"joint": attribute_text(one), "coef": coef}) for one, coef in ends)
        ties.append(f"{_opened('fixed', tie)}{inner}</fixed>")
    world = list(document.root.all("worldbody"))[-1]
    world.file.edit.insert_last(world.place, *lines)
    first = document.files[0].edit
    first.insert_last(first.root, "<tendon>", *(f"  {one}" for one in ties), "</tendon>")
    for element in document.root.iterate():
        _act_at_motors(element, of_motor)
    for section in document.root.all("keyframe"):
        for key in section.all("key"):
            _lengthen(key, read, list(motors))


def _opened(tag: str, values: Mapping[str, str]) -> str:
    return tag_text(tag, values).removesuffix("/>") + ">"


def _act_at_motors(element: MjcfElement, of_motor: Mapping[str, str]) -> None:
    """Let what drives an elastic joint drive its motor."""
    if element.tag == "actuator":
        changed = [(one, key) for one in element.children for key in ("joint", "jointinparent")]
    elif element.tag == "sensor":
        changed = [(one, "joint") for one in element.all("jointactuatorfrc")]
    else:
        return
    for one, key in changed:
        motor = of_motor.get(one.attributes.get(key, ""))
        if motor is not None:
            one.file.edit.set_attributes(one.place, {key: attribute_text(motor)})


def _lengthen(key: MjcfElement, read: MjcfTree, joints: list[str]) -> None:
    """Give the motors the positions and speeds of their joints in a keyframe."""
    for attribute, which in (("qpos", 0), ("qvel", 1)):
        values = key.attributes.get(attribute, "").split()
        if not values:
            continue
        places, count = {}, 0
        for name, row in zip(read.joint_names, read.compiled.joints, strict=True):
            places[name] = count
            count += _SIZES.get(row["type"], (1, 1))[which]
        if len(values) != count:
            raise InputError(f"{key.where}: {attribute} has {len(values)} numbers, expected {count}; mend the keyframe")
        more = [values[places[name]] for name in joints]
        key.file.edit.set_attributes(key.place, {attribute: " ".join([*values, *more])})
