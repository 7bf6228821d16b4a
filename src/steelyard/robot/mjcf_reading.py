"""Our own reading of an MJCF: bodies, joints, and the inertias that are written or follow from simple solids.

It comes to what MuJoCo compiles, without MuJoCo, for all but meshes that weigh, copies that MuJoCo makes, and what this
file does not know; these are left to MuJoCo. Rules that the documentation of the format does not tell are those of its
compiler, with which the tests compare.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown, suggestion

from .inertia import (
    Inertia,
    box_moments,
    capsule_moments,
    cylinder_moments,
    ellipsoid_moments,
    inertia_tensor,
    parameters_of_pseudo_inertia,
)
from .mjcf_classes import ACTUATORS, ORIENTATIONS, DefaultClasses
from .mjcf_compiled import BODY, EQUALITIES, IDLE, JOINT_KINDS, ON_JOINT, SITE, CompiledMjcf
from .mjcf_document import JOINTS, MjcfDocument, MjcfElement
from .placement import quaternion_rotation, rotation_x, rotation_y, rotation_z, snapped
from .xml_document import SHORTEST_AXIS

__all__ = ["FEATHERLESS", "BeyondReadingError", "MjcfReader", "read_compiled"]

Matrix = NDArray[np.float64]
Attributes = Mapping[str, str]

ON_SOMETHING_ELSE = -1

PLACED = ("name", "class", "childclass", "pos", *ORIENTATIONS)
KNOWN = {
    "body": (*PLACED, "mocap", "gravcomp", "user", "sleep"),
    "frame": PLACED,
    "inertial": ("pos", "mass", "diaginertia", "fullinertia", *ORIENTATIONS),
    "freejoint": ("name", "group", "align"),
    "joint": (
        "name", "class", "group", "type", "pos", "axis", "range", "limited", "stiffness", "damping", "armature",
        "frictionloss", "ref", "springref", "springdamper", "margin", "user", "actuatorfrcrange", "actuatorfrclimited",
        "actuatorgravcomp", "solreflimit", "solimplimit", "solreffriction", "solimpfriction",
    ),
    "geom": (
        *PLACED, "type", "size", "fromto", "mass", "density", "shellinertia", "mesh", "hfield", "fitscale", "group",
        "material", "rgba", "contype", "conaffinity", "condim", "priority", "friction", "solmix", "solref", "solimp",
        "margin", "gap", "fluidshape", "fluidcoef", "user",
    ),
    "compiler": (
        "angle", "eulerseq", "autolimits", "inertiafromgeom", "inertiagrouprange", "boundmass", "boundinertia",
        "balanceinertia", "settotalmass", "coordinate", "meshdir", "texturedir", "assetdir", "strippath",
        "discardvisual", "fusestatic", "usethread", "saveinertial", "alignfree", "fitaabb", "convexhull",
    ),
}  # fmt: skip
"""Attributes that are understood, or have nothing to do with what moves and weighs."""

LIGHT = ("site", "camera", "light")
FEATHERLESS = ("plane", "hfield")
"""Types of geoms that have neither mass nor a shape that ends."""


class BeyondReadingError(Exception):
    """An MJCF holds something that only MuJoCo reads; the message names it, as the subject of a sentence."""


def read_compiled(document: MjcfDocument) -> CompiledMjcf:
    """Return what MuJoCo would compile.

    Raises
    ------
    InputError
        If the description is wrong.
    BeyondReadingError
        If it takes MuJoCo to read it.
    """
    return MjcfReader(document).compiled()


class MjcfReader:
    """Reads the elements of a description."""

    def __init__(self, document: MjcfDocument) -> None:
        self.document = document
        for section in document.root.all("compiler", "option", "default"):
            for element in section.iterate():
                element.require_numbers()
                self.require_known(element)
        self.classes = DefaultClasses(document)
        if document.setting("compiler", "coordinate") not in (None, "local"):
            raise BeyondReadingError(f'{document.path}: coordinate="global"')
        self.unit = 1.0 if self.chosen("angle", ("degree", "radian")) == "radian" else math.pi / 180.0
        self.limits_follow = self.chosen("autolimits", ("true", "false")) == "true"
        self.from_geoms = self.chosen("inertiafromgeom", ("auto", "true", "false"))
        self.balances = self.chosen("balanceinertia", ("false", "true")) == "true"
        self.sequence = document.setting("compiler", "eulerseq") or "xyz"
        if len(self.sequence) != 3 or set(self.sequence.lower()) - set("xyz"):
            raise InputError(f"{document.path}: eulerseq must be three of x, y, z, X, Y, Z, got {shown(self.sequence)}")
        self.groups = self.settings("inertiagrouprange", 2) or (-math.inf, math.inf)
        self.least_mass, self.least_moment, self.total_mass = (
            (self.settings(key, 1) or (0.0,))[0] for key in ("boundmass", "boundinertia", "settotalmass")
        )
        self.bodies: list[dict[str, Any]] = []
        self.joints: list[dict[str, Any]] = []

    def chosen(self, key: str, words: Sequence[str]) -> str:
        """Return a word of the compiler, by default the first one."""
        found = self.document.setting("compiler", key) or words[0]
        if found not in words:
            raise InputError(
                f"{self.document.path}: {key} of <compiler> must be {' or '.join(words)}, got {shown(found)}"
            )
        return found

    def settings(self, key: str, count: int) -> tuple[float, ...] | None:
        """Return numbers of the compiler."""
        text = self.document.setting("compiler", key)
        return None if text is None else _floats(text, str(self.document.path), "compiler", key, count)

    def compiled(self) -> CompiledMjcf:
        """See `read_compiled`."""
        self.bodies.append(self.body_row("world", 0, np.eye(4)))
        for world in self.document.root.all("worldbody"):
            inherited = self.classes.name(world, key="childclass")
            self.read_body(world, 0, inherited, np.eye(4), moves=False)
        if self.total_mass > 0.0:
            factor = self.total_mass / max(sum(row["inertia"].mass for row in self.bodies), 1e-15)
            for row in self.bodies:
                row["inertia"] = Inertia.from_parameters(factor * row["inertia"].parameters)
        indices = {
            "body": _indices(self.bodies, "body", self.document), "joint": _indices(self.joints, "joint", self.document)
        }  # fmt: skip
        tendons = list(self.tendons(indices["joint"]))
        indices["tendon"] = _indices(tendons, "tendon", self.document)
        return CompiledMjcf(
            self.gravity(), self.bodies, self.joints, list(self.equalities(indices)),
            list(self.actuators(indices["joint"])), tendons,
        )  # fmt: skip

    def gravity(self) -> list[float]:
        """Return the gravity of the simulation."""
        flags = [flag.attributes.get("gravity") for one in self.document.root.all("option") for flag in one.all("flag")]
        if [flag for flag in flags if flag is not None][-1:] == ["disable"]:
            return [0.0, 0.0, 0.0]
        text = self.document.setting("option", "gravity")
        return list(
            (0.0, 0.0, -9.81) if text is None else _floats(text, str(self.document.path), "option", "gravity", 3)
        )

    # Bodies

    def read_body(self, element: MjcfElement, index: int, inherited: str, frame: Matrix, moves: bool) -> None:
        """Read what is in a body that has its row, and the bodies in it."""
        inside = list(self.inside(element, inherited, frame))
        joints = [(one, name, place) for one, name, place in inside if one.tag in JOINTS]
        moves = moves or bool(joints)
        for one, name, place in joints:
            self.joints.append(self.joint_row(one, index, self.joint_attributes(one, name), place))
        if index:
            self.bodies[index]["inertia"] = self.inertia(inside, moves)
        elif joints:
            raise InputError(f"{joints[0][0].where}: the world has a joint; put it into a body")
        for one, name, place in inside:
            if one.tag == "body":
                placed = place @ self.placement(one, one.attributes)
                self.bodies.append(self.body_row(one.attributes["name"], index, placed, one))
                self.read_body(one, len(self.bodies) - 1, name, np.eye(4), moves)

    def inside(self, element: MjcfElement, inherited: str, frame: Matrix) -> Iterator[tuple[MjcfElement, str, Matrix]]:
        """Yield what is in a body, also in frames: elements, their classes, and the frames around them in the body."""
        for child in element.children:
            if child.tag in LIGHT:
                continue
            if child.tag not in KNOWN:
                raise BeyondReadingError(f"{child.where}: <{shown(child.tag)[1:-1]}>")
            child.require_numbers()
            self.require_known(child)
            own = self.classes.name(child, inherited, "childclass") if child.tag in ("body", "frame") else inherited
            if child.tag == "frame":
                yield from self.inside(child, own, frame @ self.placement(child, child.attributes))
            else:
                yield child, own, frame

    def body_row(self, name: str, parent: int, placement: Matrix, element: MjcfElement | None = None) -> dict[str, Any]:
        """Return the row of a body, without its inertia; the world is no element."""
        own = {} if element is None else element.attributes
        return {
            "name": name,
            "parentid": parent,
            "placement": placement,
            "inertia": Inertia.zero(),
            "mocapid": 0 if own.get("mocap") == "true" else -1,
            "gravcomp": 0.0 if element is None else self.number(element, own, "gravcomp", 0.0),
        }

    # Inertias

    def inertia(self, inside: Sequence[tuple[MjcfElement, str, Matrix]], moves: bool) -> Inertia:
        """Return the inertia of a body in its frame."""
        written = [one for one, _, _ in inside if one.tag == "inertial"]
        if len(written) > 1:
            raise InputError(f"{written[1].where}: a body has two <inertial>; keep one")
        if written and self.from_geoms != "true":
            mass, center, about = self.written_inertia(written[0])
        elif self.from_geoms == "false":
            mass, center, about = 0.0, np.zeros(3), np.zeros((3, 3))
        else:
            mass, center, about = self.weighed(inside, needed=moves or self.total_mass > 0.0)
        if self.least_mass > 0.0:  # else a mass below zero stays, which is told as the fault that it is
            mass = max(mass, self.least_mass)
        if self.least_moment > 0.0 or self.balances:
            moments, axes = np.linalg.eigh(about)
            moments = np.maximum(moments, self.least_moment)
            if self.balances and moments[2] > moments[0] + moments[1]:
                moments[:] = moments.mean()
            about = (axes * moments) @ axes.T
        return Inertia.from_com(mass, center, (about + about.T) / 2)

    def written_inertia(self, element: MjcfElement) -> tuple[float, Matrix, Matrix]:
        """Return mass, centre of mass, and the inertia about it in the axes of the body."""
        own = element.attributes
        given = [key for key in ("diaginertia", "fullinertia") if key in own]
        if "pos" not in own or "mass" not in own or len(given) != 1:
            raise BeyondReadingError(f"{element.where}: an <inertial> without pos, mass or one kind of inertia")
        turn = self.rotation(element, own)
        if given == ["diaginertia"]:
            about = np.diag(_floats(own["diaginertia"], element.where, "inertial", "diaginertia", 3))
        elif any(key in own for key in ORIENTATIONS):
            raise InputError(f"{element.where}: fullinertia is in the axes of the body; remove the orientation")
        else:
            xx, yy, zz, xy, xz, yz = _floats(own["fullinertia"], element.where, "inertial", "fullinertia", 6)
            about = inertia_tensor((xx, xy, xz, yy, yz, zz))
        mass = self.number(element, own, "mass", 0.0)
        return mass, np.array(_floats(own["pos"], element.where, "inertial", "pos", 3)), turn @ about @ turn.T

    def weighed(self, inside: Sequence[tuple[MjcfElement, str, Matrix]], needed: bool) -> tuple[float, Matrix, Matrix]:
        """Return what the geoms of a body weigh, as `written_inertia`; shapes that are not `needed` may be meshes."""
        total = np.zeros((4, 4))
        for one, inherited, frame in inside:
            if one.tag == "geom":
                attributes = self.classes.attributes(one, inherited)
                try:
                    total += self.solid(one, attributes, frame)
                except BeyondReadingError:
                    if needed:
                        raise
        if total[3, 3] <= 0.0:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        body = Inertia.from_parameters(parameters_of_pseudo_inertia(total))
        return body.mass, body.com, body.about_com

    def solid(self, geom: MjcfElement, attributes: Attributes, frame: Matrix) -> Matrix:
        """Return the pseudo-inertia (4, 4) of a geom in the frame of the body."""
        mass = self.number(geom, attributes, "mass", math.nan)
        density = self.number(geom, attributes, "density", 1000.0)
        group = self.number(geom, attributes, "group", 0.0)
        kind = attributes.get("type", "sphere")
        weightless = mass == 0.0 or (math.isnan(mass) and density == 0.0)
        if weightless or kind in FEATHERLESS or not self.groups[0] <= group <= self.groups[1]:
            return np.zeros((4, 4))
        if mass < 0.0 or density < 0.0:
            raise InputError(f"{geom.where}: a geom weighs less than nothing; give a positive mass or density")
        if "mesh" in attributes or kind in ("mesh", "sdf"):
            raise BeyondReadingError(f"{geom.where}: an inertia that follows from a mesh")
        if attributes.get("shellinertia", "false") != "false":
            raise BeyondReadingError(f"{geom.where}: the inertia of a shell")
        size, placement = self.sized(geom, attributes)
        moments = solid_of(kind, size, geom.where)
        placed = frame @ placement
        scale = density if math.isnan(mass) else mass / moments[3, 3]
        return np.asarray(scale * placed @ moments @ placed.T)

    def sized(self, geom: MjcfElement, attributes: Attributes) -> tuple[tuple[float, ...], Matrix]:
        """Return the three numbers of the size of a geom, and its placement (4, 4) in the frame around it."""
        size = [0.0, 0.0, 0.0]
        if "size" in attributes:
            given = _floats(attributes["size"], geom.where, "geom", "size", 1, 3)
            size[: len(given)] = given
        if "fromto" not in attributes:
            return tuple(size), self.placement(geom, attributes)
        ends = np.array(_floats(attributes["fromto"], geom.where, "geom", "fromto", 6)).reshape(2, 3)
        kind, along = attributes.get("type", "sphere"), ends[0] - ends[1]
        length = float(np.linalg.norm(along))
        if kind not in ("capsule", "cylinder", "box", "ellipsoid") or length < SHORTEST_AXIS:
            raise BeyondReadingError(f"{geom.where}: a {kind} that goes from one point to another")
        if kind in ("capsule", "cylinder"):
            size[1] = length / 2.0
        else:
            size[1:] = size[0], length / 2.0
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = _z_to(along / length), ends.mean(axis=0)
        return tuple(size), placement

    def geoms(self) -> Iterator[tuple[str, MjcfElement, dict[str, str], Matrix]]:
        """Yield the geoms: the name of the body, the element, its attributes, and the frame (4, 4) around it."""
        waiting = [
            ("world", one, self.classes.name(one, key="childclass")) for one in self.document.root.all("worldbody")
        ]
        while waiting:
            name, body, inherited = waiting.pop()
            for one, own, frame in self.inside(body, inherited, np.eye(4)):
                if one.tag == "geom":
                    yield name, one, self.classes.attributes(one, own), frame
                elif one.tag == "body":
                    waiting.append((one.attributes["name"], one, own))

    def numbers(
        self, element: MjcfElement, attributes: Attributes, key: str, default: tuple[float, ...], step: int = 0
    ) -> tuple[float, ...]:
        """Return the numbers of an attribute, as many as the default has, or a multiple of `step`."""
        if key not in attributes:
            return default
        count = len(default) if not step else len(attributes[key].split()) // step * step
        return _floats(attributes[key], element.where, element.tag, key, count)

    def number(self, element: MjcfElement, attributes: Attributes, key: str, default: float) -> float:
        """Return the number of an attribute."""
        return self.numbers(element, attributes, key, (default,))[0]

    # Joints

    def joint_attributes(self, element: MjcfElement, inherited: str) -> dict[str, str]:
        """Return the attributes of a joint with those of its class."""
        if element.tag == "freejoint":
            return {"name": element.attributes["name"], "type": "free"}
        return self.classes.attributes(element, inherited)

    def joint_row(self, element: MjcfElement, body: int, attributes: Attributes, frame: Matrix) -> dict[str, Any]:
        """Return the row of a joint; `frame` is the one around it in its body."""
        where, kind = element.where, attributes.get("type", "hinge")
        if kind not in JOINT_KINDS:
            raise InputError(f"{where}: the type of a joint is {' or '.join(JOINT_KINDS)}, got {shown(kind)}")
        if kind == "free" and (self.bodies[body]["parentid"] or any(row["bodyid"] == body for row in self.joints)):
            raise InputError(f"{where}: a free joint is the only joint of a body in the world")
        unit = self.unit if kind in ("hinge", "ball") else 1.0
        number, numbers = partial(self.number, element, attributes), partial(self.numbers, element, attributes)
        if any(numbers("springdamper", (0.0, 0.0))):
            raise BeyondReadingError(f"{where}: a springdamper, whose damping follows from inertias")
        axis = frame[:3, :3] @ np.array(numbers("axis", (0.0, 0.0, 1.0)))
        length = float(np.linalg.norm(axis))
        if length < SHORTEST_AXIS:
            raise InputError(f"{where}: the axis of a joint is {shown(attributes['axis'])}; give its direction")
        pos = (0.0, 0.0, 0.0) if kind == "free" else numbers("pos", (0.0, 0.0, 0.0))
        limited, limits = self.limits(attributes, "limited", numbers("range", (0.0, 0.0)), where)
        drives, force = self.limits(attributes, "actuatorfrclimited", numbers("actuatorfrcrange", (0.0, 0.0)), where)
        damping, stiffness = (
            _floats(attributes.get(key, "0"), where, "joint", key, 1, 3) for key in ("damping", "stiffness")
        )
        return {
            "name": attributes["name"],
            "type": JOINT_KINDS[kind],
            "bodyid": body,
            "pos": (frame @ np.array([*pos, 1.0]))[:3].tolist(),
            "axis": (axis / length).tolist(),
            "range": [unit * value for value in limits],
            "limited": limited,
            "stiffness": stiffness[0],
            "actfrclimited": drives,
            "actfrcrange": list(force),
            "armature": number("armature", 0.0),
            "damping": damping[0],
            "friction": number("frictionloss", 0.0),
            "ref": (unit if kind == "hinge" else 1.0) * number("ref", 0.0),
            "poly": any(damping[1:]),
        }

    def limits(
        self, attributes: Attributes, key: str, limits: tuple[float, ...], where: str
    ) -> tuple[bool, tuple[float, ...]]:
        """Return whether limits hold, and the limits."""
        word = attributes.get(key, "auto")
        if word not in ("auto", "true", "false"):
            raise InputError(f"{where}: {key} must be true, false or auto, got {shown(word)}")
        if word == "auto" and any(limits) and not self.limits_follow:
            raise InputError(f'{where}: a joint has limits, but not whether they hold; write {key}="true" or "false"')
        holds = word == "true" or (word == "auto" and any(limits))
        if holds and not limits[0] < limits[1]:
            raise InputError(f"{where}: the lower limit {limits[0]:g} is not below the upper limit {limits[1]:g}")
        return holds, limits

    # Orientations

    def placement(self, element: MjcfElement, attributes: Attributes) -> Matrix:
        """Return the placement (4, 4) of an element in the frame around it."""
        placement = np.eye(4)
        placement[:3, :3] = self.rotation(element, attributes)
        if "pos" in attributes:
            placement[:3, 3] = _floats(attributes["pos"], element.where, element.tag, "pos", 3)
        return placement

    def rotation(self, element: MjcfElement, attributes: Attributes) -> Matrix:
        """Return the rotation (3, 3) of an element."""
        found = [key for key in ORIENTATIONS if key in attributes]
        if not found:
            return np.eye(3)
        if len(found) > 1:
            raise InputError(f"{element.where}: <{element.tag}> has {' and '.join(found)}; keep one orientation")
        key = found[0]
        count = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}[key]
        numbers = np.array(_floats(attributes[key], element.where, element.tag, key, count))
        if key == "euler":
            turn = np.eye(4)
            for letter, angle in zip(self.sequence, numbers * self.unit, strict=True):
                step = {"x": rotation_x, "y": rotation_y, "z": rotation_z}[letter.lower()](float(angle))
                # Small letters turn about axes that move along.
                turn = turn @ step if letter.islower() else step @ turn
            return turn[:3, :3]
        direction = numbers if key in ("quat", "zaxis") else numbers[:3]
        length = float(np.linalg.norm(direction))
        if length < SHORTEST_AXIS:
            raise InputError(f"{element.where}: {key} of <{element.tag}> has no direction; give a rotation")
        direction = direction / length
        if key == "quat":
            return snapped(quaternion_rotation(*direction))
        if key == "zaxis":
            return _z_to(direction)
        if key == "axisangle":
            half = 0.5 * numbers[3] * self.unit
            return snapped(quaternion_rotation(math.cos(half), *(math.sin(half) * direction)))
        second = numbers[3:] - (direction @ numbers[3:]) * direction
        if np.linalg.norm(second) < SHORTEST_AXIS:
            raise InputError(f"{element.where}: the axes of <{element.tag}> are one; give two directions")
        second = second / np.linalg.norm(second)
        return snapped(np.column_stack([direction, second, np.cross(direction, second)]))

    # Couplings and drives

    def equalities(self, indices: Mapping[str, Mapping[str, int]]) -> Iterator[dict[str, Any]]:
        """Yield the rows of what holds always."""
        for element in (one for section in self.document.root.all("equality") for one in section.children):
            if element.tag not in EQUALITIES:
                raise BeyondReadingError(f"{element.where}: the equality <{shown(element.tag)[1:-1]}>")
            element.require_numbers()
            own = self.classes.attributes(element, tag="equality")
            row = {"name": own.get("name", ""), "type": EQUALITIES[element.tag], "objtype": None, "data": [0.0] * 11}
            row["active0"] = own.get("active", "true") == "true"
            noun = "body" if element.tag in ("connect", "weld") else element.tag
            ends: list[int] = []
            if noun == "body" and "body1" not in own:
                row["objtype"] = SITE
                ends = [-1, -1]
            else:
                row["objtype"] = BODY if noun == "body" else None
                first = self.index(own, f"{noun}1", indices[noun], element)
                nothing = 0 if noun == "body" else -1
                second = self.index(own, f"{noun}2", indices[noun], element) if own.get(f"{noun}2") else nothing
                ends = [first, second]
            if noun in ("joint", "tendon"):
                given = _floats(own.get("polycoef", "0 1 0 0 0"), element.where, element.tag, "polycoef", 1, 5)
                row["data"] = [*given, *(0.0, 1.0, 0.0, 0.0, 0.0)[len(given) :], *[0.0] * 6]
            row["obj1id"], row["obj2id"] = ends
            yield row

    def tendons(self, joints: Mapping[str, int]) -> Iterator[dict[str, Any]]:
        """Yield the rows of the tendons."""
        for element in (one for section in self.document.root.all("tendon") for one in section.children):
            if element.tag not in ("fixed", "spatial"):
                raise BeyondReadingError(f"{element.where}: the tendon <{shown(element.tag)[1:-1]}>")
            element.require_numbers()
            own = self.classes.attributes(element, tag="tendon")
            values = {
                key: _floats(own.get(key, "0"), element.where, element.tag, key, 1, 3)[0]
                for key in ("stiffness", "damping", "frictionloss", "armature")
            }
            held = [self.index(one.attributes, "joint", joints, one) for one in element.all("joint")]
            yield {
                "name": own.get("name", ""), **values, "joints": held, "is_spatial": element.tag == "spatial"
            }  # fmt: skip

    def actuators(self, joints: Mapping[str, int]) -> Iterator[dict[str, Any]]:
        """Yield the rows of the actuators."""
        for element in (one for section in self.document.root.all("actuator") for one in section.children):
            if element.tag in (*IDLE, "plugin") or element.children:
                continue
            if element.tag not in ACTUATORS:
                raise BeyondReadingError(f"{element.where}: the actuator <{shown(element.tag)[1:-1]}>")
            element.require_numbers()
            own = self.classes.attributes(element)
            key = next((key for key in ON_JOINT if key in own), "")
            lists = {}
            for name, start in (("gear", "1 0 0"), ("gainprm", "1 0 0"), ("biasprm", "0 0 0")):
                words = own.get(name, start).split()
                rest = ["0"] * (3 - len(words))
                lists[name] = list(_floats(" ".join([*words, *rest]), element.where, element.tag, name, 3, 10))
            end = self.index(own, key, joints, element) if key else -1
            damping = _floats(own.get("damping", "0"), element.where, element.tag, "damping", 1, 3)
            yield {
                "name": own.get("name", ""), "trntype": ON_JOINT.get(key, ON_SOMETHING_ELSE), "trnid": [end], **lists,
                "armature": _floats(own.get("armature", "0"), element.where, element.tag, "armature", 1)[0],
                "damping": damping[0], "poly": any(damping[1:]),
            }  # fmt: skip

    def index(self, attributes: Attributes, key: str, known: Mapping[str, int], element: MjcfElement) -> int:
        """Return the index of what an attribute names."""
        name = attributes.get(key, "")
        if name not in known:
            raise InputError(
                f'{element.where}: {key} of <{element.tag}> names "{name}", which is not there; '
                f"{suggestion(name, known)}"
            )
        return known[name]

    def require_known(self, element: MjcfElement) -> None:
        """Leave it to MuJoCo to judge attributes that are not known here."""
        known = KNOWN.get(element.tag)
        strange = None if known is None else next((key for key in element.attributes if key not in known), None)
        if strange is not None:
            raise BeyondReadingError(f"{element.where}: the attribute {shown(strange)[1:-1]} of <{element.tag}>")


def solid_of(kind: str, size: Sequence[float], where: str) -> Matrix:
    """Return the moments (4, 4) of a geom of this type and size at 1 kg/m³."""
    needed = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
    if kind not in needed:
        known = ", ".join((*needed, *FEATHERLESS, "mesh", "sdf"))
        raise InputError(f"{where}: the type of a geom is one of {known}, got {shown(kind)}")
    if min(size[: needed[kind]]) <= 0.0:
        given = " ".join(f"{value:g}" for value in size[: needed[kind]])
        raise InputError(f"{where}: the size of a {kind} is {given}, but {needed[kind]} positive numbers make it")
    x, y, z = size
    match kind:
        case "sphere":
            return ellipsoid_moments(x, x, x)
        case "ellipsoid":
            return ellipsoid_moments(x, y, z)
        case "box":
            return box_moments((2.0 * x, 2.0 * y, 2.0 * z))
        case "cylinder":
            return cylinder_moments(x, 2.0 * y)
    return capsule_moments(x, 2.0 * y)


def _z_to(direction: Matrix) -> Matrix:
    """Return the rotation (3, 3) by the least angle that takes z to a direction."""
    x, y, z = direction
    if x == 0.0 and y == 0.0:
        return np.diag([1.0, 1.0, 1.0]) if z > 0.0 else np.diag([1.0, -1.0, -1.0])
    # Half the angle, from the half of z and the direction, keeps its digits near both poles.
    across = math.hypot(x, y)
    half = 0.5 * math.atan2(across, z)
    sine = math.sin(half) / across
    return snapped(quaternion_rotation(math.cos(half), -y * sine, x * sine, 0.0))


def _indices(rows: Sequence[Mapping[str, Any]], noun: str, document: MjcfDocument) -> dict[str, int]:
    found: dict[str, int] = {}
    for index, row in enumerate(rows):
        if row["name"] and row["name"] in found:
            raise InputError(f'{document.path}: two {noun}s have the name "{row["name"]}"; names must differ')
        found[row["name"]] = index
    return found


def _floats(text: str, where: str, tag: str, key: str, least: int, most: int | None = None) -> tuple[float, ...]:
    """Return the numbers of an attribute."""
    most = least if most is None else most
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if not least <= len(values) <= most or "_" in text:
        count = f"{least}" if least == most else f"{least} to {most}"
        raise InputError(
            f"{where}: {key} of <{tag}> must be {count} number{'s' * (most > 1)}, got {shown(text)}; mend it"
        )
    return values
