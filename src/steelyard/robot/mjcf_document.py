"""The elements of an MJCF file and of the files that it includes, each with its place, and a name for every body."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from steelyard.errors import InputError
from steelyard.files import read_bytes, shown
from steelyard.files.arguments import LARGEST

from .references import find_reference
from .xml_edit import XmlEdit, XmlElement, in_order

__all__ = [
    "JOINTS",
    "OWN_NUMBER",
    "MjcfDocument",
    "MjcfElement",
    "MjcfFile",
    "asset_name",
    "in_body",
    "new_name",
    "read_mjcf_document",
    "require_few_copies",
]

# MuJoCo refuses what is nested more than 500 times; nothing that moves is nested a tenth of that.
DEEPEST = 250
# Attributes whose words are names, even where they read as numbers.
NAMES = frozenset(
    (
        "name",
        "class",
        "childclass",
        "file",
        "mesh",
        "joint",
        "joint1",
        "joint2",
        "body",
        "body1",
        "body2",
        "site",
        "geom",
    )
)
JOINTS = ("joint", "freejoint")
OWN_NUMBER = "steelyard:{}:{}"
"""Name of a number of ours in ``<custom>``: what it is, and of which joint."""
COPYING = {"replicate": 1, "composite": 1, "flexcomp": 1000}
"""Elements that stand for so many copies as `count` says, and for how many where it does not."""
MOST_COPIES = 20_000
"""MuJoCo takes 1.7 s for 10 000 geoms that are copies and 15 s for 30 000; a line may ask for any number."""


@dataclass(eq=False)
class MjcfFile:
    """A file of a description; `include` is the file and the element that include it, None for the first one."""

    path: Path
    edit: XmlEdit
    include: tuple[MjcfFile, XmlElement] | None = None

    def where(self, element: XmlElement) -> str:
        """Return file and line of an element, for messages."""
        return f"{self.path}, line {self.edit.line(element)}"


@dataclass(eq=False)
class MjcfElement:
    """An element, with the contents of included files in the places of the elements that include them.

    Parameters
    ----------
    attributes : dict
        Those of the file; bodies and joints without a name have one that was made.
    place : XmlElement
        Where it stands in the file.
    """

    tag: str
    attributes: dict[str, str]
    file: MjcfFile
    place: XmlElement
    children: list[MjcfElement] = field(default_factory=list)

    @property
    def where(self) -> str:
        """File and line, for messages."""
        return self.file.where(self.place)

    def all(self, *tags: str) -> Iterator[MjcfElement]:
        """Yield the children of these tags, in order."""
        return (child for child in self.children if child.tag in tags)

    def iterate(self) -> Iterator[MjcfElement]:
        """Yield the element and everything in it, in the order of the document."""
        return in_order(self)

    def require_numbers(self) -> None:
        """Refuse numbers that no robot has: NaN, infinity where there is no range, and beyond 1e15."""
        for key, text in self.attributes.items():
            if key in NAMES:
                continue
            try:
                values = [float(word) for word in text.split()]
            except ValueError:
                continue
            if any(math.isnan(value) or (abs(value) > LARGEST and not key.endswith("range")) for value in values):
                raise InputError(
                    f"{self.where}: {key} of <{self.tag}> is {shown(text)}, but no robot has such a number; mend it"
                )


@dataclass(eq=False)
class MjcfDocument:
    """A whole description.

    Parameters
    ----------
    files : tuple of MjcfFile
        The file itself, and those that it includes.
    bodies, joints : dict from name to MjcfElement
        Those that stand in the files once; the copies that ``<replicate>`` and ``<attach>`` make do not.
    body_of : dict
        From the name of a joint to that of its body.
    """

    path: Path
    root: MjcfElement
    files: tuple[MjcfFile, ...]
    bodies: dict[str, MjcfElement] = field(default_factory=dict)
    joints: dict[str, MjcfElement] = field(default_factory=dict)
    body_of: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of the model, or that of the file."""
        return self.root.attributes.get("model") or self.path.stem

    def setting(self, section: str, key: str) -> str | None:
        """Return an attribute of a section, such as ``compiler``; the last one counts where there are several."""
        found = [element.attributes.get(key) for element in self.root.all(section)]
        return next((value for value in reversed(found) if value is not None), None)

    def asset_file(self, attributes: Mapping[str, str]) -> str:
        """Return the file of an asset, absolute or from the folder of the description."""
        file = attributes.get("file", "").replace("\\", "/")
        return Path(file).name if self.setting("compiler", "strippath") == "true" else file

    def mesh_file(self, attributes: Mapping[str, str]) -> str:
        """Return the file of a mesh, absolute or from the folder of the description."""
        folder = self.setting("compiler", "meshdir") or self.setting("compiler", "assetdir") or ""
        return os.path.join(folder, self.asset_file(attributes))

    def line(self, element: MjcfElement) -> int:
        """Return the line of the first file on which an element stands, or the file that holds it is included."""
        file, place = element.file, element.place
        while file.include is not None:
            file, place = file.include
        return file.edit.line(place)


def read_mjcf_document(path: Path, data: bytes | None = None) -> MjcfDocument:
    """Read an MJCF file and those that it includes; `data` is what a file of this path would hold.

    Raises
    ------
    InputError
        If a file is missing or no XML, the first one is no MJCF, or one is included twice.
    """
    reader = _Reader(path, data)
    root = reader.elements(reader.first)
    if root.tag != "mujoco":
        raise InputError(f"{path}: an MJCF begins with <mujoco>, found <{shown(root.tag)[1:-1]}>; give an MJCF file")
    document = MjcfDocument(path, root, tuple(reader.files))
    _name(document)
    return document


class _Reader:
    def __init__(self, path: Path, data: bytes | None) -> None:
        self.path = path
        self.seen: set[str] = set()
        self.files: list[MjcfFile] = []
        first = read_bytes(path, remedy="give the path of an MJCF file") if data is None else data
        self.first = self.file(path, None, first)

    def file(self, path: Path, include: tuple[MjcfFile, XmlElement] | None, data: bytes) -> MjcfFile:
        self.seen.add(os.path.realpath(path))
        read = MjcfFile(path, XmlEdit(data, path), include)
        self.files.append(read)
        return read

    def elements(self, file: MjcfFile) -> MjcfElement:
        return self.element(file, file.edit.root, 0)

    def element(self, file: MjcfFile, place: XmlElement, depth: int) -> MjcfElement:
        if depth > DEEPEST:
            raise InputError(f"{file.where(place)}: elements are nested more than {DEEPEST} times; mend the file")
        made = MjcfElement(place.tag, dict(place.attributes), file, place)
        for child in place.children:
            if child.tag == "include":
                made.children += self.included(file, child, depth)
            else:
                made.children.append(self.element(file, child, depth + 1))
        return made

    def included(self, file: MjcfFile, place: XmlElement, depth: int) -> list[MjcfElement]:
        where, name = file.where(place), place.attributes.get("file")
        if not name:
            raise InputError(f"{where}: <include> has no file; add the attribute file")
        try:
            # MuJoCo looks beside the first file before it looks beside the file that includes.
            found = find_reference(name, self.path, what="included file")
        except InputError as error:
            try:
                found = find_reference(name, file.path, what="included file")
            except InputError:
                raise InputError(f"{where}: {error}") from None
        if os.path.realpath(found) in self.seen:
            raise InputError(f"{where}: {shown(name)} is included a second time, which MuJoCo refuses; remove one")
        inner = self.file(found, (file, place), read_bytes(found, remedy="mend the path of the <include>"))
        return self.element(inner, inner.edit.root, depth).children


def _name(document: MjcfDocument) -> None:
    """Give names to bodies and joints that have none, and collect those that can be found by name."""
    bodies = {"world", *_names(document.root, ("body",))}
    joints = _names(document.root, JOINTS)
    numbers = itertools.count(1)

    def walk(element: MjcfElement, body: str) -> None:
        own = [one for one in in_body(element) if one.tag in JOINTS]
        for number, joint in enumerate(own, 1):
            number_or_nothing = number if len(own) > 1 else ""
            name = _given(joint, joints, f"{body}_joint{number_or_nothing}")
            document.joints.setdefault(name, joint)
            document.body_of.setdefault(name, body)
        for child in [one for one in in_body(element) if one.tag == "body"]:
            number = next(numbers)
            name = _given(child, bodies, f"body{number}")
            document.bodies.setdefault(name, child)
            walk(child, name)

    for world in document.root.all("worldbody"):
        walk(world, "world")


def require_few_copies(document: MjcfDocument) -> None:
    """Refuse a description of which MuJoCo would make a far larger one, by copies and by models that it attaches.

    Raises
    ------
    InputError
        With the line of the element with which the copies become too many.
    """
    _expanded_size(document, {})


def _expanded_size(document: MjcfDocument, models: dict[Path, int]) -> int:
    """Return of how many elements the bodies of a description would consist; `models` are sizes of attached ones."""
    files = {
        asset_name(model.attributes): document.asset_file(model.attributes)
        for assets in document.root.all("asset")
        for model in assets.all("model")
    }
    size, copies = 0, 0
    waiting = [(world, 1) for world in document.root.all("worldbody")]
    while waiting:
        element, times = waiting.pop()
        times *= _count(element) if element.tag in COPYING else 1
        attached = files.get(element.attributes.get("model", "")) if element.tag == "attach" else None
        made = times * (1 if attached is None else 1 + _attached_size(attached, document, models))
        size += made
        copies += made - 1
        if copies > MOST_COPIES:
            raise InputError(
                f"{element.where}: with <{element.tag}> the elements of the file become more than {MOST_COPIES} "
                "copies, more than a robot has; give its body once, or lower `count`"
            )
        waiting += ((child, times) for child in element.children)
    return size


def _attached_size(file: str, document: MjcfDocument, models: dict[Path, int]) -> int:
    """Return the size of a model that is attached; 0 of one that cannot be read, which MuJoCo tells."""
    try:
        path = find_reference(file, document.path, what="model").resolve()
        model = read_mjcf_document(path) if path not in models else None
    except InputError:
        return 0
    if model is not None:
        models[path] = 0  # of one that attaches itself
        models[path] = _expanded_size(model, models)
    return models[path]


def _count(element: MjcfElement) -> int:
    """Return how many copies an element stands for."""
    words = element.attributes.get("count", "").split()
    try:
        return math.prod(max(int(float(word)), 1) for word in words) if words else COPYING[element.tag]
    except (ValueError, OverflowError):  # which MuJoCo tells
        return 1


def asset_name(attributes: Mapping[str, str]) -> str:
    """Return the name of an asset, which is that of its file where it has none."""
    return attributes.get("name") or Path(attributes.get("file", "").replace("\\", "/")).stem


def in_body(element: MjcfElement) -> Iterator[MjcfElement]:
    """Yield what is in a body, also within frames; what is replicated has no place of its own."""
    for child in element.children:
        if child.tag == "frame":
            yield from in_body(child)
        elif child.tag != "replicate":
            yield child


def _names(root: MjcfElement, tags: Collection[str]) -> set[str]:
    return {name for one in root.iterate() if one.tag in tags and (name := one.attributes.get("name"))}


def _given(element: MjcfElement, taken: set[str], proposal: str) -> str:
    name = element.attributes.get("name")
    if not name:
        name = element.attributes["name"] = new_name(proposal, taken)
    taken.add(name)
    return name


def new_name(proposal: str, taken: set[str]) -> str:
    """Return a name that is not taken yet, with a number at its end where the proposal is; it is taken then.

    Examples
    --------
    >>> new_name("arm", {"arm", "arm_2"})
    'arm_3'
    """
    numbered = (f"{proposal}_{number}" for number in itertools.count(2))
    name = next(one for one in itertools.chain([proposal], numbered) if one not in taken)
    taken.add(name)
    return name
