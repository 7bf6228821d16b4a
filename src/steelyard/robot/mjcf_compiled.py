"""Having MuJoCo compile an MJCF file: what is left of it for that, and what of the compiled model is needed.

What moves and weighs is handed on; pictures, lights, sensors, contacts and meshes that only show or collide are not.
So a description can be read without its textures, quickly, and by other versions of MuJoCo than it was written for.
It is asked for what our own reading does not cover, see `mjcf_reading`.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, is_installed, missing_extra
from steelyard.files import shown
from steelyard.files.child_process import ChildLimits, run_child

from .inertia import Inertia
from .mjcf_document import JOINTS, MjcfDocument, MjcfElement, asset_name, in_body, require_few_copies
from .placement import quaternion_rotation, snapped
from .references import find_reference

__all__ = [
    "BALL",
    "BODY",
    "CONNECT",
    "EQUALITIES",
    "FREE",
    "HINGE",
    "IDLE",
    "JOINT",
    "JOINT_KINDS",
    "OF_ACTUATORS",
    "ON_JOINT",
    "SITE",
    "SLIDE",
    "TENDON",
    "WELD",
    "CompiledMjcf",
    "compiled",
]

# Numbers of MuJoCo's enumerations: types of joints, of equalities, of what an equality ties, and of what an actuator
# acts on.
JOINT_KINDS = {"free": 0, "ball": 1, "slide": 2, "hinge": 3}
FREE, BALL, SLIDE, HINGE = JOINT_KINDS.values()
EQUALITIES = {"connect": 0, "weld": 1, "joint": 2, "tendon": 3}
CONNECT, WELD, JOINT, TENDON = EQUALITIES.values()
BODY, SITE = 1, 6
ON_JOINT = {"joint": 0, "jointinparent": 1}
OF_ACTUATORS = ("armature", "damping")
"""What an actuator gives the joint that it acts on, in MuJoCo 4.0."""

SECTIONS = ("compiler", "option", "default", "extension", "asset", "worldbody", "equality", "tendon", "actuator")
# In defaults and bodies: what has neither mass nor motion.
IDLE = frozenset(
    (
        "camera",
        "light",
        "skin",
        "pair",
        "exclude",
        "material",
        "texture",
        "hfield",
        "flex",
        "muscle",
        "adhesion",
        "dcmotor",
    )
)
# The compiler of MuJoCo would look for files, merge welded bodies, or move frames of free ones.
COMPILER = frozenset(
    ("meshdir", "texturedir", "assetdir", "strippath", "fusestatic", "discardvisual", "alignfree", "convexhull")
)
LARGEST_MESH = 500_000_000  # bytes
TIME, TIME_PER_BYTE = 60.0, 2e-6  # s to wait for the other process
PROCESSOR = 300  # s of its processor time
MEMORY, MEMORY_PER_BYTE = 2**31, 50  # bytes of its address space


@dataclass(frozen=True)
class CompiledMjcf:
    """A description in which defaults, frames and settings of the compiler are resolved.

    Parameters
    ----------
    gravity : list of 3 floats
    bodies, joints, equalities, actuators, tendons : list of dict
        In MuJoCo's order, with its names of their fields and its numbers of types; the first body is the world. Bodies
        have a ``placement`` (4, 4) in their parent, and an ``inertia`` in their frame.
    """

    gravity: list[float]
    bodies: list[dict[str, Any]]
    joints: list[dict[str, Any]]
    equalities: list[dict[str, Any]]
    actuators: list[dict[str, Any]]
    tendons: list[dict[str, Any]]

    def of_actuators(self, joint: int) -> dict[str, float]:
        """Return the armature and the damping that actuators give a joint beside its own: times their gear, squared."""
        acting = [row for row in self.actuators if row["trntype"] in ON_JOINT.values() and row["trnid"][0] == joint]
        return {key: float(sum(row["gear"][0] ** 2 * row[key] for row in acting)) for key in OF_ACTUATORS}

    def moving(self) -> set[int]:
        """Return the indices of the bodies that a joint moves."""
        jointed = {row["bodyid"] for row in self.joints}
        found: set[int] = set()
        for index, row in enumerate(self.bodies):  # parents come first
            if index in jointed or row["parentid"] in found:
                found.add(index)
        return found


def compiled(document: MjcfDocument, reason: str = "MJCF") -> CompiledMjcf:
    """Compile a description with MuJoCo.

    Another process does so, because a damaged mesh may end the process that reads it, and because MuJoCo prints
    warnings and keeps a log in the current folder.

    Parameters
    ----------
    document : MjcfDocument
    reason : str
        What MuJoCo is needed for, as the subject of a sentence.

    Raises
    ------
    InputError
        If MuJoCo refuses the description, a mesh that a body takes its inertia from is missing, or elements make far
        too many copies.
    MissingExtraError
        If MuJoCo is not installed (extra ``mjcf``).
    """
    if not is_installed("mujoco"):
        raise missing_extra(f"{reason} is read with the package mujoco, which is not installed", "mjcf")
    require_few_copies(document)
    excerpt = _Excerpt(document)
    found = _asked({"xml": excerpt.text(), "files": {name: str(path) for name, path in excerpt.files.items()}})
    if "problem" in found:
        raise InputError(f"{document.path}: MuJoCo cannot compile it ({found['problem']}); mend the file.")
    for row in found["bodies"]:
        placement, principal = (
            _placement(row.pop(pos), row.pop(quat)) for pos, quat in (("pos", "quat"), ("ipos", "iquat"))
        )
        row["placement"] = placement
        row["inertia"] = Inertia.from_inertial_frame(row.pop("mass"), principal, np.diag(row["inertia"]))
    return CompiledMjcf(**found)


def _placement(position: Sequence[float], quaternion: Sequence[float]) -> NDArray[np.float64]:
    placement = np.eye(4)
    placement[:3, :3] = snapped(quaternion_rotation(*np.array(quaternion) / np.linalg.norm(quaternion)))
    placement[:3, 3] = position
    return placement


def _asked(request: dict[str, Any]) -> dict[str, Any]:
    """Return the answer of the other process."""
    size = sum(os.path.getsize(path) for path in request["files"].values())
    limits = ChildLimits(TIME + TIME_PER_BYTE * size, PROCESSOR, MEMORY + MEMORY_PER_BYTE * size)
    program, what = Path(__file__).with_name("mjcf_child.py"), "MuJoCo runs in another process"
    with tempfile.TemporaryDirectory(prefix="steelyard-") as folder:  # in which MuJoCo keeps a log
        written, code = run_child(program, json.dumps(request).encode(), limits, what, folder=folder)
    if code is None:
        return {"problem": f"it takes longer than {limits.wait:.0f} s"}
    try:
        found: dict[str, Any] = json.loads(written)
    except ValueError:
        return {"problem": "MuJoCo ended without an answer, perhaps because of a damaged mesh"}
    return found


class _Excerpt:
    """The part of a description that MuJoCo is given, and the files that it needs for it."""

    def __init__(self, document: MjcfDocument) -> None:
        self.document = document
        self.files: dict[str, Path] = {}
        self.from_geoms = document.setting("compiler", "inertiafromgeom") or "auto"
        self.total_mass = document.setting("compiler", "settotalmass") is not None
        self.meshes: set[str] = set()

    def text(self) -> str:
        """Return the excerpt as XML."""
        root = self.document.root
        # Geoms come first, since they say which meshes are needed.
        parts = {id(one): self.worldbody(one) for one in root.all("worldbody")}
        parts |= {id(one): self.plain(one) for one in root.all("default")}
        for one in root.all(*SECTIONS):
            if id(one) not in parts:
                parts[id(one)] = getattr(self, one.tag, self.plain)(one)
        content = "".join(parts[id(one)] for one in root.all(*SECTIONS))
        return f"<mujoco>{content}</mujoco>"

    def compiler(self, element: MjcfElement) -> str:
        kept = {key: value for key, value in element.attributes.items() if key not in COMPILER}
        if kept.get("coordinate") == "local":  # the default, which newer versions do not know any more
            del kept["coordinate"]
        return _tag("compiler", kept, '<lengthrange mode="none"/>')

    def option(self, element: MjcfElement) -> str:
        element.require_numbers()
        kept = {key: value for key, value in element.attributes.items() if key == "gravity"}
        flags = [one.attributes["gravity"] for one in element.all("flag") if "gravity" in one.attributes]
        return _tag("option", kept, *(_tag("flag", {"gravity": flag}) for flag in flags))

    def actuator(self, element: MjcfElement) -> str:
        kept = [self.plain(one) for one in element.children if one.tag not in (*IDLE, "plugin") and not one.children]
        return _tag("actuator", {}, *kept)

    def asset(self, element: MjcfElement) -> str:
        parts = []
        for one in element.children:
            if one.tag == "model":
                path = self.path(one, self.document.asset_file(one.attributes))
                parts.append(_tag("model", {**one.attributes, "file": str(path)}))
            if one.tag == "mesh":
                name = asset_name(one.attributes)
                if name in self.meshes:
                    parts.append(self.mesh(one, name))
        return _tag("asset", {}, *parts)

    def mesh(self, element: MjcfElement, name: str) -> str:
        changed = {**element.attributes, "name": name}
        if "file" in changed:
            path = self.path(element, self.document.mesh_file(element.attributes))
            changed["file"] = f"{len(self.files)}{path.suffix}"
            self.files[changed["file"]] = path
        return self.plain(element, changed)

    def path(self, element: MjcfElement, file: str) -> Path:
        """Return the path of the file of an asset."""
        try:
            found = find_reference(file, self.document.path, what=element.tag)
        except InputError as error:
            raise InputError(f"{element.where}, which an inertia needs: {error}") from None
        found = Path(os.path.abspath(found))
        if found.stat().st_size > LARGEST_MESH:
            raise InputError(f"{found}: has more than {LARGEST_MESH / 1e6:.0f} MB; simplify the mesh.")
        return found

    def plain(self, element: MjcfElement, attributes: dict[str, str] | None = None) -> str:
        """Return an element with all that is in it, save what is idle."""
        element.require_numbers()
        kept = {
            key: value for key, value in (attributes or element.attributes).items() if key not in ("material", "user")
        }
        if element.tag == "geom" and "mesh" in kept:
            self.meshes.add(kept["mesh"])
        return _tag(element.tag, kept, *(self.plain(one) for one in element.children if one.tag not in IDLE))

    def worldbody(self, element: MjcfElement) -> str:
        return _tag("worldbody", {}, *self.body(element, moves=False, weighs=False))

    def body(self, element: MjcfElement, moves: bool, weighs: bool) -> list[str]:
        """Return the contents of a body or frame; `weighs` tells whether the geoms in it make its inertia."""
        parts = []
        for one in element.children:
            if one.tag in ("body", "frame", "replicate"):
                one.require_numbers()
                inside = (moves, weighs)
                if one.tag == "body":
                    moving = moves or any(part.tag in JOINTS for part in in_body(one))
                    explicit = self.from_geoms == "auto" and any(one.all("inertial"))
                    inside = (moving, (moving or self.total_mass) and not explicit and self.from_geoms != "false")
                parts.append(_tag(one.tag, one.attributes, *self.body(one, *inside)))
            elif one.tag == "freejoint":
                parts.append(_tag(one.tag, {key: text for key, text in one.attributes.items() if key != "align"}))
            elif one.tag not in IDLE and not (one.tag == "geom" and self.is_only_seen(one, weighs)):
                parts.append(self.plain(one))
        return parts

    def is_only_seen(self, geom: MjcfElement, weighs: bool) -> bool:
        """Return whether a geom is made of a file that tells nothing of an inertia."""
        of_file = "mesh" in geom.attributes or geom.attributes.get("type") in ("mesh", "hfield", "sdf")
        if "hfield" in geom.attributes or geom.attributes.get("type") == "hfield":
            return True
        weightless = any(_is_zero(geom.attributes.get(key, "")) for key in ("mass", "density"))
        return of_file and (weightless or not weighs)


def _is_zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False


def _tag(tag: str, attributes: dict[str, str], *content: str) -> str:
    if not tag.isidentifier():
        raise InputError(f"<{shown(tag)[1:-1]}> is no element of MJCF; mend the file")
    start = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
    return f"<{tag}{start}>{''.join(content)}</{tag}>"
