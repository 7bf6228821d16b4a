"""Writing identified parameters into a copy of the MJCF that the robot was read from."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from steelyard.errors import InputError
from steelyard.files import read_bytes, write_bytes

from .description_changes import DescriptionChanges, description_changes, is_same, require_robot, require_target
from .inertia import Inertia
from .joint import SPRINGS_AND_POWERS, Drives
from .mjcf_compiled import OF_ACTUATORS, ON_JOINT
from .mjcf_document import OWN_NUMBER, MjcfElement, MjcfFile
from .mjcf_tree import MjcfTree, read_mjcf_tree
from .robot import Robot
from .xml_edit import attribute_text, number_text, tag_text

__all__ = ["DRIVE_ATTRIBUTES", "MjcfWriter", "write_mjcf"]

DRIVE_ATTRIBUTES = {"damping": "damping", "friction": "frictionloss", "rotor_inertia": "armature"}
OTHER_INERTIA = ("fullinertia", "quat", "axisangle", "xyaxes", "zaxis", "euler")
# MuJoCo refuses principal moments of which two are less than the third, or one below 1e-14 kg m², by whatever little.
# An estimate may lie on that bound, where rounding decides; so much, relative to the largest one, is added to all.
MARGIN, LEAST = 1e-12, 2e-14
ROUNDING = 1e-9  # of the second moments, which rounding of an estimate on the bound exceeds by far less
READ_BACK = 1e-9
# Assets by the attribute of <compiler> that says where their files are.
FOLDERS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir"}


def write_mjcf(
    robot: Robot,
    parameters: ArrayLike,
    drives: Drives,
    source: str | Path,
    target: str | Path,
) -> None:
    """Write a copy of an MJCF with other inertias, damping, friction loss and armature; all else stays, byte for byte.

    The inertia of a body is written as principal moments and axes in its ``<inertial>``, and values of a joint at the
    joint, also where the old ones came from geoms or defaults. Bodies that are
    welded to a moving one get an ``<inertial>`` without mass, so that the total is the estimate. Bodies on *locked*
    joints keep theirs, which is taken from the estimate, or a part of it where no possible body would remain. Where a
    body has several joints, and the estimate says that something moves between them, a body is put there.

    Settings of the compiler that would change what is written are taken out: ``settotalmass``, and ``boundmass``,
    ``boundinertia`` and ``inertiafromgeom="true"`` where they matter; the other bodies then get the inertias that they
    had by those. Included files in which something changes are put in the place of their ``<include>``. Where the
    target is in another folder, the paths to other files are made absolute. A copy of a description of which nothing
    changes is the same, byte for byte.

    What is written is read again and compared before the target appears, which is whole or not there.

    Parameters
    ----------
    robot : Robot
        The robot that was read from `source`.
    parameters : (n,) array
        Values of `robot.parameter_names`.
    drives : Drives
        Of each coordinate; NaN leaves a value as it was. They include what the mimic joints of the coordinate add,
        which get 0. Springs and powers of the speed are as MuJoCo 4.0 reads them. The offset of a joint with a spring
        goes into its ``springref``. That of others, for which MJCF has no place, stands in ``<custom>`` as the number
        with the name ``steelyard:offset:`` and that of the joint; the stiffness and the damping of the transmission of
        an elastic joint likewise, ``steelyard:stiffness:`` and ``steelyard:transmission_damping:``.
    source : str or Path
        The MJCF to copy.
    target : str or Path
        The file to write; an existing file is replaced.

    Raises
    ------
    InputError
        When an array has the wrong size, a link's mass is not positive, its moments of inertia are such that MuJoCo
        refuses them, a value of a joint is negative, a body is a copy that MuJoCo makes (``<replicate>``,
        ``<attach>``), `source` is not the robot's MJCF, or `target` is `source`.
    MissingExtraError
        When it takes MuJoCo to read the source, which is not installed.

    Examples
    --------
    >>> import tempfile
    >>> from steelyard.robot import Drives
    >>> text = '''<mujoco model="door"><default><joint damping="0.4"/></default>
    ... <worldbody><body name="leaf"><joint name="hinge"/><geom size="0.1"/></body></worldbody></mujoco>'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     source, target = Path(folder) / "door.xml", Path(folder) / "weighed.xml"
    ...     _ = source.write_text(text)
    ...     robot = Robot.from_mjcf(source)
    ...     leaf = Inertia.from_com(mass=12.0, com=(0.5, 0.0, 1.0), about_com=np.diag([4.0, 4.5, 0.75]))
    ...     drives = Drives.unknown(1).with_known(damping=[0.3], rotor_inertia=[0.02])
    ...     write_mjcf(robot, leaf.parameters, drives, source, target)
    ...     print(target.read_text())
    <mujoco model="door"><default><joint damping="0.4"/></default>
    <worldbody><body name="leaf"><inertial pos="0.5 0.0 1.0" mass="12.0" diaginertia="4.0 4.5 0.75"/><joint
    name="hinge" damping="0.3" armature="0.02"/><geom size="0.1"/></body></worldbody></mujoco>
    """
    source, target = Path(source), Path(target)
    drives = drives.with_offsets_in_springs()
    changes = description_changes(robot, parameters, drives.held_by_joints())
    own = {
        OWN_NUMBER.format(key, name): drives.told(key, name, k)
        for key in drives.without_joint
        if key not in SPRINGS_AND_POWERS
        for k, name in enumerate(robot.joint_names)
    }
    require_target(source, target, robot, "MJCF")
    if not changes and all(math.isnan(value) for value in own.values()) and not drives.told_where_present():
        write_bytes(read_bytes(source, remedy="give the path of an MJCF file"), target)
        return
    read = read_mjcf_tree(source)
    require_robot(source, robot, "MJCF", read.tree.links, read.tree.joints, "body")
    writer = MjcfWriter(read, changes)
    writer.set_own({name: value for name, value in own.items() if not math.isnan(value)})
    writer.set_springs_and_powers(robot, drives)
    if not changes and not any(file.edit.edited for file in read.document.files):
        write_bytes(read.document.files[0].edit.data, target)
        return
    data = writer.edited(source.resolve().parent, target.resolve().parent)
    writer.require_read_back(read_mjcf_tree(target, data))
    write_bytes(data, target)


class MjcfWriter:
    """The edits of an MJCF by changes of links and joints, and the file with all of them, maybe in another folder."""

    def __init__(self, read: MjcfTree, changes: DescriptionChanges) -> None:
        self.read, self.document, self.changes = read, read.document, changes
        self.rows = dict(zip(read.body_names, read.compiled.bodies, strict=True))
        self.joint_rows = dict(zip(read.joint_names, read.compiled.joints, strict=True))
        self.springs = any("springdamper" in one.attributes for one in self.document.root.iterate())
        self.between = {link for link in read.link_of.values() if link not in self.rows}
        allowed = {name: _allowed(name, inertia) for name, inertia in changes.inertias.items()}
        self.inertias = {name: inertia for name, inertia in allowed.items() if name in self.rows}
        self.inertias_between = {name: inertia for name, inertia in allowed.items() if name in self.between}
        self.inertias |= {name: Inertia.zero() for name in changes.emptied if self._weighs(name)}

    def _weighs(self, name: str) -> bool:
        return name in self.rows and bool(self.rows[name]["inertia"].parameters.any())

    def edited(self, source: Path, target: Path) -> bytes:
        """Return the file with all edits; `source` and `target` are folders."""
        if self.inertias or self.inertias_between:
            self._settle_compiler()
        for name, inertia in self.inertias.items():
            self._set_inertial(self._element(name, "body"), inertia)
        for name, values in self.changes.drives.items():
            joint = self._element(name, "joint")
            texts = {DRIVE_ATTRIBUTES[key]: number_text(value) for key, value in values.items()}
            if "damping" in values and self.springs:  # MuJoCo would replace the damping by that of the spring
                stiffness = self.joint_rows[name]["stiffness"]
                texts |= {"springdamper": "0 0", "stiffness": number_text(stiffness)}
            joint.file.edit.set_attributes(joint.place, texts)
            self.take_from_actuators(name, texts.keys() & OF_ACTUATORS)
        joints = self.document.body_of.items()
        parted = [body for joint, body in joints if self.read.link_of.get(joint) in self.inertias_between]
        if parted:
            # Bodies that are added would change the names that are made for others.
            for name, element in (*self.document.bodies.items(), *self.document.joints.items()):
                if name not in parted and not element.place.attributes.get("name"):
                    element.file.edit.set_attributes(element.place, {"name": _attribute(name)})
        for name in dict.fromkeys(parted):
            self._put_between(name)
        if source != target:
            self._find_assets(source)
        self._join(source, target)
        return self.document.files[0].edit.result()

    def take_from_actuators(self, joint: str, keys: Collection[str]) -> None:
        """Leave the joint alone with what its actuators give it, too, such as armature."""
        index = self.read.joint_names.index(joint)
        given = self.read.compiled.of_actuators(index)
        zeros = {key: "0" for key in keys if given[key]}
        for element in (one for section in self.document.root.all("actuator") for one in section.children):
            if zeros and joint in (element.attributes.get(key) for key in ON_JOINT):
                element.file.edit.set_attributes(element.place, zeros)

    def set_own(self, numbers: Mapping[str, float]) -> None:
        """Write what MJCF does not have, such as constant torques, as numbers of the user."""
        sections = list(self.document.root.all("custom"))
        held = {one.attributes.get("name"): one for section in sections for one in section.all("numeric")}
        lines = []
        for name, value in numbers.items():
            data = number_text(value)
            if name not in held:
                lines.append(tag_text("numeric", {"name": _attribute(name), "data": data}))
            elif held[name].attributes.get("data") != data:
                held[name].file.edit.set_attributes(held[name].place, {"data": data})
        if lines:
            first = self.document.files[0].edit
            first.insert_last(first.root, "<custom>", *(f"  {line}" for line in lines), "</custom>")

    def set_springs_and_powers(self, robot: Robot, drives: Drives) -> None:
        """Write springs, and damping as a polynomial ``d0 + d1 |v| + d2 v²`` of the speed."""
        told = drives.told_where_present()
        degrees = self.document.setting("compiler", "angle") != "radian"
        for index, name in zip(robot.driving_joints, robot.joint_names, strict=True):
            joint = robot.joints[index]
            own = {key: float(values[joint.coordinate]) for key, values in told.items()}
            texts: dict[str, str] = {}
            if math.isfinite(own.get("spring_stiffness", math.nan)):
                rest = math.degrees(own["spring_rest"]) if degrees and joint.rotates else own["spring_rest"]
                texts |= {"stiffness": number_text(own["spring_stiffness"]), "springref": number_text(rest)}
            powers = [own.get(key, 0.0) for key in ("quadratic_damping", "cubic_damping")]
            if any(powers):
                first = float(drives.damping[joint.coordinate])
                first = joint.damping if math.isnan(first) else first
                linear = 0.0 if math.isnan(first) else first
                texts["damping"] = " ".join(number_text(value) for value in (linear, *powers))
                self.changes.drives.get(name, {}).pop("damping", None)
            if texts:
                element = self._element(name, "joint")
                element.file.edit.set_attributes(element.place, texts)
                self.take_from_actuators(name, texts.keys() & OF_ACTUATORS)

    def _element(self, name: str, what: str) -> MjcfElement:
        found = (self.document.bodies if what == "body" else self.document.joints).get(name)
        if found is None:
            raise InputError(
                f'{self.document.path}: the {what} "{name}" is a copy that MuJoCo makes and has no element of its own, '
                "in which its values could be written; save the model as it is compiled, and identify with that file"
            )
        return found

    def _settle_compiler(self) -> None:
        """Take out the settings that would change the inertias that are written, and write those that they made."""
        taken = []
        if self.document.setting("compiler", "settotalmass") is not None:
            taken.append("settotalmass")
        if self.document.setting("compiler", "inertiafromgeom") == "true":
            taken.append("inertiafromgeom")
        for key in ("boundmass", "boundinertia"):
            bound = float(self.document.setting("compiler", key) or 0.0)
            written = (*self.inertias.values(), *self.inertias_between.values())
            if bound > 0.0 and any(_least(one)[key] < bound for one in written):
                taken.append(key)
        if not taken:
            return
        for element in self.document.root.all("compiler"):
            element.file.edit.remove_attributes(element.place, taken)
        moving = self.read.compiled.moving()
        for index, (name, row) in enumerate(self.rows.items()):
            if name not in self.inertias and self._weighs(name) and (index in moving or "settotalmass" in taken):
                self.inertias[name] = row["inertia"]

    def _set_inertial(self, body: MjcfElement, inertia: Inertia) -> None:
        edit, values = body.file.edit, _inertial(inertia)
        inertial = next(body.all("inertial"), None)
        if inertial is None:
            edit.insert_first(body.place, tag_text("inertial", values))
            return
        stale = [key for key in OTHER_INERTIA if key not in values]
        inertial.file.edit.remove_attributes(inertial.place, stale)
        inertial.file.edit.set_attributes(inertial.place, values)

    def _put_between(self, name: str) -> None:
        """Put bodies between the joints of a body where the estimate has mass there."""
        joints = [joint for joint, body in self.document.body_of.items() if body == name]
        links = [self.read.link_of.get(joint, name) for joint in joints]
        body = self._element(name, "body")
        own = [one for one in body.children if one.tag == "joint"]
        if len(own) < len(joints) or any(one.file is not body.file for one in own):
            raise InputError(
                f'{body.where}: joints of the body "{name}" stand in a frame or in an included file, so that nothing '
                "can be put between them; write them into the body"
            )
        edit = body.file.edit
        pieces: list[str] = []
        waiting: list[bytes] = []
        opened = 0
        first = ""
        for joint, link in zip(own, links, strict=True):
            if link not in self.between:  # the joints before the body itself stay in it
                break
            waiting.append(edit.take(joint.place))
            if link in self.inertias_between:
                text = b"".join(waiting).decode("utf-8")
                inner = tag_text("inertial", _inertial(self.inertias_between[link])) + text
                pieces.append(inner if not opened else f'<body name="{_attribute(link)}">{inner}')
                first = first or link
                opened, waiting = opened + 1, []
        rest = b"".join(waiting).decode("utf-8")
        pieces.append(f'<body name="{_attribute(name)}">{rest}')
        edit.set_attributes(body.place, {"name": _attribute(first)})
        edit.insert_at_start(body.place, "".join(pieces))
        edit.insert_at_end(body.place, "</body>" * opened)

    def _find_assets(self, source: Path) -> None:
        """Make the paths of meshes and textures absolute."""
        needed: dict[str, bool] = {}
        for element in self.document.root.iterate():
            named = [key for key in element.attributes if key.startswith("file")]
            if element.tag == "model" and named:
                path = {"file": _attribute(source / element.attributes["file"])}
                element.file.edit.set_attributes(element.place, path)
            elif element.tag in FOLDERS and named:
                needed[FOLDERS[element.tag]] = True
        compilers = list(self.document.root.all("compiler"))
        missing = {}
        for key in needed:
            holders = [one for one in compilers if key in one.attributes]
            if not holders:
                missing[key] = _attribute(source / (self.document.setting("compiler", "assetdir") or ""))
            for one in holders:
                one.file.edit.set_attributes(one.place, {key: _attribute(source / one.attributes[key])})
        if missing and compilers:
            compilers[-1].file.edit.set_attributes(compilers[-1].place, missing)
        elif missing:
            first = self.document.files[0].edit
            first.insert_first(first.root, tag_text("compiler", missing))

    def _join(self, source: Path, target: Path) -> None:
        """Put included files that changed in the places of their includes; name the others where they are."""
        files = self.document.files
        for file in reversed(files[1:]):
            if file.include is None:
                continue
            outer, place = file.include
            nested = any(one.include is not None and one.include[0] is file for one in files)
            if file.edit.edited or (nested and source != target):
                outer.edit.replace(place, _as_utf8(file, file.edit.content()))
            elif source != target:
                outer.edit.set_attributes(place, {"file": _attribute(file.path.resolve())})

    def require_read_back(self, again: MjcfTree) -> None:
        """Refuse to write what is read as something else."""
        rows = dict(zip(again.body_names, again.compiled.bodies, strict=True))
        for name, inertia in {**self.inertias, **self.inertias_between}.items():
            found = rows[name]["inertia"] if name in rows else Inertia.zero()
            if not is_same(inertia.parameters, found.parameters, READ_BACK):
                raise InputError(
                    f'{self.document.path}: another inertia is read of the body "{name}" than was written, '
                    f"{found} for {inertia}; give it an <inertial> in the file"
                )
        joints = dict(zip(again.joint_names, again.compiled.joints, strict=True))
        for name, values in self.changes.drives.items():
            for key, value in values.items():
                row_key = "armature" if key == "rotor_inertia" else key
                if abs(joints[name][row_key] - value) > READ_BACK * abs(value):
                    raise InputError(
                        f"{self.document.path}: {joints[name][row_key]:g} is read as the {row_key} of the joint "
                        f'"{name}", for which {value:g} was written; give it the attribute in the file'
                    )


def _least(inertia: Inertia) -> dict[str, float]:
    """Return what the bounds of the compiler are compared with."""
    if inertia.mass == 0.0:
        return {"boundmass": 0.0, "boundinertia": 0.0}
    return {"boundmass": inertia.mass, "boundinertia": float(np.linalg.eigvalsh(inertia.about_com)[0])}


def _allowed(name: str, inertia: Inertia) -> Inertia:
    """Return an inertia that MuJoCo takes: the same one, or one whose moments are larger by next to nothing.

    Raises
    ------
    InputError
        If next to nothing is not enough, as of estimates that are consistent in their inertia alone: with moments that
        were enlarged by as much as it takes, the torques of a simulated arm were off by 10.6 %, and by 2.8 % as
        estimated.
    """
    moments = np.linalg.eigvalsh(inertia.about_com)
    short = max(moments[2] * (1.0 + MARGIN) - moments[0] - moments[1], LEAST - moments[0])
    if short <= 0.0:
        return inertia
    if short > max(ROUNDING * float(np.trace(inertia.about_origin)), 2.0 * LEAST):
        told = ", ".join(f"{value:.3g}" for value in moments)
        raise InputError(
            f'body "{name}": its principal moments of inertia would be {told} kg·m², of which one exceeds the sum of '
            'the others, so that MuJoCo refuses the file; use the consistency "full"'
        )
    return Inertia(inertia.mass, inertia.first_moment, inertia.about_origin + short * np.eye(3))


def _inertial(inertia: Inertia) -> dict[str, str]:
    # `fullinertia` would be plainer, but MuJoCo 3.2 finds its axes to 1e-6 alone.
    if inertia.mass == 0.0:
        return {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}
    second = (inertia.about_com + inertia.about_com.T) / 2
    moments, texts = np.diagonal(second), {}
    if np.count_nonzero(second) > np.count_nonzero(moments):
        moments, axes = np.linalg.eigh(second)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        turn = Rotation.from_matrix(axes).as_quat(canonical=True, scalar_first=True)
        texts = {"quat": _texts(turn)}
    return {"pos": _texts(inertia.com), **texts, "mass": number_text(inertia.mass), "diaginertia": _texts(moments)}


def _as_utf8(file: MjcfFile, content: bytes) -> bytes:
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"{file.path}: it cannot be put into another file; save it as UTF-8") from None
    return content


def _attribute(value: str | Path) -> str:
    return attribute_text(value.as_posix() if isinstance(value, Path) else value)


def _texts(values: Iterable[float]) -> str:
    return " ".join(number_text(value) for value in values)
