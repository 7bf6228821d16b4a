"""The element of ours for what URDF and SDF have no place for: rotors, offsets, elastic joints, springs, powers.

Other programs pass over it, since they do not know its namespace; docs/reference/descriptions.md says what is in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .joint import Drives
from .robot import Robot
from .xml_document import DRIVES_NAMESPACE
from .xml_edit import XmlEdit, XmlElement, attribute_text, number_text, tag_text

__all__ = ["write_extension"]

ELEMENT, JOINT = "steelyard:drives", "steelyard:joint"
HELD = ("rotor_inertia",)


def write_extension(
    edit: XmlEdit, parent: XmlElement, robot: Robot, drives: Drives, changed: Mapping[str, Mapping[str, float]]
) -> None:
    """Write the extension, in the place of an earlier one.

    Parameters
    ----------
    parent : XmlElement
        The element of the robot.
    changed : mapping
        For each joint those that are other than in the description, as `DescriptionChanges.drives`.

    Raises
    ------
    InputError
        If one of them is infinite.
    """
    earlier = parent.find(ELEMENT)
    held = {one.attributes.get("name", ""): dict(one.attributes) for one in earlier.all(JOINT)} if earlier else {}
    before = {name: dict(attributes) for name, attributes in held.items()}
    for name, index in zip(robot.joint_names, robot.driving_joints, strict=True):
        told = {key: value for key, value in changed.get(name, {}).items() if key in HELD}
        for key in drives.without_joint:
            value = drives.told(key, name, robot.joints[index].coordinate)
            if not math.isnan(value):
                told[key] = value
        if told:
            texts = {key: number_text(value) for key, value in told.items()}
            held[name] = {"name": name, **held.get(name, {}), **texts}
    if held == before:
        return
    if earlier is not None:
        edit.remove(earlier)
    lines = [
        "  " + tag_text(JOINT, {key: attribute_text(value) for key, value in attributes.items()})
        for attributes in held.values()
    ]
    edit.insert_last(parent, f'<{ELEMENT} xmlns:steelyard="{DRIVES_NAMESPACE}">', *lines, f"</{ELEMENT}>")
